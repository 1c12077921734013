"""The emulated servos against the maker's manual, the maker's SDK, and a second client."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ports import PatientPort, RawLine, sdk
from processes import HANG

import whiptool as wt
from whiptool.commands.emulator import main
from whiptool.errors import InputError
from whiptool.rig.dynamixel.control_table import XM430_W350, Units, register
from whiptool.rig.emulator import HARDWARE, Emulator, Fault, Motor, TwinOptions
from whiptool.rig.emulator.instructions import Chain
from whiptool.rig.emulator.packets import LONGEST, Packet, Parser, crc16, encode, fast_status, status, stuff, unstuff
from whiptool.rig.emulator.process import _link
from whiptool.rig.emulator.servo import Servo

h = bytes.fromhex


# -- packets, as the manual prints them --------------------------------------------------------------------------------

# (title in https://emanual.robotis.com/docs/en/dxl/protocol2/, packet)
GOLDEN = {
    "ping": "FF FF FD 00 01 03 00 01 19 4E",
    "ping status": "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
    "ping status 2": "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D",
    "ping broadcast": "FF FF FD 00 FE 03 00 01 31 42",
    "read": "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
    "read status": "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
    "write": "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
    "write status": "FF FF FD 00 01 04 00 55 00 A1 0C",
    "reg write": "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
    "action": "FF FF FD 00 01 03 00 05 02 CE",
    "factory reset": "FF FF FD 00 01 04 00 06 01 A1 E6",
    "reboot": "FF FF FD 00 01 03 00 08 2F 4E",
    "clear": "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC",
    "sync read": "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
    "sync read status 2": "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE",
    "sync write": "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    "bulk read": "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
    "bulk read status 1": "FF FF FD 00 01 06 00 55 00 77 00 C3 69",
    "bulk read status 2": "FF FF FD 00 02 05 00 55 00 24 8B A9",
    "bulk write": "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
    "fast sync read": "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
}
FAST_SYNC = h("FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E")
FAST_BULK = h("FF FF FD 00 FE 14 00 55 00 03 A6 00 00 00 67 A4 00 07 A5 01 24 74 00 04 1F D9 C1")


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_packets_parse_and_encode(name):
    data = h(GOLDEN[name])
    (packet,) = Parser().feed(data)
    assert packet.id == data[4]
    assert packet.instruction == data[7]
    assert packet.parameters == data[8:-2]
    assert encode(packet) == data


def test_golden_fast_replies():
    parts = [(3, 0, h("A6 00 00 00")), (7, 0, h("1F 08 00 00")), (4, 0, h("FF 03 00 00"))]
    assert b"".join(fast_status(parts)) == FAST_SYNC
    parts = [(3, 0, h("A6 00 00 00")), (7, 0, h("A5 01")), (4, 0, h("1F"))]
    assert b"".join(fast_status(parts)) == FAST_BULK


def test_the_manuals_crc_of_the_fast_bulk_read_is_a_misprint():
    # It repeats the CRC of the fast sync read's example. The SDK's own table settles it.
    body = h("FF FF FD 00 FE 12 00 9A 03 84 00 04 00 07 7C 00 02 00 04 92 00 01 00")
    assert crc16(body) == sdk.Protocol2PacketHandler().updateCRC(0, body, len(body)) == 0x2DDA


@given(st.binary(max_size=300))
def test_crc_equals_the_sdks(data):
    assert crc16(data) == sdk.Protocol2PacketHandler().updateCRC(0, list(data), len(data))


bytes_with_headers = st.lists(st.sampled_from([b"\xff", b"\xfd", b"\x00", b"\xff\xff\xfd", b"\x55", b"\x01"])).map(
    b"".join
)


@given(bytes_with_headers | st.binary(max_size=200))
def test_stuffing_is_undone(body):
    stuffed = stuff(body)
    assert unstuff(stuffed) == body
    assert b"\xff\xff\xfd\x00" not in stuffed


@st.composite
def streams(draw):
    """Packets with noise between them that contains no header, cut anywhere."""
    packets = draw(
        st.lists(
            st.builds(Packet, st.integers(0, 252), st.integers(0, 255), bytes_with_headers | st.binary(max_size=60)),
            max_size=6,
        )
    )
    noise = st.binary(max_size=20).filter(lambda b: b"\xff" not in b)
    data = b"".join(draw(noise) + encode(packet) for packet in packets) + draw(noise)
    cuts = sorted(draw(st.lists(st.integers(0, len(data)), max_size=8)))
    return packets, [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


@given(streams())
def test_parser_finds_every_packet_however_the_bytes_are_cut(stream):
    packets, pieces = stream
    parser = Parser()
    assert [p for piece in pieces for p in parser.feed(piece)] == packets


good_packets = st.builds(Packet, st.integers(0, 254), st.integers(0, 255), st.binary(max_size=9)).map(encode)


@given(st.lists(st.binary(max_size=80) | bytes_with_headers | good_packets, max_size=20))
@settings(max_examples=300)
def test_parser_survives_any_bytes_and_accepts_only_what_has_its_crc(pieces):
    parser, whole = Parser(), b"".join(pieces)
    valid, crc = set(), sdk.Protocol2PacketHandler().updateCRC
    for i in range(len(whole) - 9):  # by brute force and the SDK's table: every packet that stands anywhere in there
        length = whole[i + 5] | whole[i + 6] << 8
        packet = whole[i : i + 7 + length]
        whole_one = packet[:4] == b"\xff\xff\xfd\x00" and length >= 3 and len(packet) == 7 + length
        if whole_one and crc(0, packet, len(packet) - 2) == packet[-2] | packet[-1] << 8:
            valid.add((packet[4], unstuff(packet[7:-2])))
    for piece in pieces:
        for packet in parser.feed(piece):
            assert (packet.id, bytes([packet.instruction]) + packet.parameters) in valid
    assert parser.pending <= LONGEST + 7  # it never hoards


@given(st.builds(Packet, st.integers(0, 252), st.integers(0, 255), st.binary(max_size=40)), st.data())
@settings(max_examples=300)
def test_no_single_flipped_bit_is_accepted(packet, data):
    good = encode(packet)
    at = data.draw(st.integers(0, len(good) * 8 - 1))
    bad = bytearray(good)
    bad[at // 8] ^= 1 << at % 8
    assert list(Parser().feed(bytes(bad))) == []


def test_a_cut_off_packet_does_not_swallow_the_next():
    parser = Parser()
    assert list(parser.feed(encode(Packet(1, 3, bytes(300)))[:50])) == []  # 250 bytes are still to come
    assert len(list(parser.feed(h(GOLDEN["ping"])))) == 1


# -- one servo's rules -------------------------------------------------------------------------------------------------


def servo() -> Servo:
    return Servo(1, Motor())


def put(s: Servo, name: str, value: int) -> int:
    r = register(name)
    return s.write(r.address, value.to_bytes(r.size, "little", signed=value < 0))


def test_the_control_table_is_the_manuals():
    # (address, size, initial value), copied from the manual's two tables, apart from the module's own
    manual = {
        "model_number": (0, 2, 1020), "id": (7, 1, 1), "baud_rate": (8, 1, 1), "return_delay_time": (9, 1, 250),
        "operating_mode": (11, 1, 3), "homing_offset": (20, 4, 0), "temperature_limit": (31, 1, 80),
        "max_voltage_limit": (32, 2, 160), "min_voltage_limit": (34, 2, 95), "pwm_limit": (36, 2, 885),
        "current_limit": (38, 2, 1193), "velocity_limit": (44, 4, 350), "shutdown": (63, 1, 52),
        "torque_enable": (64, 1, 0), "status_return_level": (68, 1, 2), "hardware_error_status": (70, 1, 0),
        "bus_watchdog": (98, 1, 0), "goal_pwm": (100, 2, 885), "goal_current": (102, 2, 1193),
        "goal_velocity": (104, 4, 0),
        "goal_position": (116, 4, 0), "realtime_tick": (120, 2, 0), "present_current": (126, 2, 0),
        "present_velocity": (128, 4, 0), "present_position": (132, 4, 0), "present_input_voltage": (144, 2, 0),
        "present_temperature": (146, 1, 0), "indirect_address_1": (168, 2, 224), "indirect_address_28": (222, 2, 251),
        "indirect_data_28": (251, 1, 0), "indirect_address_29": (578, 2, 634), "indirect_data_56": (661, 1, 0),
    }  # fmt: skip
    for name, (address, size, default) in manual.items():
        r = XM430_W350[name]
        assert (r.address, r.size, r.default) == (address, size, default), name
    owners = [a for r in XM430_W350.values() for a in range(r.address, r.address + r.size)]
    assert len(owners) == len(set(owners))


def test_the_control_table_is_the_second_clients():
    rustypot = pytest.importorskip("rustypot")
    checked = 0
    for info in rustypot.Xl430PyController.registers():
        ours = XM430_W350.get(info.name)
        if ours is not None:
            assert (ours.address, ours.size) == (info.addr, info.size), info.name
            if info.name.startswith(("goal_", "present_")):  # it has no signs for some others
                assert ours.signed == (info.encoding == "twos_complement"), info.name
            assert ours.writable == (info.access != rustypot.RegisterAccess.Read), info.name
            checked += 1
    assert checked > 40


def test_rules_for_writing():
    s = servo()
    assert put(s, "model_number", 5) == 7  # read-only
    assert s.write(14, b"\x00") == 7  # nothing there
    assert s.write(116, b"\x00\x00") == 5  # half a register
    assert put(s, "operating_mode", 2) == 4  # no such mode
    assert put(s, "led", 2) == 4
    assert put(s, "current_limit", 400) == 0
    assert put(s, "goal_current", 401) == 6  # beyond the configured limit
    assert put(s, "torque_enable", 1) == 0
    assert put(s, "current_limit", 300) == 7  # the EEPROM is locked
    assert put(s, "goal_current", -400) == 0  # RAM is not
    assert s.get("goal_current") == -400
    # two registers in one write, the second one refused: nothing happens
    assert s.write(64, b"\x00\x09") == 4
    assert s.get("torque_enable") == 1


def test_a_change_of_mode_sets_goal_current_to_the_limit():
    s = servo()
    put(s, "current_limit", 500)
    put(s, "goal_current", 0)
    put(s, "operating_mode", 0)
    assert s.get("goal_current") == 500
    put(s, "goal_current", 7)
    put(s, "operating_mode", 0)  # no change
    assert s.get("goal_current") == 7


def test_indirect_addresses_lead_to_their_registers():
    s = servo()
    for i, address in enumerate((132, 133, 134, 135, 146)):
        s.write(168 + 2 * i, address.to_bytes(2, "little"))
    s.feel(0.5, 0, 0, 0)
    error, data = s.read(224, 5)
    assert error == 0
    assert int.from_bytes(data[:4], "little") == 2048 + round(0.5 / Units().position)
    assert data[4] == 30
    s.write(178, (65).to_bytes(2, "little"))  # the LED, through indirect data 6
    assert s.write(229, b"\x01") == 0
    assert s.get("led") == 1


def test_watchdog_stops_the_motor_and_locks_the_goals():
    s = servo()
    for name, value in (("operating_mode", 0), ("goal_current", 100), ("bus_watchdog", 3), ("torque_enable", 1)):
        assert put(s, name, value) == 0
    s.age(0.06)
    assert s.goal() == pytest.approx(0.269)
    s.age(0.001)
    assert s.goal() == 0
    assert s.get("bus_watchdog") == -1
    assert put(s, "goal_current", 5) == 4  # data range error, as in the manual's example
    assert put(s, "bus_watchdog", 0) == 0
    assert put(s, "goal_current", 5) == 0


def test_watchdog_is_quiet_while_the_bus_talks():
    s = servo()
    chain = Chain([s])
    for name, value in (("operating_mode", 0), ("goal_current", 100), ("bus_watchdog", 2), ("torque_enable", 1)):
        put(s, name, value)
    for _ in range(20):
        s.age(0.03)
        chain.handle(Packet(77, 1))  # for a servo that is not there
    assert s.goal() > 0


def test_overheating_shuts_down_until_reboot():
    s = servo()
    put(s, "torque_enable", 1)
    s.heat = 60.0
    s.age(0.001)
    assert not s.torque_on
    assert s.get("hardware_error_status") == 1 << 2
    assert put(s, "torque_enable", 1) == 1  # result fail
    (reply,) = Chain([s]).handle(Packet(1, 1))
    assert reply[8] == 0x80  # the alert bit
    s.heat = 0.0
    Chain([s]).handle(Packet(1, 8))
    assert put(s, "torque_enable", 1) == 0


def test_a_lasting_overload_shuts_down():
    s = servo()
    put(s, "torque_enable", 1)
    for _ in range(2001):
        s.current = 2.2
        s.age(0.001)
    assert not s.torque_on
    assert s.get("hardware_error_status") == 1 << 5


def test_low_supply_raises_the_alert_but_does_not_shut_down_by_default():
    s = Servo(1, Motor(voltage=9.0))
    put(s, "torque_enable", 1)
    s.age(0.001)
    assert s.get("hardware_error_status") == 1
    assert s.torque_on


# -- the motor ---------------------------------------------------------------------------------------------------------


def test_registers_end_where_a_diverging_loop_does_not():
    s = Servo(1, Motor())
    for sign in (1, -1):
        s.feel(sign * 1e9, sign * 1e9, sign * 1e9, 0.0)
        shown = [s.get(f"present_{name}") for name in ("current", "velocity", "position")]
        assert shown == [sign * (2**15 - 1), sign * (2**31 - 1), sign * (2**31 - 1)]


def test_motor_has_the_makers_three_figures():
    m = Motor()
    stall = m.current(99, 0.0)
    assert stall == pytest.approx(2.3)
    assert m.torque(stall, 0.0) == pytest.approx(4.1)
    no_load = 46 * 2 * math.pi / 60
    assert m.current(99, no_load) == pytest.approx(0, abs=1e-12)
    for w in np.linspace(0, no_load, 7):  # the line between them
        assert m.torque(m.current(99, w), w) == pytest.approx(4.1 * (1 - w / no_load))


def test_motor_friction_takes_power_at_any_speed():
    for w in (-3.0, -0.01, 0.01, 3.0):
        assert (HARDWARE.torque(0.0, w)) * w < 0
    assert HARDWARE.torque(0.0, 5.0) == pytest.approx(-0.03 * 5 - 0.08, rel=1e-3)


def test_motor_refuses_nonsense():
    with pytest.raises(InputError, match="efficiency"):
        Motor(efficiency=1.2)
    with pytest.raises(InputError, match="fault"):
        Fault("explode")  # type: ignore[arg-type]


def test_a_dead_motor_lets_the_arm_swing_as_the_plain_simulation_does():
    # a pendulum's energy: torque off, no friction, the whip's own damping set aside by a short time
    options = TwinOptions(start=(0.4, 0.2))
    physics = options.make_physics(options.make_servos())
    ref = physics._rollout
    physics.advance_to(0.2)
    import mujoco

    data = mujoco.MjData(ref._mj)
    data.qpos[:] = [0.4, 0.2, -0.6] + [0.0] * 11
    ref._mj.opt.timestep = 2e-5  # an independent, finer integration
    for _ in range(10_000):
        mujoco.mj_step(ref._mj, data)
    assert np.abs(physics.data.qpos - data.qpos).max() < 1e-6


# -- over the pseudo-terminal ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def twin():
    with Emulator(TwinOptions()) as emulator:
        yield emulator


@pytest.fixture
def line(twin):
    """The SDK's own port and handler on a fresh emulator."""
    twin.reset()
    port = PatientPort(twin)
    yield port, sdk.Protocol2PacketHandler()
    port.closePort()


