"""Every instruction of the protocol, asked by the maker's SDK and by a second client."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ports import RawLine, sdk
from processes import HANG
from servos import GOLDEN, OK, h

from whiptool.rig.dynamixel.control_table import Units
from whiptool.rig.emulator import Motor
from whiptool.rig.emulator.instructions import ServoChain
from whiptool.rig.emulator.packets import Packet, Parser, status
from whiptool.rig.emulator.servo import Servo


def test_sdk_ping_and_broadcast_ping(line):
    port, handler = line
    assert handler.ping(port, 1) == (1020, *OK)
    assert handler.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT
    found, result = handler.broadcastPing(port)
    assert result == 0
    assert found == {1: [1020, 45], 2: [1020, 45]}


def test_sdk_read_and_write_of_every_size(line):
    port, handler = line
    assert handler.read2ByteTxRx(port, 2, 0) == (1020, *OK)
    assert handler.write1ByteTxRx(port, 1, 65, 1) == OK
    assert handler.read1ByteTxRx(port, 1, 65) == (1, *OK)
    assert handler.write2ByteTxRx(port, 1, 38, 700) == OK
    assert handler.read2ByteTxRx(port, 1, 38) == (700, *OK)
    assert handler.write4ByteTxRx(port, 1, 108, 0x1234) == OK
    assert handler.read4ByteTxRx(port, 1, 108) == (0x1234, *OK)
    assert handler.write1ByteTxRx(port, 1, 0, 1) == (0, 7)
    assert handler.write2ByteTxRx(port, 1, 38, 2000) == (0, 4)
    assert handler.writeTxRx(port, 1, 116, 2, [0, 0]) == (0, 5)


def test_sdk_reg_write_and_action(line):
    port, handler = line
    assert handler.regWriteTxRx(port, 1, 65, 1, [1]) == OK
    assert handler.read1ByteTxRx(port, 1, 69) == (1, *OK)
    assert handler.read1ByteTxRx(port, 1, 65) == (0, *OK)
    assert handler.action(port, 1) == 0
    port.settle()  # its reply is not waited for
    assert handler.read1ByteTxRx(port, 1, 65) == (1, *OK)
    assert handler.read1ByteTxRx(port, 1, 69) == (0, *OK)


def test_sdk_sync_and_bulk(line, twin):
    port, handler = line
    write = sdk.GroupSyncWrite(port, handler, 104, 4)
    write.addParam(1, [11, 0, 0, 0])
    write.addParam(2, [22, 0, 0, 0])
    assert write.txPacket() == 0
    for fast in (False, True):
        read = sdk.GroupSyncRead(port, handler, 104, 4)
        read.addParam(1)
        read.addParam(2)
        assert (read.fastSyncRead() if fast else read.txRxPacket()) == 0
        assert [read.getData(i, 104, 4) for i in (1, 2)] == [11, 22]
        bulk = sdk.GroupBulkRead(port, handler)
        bulk.addParam(2, 144, 2)
        bulk.addParam(1, 146, 1)
        assert (bulk.fastBulkRead() if fast else bulk.txRxPacket()) == 0
        assert bulk.getData(1, 146, 1) == 30
        assert bulk.getData(2, 144, 2) == 120
    write = sdk.GroupBulkWrite(port, handler)
    write.addParam(1, 65, 1, [1])
    write.addParam(2, 38, 2, [44, 1])
    assert write.txPacket() == 0
    assert handler.read1ByteTxRx(port, 1, 65) == (1, *OK)
    assert handler.read2ByteTxRx(port, 2, 38) == (300, *OK)


def test_sdk_reboot_factory_reset_clear(line):
    port, handler = line
    handler.write2ByteTxRx(port, 1, 38, 700)
    handler.write1ByteTxRx(port, 1, 65, 1)
    assert handler.reboot(port, 1) == OK
    assert handler.read1ByteTxRx(port, 1, 65) == (0, *OK)  # RAM is fresh
    assert handler.read2ByteTxRx(port, 1, 38) == (700, *OK)  # EEPROM is kept
    assert handler.factoryReset(port, 1, 0x02) == OK  # all but id and baud rate
    assert handler.read2ByteTxRx(port, 1, 38) == (1193, *OK)
    assert handler.clearMultiTurn(port, 1) == OK
    handler.write1ByteTxRx(port, 1, 64, 1)
    assert handler.factoryReset(port, 1, 0x02)[1] == 7  # not with torque on


def test_sdk_gets_what_needs_stuffing(line):
    port, handler = line
    # the reply has FF FF FD in it; the servo escapes it, the SDK takes the escape out, which it does not put in
    assert handler.write1ByteTxRx(port, 1, 11, 4) == OK
    assert handler.writeTxRx(port, 1, 116, 5, [0xFF, 0xFF, 0xFD, 0xFD, 0xFF]) == OK
    assert handler.read4ByteTxRx(port, 1, 116) == (0xFFFDFFFF, *OK)
    assert handler.write4ByteTxRx(port, 1, 116, 0xFFFFFFFF) == OK
    assert handler.write2ByteTxRx(port, 1, 102, 0xFFFF) == OK  # -1
    assert handler.read4ByteTxRx(port, 1, 116) == (0xFFFFFFFF, *OK)


def test_status_return_level(line):
    port, handler = line
    handler.write1ByteTxRx(port, 1, 68, 1)
    assert handler.write1ByteTxRx(port, 1, 65, 1)[0] == sdk.COMM_RX_TIMEOUT
    assert handler.read1ByteTxRx(port, 1, 65) == (1, *OK)
    handler.write1ByteTxOnly(port, 1, 68, 0)
    assert handler.read1ByteTxRx(port, 1, 65)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.ping(port, 1) == (1020, *OK)


def test_another_baud_rate_is_noise(line):
    port, handler = line
    assert port.setBaudRate(57_600)
    assert handler.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert port.setBaudRate(1_000_000)
    assert handler.write1ByteTxRx(port, 2, 8, 1) == OK  # servo 2 goes to 57600
    assert handler.ping(port, 2)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.ping(port, 1) == (1020, *OK)
    assert port.setBaudRate(57_600)
    assert handler.ping(port, 2) == (1020, *OK)


def test_ids_can_be_changed(line):
    port, handler = line
    assert handler.write1ByteTxRx(port, 1, 7, 42) == OK
    assert handler.ping(port, 42) == (1020, *OK)
    assert handler.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT


def test_a_second_client_agrees(twin):
    rustypot = pytest.importorskip("rustypot")
    twin.reset((0.3, 0.5))
    client = rustypot.Xl430PyController(twin.port, 1_000_000, HANG)
    try:
        assert client.ping(1)
        assert client.read_raw_data(1, 0, 2) == list((1020).to_bytes(2, "little"))
        counts = [2048 + round(q / Units().position) for q in (0.3, 0.5)]
        for fast in (False, True):
            client.set_fast_sync_read(fast)
            raw = client.sync_read_raw_data([1, 2], 132, 4)
            assert [int.from_bytes(bytes(x), "little") for x in raw] == counts
        client.sync_write_raw_data([1, 2], 38, [[44, 1], [45, 1]])
        assert [int.from_bytes(bytes(x), "little") for x in client.sync_read_raw_data([1, 2], 38, 2)] == [300, 301]
        client.write_raw_data(1, 102, [0xFF, 0xFF])
        assert bytes(client.read_raw_data(1, 102, 2)) == b"\xff\xff"
        # a value out of range comes back as an error byte, and is not taken
        assert client.write_raw_data_with_error(1, 64, [5]) == 4
        assert client.read_raw_data(1, 64, 1) == [0]
    finally:
        client.close()


def test_golden_instructions_over_the_line(twin):
    twin.reset()
    with RawLine(twin) as line:
        for name in ("write", "reg write", "action", "reboot", "clear"):  # a factory reset would change the baud rate
            line.write(h(GOLDEN[name]))
            assert line.answer() == h(GOLDEN["write status"]), name
        line.write(h(GOLDEN["ping"]))
        assert line.answer()[:11] == h("FF FF FD 00 01 07 00 55 00 FC 03")
        line.write(h(GOLDEN["sync read"]))
        assert line.answer() == b"".join(status(i, 0, (2048).to_bytes(4, "little")) for i in (1, 2))


@given(st.binary(max_size=60), st.integers(0, 255), st.sampled_from([1, 2, 254, 200]))
@example(bytes([0, 0, 0, 0x56, 0, 0, 0]), 0x8A, 254)  # a fast read of more than a packet's length field can say
@settings(max_examples=400, deadline=None)
def test_no_instruction_breaks_a_servo(parameters, instruction, id):
    servos = [Servo(1, Motor()), Servo(2, Motor())]
    for reply in ServoChain(servos).handle(Packet(id, instruction, parameters)):
        if reply[:4] == b"\xff\xff\xfd\x00" and instruction not in (0x8A, 0x9A):
            assert len(list(Parser().feed(reply))) == 1
    for s in servos:
        s.age(0.001)
        s.feel(0.1, 0.2, 0.3, 1.0)
        s.drive()
