"""The servos' registers: addresses, units, and what they take."""

from __future__ import annotations

import math

import pytest

from whiptool.errors import InputError
from whiptool.rig.dynamixel import Units, register
from whiptool.rig.dynamixel.control_table import XM430_W350, in_words


def test_the_control_table_is_the_manuals():
    # (address, size, initial value), copied from the manual's two tables, apart from the module's own
    manual = {
        "model_number": (0, 2, 1020), "id": (7, 1, 1), "baud_rate": (8, 1, 1), "return_delay_time": (9, 1, 250),
        "operating_mode": (11, 1, 3), "homing_offset": (20, 4, 0), "temperature_limit": (31, 1, 80),
        "max_voltage_limit": (32, 2, 160), "min_voltage_limit": (34, 2, 95), "pwm_limit": (36, 2, 885),
        "current_limit": (38, 2, 1193), "velocity_limit": (44, 4, 200), "startup_configuration": (60, 1, 0),
        "shutdown": (63, 1, 52),
        "torque_enable": (64, 1, 0), "status_return_level": (68, 1, 2), "hardware_error_status": (70, 1, 0),
        "bus_watchdog": (98, 1, 0), "goal_pwm": (100, 2, 885), "goal_current": (102, 2, 1193),
        "goal_velocity": (104, 4, 0),
        "goal_position": (116, 4, 0), "realtime_tick": (120, 2, 0), "present_current": (126, 2, 0),
        "present_velocity": (128, 4, 0), "present_position": (132, 4, 0), "present_input_voltage": (144, 2, 0),
        "present_temperature": (146, 1, 0), "backup_ready": (147, 1, 0),
        "indirect_address_1": (168, 2, 224), "indirect_address_28": (222, 2, 251),
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


def test_registers_refuse_what_they_do_not_take():
    with pytest.raises(InputError, match="goal_current: got 1194"):
        register("goal_current").encode(1194)
    assert register("goal_current").encode(-2) == b"\xfe\xff"
    assert in_words(0b100100) == "overheating, overload"


def test_finer_units_are_finer():
    assert Units(2**14).position * 2**14 == pytest.approx(2 * math.pi / 4096)
    assert Units(2**14).current * 16 == pytest.approx(2.69e-3)