OK = (0, 0)  # communication and servo


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
    assert handler.write4ByteTxRx(port, 1, 116, 0x12345678) == OK
    assert handler.read4ByteTxRx(port, 1, 116) == (0x12345678, *OK)
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
    # the reply has FF FF FD in it; the servo escapes it, the SDK takes the escape out
    assert handler.write4ByteTxRx(port, 1, 20, 0x00FDFFFF & 0xFFFFF)[1] == 0
    assert handler.read4ByteTxRx(port, 1, 20) == (0xDFFFF, *OK)
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


def test_fuzzed_line_neither_hangs_nor_dies(twin):
    twin.reset()
    rng = np.random.default_rng(0)
    with RawLine(twin) as line:
        for _ in range(150):
            kind = rng.integers(3)
            noise = rng.integers(0, 256, int(rng.integers(1, 200)), dtype=np.uint8).tobytes()
            if kind == 1:  # good packets with any instruction and parameters; not those that change how it talks
                packet = Packet(int(rng.choice([1, 2, 254, 9])), int(rng.integers(256)), noise[:40])
                noise = encode(packet) if packet.instruction not in (3, 4, 6, 0x83, 0x93) else b"\xff\xff\xfd"
            elif kind == 2:
                good = bytearray(h(list(GOLDEN.values())[int(rng.integers(len(GOLDEN)))]))
                good[int(rng.integers(len(good)))] ^= 1 << int(rng.integers(8))
                noise = bytes(good)
            line.write(noise)
        line.answer()
        line.write(h(GOLDEN["ping"]))
        assert h("FF FF FD 00 01 07 00 55") in line.answer()


