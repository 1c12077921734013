"""The serial port under the manufacturer's SDK, with corrected clock, waiting and byte stuffing."""

from __future__ import annotations

import errno
import os
import select
import time
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import optional


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
        """Start to count the bytes of a port."""
        ...


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
    """Return an open port, see `port_class`; no other program can open the device while it is open.

    Raises:
        InputError: The device cannot be opened, or does not support the baud rate.
    """
    check_present(device)
    port = port_class()(device)
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


@cache
def port_class() -> type[Any]:
    """Return a class of ports that differ from the SDK's `PortHandler` in four things.

    The ports wait in the kernel instead of polling, and read all available bytes at once; they use the monotonic clock
    instead of the time of day; an end of file is an error. With a `peer`, a reply counts as missing only if the peer
    has not sent it, however long that takes.

    Raises:
        InputError: The SDK is not installed.
    """
    usual: Any = sdk().PortHandler

    class Port(usual):
        def getCurrentTime(self) -> float:
            return time.monotonic() * 1e3

        peer: Peer | None = None
        sent = received = 0  # bytes, since the peer counts with us
        held = b""  # read already, not asked for yet

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
            """Whether bytes have come, or will come, that have not been read yet."""
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
            """Throw away all that the peer has sent so far; how many bytes that were."""
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

    return Port


def make_handler() -> Any:
    """Return the SDK's handler of Protocol 2.0 with corrected byte stuffing.

    The SDK's `addStuffing` writes the stuffed packet to a new list that its caller never gets, so FF FF FD is sent
    unstuffed; `removeStuffing` overwrites bytes that it still compares, and does not shorten the list.
    """

    usual: Any = sdk().Protocol2PacketHandler

    class Handler(usual):
        def addStuffing(self, packet: list[int]) -> list[int]:
            body = bytes(packet[7:-2]).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
            packet[5:] = [*(len(body) + 2).to_bytes(2, "little"), *body, 0, 0]
            return packet

        def removeStuffing(self, packet: list[int]) -> list[int]:
            end = 7 + (packet[5] | packet[6] << 8)
            body = bytes(packet[7 : end - 2]).replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            packet[5:] = [*(len(body) + 2).to_bytes(2, "little"), *body, *packet[end - 2 : end]]
            return packet

    return Handler()


def latency_timer(device: str, *, sysfs: Path = Path("/sys/class/tty")) -> float | None:
    """Return how long the USB adapter delays a short reply [s]; None if its driver has no such timer."""
    path = sysfs / Path(device).resolve().name / "device" / "latency_timer"
    try:
        return int(path.read_text()) * 1e-3
    except (OSError, ValueError):
        return None


def check_rate(
    rate: float, *, device: str, baud: int, bytes_per_cycle: int, delays: float = 0.0, latency: float | None = None
) -> float:
    """Return the transmission time of one control cycle [s]; refuse a rate that the line cannot support.

    Args:
        rate: Desired cycles per second [Hz].
        device: Serial device, for the command in the message.
        baud: Bits per second; a byte is ten bits.
        bytes_per_cycle: Bytes per cycle of the read, its reply, and the write.
        delays: Sum of the servos' return delays [s].
        latency: The adapter's latency timer [s], or None.

    Raises:
        InputError: A cycle takes longer than 1 / rate. The message names the change that is needed.
    """
    if not rate > 0:
        raise InputError("rate", rate, "a number > 0 Hz")
    wire = bytes_per_cycle * 10 / baud + delays
    total = wire + (latency or 0.0)
    if total <= 1 / rate:
        return total
    name = Path(device).name
    if latency is not None and latency > 1e-3 and wire + 1e-3 <= 1 / rate:
        fix = f"echo 1 | sudo tee /sys/class/tty/{name}/device/latency_timer"
        raise InputError("USB latency timer", f"{latency * 1e3:g} ms", f"at most 1 ms for {rate:g} Hz", fix)
    if delays and total - delays <= 1 / rate:
        fix = f"python -m whiptool.rig.dynamixel --port {device} --baud {baud} --set-return-delay 0"
        raise InputError("return delay", f"{delays * 1e6:.0f} us a cycle", f"less for {rate:g} Hz", f"run {fix}")
    faster = next((b for b in (1_000_000, 2_000_000, 3_000_000, 4_000_000) if b > baud), None)
    fix = f"python -m whiptool.rig.dynamixel --port {device} --baud {baud} --set-baud {faster}" if faster else ""
    fits = f"{1 / total:.0f} Hz ({bytes_per_cycle} bytes a cycle at {baud} baud)"
    raise InputError("rate", f"{rate:g} Hz", f"at most {fits}", fix or "take a lower rate")
