"""Clients of the emulated servos that know, and do not guess by a clock, whether an answer is still to come."""

from __future__ import annotations

import os
import select
import termios
import tty

import pytest

from whiptool.rig.emulator import Emulator

sdk = pytest.importorskip("dynamixel_sdk")


class PatientPort(sdk.PortHandler):
    """The SDK's own port on an emulator in lock-step: a time-out is one only if nothing is under way."""

    def __init__(self, twin: Emulator) -> None:
        super().__init__(twin.port)
        self.sent = self.received = 0
        self.twin = twin
        self.openPort()
        self.setBaudRate(1_000_000)
        twin.follow(self)

    def writePort(self, packet):
        written = super().writePort(packet)
        self.sent += written
        return written

    def readPort(self, length):
        data = super().readPort(length)
        self.received += len(data)
        return data

    def clearPort(self):
        self.readPort(self.ser.in_waiting)

    def isPacketTimeout(self):
        return super().isPacketTimeout() and self.twin.given() == self.received

    def settle(self) -> None:
        """Throw away every answer to what was sent."""
        while self.twin.given() > self.received:
            self.clearPort()


class RawLine:
    """Bytes as they are on the line of an emulator in lock-step."""

    def __init__(self, twin: Emulator) -> None:
        self.fd = os.open(twin.port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        attributes = termios.tcgetattr(self.fd)
        attributes[4] = attributes[5] = termios.B1000000
        termios.tcsetattr(self.fd, termios.TCSANOW, attributes)
        self.sent = self.received = 0
        self.twin, self._held = twin, b""
        twin.follow(self)

    def write(self, data: bytes) -> None:
        self.sent += os.write(self.fd, data)
        while select.select([self.fd], [], [], 0)[0]:
            self._read()

    def answer(self) -> bytes:
        """All that came since the last answer, and is to come."""
        while self.twin.given() > self.received:
            self._read()
        data, self._held = self._held, b""
        return data

    def _read(self) -> None:
        data = os.read(self.fd, 4096)
        self.received += len(data)
        self._held += data

    def __enter__(self) -> RawLine:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.fd)