def test_in_lockstep_a_packet_may_come_in_pieces_at_any_pace(twin):
    twin.reset()
    ping = h(GOLDEN["ping"])
    with RawLine(twin) as line:
        for cut in (1, 5, len(ping) - 1):
            line.write(ping[:cut])
            assert line.answer() == b""
            time.sleep(0.05)  # longer than a servo would wait
            for _ in range(2):
                twin.state()  # it looks, and nothing has come
            line.write(ping[cut:])
            assert len(line.answer()) == 14


@given(st.binary(max_size=60), st.integers(0, 255), st.sampled_from([1, 2, 254, 200]))
@example(bytes([0, 0, 0, 0x56, 0, 0, 0]), 0x8A, 254)  # a fast read of more than a packet's length field can say
@settings(max_examples=400, deadline=None)
def test_no_instruction_breaks_a_servo(parameters, instruction, id):
    servos = [Servo(1, Motor()), Servo(2, Motor())]
    for reply in Chain(servos).handle(Packet(id, instruction, parameters)):
        if reply[:4] == b"\xff\xff\xfd\x00" and instruction not in (0x8A, 0x9A):
            assert len(list(Parser().feed(reply))) == 1
    for s in servos:
        s.age(0.001)
        s.feel(0.1, 0.2, 0.3, 1.0)
        s.goal()


