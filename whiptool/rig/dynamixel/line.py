"""Transactions on the line to the servos, and the serial port under the manufacturer's SDK.

Clock, waiting and byte stuffing of the SDK are corrected. Replies are checked, and after a failure the line is
resynchronised.
"""

from __future__ import annotations

import errno
import os
import select
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, TypeVar

from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import optional

BROADCAST = 254
# Status packet: number in the low 7 bits of the error byte; bit 7 is the alert
STATUS_ERRORS = {
    1: "result fail",
    2: "undefined instruction",
    3: "CRC does not match",
    4: "data out of range",
    5: "data too short for the register",
    6: "data beyond the configured limit",
    7: "no access to this address now",
}


class BusError(WhiptoolError):
    """A transaction with the servos failed."""


class NoReply(BusError):
    """No complete reply came in time."""


class Damaged(NoReply):
    """Bytes came back that are not a complete reply."""


class Unplugged(BusError):
    """The serial port no longer exists."""


class Refused(BusError):
    """A servo answered with an error."""


def sdk() -> Any:
    """Return the module `dynamixel_sdk`.

    Raises:
        InputError: The module is not installed, or does not load.
    """
    return optional("dynamixel_sdk", "servos")


class Peer(Protocol):
    """The other end of a line in lock step (an emulator), which reports whether bytes are still under way."""

    def given(self) -> int:
        """Return the total number of bytes that the peer has sent, after it has processed all bytes sent to it.

        Raises:
            OSError: The emulator has ended.
        """
        ...

    def follow(self, client: Any) -> None:
        """Start to count the bytes that the port `client` sends and receives."""
        ...


_OfSdk: Any = object  # for types: the rest is the class of the SDK, which is optional
OPENS = "a serial device that can be opened"


def check_present(device: str) -> None:
    """Refuse a serial device that does not exist, without opening it.

    Raises:
        InputError: The device does not exist.
    """
    if not Path(device).exists():
        there = sorted(str(p) for kind in ("ttyUSB*", "ttyACM*") for p in Path("/dev").glob(kind))
        fix = f"there are {', '.join(there)}" if there else "no serial adapter is plugged in"
        raise InputError("port", device, OPENS, fix)


def make_port(device: str, baud: int) -> Any:
    """Return an open port, see `KernelPort`; no other program can open the device while it is open.

    Raises:
        InputError: The device cannot be opened, or does not support the baud rate.
    """
    check_present(device)
    port: Any = type("Port", (KernelPort, sdk().PortHandler), {})(device)
    try:
        port.baudrate = baud
        if not port.openPort() or not port.setBaudRate(baud):
            raise InputError("baud", baud, "a rate of dynamixel-sdk (9600 to 4000000)")
        port.ser.exclusive = True
    except InputError:
        raise
    except Exception as error:  # pyserial, termios and the OS each raise their own
        raise InputError("port", device, OPENS, _cure(error)) from error
    return port


def _cure(error: Exception) -> str:
    """What to do about a device that does not open."""
    if getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY):
        return "another program holds it: end that one"
    return f"{error} (for permission: sudo usermod -aG dialout $USER, and log in again)"


class KernelPort(_OfSdk):
    """Base of the ports that `make_port` returns; it replaces how the SDK's `PortHandler`, their other base, waits.

    Ports wait in the kernel instead of polling, and read all available bytes at once; they use the monotonic clock
    instead of the time of day; an end of file is an error. With a `peer`, a reply counts as missing only if the peer
    has not sent it, however long that takes.
    """

    peer: Peer | None = None
    sent = received = 0  # bytes, since the peer counts with us
    held = b""  # read already, not asked for yet

    def getCurrentTime(self) -> float:
        return time.monotonic() * 1e3

    def readPort(self, length: int) -> bytes:
        if not self.held:
            remaining = (self.packet_timeout - self.getTimeSinceStart()) / 1e3
            if not self._wait(max(0.0, remaining)) and not self.awaits_bytes():
                return b""
            self._take()
        data, self.held = self.held[:length], self.held[length:]
        return data

    def writePort(self, packet: list[int]) -> int:
        written = os.write(self.ser.fileno(), bytes(packet))
        self.sent += written
        return written

    def getBytesAvailable(self) -> int:
        return len(self.held) + super().getBytesAvailable()

    def isPacketTimeout(self) -> bool:
        return super().isPacketTimeout() and not self.awaits_bytes()

    def has_more(self) -> bool:
        """Whether there are unread bytes, or bytes that the peer has sent are still under way."""
        return self.getBytesAvailable() > 0 or self.awaits_bytes()

    def awaits_bytes(self) -> bool:
        """Whether the peer has sent bytes that have not come yet; False without a peer, as it is unknown then."""
        return self.peer is not None and self.peer.given() > self.received

    def clearPort(self) -> None:
        while self.peer is not None and self._wait(0.0):
            self._take()  # what is thrown away has been received, too
        self.held = b""
        super().clearPort()

    def swallow(self) -> int:
        """Discard all bytes that the peer has sent so far, and return their number."""
        thrown, self.held = len(self.held), b""
        while self.awaits_bytes():
            self._take()
            thrown, self.held = thrown + len(self.held), b""
        return thrown

    def _wait(self, seconds: float | None) -> bool:
        return bool(select.select([self.ser.fileno()], [], [], seconds)[0])

    def _take(self) -> None:
        self._wait(None)
        self.held = os.read(self.ser.fileno(), 4096)
        if not self.held:
            raise OSError("end of file")
        self.received += len(self.held)


