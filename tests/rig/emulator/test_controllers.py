"""The controllers of a servo: what the manual states of their output, its bounds, and what the registers show of it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from servos import put, servo

from whiptool.rig.emulator.motion_profile import ACCELERATION, VELOCITY
from whiptool.rig.emulator.servo import Servo

FULL = 12.0 / 885  # [V] of one count of PWM
GOAL_OF = {
    0: "goal_current",
    1: "goal_velocity",
    3: "goal_position",
    4: "goal_position",
    5: "goal_position",
    16: "goal_pwm",
}
FAR = {0: 1193, 1: 200, 3: 4095, 4: 100_000, 5: 100_000, 16: 885}  # goals that ask for all there is


def on(mode: int, **registers: int) -> Servo:
    """A servo in a mode, its torque on, with these registers set in this order."""
    s = servo()
    s.feel(0.0, 0.0, 0.0, 0.0)
    put(s, "operating_mode", mode)
    eeprom = {name: value for name, value in registers.items() if name.endswith(("limit", "drive_mode"))}
    for name, value in [*eeprom.items(), ("torque_enable", 1), *registers.items()]:
        if name not in eeprom or not s.torque_on:
            assert put(s, name, value) == 0, name
    return s


def turning(s: Servo, seconds: float, *, inertia: float = 0.01, load: float = 0.0) -> Iterator[float]:
    """Turn a disc of this inertia [kg m2] against a constant load [N m]; yield the time every millisecond [s]."""
    q, v, h, t = s.q, s.v, 1e-4, 0.0
    for step in range(round(seconds / h)):
        if step % 10 == 0:
            s.q, s.v = q, v
            s.control()
        current = s.motor.current(s.drive()[0], v, *s.drive()[1:]) if s.torque_on else 0.0
        v += h * (s.motor.torque(current, v) - load) / inertia
        q += h * v
        t += h
        if step % 10 == 9:
            s.feel(q, v, current, t)
            s.age(10 * h)
            yield t


# -- output and its bounds -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gain", "error"), [(800, 100), (640, -60), (1600, 10)])
def test_the_position_controller_has_the_manuals_gain(gain, error):
    s = on(3, position_p_gain=gain, goal_position=2048 + error)
    s.control()
    current, low, high = s.drive()
    assert low == high == pytest.approx(gain / 128 * error * FULL)
    assert current == 0


def test_integral_and_derivative_have_the_manuals_gains():
    s = on(3, position_p_gain=0, position_i_gain=6553, goal_position=2048 + 100)
    for k in range(1, 6):
        s.control()
        assert s.drive()[1] == pytest.approx(k * 6553 / 65_536 * 100 * FULL)
    s = on(3, position_p_gain=0, position_d_gain=16, goal_position=2048 + 100)
    s.control()
    s.feel(40.2 * s.units.position, 0, 0, 0)
    s.control()
    assert s.drive()[1] == pytest.approx(-40 * FULL)


def test_the_velocity_controller_has_the_manuals_gains():
    s = on(1, goal_velocity=100)
    for k in range(1, 11):
        s.control()
        assert s.drive()[1] == pytest.approx((100 / 128 + k * 1920 / 65_536) * 100 * FULL)


@pytest.mark.parametrize("mode", GOAL_OF)
@pytest.mark.parametrize("by", ["goal_pwm", "pwm_limit", "both"])
def test_goal_pwm_and_pwm_limit_bound_the_output_of_every_mode(mode, by):
    bounds = {"goal_pwm": {"goal_pwm": 177}, "pwm_limit": {"pwm_limit": 177}}
    registers = bounds.get(by, {"pwm_limit": 300, "goal_pwm": 177})
    if mode == 16:
        registers = {"pwm_limit": 177}
    goal = {GOAL_OF[mode]: min(FAR[mode], 177) if mode == 16 else FAR[mode]}
    s = on(mode, **registers, **goal)
    for _ in range(300):
        s.control()
    current = s.motor.current(s.drive()[0], 0.0, *s.drive()[1:])  # of a motor that is held
    assert current == pytest.approx(0.2 * 12 / s.motor.resistance)
    s.feel(0.0, 0.0, current, 1.0)
    assert s.get("present_pwm") == 177
    if mode not in (0, 16):
        put(s, "goal_pwm", 0)
        assert s.motor.current(s.drive()[0], 0.0, *s.drive()[1:]) == 0


def test_current_mode_is_exact_as_far_as_the_voltage_gives_it():
    s = on(0, goal_current=200)
    for speed in (0.0, 2.0, -4.0):
        assert s.motor.current(s.drive()[0], speed, *s.drive()[1:]) == pytest.approx(200 * 2.69e-3)
    assert s.motor.current(s.drive()[0], 4.5, *s.drive()[1:]) < 200 * 2.69e-3


def test_goal_current_bounds_the_current_in_current_based_position_mode():
    s = on(5, goal_current=100, goal_position=4000)
    s.control()
    assert s.drive()[0] == pytest.approx(0.269)
    put(s, "goal_position", 2048 + 8)
    s.control()
    assert s.drive()[0] == pytest.approx(8 * 800 / 128 * 2.69e-3)


def test_pwm_mode_turns_as_fast_as_its_voltage():
    s = on(16, goal_pwm=-443)
    for _ in turning(s, 0.5):
        pass
    assert s.get("present_velocity") == pytest.approx(-443 / 885 * 46 / 0.229, abs=1.5)
    assert s.get("present_pwm") == -443


def test_reverse_mode_turns_the_other_way():
    s = on(4, drive_mode=1, goal_position=2500)
    for _ in turning(s, 1.0):
        pass
    assert s.q == pytest.approx(-452 * 2 * math.pi / 4096, abs=0.01)
    assert s.get("present_position") == pytest.approx(2500, abs=6)
    s = on(0, drive_mode=1, goal_current=100)
    assert s.drive()[0] == pytest.approx(-0.269)


# -- profiles, and what the registers show -----------------------------------------------------------------------------


def test_a_velocity_based_profile_is_moved_along_and_shown():
    v, a, distance = 100, 20, 1000
    s = on(3, profile_acceleration=a, profile_velocity=v, goal_position=2048 + distance)
    top, acceleration = v * VELOCITY, a * ACCELERATION
    rise, whole = top / acceleration, distance / top + top / acceleration
    shown = []
    for t in turning(s, whole + 0.3):
        left = whole - t
        if t < rise:
            p, speed = acceleration * t**2 / 2, acceleration * t
        elif left < rise:
            p, speed = distance - acceleration * max(left, 0) ** 2 / 2, acceleration * max(left, 0)
        else:
            p, speed = top * (t - rise / 2), top
        assert s.get("position_trajectory") == pytest.approx(2048 + p, abs=2)
        assert s.get("velocity_trajectory") == pytest.approx(speed / VELOCITY, abs=1)
        shown.append((t, s.get("moving"), s.get("moving_status"), s.get("present_position")))
    for t, moving, status, _ in shown:
        if t < whole - 0.002:
            assert moving == 1
            assert status & 0b110010 == 0b110010, t  # trapezoidal, in progress
        elif t > whole + 0.002:
            assert status & 0b10 == 0
    assert shown[100][2] & 0b1001 == 0  # following, and not there yet
    assert shown[-1][1:3] == (0, 0b110001)
    assert abs(shown[-1][3] - 2048 - distance) <= 3
    path = np.array([(t, p) for t, _, _, p in shown])
    lag = path[:, 1] - np.interp(path[:, 0], [rise / 2, whole - rise / 2], [2048, 2048 + distance])
    # with a proportional gain alone the error drives the speed: 885 PWM are 46 rev/min
    assert lag[len(path) // 2] == pytest.approx(-v * 0.229 / 46 * 885 / (800 / 128), rel=0.05)


def test_a_time_based_profile_takes_its_time_and_a_step_none():
    s = on(4, drive_mode=4, profile_acceleration=100, profile_velocity=600, goal_position=3048)
    times = [t for t in turning(s, 1.0) if s.get("moving_status") & 2]
    assert times[-1] == pytest.approx(0.6, abs=0.0021)
    assert s.get("present_position") == pytest.approx(3048, abs=3)
    s = on(4, goal_position=2148)
    assert s.get("moving_status") == 0
    s.control()
    s.feel(0, 0, 0, 0)
    assert (s.get("position_trajectory"), s.get("velocity_trajectory"), s.get("moving_status")) == (2148, 0, 0)


def test_a_servo_that_is_held_no_longer_follows():
    s = on(3, profile_velocity=100, goal_position=3000)
    for _ in range(200):
        s.control()
    s.feel(0, 0, 0, 0)
    assert s.get("moving_status") & 0b1001 == 0b1000
    assert s.get("moving") == 1  # while a profile is in progress, whatever the velocity


def test_velocity_mode_reaches_its_goal_on_its_ramp():
    s = on(1, profile_acceleration=30, goal_velocity=150)
    for t in turning(s, 3.0):
        assert s.get("velocity_trajectory") == pytest.approx(min(150, 150 * t / (0.064 * 150 / 30)), abs=1)
    assert s.get("present_velocity") == pytest.approx(150, abs=1)  # "equal to Goal Velocity"
    assert s.get("moving") == 1


def test_moving_is_by_the_threshold():
    s = servo()
    assert put(s, "moving_threshold", 20) == 0
    for speed, moving in ((19, 0), (20, 0), (21, 1), (-21, 1)):
        s.feel(0.0, speed * s.units.velocity, 0.0, 0.0)
        assert s.get("moving") == moving, speed


def test_without_torque_nothing_is_driven_or_planned():
    s = servo()
    put(s, "profile_velocity", 50)
    put(s, "goal_position", 3000)
    for _ in range(5):
        s.control()
    s.feel(0.0, 0.0, 0.0, 0.0)
    assert s.drive() == (0, 0, 0)
    shown = [s.get(x) for x in ("present_pwm", "moving", "moving_status", "position_trajectory", "velocity_trajectory")]
    assert shown == [0, 0, 0, 2048, 0]
