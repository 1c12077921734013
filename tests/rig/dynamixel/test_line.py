"""Transactions on a line whose other end is scripted: which replies are taken, and how it comes back into step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from ports import sdk

from whiptool.rig.dynamixel import line as module
from whiptool.rig.dynamixel.line import Line, NoReply, Refused, Unplugged, accept, latency_timer
from whiptool.rig.emulator.packets import status

PING, READ = 1, 2
Answer = Callable[[bytes], bytes]


class Scripted:
    """A port in memory: each packet that is sent takes the next answer, and silence is a reply that is missing."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.sent: list[bytes] = []
        self.waiting = b""
        self.peer, self.is_using, self.closed = None, False, False
        self.timeouts: list[float] = []

    def writePort(self, packet: list[int]) -> int:
        self.sent.append(bytes(packet))
        self.waiting += self.answers.pop(0)(bytes(packet)) if self.answers else b""
        return len(packet)

    def readPort(self, length: int) -> bytes:
        data, self.waiting = self.waiting[:length], self.waiting[length:]
        return data

    def getBytesAvailable(self) -> int:
        return len(self.waiting)

    def clearPort(self) -> None:
        self.waiting = b""

    def setPacketTimeout(self, length: int) -> None:
        pass

    def setPacketTimeoutMillis(self, milliseconds: float) -> None:
        self.timeouts.append(milliseconds)

    def isPacketTimeout(self) -> bool:
        return not self.waiting

    def closePort(self) -> None:
        self.closed = True


def says(reply: bytes) -> Answer:
    return lambda packet: reply


PONG = says(status(1, 0, b"\xfc\x03\x2d"))


@pytest.fixture
def port() -> Scripted:
    return Scripted()


@pytest.fixture
def line(port: Scripted, monkeypatch) -> Line:
    monkeypatch.setattr(module, "make_port", lambda device, baud: port)
    monkeypatch.setattr(module, "latency_timer", lambda device: None)
    return Line("/dev/ttyNOWHERE", 1, baud=1_000_000, timeout=0.01)


def read(line: Line, id: int = 1, length: int = 2, timeout: float | None = None) -> bytes:
    packet = [0] * 8 + [*(132).to_bytes(2, "little"), *length.to_bytes(2, "little"), 0, 0]
    return line._ask(packet, id, READ, length, timeout, asked="for present_position")


def test_a_reply_gives_its_data(line: Line, port: Scripted):
    port.answers = [says(status(1, 0, b"\x12\x34"))]
    assert read(line) == b"\x12\x34"
    assert line.failures == {}
    [sent] = port.sent
    assert sent[:4] == b"\xff\xff\xfd\x00"
    assert (sent[4], sent[7], int.from_bytes(sent[5:7], "little")) == (1, READ, len(sent) - 7)


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (b"", r"servo 1 does not answer when asked for present_position: .*--port /dev/ttyNOWHERE` lists the servos"),
        (status(2, 0, b"\x12\x34"), "reply of servo 2, not 1"),
        (status(1, 0, b"\x12"), "sent 1 bytes of data, not 2"),
        (status(1, 0, b"\x12\x34")[:-1] + b"\x00", "servo 1 gave a damaged answer when asked for present_position"),
    ],
)
def test_what_is_no_reply_to_the_question_is_none(line: Line, port: Scripted, reply: bytes, message: str):
    port.answers = [says(reply)]
    with pytest.raises(NoReply, match=message):
        read(line)
    assert line.failures == {"no reply": 1}


def test_an_error_without_data_is_refused_and_named(line: Line, port: Scripted):
    port.answers = [says(status(1, 7))]
    with pytest.raises(Refused, match="servo 1, asked for present_position: no access"):
        read(line)
    assert line.failures == {"refused": 1}


def test_the_alert_bit_alone_is_no_refusal(line: Line, port: Scripted):
    port.answers = [says(status(1, 0x80, b"\x12\x34"))]
    assert read(line) == b"\x12\x34"
    accept(0x80, 1, "")
    with pytest.raises(Refused, match="servo 3, asked for led: error 126"):
        accept(0xFE, 3, "for led")


