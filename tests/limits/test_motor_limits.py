"""A motor's speed-torque line: what it gives, what a state and a strike use of it, by hand and by definition."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.limits.motor_limits import XM430, MotorLimits, limits_preset
from whiptool.models.trajectory import Approach, Trajectory

MOTOR = MotorLimits("toy", stall_torque=2.0, no_load_speed=10.0, stall_current=4.0)


def trajectory(v: np.ndarray, tau: np.ndarray, diverged: bool = False) -> Trajectory:
    """Of an arm of as many joints as tau has columns, with whip joints that turn at 1000 rad/s."""
    T, a = tau.shape
    none = np.zeros((T, a))
    whip = np.full((T, 3), 1000.0)
    return Trajectory(
        t=0.01 * np.arange(T),
        q=np.zeros((T, a + 3)),
        v=np.hstack([v, whip]),
        q_d=none,
        v_d=none,
        tau=tau,
        K=np.zeros((T, a, a)),
        B=np.zeros((T, a, a)),
        tip=np.zeros((T, 2)),
        tip_velocity=np.zeros((T, 2)),
        diverged=diverged,
    )


@pytest.mark.parametrize(
    ("v", "direction", "torque"),
    [(0, 1, 2.0), (5, 1, 1.0), (10, 1, 0.0), (15, 1, -1.0), (-5, 1, 2.0), (5, -1, 2.0), (-5, -1, 1.0), (-15, -1, -1.0)],
)
def test_what_a_motor_gives(v, direction, torque):
    assert MOTOR.available(np.array(float(v)), np.array(float(direction))) == pytest.approx(torque)


@pytest.mark.parametrize(
    ("v", "tau", "used"),
    [
        (0, 1, 0.5), (0, -2, 1.0), (5, 1, 1.0), (5, 2, 1.5), (-5, -1, 1.0), (-5, 1, 0.5), (5, -2, 1.0), (-5, 0.2, 0.5),
        (12, 0, 1.2), (-12, 0.1, 1.2), (10, -2, 1.0), (0, 0, 0.0),
    ],
)  # fmt: skip
def test_what_a_state_uses(v, tau, used):
    assert MOTOR.usage(np.array(float(v)), np.array(float(tau))) == pytest.approx(used)


def test_usage_is_one_exactly_where_the_motor_gives_no_more():
    """Over many speeds below the no-load speed: the largest torque that is available is the largest within the line."""
    for v in np.linspace(-9.9, 9.9, 45):
        for direction in (-1.0, 1.0):
            most = float(MOTOR.available(np.array(v), np.array(direction)))
            assert MOTOR.usage(np.array(v), np.array(direction * most * 0.999)) < 1
            assert MOTOR.usage(np.array(v), np.array(direction * most * 1.001)) > 1


def test_a_strike_is_judged_by_its_worst_instant_and_joint():
    v = np.array([[0.0, 0.0], [5.0, -5.0], [0.0, 2.0]])
    tau = np.array([[1.0, 0.0], [0.5, 1.5], [0.0, -1.8]])
    assert MOTOR.violation(trajectory(v, tau)) == pytest.approx(0.9 - 1)  # braking at -1.8 N m
    assert MOTOR.keeping_free(0.2).violation(trajectory(v, tau)) == pytest.approx(0.9 / 0.8 - 1)
    assert MOTOR.violation(trajectory(v, tau * [1, -1])) == pytest.approx(0.5 + 0.75 - 1)
    assert MOTOR.violation(trajectory(v, tau, diverged=True)) == np.inf


def test_peaks_add_largest_speed_and_torque():
    near = Approach(
        distance=np.zeros(4),
        time=np.zeros(4),
        velocity=np.zeros((4, 2)),
        tip=np.zeros((4, 2)),
        max_joint_speed=np.array([[1.0, 2.0], [3.0, 8.0], [0.0, 0.0], [0.0, np.nan]]),
        max_torque=np.array([[1.0, 0.5], [0.2, 1.0], [0.0, 0.0], [0.0, 0.0]]),
        diverged=np.array([False, False, True, False]),
    )
    np.testing.assert_allclose(MOTOR.violation_of_peaks(near), [0.6 - 1, 1.3 - 1, np.inf, np.inf])
    np.testing.assert_allclose(MOTOR.keeping_free(0.3).violation_of_peaks(near)[:2], [0.6 / 0.7 - 1, 1.3 / 0.7 - 1])


def test_peaks_are_never_below_the_strike_itself():
    rng = np.random.default_rng(0)
    for _ in range(200):
        v, tau = rng.normal(0, 4, (5, 2)), rng.normal(0, 1, (5, 2))
        near = Approach(
            *(np.zeros(1), np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2))),
            max_joint_speed=np.abs(v).max(axis=0)[None],
            max_torque=np.abs(tau).max(axis=0)[None],
            diverged=np.array([False]),
        )
        assert MOTOR.violation_of_peaks(near)[0] >= MOTOR.violation(trajectory(v, tau)) - 1e-12


def test_the_worst_instant_in_words():
    v, tau = np.array([[0.0, 0.0], [5.0, -5.0]]), np.array([[1.0, 0.0], [0.5, -1.5]])
    said = MOTOR.explain(trajectory(v, tau), ("shoulder", "elbow"))
    assert said == ("at 0.010 s the elbow turns at -5.00 rad/s and asks for -1.50 N m, where the toy gives 1.00 N m")
    fast = MOTOR.explain(trajectory(3 * v, tau), ("shoulder", "elbow"))
    assert fast.endswith("the toy gives 0.00 N m")


def test_the_makers_figures():
    """https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/: at 12 V 4.1 N m at 2.3 A, 46 rev/min."""
    assert (XM430.stall_torque, XM430.stall_current) == (4.1, 2.3)
    assert XM430.no_load_speed / (2 * np.pi) * 60 == pytest.approx(46)
    assert XM430.torque_constant == pytest.approx(4.1 / 2.3)
    assert limits_preset("xm430") is XM430
    with pytest.raises(InputError, match="xm430"):
        limits_preset("mx28")
    for name in ("stall_torque", "no_load_speed", "stall_current"):
        with pytest.raises(InputError, match=name):
            dataclasses.replace(MOTOR, **{name: 0.0})


def test_what_is_kept_free_of_the_line_is_the_margin():
    rng = np.random.default_rng(0)
    v, tau = rng.uniform(-5, 5, (2, 40)), rng.uniform(-5, 5, (2, 40))
    left = XM430.keeping_free(0.2)
    np.testing.assert_allclose(left.usage(v, tau), XM430.usage(v, tau) / 0.8)
    assert left.torque_constant == pytest.approx(XM430.torque_constant)
