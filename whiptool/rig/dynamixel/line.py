"""Transactions on the line to the servos; replies are checked, and after a failure the line is resynchronised."""

from __future__ import annotations

import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Self, TypeVar

from whiptool.rig.dynamixel.control_table import BROADCAST, STATUS_ERRORS
from whiptool.rig.dynamixel.port import (
    Damaged,
    NoReply,
    Peer,
    Refused,
    Unplugged,
    latency_timer,
    make_handler,
    make_port,
    sdk,
)

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
    """Raise `Refused` if a status packet has an error number.

    The alert bit alone is not an error; its cause is among the values of `DynamixelBus.read_block`.
    """
    number = error & 0x7F
    if number:
        raise Refused(f"servo {id}, asked {asked}: {STATUS_ERRORS.get(number, f'error {number}')}")
