"""The bus: every trap of the maker's SDK, first shown, then closed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import termios
import threading
import time

import pytest
from ports import PatientPort, sdk
from processes import HANG

from whiptool.errors import InputError
from whiptool.rig.dynamixel import BLOCK, DynamixelBus, NoReply, Refused, Units, Unplugged, register
from whiptool.rig.dynamixel.bus import check_rate
from whiptool.rig.emulator import Emulator, Fault, TwinOptions
from whiptool.rig.emulator.packets import status


@pytest.fixture
def plain(twin):
    """The SDK as it comes, but for a machine that may be slow."""
    twin.reset((0.3, 0.5))
    port = PatientPort(twin)
    yield port, sdk.Protocol2PacketHandler()
    port.closePort()


def at(block, name):
    return [row[BLOCK.index(name)] for row in block]


COUNTS = [2048 + round(q / Units().position) for q in (0.3, 0.5)]


# -- what it reads and writes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fast", [False, True])
def test_block_of_one_read_has_all_registers(bus, fast):
    bus.fast = fast
    block = bus.read_block()
    assert at(block, "present_position") == COUNTS
    assert at(block, "present_input_voltage") == [120, 120]
    assert at(block, "present_temperature") == [30, 30]
    assert at(block, "torque_enable") == [0, 0]
    for name in BLOCK:  # the same as read one by one
        assert at(block, name) == [bus.read(id, name) for id in (1, 2)]


def test_values_are_signed_both_ways(bus, twin):
    for id, goal in ((1, -321), (2, 1193)):
        bus.write(id, "operating_mode", 0)
        bus.write(id, "goal_current", goal)
        bus.write(id, "torque_enable", 1)
        assert bus.read(id, "goal_current") == goal
    bus.write_currents([-321, -5])
    assert [bus.read(id, "goal_current") for id in (1, 2)] == [-321, -5]
    for _ in range(10):
        bus.write_currents([-321, -5])
    block = bus.read_block()
    assert at(block, "present_current") == [-321, -5]
    assert at(block, "present_velocity")[0] < 0
    assert at(block, "present_position")[0] < COUNTS[0]


def test_refusals_name_the_reason(bus):
    bus.write(1, "torque_enable", 1)
    with pytest.raises(Refused, match="servo 1, asked to set operating_mode = 0: no access to this address now"):
        bus.write(1, "operating_mode", 0)
    with pytest.raises(Refused, match="out of range"):
        bus.write(2, "current_limit", 2000)
    with pytest.raises(InputError, match="can be written"):
        bus.write(1, "present_position", 0)
    with pytest.raises(InputError, match="register: got 'goal_torque'"):
        bus.read(1, "goal_torque")
    assert bus.failures == {"refused": 2}


# -- traps of the SDK --------------------------------------------------------------------------------------------------


def test_trap_late_reply_becomes_the_next_answer(plain, twin):
    port, handler = plain
    twin.inject(Fault("late"))
    assert handler.read2ByteTxRx(port, 1, 144)[1] == sdk.COMM_RX_TIMEOUT
    # the voltage comes late, and is taken for the current limit
    assert handler.read2ByteTxRx(port, 1, 38)[0] == 120


@pytest.mark.parametrize("fast", [False, True])
def test_late_reply_is_not_taken_for_the_next(bus, twin, fast):
    bus.fast = fast
    twin.inject(Fault("late"))
    with pytest.raises(NoReply):
        bus.read(1, "present_input_voltage")
    assert bus.read(1, "current_limit") == 1193
    twin.inject(Fault("late", count=2))  # of either servo
    with pytest.raises(NoReply):
        bus.read_block()
    twin.advance(0.3)  # the arm falls on: the old sample would show it
    q = twin.state()["q"][:2]
    assert at(bus.read_block(), "present_position") == [2048 + round(x / Units().position) for x in q]


def test_a_reply_with_another_behind_it_is_thrown_away(bus, twin):
    twin.inject(Fault("duplicate", count=4))
    lost = 0
    for _ in range(6):
        try:
            assert at(bus.read_block(), "present_position") == COUNTS
        except NoReply:
            lost += 1
    assert bus.read(1, "current_limit") == 1193
    assert lost <= 4


def test_trap_nothing_came_and_it_is_zero(plain, twin):
    port, handler = plain
    read = sdk.GroupSyncRead(port, handler, 132, 4)
    read.addParam(1)
    read.addParam(2)
    twin.inject(Fault("drop", count=2))
    assert read.txRxPacket() != 0
    assert read.getData(1, 132, 4) == 0  # a position like any other


@pytest.mark.parametrize("kind", ["drop", "corrupt"])
def test_nothing_came_is_an_error(bus, twin, kind):
    bus.fast = True
    twin.inject(Fault(kind))
    with pytest.raises(NoReply):
        bus.read_block()
    assert at(bus.read_block(), "present_position") == COUNTS


def test_trap_group_reads_drop_the_error_byte(plain):
    port, handler = plain
    handler.write1ByteTxRx(port, 1, 63, 0)
    read = sdk.GroupSyncRead(port, handler, 700, 2)  # no such address: every reply is an error without data
    read.addParam(1)
    assert read.txRxPacket() == 0
    assert read.getData(1, 700, 2) not in (0, None)  # what stands for data is the packet's CRC


def test_the_alert_bit_and_hardware_errors_are_seen(bus, twin):
    twin.inject(Fault("alert", servo=1))
    assert at(bus.read_block(), "hardware_error_status") == [0, 1 << 3]
    assert bus.read(2, "hardware_error_status") == 1 << 3  # an alert alone refuses nothing


def test_trap_error_status_decoded_as_data(plain):
    port, handler = plain
    value, result, error = handler.read2ByteTxRx(port, 1, 700)
    assert (result, error) == (0, 7)
    assert value == int.from_bytes(status(1, 7)[-2:], "little")  # a status without data: its CRC is taken for some


def test_error_status_is_not_data(bus):
    with pytest.raises(Refused, match="no access"):
        bus._read_bytes(1, 700, 2, "nothing")
    bus._block_at = 700
    for fast in (False, True):
        bus.fast = fast
        with pytest.raises(Refused, match="no access"):
            bus.read_block()


def test_trap_an_exception_leaves_the_port_in_use(plain, monkeypatch):
    port, handler = plain
    with monkeypatch.context() as patch:
        patch.setattr(port, "readPort", lambda n: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            handler.ping(port, 1)
    assert handler.ping(port, 1)[1] == sdk.COMM_PORT_BUSY


def test_an_exception_leaves_the_port_usable(bus, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(bus._port, "readPort", lambda n: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            bus.ping(1)
    assert bus.ping(1) == (1020, 45)


def test_trap_the_latency_timer_is_fixed(plain):
    port, handler = plain
    start = time.monotonic()
    handler.ping(port, 9)
    assert time.monotonic() - start > 0.03  # twice 16 ms, fifteen cycles of a 500 Hz loop


def test_timeouts_are_ours(bus, monkeypatch):
    waits, wait = [], select.select
    monkeypatch.setattr(select, "select", lambda r, w, x, seconds: waits.append(seconds) or wait(r, w, x, seconds))
    bus.timeout = 0.004
    start = time.monotonic()
    with pytest.raises(NoReply):
        bus.ping(9)
    assert time.monotonic() - start >= 0.004
    assert max(waits) <= 0.004


def test_a_twin_in_lockstep_is_waited_for_however_slow_its_machine(bus, twin):
    stopped = twin._process
    os.kill(stopped.pid, signal.SIGSTOP)
    later = threading.Timer(20 * bus.timeout, lambda: os.kill(stopped.pid, signal.SIGCONT))
    later.start()
    assert bus.read(1, "present_input_voltage") == 120
    assert bus.failures == {}
    later.join()
    twin.inject(Fault("drop"))
    with pytest.raises(NoReply):  # what is not under way is missing
        bus.read(1, "present_input_voltage")


def test_what_is_asked_of_a_twin_comes_after_what_was_sent(bus, twin):
    for name, value in (("operating_mode", 0), ("goal_current", 0), ("torque_enable", 1)):
        for id in (1, 2):
            bus.write(id, name, value)
    for k in range(1, 200):
        bus.write_currents([k, 0])  # is not answered
        state = twin.state()
        assert state["goal_current"] == [k, 0]
        assert state["t"] == pytest.approx(k * 0.002)


def test_trap_unplugging_raises_what_is_not_the_sdks(plain, twin):
    port, handler = plain
    twin.inject(Fault("unplug"))
    with pytest.raises((termios.error, OSError)):
        handler.ping(port, 1)


def test_unplugging_is_one_error(bus, twin):
    twin.inject(Fault("unplug"))
    for act in (bus.read_block, lambda: bus.write_currents([0, 0]), lambda: bus.ping(1), lambda: bus.read(1, "led")):
        with pytest.raises(Unplugged, match="is gone"):
            act()


def test_unplugging_while_waiting_for_a_reply(bus, twin):
    bus.timeout = HANG
    twin.inject(Fault("drop"), Fault("unplug", at=0.1))
    later = threading.Timer(0.2, lambda: twin.advance(0.2))
    later.start()
    with pytest.raises(Unplugged):
        bus.ping(1)
    later.join()


def test_trap_unsigned(plain):
    port, handler = plain
    handler.write2ByteTxRx(port, 1, 102, 0xFFFF)
    read = sdk.GroupSyncRead(port, handler, 102, 2)
    read.addParam(1)
    assert read.txRxPacket() == 0
    assert read.getData(1, 102, 2) == 65535  # -1, that is 2.69 mA the other way


def test_trap_the_sdk_sends_unstuffed_packets(plain):
    port, handler = plain
    packet = [0, 0, 0, 0, 1, 9, 0, 3, 116, 0, 0xFF, 0xFF, 0xFD, 0x00, 0, 0]
    handler.txPacket(port, packet)
    port.is_using = False
    assert len(packet) == 16  # it should have grown by the escape
    assert handler.write4ByteTxRx(port, 1, 116, 0x00FDFFFF)[0] != 0  # and the servo sees a header


def test_what_needs_stuffing_goes_both_ways(bus):
    bus.write(1, "operating_mode", 4)
    for value in (-131073, -3, 0xDFFFF):
        bus.write(1, "goal_position", value)
        assert bus.read(1, "goal_position") == value
    # two escapes in one reply, and an FD FD behind an FF: the SDK's own removal gets these wrong
    data = bytes.fromhex("FFFFFD00 FFFFFD00 00FFFDFD 000000")
    bus.write(2, "led", 0)
    start = register("indirect_data_29").address
    for fast in (False, True):
        bus.fast = fast
        bus._write_bytes(1, start, data, "data")
        assert bus._read_bytes(1, start, len(data), "data") == data


def test_time_of_day_is_not_used(bus, monkeypatch):
    monkeypatch.setattr(
        time, "time", lambda: 0.0
    )  # a time server sets the clock back: the SDK's own timeout never ends
    bus.timeout = 0.01
    with pytest.raises(NoReply):
        bus.ping(9)


# -- opening -----------------------------------------------------------------------------------------------------------


def test_check_accepts_servos_that_are_there(bus):
    bus.check(500)


def test_absent_servo_is_named(twin):
    twin.reset()
    with (
        twin.bus(ids=[1, 7], timeout=0.02) as bus,
        pytest.raises(InputError, match=r"servo 7.*no reply at any"),
    ):
        bus.check(100)


def test_wrong_baud_rate_names_the_right_one_and_the_command():
    with Emulator(TwinOptions(baud=57_600)) as slow:
        with (
            slow.bus(baud=1_000_000) as bus,
            pytest.raises(InputError, match=r"57600, the rate of servo 1.*whiptool.rig.dynamixel .*--set-baud 1000000"),
        ):
            bus.check(500)
        with slow.bus() as bus:
            bus.check(40)
            with pytest.raises(InputError, match=r"rate: got '500 Hz'.*--set-baud 1000000"):
                bus.check(500)
        # and the command does it
        command = [sys.executable, "-m", "whiptool.rig.dynamixel", "--port", slow.port, "--baud", "57600"]
        done = subprocess.run([*command, "--set-baud", "1000000"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert "servo 2: model 1020" in done.stdout
        with slow.bus(baud=1_000_000) as bus:
            bus.check(500)


def test_a_port_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"port: got '/dev/ttyNONE'"):
        DynamixelBus("/dev/ttyNONE", [1])
    with pytest.raises(InputError, match="ids"):
        DynamixelBus("/dev/ttyNONE", [1, 1])


def test_a_port_is_held_by_one_program(bus, twin):
    with pytest.raises(InputError, match="another program holds it"):
        DynamixelBus(twin.port, [1])


def test_the_sdk_is_named_when_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "dynamixel_sdk", None)
    with pytest.raises(InputError, match=r"pip install 'whiptool\[rig\]'"):
        DynamixelBus(os.devnull, [1])


def test_rates_and_what_mends_them():
    ok: dict = {"device": "/dev/ttyUSB0", "bytes_per_cycle": 88}
    assert check_rate(500, baud=1_000_000, latency=1e-3, **ok) == pytest.approx(88e-5 + 1e-3)
    with pytest.raises(InputError, match=r"latency timer: got '16 ms'.*echo 1 \| sudo tee /sys/class/tty/ttyUSB0/"):
        check_rate(500, baud=1_000_000, latency=16e-3, **ok)
    with pytest.raises(InputError, match="--set-return-delay 0"):
        check_rate(500, baud=1_000_000, delays=2e-3, **ok)
    with pytest.raises(InputError, match="--set-baud 2000000"):
        check_rate(2000, baud=1_000_000, **ok)
    with pytest.raises(InputError, match="take a lower rate"):
        check_rate(9000, baud=4_000_000, **ok)
