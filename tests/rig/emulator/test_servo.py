"""One emulated servo's rules against the maker's manual."""

from __future__ import annotations

import math

import numpy as np
import pytest
from servos import put, servo

from whiptool.errors import InputError
from whiptool.rig.dynamixel.control_table import Units
from whiptool.rig.emulator import HARDWARE, Fault, Motor
from whiptool.rig.emulator.instructions import ServoChain
from whiptool.rig.emulator.packets import Packet
from whiptool.rig.emulator.servo import Servo


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
    assert s.drive()[0] == pytest.approx(0.269)
    s.age(0.001)
    assert s.drive()[0] == 0
    assert s.get("bus_watchdog") == -1
    assert put(s, "goal_current", 5) == 4  # data range error, as in the manual's example
    assert put(s, "bus_watchdog", 0) == 0
    assert put(s, "goal_current", 5) == 0


def test_watchdog_is_quiet_while_the_bus_talks():
    s = servo()
    chain = ServoChain([s])
    for name, value in (("operating_mode", 0), ("goal_current", 100), ("bus_watchdog", 2), ("torque_enable", 1)):
        put(s, name, value)
    for _ in range(20):
        s.age(0.03)
        chain.handle(Packet(77, 1))  # for a servo that is not there
    assert s.drive()[0] > 0


def test_overheating_shuts_down_until_reboot():
    s = servo()
    put(s, "torque_enable", 1)
    s.heat = 60.0
    s.age(0.001)
    assert not s.torque_on
    assert s.get("hardware_error_status") == 1 << 2
    assert put(s, "torque_enable", 1) == 1  # result fail
    (reply,) = ServoChain([s]).handle(Packet(1, 1))
    assert reply[8] == 0x80  # the alert bit
    s.heat = 0.0
    ServoChain([s]).handle(Packet(1, 8))
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
        Fault("explode")