class Stuffing:
    """Byte stuffing of Protocol 2.0, which replaces the faulty methods of the SDK's handler.

    The SDK's `addStuffing` writes the stuffed packet to a new list that its caller never gets, so FF FF FD is sent
    unstuffed; `removeStuffing` overwrites bytes that it still compares, and does not shorten the list.
    """

    def addStuffing(self, packet: list[int]) -> list[int]:
        body = bytes(packet[7:-2]).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        packet[5:] = [*(len(body) + 2).to_bytes(2, "little"), *body, 0, 0]
        return packet

    def removeStuffing(self, packet: list[int]) -> list[int]:
        end = 7 + (packet[5] | packet[6] << 8)
        body = bytes(packet[7 : end - 2]).replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        packet[5:] = [*(len(body) + 2).to_bytes(2, "little"), *body, *packet[end - 2 : end]]
        return packet


def make_handler() -> Any:
    """Return the SDK's handler of Protocol 2.0 with corrected byte stuffing."""
    return type("Handler", (Stuffing, sdk().Protocol2PacketHandler), {})()


def latency_timer(device: str, *, sysfs: Path = Path("/sys/class/tty")) -> float | None:
    """Return how long the USB adapter delays a short reply [s]; None if its driver has no such timer."""
    path = sysfs / Path(device).resolve().name / "device" / "latency_timer"
    try:
        return int(path.read_text()) * 1e-3
    except (OSError, ValueError):
        return None


T = TypeVar("T")


