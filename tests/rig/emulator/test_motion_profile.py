"""The profiles of a servo, against the manual's times, closed forms and a planner that was not written here."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig

from whiptool.rig.emulator.motion_profile import (
    ACCELERATION,
    RECTANGULAR,
    STEP,
    TRAPEZOIDAL,
    TRIANGULAR,
    VELOCITY,
    to_position,
    to_velocity,
)


def test_units_are_the_manuals():
    # 0.229 rev/min and 214.577 rev/min2, at 4096 counts a turn
    assert pytest.approx(0.229 * 4096 / 60) == VELOCITY
    assert pytest.approx(214.577 * 4096 / 3600) == ACCELERATION


def test_a_trapezoid_takes_the_manuals_times():
    # "t1 = 64 {V / A}", "t2 = 64 {dPos / V}", "t3 = t1 + t2" in ms; the 64 is rounded
    v, a, distance = 100, 20, 2000
    profile = to_position(1000, 0, 3000, velocity=v, acceleration=a, timed=False)
    t1, t2 = 0.064 * v / a, 0.064 * distance / v
    assert profile.kind == TRAPEZOIDAL
    assert profile.pieces[0][0] == pytest.approx(t1, rel=1e-3)
    assert profile.pieces[2][0] == pytest.approx(t1, rel=1e-3)
    assert profile.duration == pytest.approx(t1 + t2, rel=1e-3)
    # the closed form of a trapezoid, in counts and seconds
    top, acceleration = v * 15.63307, a * 244.14094
    rise, whole = top / acceleration, distance / top + top / acceleration
    for t in np.linspace(0, whole, 41):
        left = whole - t
        if t < rise:
            p, speed = acceleration * t**2 / 2, acceleration * t
        elif left < rise:
            p, speed = distance - acceleration * left**2 / 2, acceleration * left
        else:
            p, speed = top * (t - rise / 2), top
        assert profile.at(t)[:2] == pytest.approx((1000 + p, speed), rel=1e-4, abs=1e-2)
    assert profile.at(whole + 1) == (3000, 0, 0)


def test_a_short_way_is_a_triangle():
    profile = to_position(0, 0, -50, velocity=200, acceleration=10, timed=False)
    peak = np.sqrt(50 * 10 * ACCELERATION)
    assert profile.kind == TRIANGULAR
    assert peak < 200 * VELOCITY
    assert profile.at(profile.duration / 2)[:2] == pytest.approx((-25, -peak))


def test_without_acceleration_it_is_rectangular_and_without_velocity_a_step():
    profile = to_position(100, 0, 500, velocity=50, acceleration=0, timed=False)
    assert profile.kind == RECTANGULAR
    assert profile.duration == pytest.approx(0.064 * 400 / 50, rel=1e-3)
    assert profile.at(profile.duration / 4)[:2] == pytest.approx((200, 50 * VELOCITY))
    for acceleration in (0, 7):  # "V = 0: profile not used", whatever the acceleration
        step = to_position(100, 0, 500, velocity=0, acceleration=acceleration, timed=False)
        assert (step.kind, step.at(0)) == (STEP, (500, 0, 0))


@pytest.mark.parametrize(("total", "rising", "kind"), [(1000, 200, 3), (1000, 500, 2), (1000, 0, 1), (1000, 900, 2)])
def test_a_time_based_profile_takes_its_time(total, rising, kind):
    profile = to_position(0, 0, 1000, velocity=total, acceleration=rising, timed=True)
    t1 = min(rising, total / 2) / 1000  # "will not exceed 50 % of Profile Velocity"
    assert (profile.kind, profile.duration) == (kind, pytest.approx(1.0))
    top = 1000 / (1.0 - t1)
    assert profile.at(0.5)[:2] == pytest.approx((500, top))
    if t1:
        assert profile.at(t1 / 2)[:2] == pytest.approx((top * t1 / 8, top / 2))
    assert profile.at(1.0)[:2] == (1000, 0)


@pytest.mark.parametrize("timed", [False, True])
def test_a_new_goal_on_the_way_changes_the_velocity_without_a_jump(timed):
    rng = np.random.default_rng(0)
    for _ in range(200):
        p, goal = rng.uniform(-4000, 4000, 2)
        v = rng.uniform(-3000, 3000)
        velocity, acceleration = (
            int(rng.integers(1, 2000 if timed else 300)),
            int(rng.integers(1, 900 if timed else 100)),
        )
        profile = to_position(p, v, goal, velocity=velocity, acceleration=acceleration, timed=timed)
        t = np.append(np.cumsum([d for d, _ in profile.pieces]), 0)
        edges = [profile.at(max(x + e, 0.0)) for x in t for e in (-1e-12, 1e-12)]
        assert edges[-1][:2] == pytest.approx((p, v), abs=1e-3)
        for before, after in zip(edges[:-2:2], edges[1:-2:2], strict=True):
            assert before[:2] == pytest.approx(after[:2], abs=1e-3)  # the last one: at rest at the goal


def test_the_fastest_profile_is_another_planners():
    rng = np.random.default_rng(1)
    for _ in range(200):
        p, goal = rng.uniform(-4000, 4000, 2)
        velocity, acceleration = int(rng.integers(20, 300)), int(rng.integers(1, 100))
        v = float(rng.uniform(-1, 1)) * velocity * VELOCITY
        ours = to_position(p, v, goal, velocity=velocity, acceleration=acceleration, timed=False)
        asked = ruckig.InputParameter(1)
        # in turns, as it compares with an absolute tolerance
        asked.current_position, asked.current_velocity, asked.target_position = [p / 4096], [v / 4096], [goal / 4096]
        asked.max_velocity, asked.max_acceleration = [velocity * VELOCITY / 4096], [acceleration * ACCELERATION / 4096]
        theirs = ruckig.Trajectory(1)
        assert ruckig.Ruckig(1).calculate(asked, theirs) == ruckig.Result.Working
        assert ours.duration == pytest.approx(theirs.duration, rel=1e-6)
        for t in np.linspace(0, ours.duration, 11):
            (q,), (w,), _ = theirs.at_time(t)
            assert ours.at(t)[:2] == pytest.approx((4096 * q, 4096 * w), rel=1e-5, abs=1e-2)


def test_velocity_mode_accelerates_in_the_manuals_time():
    # "t1 = 64 {Goal Velocity / Profile Acceleration}", time-based: t1 = Profile Acceleration, in ms
    profile = to_velocity(0, 150 * VELOCITY, acceleration=30, timed=False)
    assert profile.duration == pytest.approx(0.064 * 150 / 30, rel=1e-3)
    assert profile.at(profile.duration / 3)[1] == pytest.approx(50 * VELOCITY)
    assert profile.at(99)[1] == 150 * VELOCITY
    timed = to_velocity(20 * VELOCITY, -10 * VELOCITY, acceleration=300, timed=True)
    assert timed.duration == pytest.approx(0.3)
    assert timed.at(0.1)[1] == pytest.approx(10 * VELOCITY)
    assert to_velocity(0, 5, acceleration=0, timed=False).at(0)[1] == 5
