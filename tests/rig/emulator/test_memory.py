"""Which writes a servo refuses, against the maker's manual, and what it keeps without power."""

from __future__ import annotations

import pytest
from servos import put, servo

from whiptool.rig.dynamixel.control_table import WATCHDOG_TRIPPED
from whiptool.rig.emulator.instructions import ServoChain
from whiptool.rig.emulator.packets import Packet

RANGE, LIMIT, ACCESS = 4, 6, 7  # error numbers of Protocol 2.0


def test_position_limits_bound_the_goal_in_position_mode_alone():
    s = servo()
    assert put(s, "max_position_limit", 3000) == 0
    assert put(s, "min_position_limit", 1000) == 0
    for value, error in ((3500, LIMIT), (3001, LIMIT), (3000, 0), (1000, 0), (999, LIMIT), (-1, LIMIT), (10**6, LIMIT)):
        assert put(s, "goal_position", value) == error, value
    assert s.get("goal_position") == 1000
    for mode in (4, 5):  # "the angle limits do not apply"; 256 turns do
        assert put(s, "operating_mode", mode) == 0
        for value, error in ((3500, 0), (-1_048_575, 0), (1_048_575, 0), (1_048_576, RANGE), (-1_048_576, RANGE)):
            assert put(s, "goal_position", value) == error, (mode, value)


def test_velocity_limit_bounds_the_goal():
    s = servo()
    assert s.get("velocity_limit") == 200
    for value, error in ((200, 0), (-200, 0), (201, LIMIT), (-201, LIMIT), (2000, LIMIT)):
        assert put(s, "goal_velocity", value) == error, value
    assert put(s, "velocity_limit", 1023) == 0
    assert put(s, "goal_velocity", 1023) == 0
    assert put(s, "velocity_limit", 1024) == RANGE
    assert put(s, "velocity_limit", 50) == 0
    assert s.get("goal_velocity") == 50  # a lower limit lowers the goal


def test_pwm_limit_bounds_the_goal():
    s = servo()
    assert put(s, "pwm_limit", 300) == 0
    assert s.get("goal_pwm") == 300
    assert put(s, "goal_pwm", 301) == LIMIT
    assert put(s, "goal_pwm", -300) == 0


def test_what_firmware_45_has():
    s = servo()
    assert s.get("firmware_version") == 45
    assert [put(s, "startup_configuration", x) for x in (0, 1, 2, 3, 4)] == [0, 0, 0, 0, RANGE]
    assert put(s, "backup_ready", 1) == ACCESS
    assert [put(s, "drive_mode", x) for x in (0, 1, 4, 5, 8, 13)] == [0] * 6
    assert [put(s, "drive_mode", x) for x in (2, 3, 6, 16)] == [RANGE] * 4  # bits that the XM430 does not have
    assert s.read(40, 4)[0] == ACCESS  # Acceleration Limit, of older firmware
    put(s, "drive_mode", 4)
    assert put(s, "profile_velocity", 32_738) == RANGE  # [ms]
    put(s, "drive_mode", 0)
    assert put(s, "profile_velocity", 32_767) == 0


def test_protocol_1_is_refused():
    s = servo()
    assert put(s, "protocol_version", 1) == RANGE
    assert s.get("protocol_version") == 2
    assert put(s, "protocol_version", 2) == 0


def test_a_change_of_mode_resets_goals_profile_and_gains():
    s = servo()
    for name, value in (
        ("position_p_gain", 640),
        ("profile_velocity", 50),
        ("profile_acceleration", 5),
        ("goal_pwm", 9),
    ):
        assert put(s, name, value) == 0
    put(s, "operating_mode", 4)
    found = [s.get(x) for x in ("position_p_gain", "profile_velocity", "profile_acceleration", "goal_pwm")]
    assert found == [800, 0, 0, 885]