def test_after_a_failure_the_line_is_drained_and_pinged(line: Line, port: Scripted):
    """A late reply of an earlier question is thrown away, even one that comes behind the ping."""
    late = status(1, 0, b"\x99\x99")
    port.answers = [says(b"")]
    with pytest.raises(NoReply):
        read(line)
    port.waiting = late
    port.answers = [lambda packet: late + PONG(packet), says(status(1, 0, b"\x12\x34"))]
    assert read(line) == b"\x12\x34"
    assert [packet[7] for packet in port.sent] == [READ, PING, READ]
    port.answers = [says(status(1, 0, b"\x56\x78"))]
    assert read(line) == b"\x56\x78"  # in step: no further ping
    assert [packet[7] for packet in port.sent[3:]] == [READ]


def test_the_question_is_not_asked_while_the_line_is_out_of_step(line: Line, port: Scripted):
    port.answers = [says(b""), says(b"")]
    for message in ("servo 1 does not answer when asked", "does not answer a ping after a failure"):
        with pytest.raises(NoReply, match=message):
            read(line)
    assert [packet[7] for packet in port.sent] == [READ, PING]
    assert line.failures == {"no reply": 2}


@pytest.mark.parametrize("error", [OSError("end of file"), TypeError("fd is None"), AttributeError("ser")])
def test_whatever_a_missing_adapter_raises_is_one_error(line: Line, port: Scripted, monkeypatch, error: Exception):
    def fail(packet: list[int]) -> int:
        raise error

    monkeypatch.setattr(port, "writePort", fail)
    with pytest.raises(Unplugged, match=f"/dev/ttyNOWHERE is gone: {error}"):
        read(line)
    assert line.failures == {"unplugged": 1}
    assert not port.is_using


def test_draining_counts_what_it_throws_away_and_ends_on_a_line_that_babbles(line: Line, port: Scripted, monkeypatch):
    """By a clock that counts how often it is asked."""
    clock = iter(range(10**6))
    monkeypatch.setattr(module.time, "monotonic", lambda: next(clock) * 1e-4)
    monkeypatch.setattr(module.time, "sleep", lambda seconds: None)
    port.waiting = b"12345"
    assert line.drain() == 5
    monkeypatch.setattr(port, "getBytesAvailable", lambda: 1)
    assert 20 * line.quiet / 1e-4 == pytest.approx(line.drain(), abs=2)


def test_the_adapters_latency_adds_to_the_timeout(port: Scripted, monkeypatch):
    monkeypatch.setattr(module, "make_port", lambda device, baud: port)
    monkeypatch.setattr(module, "latency_timer", lambda device: 0.016)
    with Line("/dev/ttyUSB0", 1, baud=57_600, timeout=0.01) as slow:
        assert slow.timeout == pytest.approx(0.026)
        assert slow.quiet == pytest.approx(0.017)
        port.answers = [says(status(1, 0, b"\x12\x34"))] * 2
        read(slow)
        read(slow, timeout=0.5)
        assert port.timeouts[-1] == pytest.approx(500)
        assert pytest.approx(26) in port.timeouts
        assert not port.closed
    assert port.closed


def test_the_sdk_names_what_came_of_it():
    """The messages above are the SDK's own."""
    assert "no status packet" in sdk.Protocol2PacketHandler().getTxRxResult(sdk.COMM_RX_TIMEOUT)


def test_trap_sdk_removes_too_much():
    reply = list(bytes.fromhex("FFFFFD00010C0055 00 FFFFFDFD 00FFFDFD 00 0000".replace(" ", "")))
    reply[5] = len(reply) - 7
    body = bytes(sdk.Protocol2PacketHandler().removeStuffing(list(reply)))[9:]
    assert not body.startswith(bytes.fromhex("FFFFFD 00FFFDFD"))
    from whiptool.rig.dynamixel.line import make_handler

    assert bytes(make_handler().removeStuffing(list(reply)))[9:].startswith(bytes.fromhex("FFFFFD 00FFFDFD"))


def test_latency_timer_comes_from_the_driver(tmp_path: Path):
    (tmp_path / "ttyUSB3" / "device").mkdir(parents=True)
    (tmp_path / "ttyUSB3" / "device" / "latency_timer").write_text("16\n")
    assert latency_timer("/dev/ttyUSB3", sysfs=tmp_path) == pytest.approx(0.016)
    assert latency_timer("/dev/ttyACM0", sysfs=tmp_path) is None