class Line:
    """An open port with the SDK's handler of Protocol 2.0, and further checks.

    Args:
        device: Serial device, such as /dev/ttyUSB0.
        first: Id of a servo to ping for resynchronising the line after a failure.
        baud: Bits per second.
        timeout: Largest time for a reply, in addition to the adapter's latency [s].

    Raises:
        InputError: The port cannot be opened.
    """

    def __init__(self, device: str, first: int, *, baud: int, timeout: float) -> None:
        self._sdk = sdk()
        self.device, self.baud, self._first = device, baud, first
        self._port, self._handler = make_port(device, baud), make_handler()
        self.latency = latency_timer(device)
        self.timeout = timeout + (self.latency or 0.0)
        self.quiet = 1e-3 + (self.latency or 0.0)  # [s] without a byte: the line is drained
        self._dirty = False
        self.failures: dict[str, int] = {}  # how often, by kind

    def follow(self, peer: Peer) -> None:
        """Run in lock step with an emulator, which reports whether a reply is missing, so that no timeout is needed."""
        self._port.peer = peer
        peer.follow(self._port)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """What an unplugged adapter raises (pyserial, termios and the OS each their own), as one error."""
        import serial

        try:
            yield
        except (serial.SerialException, termios.error, OSError, AttributeError, TypeError) as error:
            self._count("unplugged")
            raise Unplugged(f"{self.device} is gone: {error}") from error

    def _transaction(self, transact: Callable[[], T], *, replies: bool = True) -> T:
        with self._guarded():
            try:
                if self._dirty and replies:
                    self._resynchronise()
                return transact()
            except BaseException as error:
                self._dirty = True  # a reply may be under way, also where a signal cut the wait for it short
                if isinstance(error, NoReply | Refused):
                    self._count("no reply" if isinstance(error, NoReply) else "refused")
                raise
            finally:
                self._port.is_using = False  # an exception in the SDK leaves it set, and every later call fails

    def _resynchronise(self) -> None:
        """Get past whatever an earlier transaction left on the line."""
        self.drain()
        id = self._first
        self._sent(self._handler.txPacket(self._port, [0, 0, 0, 0, id, 3, 0, self._sdk.INST_PING, 0, 0]))
        self._port.setPacketTimeoutMillis(self.timeout * 1e3)
        while True:  # until the reply is there or the time is up
            self._port.is_using = True
            packet, result = self._handler.rxPacket(self._port, False)
            if result == self._sdk.COMM_SUCCESS and packet[4] == id and len(packet) == 14:
                break
            if result != self._sdk.COMM_SUCCESS and self._port.isPacketTimeout():
                raise NoReply(f"servo {id} does not answer a ping after a failure: check its power, cable and id")
        self._dirty = False

    def drain(self) -> int:
        """Discard incoming bytes until the line is quiet, and return their number.

        It gives up after 20 times the quiet period if bytes keep coming; the next reply is then refused. In lock step
        the bytes that the emulator has sent are discarded.
        """
        if self._port.peer is not None:
            return self._port.swallow()
        n, last = 0, time.monotonic()
        end = last + 20 * self.quiet
        while (now := time.monotonic()) - last < self.quiet and now < end:
            waiting = self._port.getBytesAvailable()
            if waiting:
                self._port.clearPort()
                n, last = n + waiting, now
            else:
                time.sleep(self.quiet / 4)
        return n

    def _ask(
        self,
        packet: list[int],
        id: int,
        instruction: int,
        length: int,
        timeout: float | None = None,
        *,
        asked: str,
        refusable=True,
    ) -> bytes:
        """One instruction to one servo and the data of its reply, `length` bytes; `asked` is what for, in words."""
        packet[4], packet[7] = id, instruction
        packet[5:7] = (len(packet) - 7).to_bytes(2, "little")

        def transact() -> bytes:
            self._sent(self._handler.txPacket(self._port, packet))
            self._port.setPacketTimeoutMillis((timeout or self.timeout) * 1e3)
            data = self._receive(id, length + 1, fast=False, or_error=True, asked=asked)
            if refusable:
                accept(data[0], id, asked)
            if len(data) != length + 1:
                raise NoReply(f"servo {id} sent {len(data) - 1} bytes of data, not {length}, when asked {asked}")
            return data[1:]

        return self._transaction(transact)

    def _sent(self, result: int) -> None:
        if result != self._sdk.COMM_SUCCESS:
            raise NoReply(f"{self.device} did not send: {self._handler.getTxRxResult(result)}")

    def _receive(self, id: int, length: int, *, fast: bool, asked: str, or_error: bool = False) -> bytes:
        """Error byte and data of the next status packet: `length` bytes from servo `id`, and no other."""
        packet, result = self._handler.rxPacket(self._port, fast)
        if result != self._sdk.COMM_SUCCESS:
            raise self._lost(id, result, asked)
        if packet[4] != id:
            raise NoReply(f"reply of servo {packet[4]}, not {id}, when asked {asked}")
        body = bytes(packet[8:-2])
        # An error status carries no data; it must not be decoded as some
        if len(body) != length and len(body) == 1 and body[0] & 0x7F:
            accept(body[0], id, asked)
        if len(body) != length and not or_error:
            raise NoReply(f"{len(body)} bytes, not {length}, when asked {asked}")
        return body

    def _lost(self, id: int, result: int, asked: str) -> NoReply:
        """Say which servo gave no whole reply to what, and what to do, in place of the SDK's own words."""
        who = "a servo" if id == BROADCAST else f"servo {id}"
        cure = f"power, cable and id; `python -m whiptool.rig.dynamixel --port {self.device}` lists the servos"
        if result == self._sdk.COMM_RX_TIMEOUT:
            return NoReply(f"{who} does not answer when asked {asked}: check its {cure}")
        if result == self._sdk.COMM_RX_CORRUPT:
            why = "do two servos have this id? Check ground and baud rate, its"
            return Damaged(f"{who} gave a damaged answer when asked {asked}: {why} {cure}")
        return NoReply(f"{who}, asked {asked}: {self._handler.getTxRxResult(result)}; check its {cure}")

    def _count(self, kind: str) -> None:
        self.failures[kind] = self.failures.get(kind, 0) + 1

    def close(self) -> None:
        """Close the serial port, if it is open."""
        with suppress(Exception):  # it may be gone; closed it is
            self._port.closePort()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def accept(error: int, id: int, asked: str) -> None:
    """Raise `Refused` if a status packet has an error number; `asked` names the instruction in the message.

    The alert bit alone is not an error; its cause is among the values of `DynamixelBus.read_block`.
    """
    number = error & 0x7F
    if number:
        raise Refused(f"servo {id}, asked {asked}: {STATUS_ERRORS.get(number, f'error {number}')}")