def test_the_watchdog_clears_goals_and_profile():
    for mode, goal in ((0, "goal_current"), (1, "goal_velocity"), (3, "goal_position"), (16, "goal_pwm")):
        s = servo()
        s.feel(0.3, 0.0, 0.0, 0.0)
        put(s, "operating_mode", mode)
        put(s, "torque_enable", 1)
        for name, value in (("profile_acceleration", 9), ("profile_velocity", 9), (goal, 100), ("bus_watchdog", 1)):
            assert put(s, name, value) == 0, name
        s.age(0.021)
        assert s.get("bus_watchdog") == WATCHDOG_TRIPPED
        assert s.torque_on
        assert s.get(goal) == (s.get("present_position") if mode == 3 else 0)
        assert (s.get("profile_acceleration"), s.get("profile_velocity")) == (0, 0)
        assert put(s, goal, 50) == RANGE
        s.control()
        current, low, high = s.drive()
        assert current == 0
        assert mode == 0 or low == high == 0  # it brakes
        assert put(s, "bus_watchdog", 0) == 0
        assert s.get(goal) == (s.get("present_position") if mode == 3 else 0)  # what was wanted before is gone
        assert put(s, goal, 50) == 0


# -- boots and backups -----------------------------------------------------------------------------------------------

STORE, RESTORE = b"\x01CTRL", b"\x02CTRL"


def ask(s, instruction: int, parameters: bytes = b"", id: int = 1) -> int | None:
    """Error number of one instruction; None: no reply."""
    replies = ServoChain([s]).handle(Packet(id, instruction, parameters))
    return replies[0][8] if replies else None


def test_a_backup_is_kept_and_restored():
    s = servo()
    assert s.get("backup_ready") == 0
    assert ask(s, 0x20, RESTORE) == 1  # there is none
    for name, value in (("position_p_gain", 640), ("profile_velocity", 77), ("pwm_limit", 700), ("led", 1)):
        put(s, name, value)
    s.write(168, (132).to_bytes(2, "little"))
    put(s, "torque_enable", 1)
    assert ask(s, 0x20, STORE) == 1  # not with torque on
    put(s, "torque_enable", 0)
    assert ask(s, 0x20, b"\x01abcd") == 1
    assert ask(s, 0x20, STORE) == 0
    assert s.get("backup_ready") == 1
    put(s, "pwm_limit", 100)
    assert ask(s, 8) == 0
    assert [s.get(x) for x in ("position_p_gain", "profile_velocity", "backup_ready")] == [800, 0, 1]
    assert ask(s, 0x20, RESTORE) == 0
    assert s.get("pwm_limit") == 700


def test_startup_restores_ram_and_switches_torque_on_if_it_is_configured():
    s = servo()
    for name, value in (("position_p_gain", 640), ("profile_velocity", 77), ("led", 1)):
        put(s, name, value)
    s.write(168, (132).to_bytes(2, "little"))
    assert ask(s, 0x20, STORE) == 0
    put(s, "startup_configuration", 2)
    ask(s, 8)
    kept = ("position_p_gain", "profile_velocity", "indirect_address_1", "led", "torque_enable")
    assert [s.get(x) for x in kept] == [640, 77, 132, 0, 0]
    put(s, "startup_configuration", 1)
    ask(s, 8)
    assert [s.get(x) for x in kept] == [800, 0, 224, 0, 1]
    assert s.get("goal_position") == s.get("present_position") == 2048


def test_a_goal_switches_torque_on_if_the_drive_mode_says_so():
    s = servo()
    put(s, "goal_position", 2100)
    assert not s.torque_on
    put(s, "drive_mode", 8)
    put(s, "profile_velocity", 20)  # no goal
    put(s, "goal_current", 10)  # not the goal of this mode
    assert not s.torque_on
    put(s, "goal_position", 2100)
    assert s.torque_on
    assert s.get("goal_position") == 2100
    assert s.controllers.ongoing
    s.heat = 60.0
    s.age(0.001)
    put(s, "goal_position", 2048)
    assert not s.torque_on  # it has shut itself down


# -- turns -----------------------------------------------------------------------------------------------------------

TURN = 2 * 3.141592653589793