def test_lockstep_repeats_exactly(twin):
    def play() -> np.ndarray:
        twin.reset((0.2, 0.3))
        port, handler = PatientPort(twin), sdk.Protocol2PacketHandler()
        for i in (1, 2):
            handler.write1ByteTxRx(port, i, 11, 0)
            handler.write2ByteTxRx(port, i, 102, 0)
            handler.write1ByteTxRx(port, i, 64, 1)
        write = sdk.GroupSyncWrite(port, handler, 102, 2)
        for i in (1, 2):
            write.addParam(i, [0, 0])
        for k in range(60):
            for i in (1, 2):
                write.changeParam(i, list((200 - 5 * k * i).to_bytes(2, "little", signed=True)))
            write.txPacket()
        path = twin.trajectory()
        port.closePort()
        return path["q"]

    first, second = play(), play()
    # a sample every millisecond of 61 periods of 2 ms: the second servo's first goal came with the first one on
    assert len(first) == 61 * 2 + 1
    np.testing.assert_array_equal(first, second)
    assert np.abs(first[-1] - first[0]).max() > 0.01


def test_time_stands_still_without_writes_in_lockstep(twin):
    twin.reset()
    time.sleep(0.05)
    assert twin.state()["t"] == 0
    twin.advance(0.25)
    assert twin.state()["t"] == pytest.approx(0.25)