@pytest.mark.parametrize("how", ["mode", "torque", "reboot", "clear", "none"])
def test_turns_are_forgotten_where_the_manual_says(how):
    s = servo()
    put(s, "operating_mode", 5)
    put(s, "homing_offset", 100)
    s.feel(2.25 * TURN, 0.0, 0.0, 0.0)
    beyond, within = 2048 + 9 * 1024 + 100, 3072 + 100
    assert s.get("present_position") == beyond
    if how == "mode":
        put(s, "operating_mode", 3)
    elif how == "torque":
        s.set("operating_mode", 3)
        put(s, "torque_enable", 1)
    elif how == "reboot":
        ask(s, 8)
    elif how == "clear":
        assert ask(s, 0x10, b"\x01\x44\x58\x4c\x22") == 0
    else:
        put(s, "torque_enable", 1)  # in another mode
        put(s, "goal_position", beyond)
    assert s.get("present_position") == (beyond if how == "none" else within)
    assert s.get("homing_offset") == 100
    if how == "torque":
        assert s.get("goal_position") == within
    s.feel(1.25 * TURN, 0.0, 0.0, 0.0)  # it goes on counting from there
    assert s.get("present_position") == (beyond if how == "none" else within) - 4096


def test_clear_needs_a_servo_that_stands():
    s = servo()
    s.feel(2 * TURN, 3.0, 0.0, 0.0)
    assert ask(s, 0x10, b"\x01\x44\x58\x4c\x22") == 1
    s.feel(2 * TURN, 0.0, 0.0, 0.0)
    assert ask(s, 0x10, b"\x01\x44\x58\x4c\x23") == 1
    assert ask(s, 0x10, b"\x01\x44\x58\x4c\x22") == 0
    assert s.get("present_position") == 2048


def test_clear_leaves_a_servo_where_it_holds():
    s = servo()
    put(s, "operating_mode", 4)
    s.feel(2 * TURN, 0.0, 0.0, 0.0)
    put(s, "torque_enable", 1)
    put(s, "goal_position", 2048 + 2 * 4096 + 7)
    assert ask(s, 0x10, b"\x01\x44\x58\x4c\x22") == 0
    assert (s.get("present_position"), s.get("goal_position"), s.get("position_trajectory")) == (2048, 2055, 2055)


def test_homing_offset_beyond_a_quarter_turn_has_no_effect_in_position_mode():
    s = servo()
    for offset, seen in ((1024, 3072), (-1024, 1024), (1025, 2048), (-2000, 2048)):
        assert put(s, "homing_offset", offset) == 0
        assert s.get("present_position") == seen, offset
    put(s, "operating_mode", 4)
    assert s.get("present_position") == 48
    assert put(s, "homing_offset", 1_044_480) == RANGE


# -- secondary id ----------------------------------------------------------------------------------------------------


def test_a_secondary_id_is_obeyed_in_silence_and_changes_no_eeprom():
    first, second = servo(), servo()
    second.set("id", 2)
    chain = ServoChain([first, second])
    for s in (first, second):
        assert put(s, "secondary_id", 2) == 0
    led = bytes([65, 0, 1])
    assert [reply[4] for reply in chain.handle(Packet(2, 3, led))] == [
        2
    ]  # the manual's example: one answers, both obey
    assert (first.get("led"), second.get("led")) == (1, 1)
    for s in (first, second):
        put(s, "secondary_id", 100)
    assert chain.handle(Packet(100, 3, bytes([65, 0, 0]))) == []
    assert chain.handle(Packet(100, 3, bytes([36, 0, 44, 1]))) == []  # PWM Limit is EEPROM
    assert chain.handle(Packet(100, 1)) == []
    assert chain.handle(Packet(100, 6, b"\xff")) == []
    assert [(s.get("led"), s.get("pwm_limit"), s.get("secondary_id")) for s in (first, second)] == [(0, 885, 100)] * 2
    chain.handle(Packet(254, 0x83, bytes([65, 0, 1, 0, 100, 1])))  # a sync write reaches them, too
    assert (first.get("led"), second.get("led")) == (1, 1)
    put(first, "secondary_id", 253)  # off
    chain.handle(Packet(253, 3, bytes([65, 0, 0])))
    assert first.get("led") == 1