def test_sample_delay_shows_the_past():
    options = TwinOptions(start=(0.5, 0.0), sample_delay=0.01)
    servos = options.make_servos()
    physics = options.make_physics(servos)
    plain = dataclasses.replace(options, sample_delay=0.0)
    now = plain.make_servos()
    reference = plain.make_physics(now)
    physics.advance_to(0.1)
    reference.advance_to(0.09)
    assert servos[0].get("present_position") == now[0].get("present_position")
    reference.advance_to(0.1)
    assert servos[0].get("present_position") != now[0].get("present_position")


def test_command_delay_postpones_the_current():
    options = TwinOptions(command_delay=0.01)
    servos = options.make_servos()
    physics = options.make_physics(servos)
    for s in servos:
        s.set("operating_mode", 0)
        s.set("goal_current", 0)
        s.set("torque_enable", 1)
    physics.advance_to(0.05)
    servos[0].set("goal_current", 100)
    physics.advance_to(0.1)
    path = physics.trajectory()
    began = path["t"][np.flatnonzero(path["current"][:, 0])[0]]
    assert began == pytest.approx(0.061, abs=0.0015)


def test_command_line_serves_a_linked_device(tmp_path):
    link = tmp_path / "tty"
    process = subprocess.Popen(
        [sys.executable, "-m", "whiptool.rig.emulator", "--link", str(link)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert "emulated servos [1, 2] at 1000000 baud" in process.stdout.readline()
        assert "and on" in process.stdout.readline()
        port, handler = sdk.PortHandler(str(link)), sdk.Protocol2PacketHandler()
        assert port.setBaudRate(1_000_000)
        while handler.ping(port, 2) != (1020, *OK):  # the SDK gives up after 34 ms, a busy machine does not
            assert process.poll() is None
        port.closePort()
    finally:
        process.terminate()
        process.wait(HANG)


@pytest.mark.parametrize("there", ["file", "folder", "link to a file", "no folder"])
def test_a_link_replaces_nothing_that_is_not_its_own(tmp_path, there, capsys):
    """Its own links lead to a pseudo-terminal; what else has the name stays, and the command says so."""
    link, thesis = tmp_path / "tty", tmp_path / "thesis.tex"
    thesis.write_text("years of work")
    if there == "file":
        link = thesis
    elif there == "folder":
        link.mkdir()
    elif there == "link to a file":
        link.symlink_to(thesis)
    else:
        link = tmp_path / "none" / "tty"
    assert main(["--link", str(link)]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("whiptool: --link: got")
    assert "\n" not in error
    assert thesis.read_text() == "years of work"
    assert link.is_symlink() == (there == "link to a file")


def test_a_link_that_a_killed_emulator_left_is_replaced(tmp_path):
    link = tmp_path / "tty"
    link.symlink_to("/dev/pts/987654")
    _link(link, "/dev/pts/3")
    assert link.readlink() == Path("/dev/pts/3")


def test_options_are_checked():
    with pytest.raises(InputError, match="baud"):
        TwinOptions(baud=1234)
    with pytest.raises(InputError, match="ids"):
        TwinOptions(ids=(1, 1))
    o = TwinOptions(model=wt.preset("lemon2024"), start=(0.1,))
    with pytest.raises(InputError, match="start"):
        o.make_physics(o.make_servos())
