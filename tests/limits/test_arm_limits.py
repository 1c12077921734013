"""Limits of joints and motors: usage by hand, peaks against whole strikes, changes of torques."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from whiptool.commands.strike_lines import limit_lines, limits_table
from whiptool.errors import InputError
from whiptool.limits.all_limits import AllLimits
from whiptool.limits.arm_limits import XM430, ArmLimits, MotorLimits, limits_preset, torque_rates, unlimited
from whiptool.models import JointLimits, Strike, preset
from whiptool.models.joint_trajectory import free_hand
from whiptool.models.trajectory import Approach, Trajectory


def test_even_changes_have_their_rate_at_any_step():
    for step in (2.5e-4, 1e-3, 1.5e-3):
        t = np.arange(0, 0.3, step)
        at, rates = torque_rates(t, np.stack([40 * t, 3 - 700 * t], axis=1))
        np.testing.assert_allclose(rates, np.tile([40, -700], (len(at), 1)), rtol=1e-9)
        np.testing.assert_allclose(np.diff(at), 1e-3)
        assert at[-1] <= t[-1] + 1e-12


def test_a_step_is_one_change_within_a_millisecond():
    t = np.arange(0, 0.02, 2.5e-4)
    _, rates = torque_rates(t, np.where(t < 0.0101, 1.0, 3.0)[:, None])
    assert np.count_nonzero(rates) == 1
    np.testing.assert_allclose(rates.max(), 2000)


def test_a_strike_that_broke_off_at_once_has_none():
    assert torque_rates(np.zeros(1), np.zeros((1, 2)))[1].shape == (0, 2)


def test_limits_that_an_arm_lacks_are_named_where_a_strike_is_within_the_others():
    arm = preset("ur5e").arm.in_space()
    assert ArmLimits.of(arm, keep_free=0.1).words == "the arm's limits, 10% of them kept free"
    slow = [dataclasses.replace(x, limits=dataclasses.replace(x.limits, velocity=math.inf)) for x in arm.links]
    turning = dataclasses.replace(slow[-1], limits=JointLimits(torque=9.0))
    words = ArmLimits.of(dataclasses.replace(arm, links=(*slow[:-1], turning))).words
    assert words == (
        "the arm's limits (it has none for the speed of all joints, the position of wrist_3; "
        "arm.limits in a model file gives them)"
    )
    limits = ArmLimits.of(dataclasses.replace(arm, links=(*arm.links[:-1], slow[-1])))
    assert unlimited(limits.joints, arm.joints) == {"speed": [arm.joints[-1]]}
    trajectory = path(np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 6)))
    table = limits_table(AllLimits([limits]), trajectory, Strike((0.0,) * 6, (0.1,) * 6, 1.0), arm)
    assert table["unlimited"] == {"speed": [arm.joints[-1]]}
    assert f"(it has none for the speed of {arm.joints[-1]}; " in limit_lines(AllLimits([limits]), table)[0]


TURNS = JointLimits(position=(-1.0, 3.0), velocity=2.0, torque=10.0)
SPINS = JointLimits(velocity=4.0)  # for ever
SLIDES = JointLimits(position=(0.0, math.inf), torque=5.0)
LIMITS = ArmLimits((TURNS, SPINS, SLIDES), slides=(2,))
REST = np.array([[1.0, 0.0, 1.0]])


def usage(q=(1.0, 0.0, 1.0), v=(0.0, 0.0, 0.0), tau=(0.0, 0.0, 0.0)) -> np.ndarray:
    return LIMITS.usage(np.array(q), np.array(v), np.array(tau))


def path(q=REST, v=0 * REST, tau=0 * REST, *, diverged: bool = False) -> Trajectory:
    """A trajectory of these states, behind whose arm whip joints are far away and turn fast."""
    T = len(q)
    whip, gains, tip = np.full((T, 4), 1e3), np.zeros((T, 3, 3)), np.zeros((T, 3))
    arm = np.broadcast_to(v, q.shape), np.broadcast_to(tau, q.shape)
    whole = np.hstack([q, whip]), np.hstack([arm[0], whip])
    return Trajectory(np.arange(T) / 100, *whole, q, arm[0], arm[1], gains, gains, tip, tip, diverged)


def test_what_states_use_of_limits():
    assert usage().max() == 0  # in the middle of the one range, at rest
    np.testing.assert_allclose(usage(q=(2.5, 99.0, -0.25))[0], [0.75, 0, 1.25])
    np.testing.assert_allclose(usage(q=(-1.5, 0.0, 99.0))[0], [1.25, 0, 0])
    np.testing.assert_allclose(usage(v=(-1.0, -6.0, 99.0))[1], [0.5, 1.5, 0])
    np.testing.assert_allclose(usage(tau=(-12.0, 99.0, 2.0))[2], [1.2, 0, 0.4])


def test_a_strike_is_judged_by_its_worst_instant_and_its_peaks_say_the_same():
    rng = np.random.default_rng(0)
    for _ in range(50):
        q, v, tau = REST + rng.normal(0, 1, (6, 3)), rng.normal(0, 1.5, (6, 3)), rng.normal(0, 3, (6, 3))
        strike = path(q, v, tau)
        worst = LIMITS.usage(q, v, tau).max() - 1
        assert LIMITS.violation(strike) == pytest.approx(worst)
        near = strike.approach(np.zeros(3))
        assert LIMITS.violation_of_peaks(near) == pytest.approx([worst])
    assert LIMITS.violation(path(diverged=True)) == np.inf
    assert LIMITS.violation_of_peaks(path(diverged=True).approach(np.zeros(3))) == [np.inf]


def test_unknown_positions_are_no_alibi():
    near: Approach = dataclasses.replace(path(np.repeat(REST, 2, axis=0)).approach(np.zeros(3)), positions=None)
    assert LIMITS.violation_of_peaks(near) == [np.inf]
    free = ArmLimits((JointLimits(velocity=1.0), JointLimits(), JointLimits()))
    assert free.violation_of_peaks(near) == [-1.0]


@pytest.mark.parametrize(
    ("states", "said"),
    [
        ({"q": REST - [[0, 0, 0], [3, 0, 0]]},
         "at 0.010 s the position of a is -2.00 rad; its limit is -1.00 to 3.00 rad"),
        ({"q": REST - [[0, 0, 4]]}, "at 0.000 s the position of c is -3.00 m; its limit is 0.00 to inf m"),
        ({"v": np.array([[1.0, -5, 0]])}, "at 0.000 s the velocity of b is -5.00 rad/s; its limit is 4.00 rad/s"),
        ({"tau": np.array([[1.0, 0, 6]])}, "at 0.000 s the force of c is +6.00 N; its limit is 5.00 N"),
    ],
)  # fmt: skip
def test_the_worst_instant_in_words(states, said):
    assert str(LIMITS.explain(path(**states), ("a", "b", "c"))) == said


def test_arms_have_limits_or_none():
    ur5e = ArmLimits.of(preset("ur5e").arm)
    assert [joint.torque for joint in ur5e.joints] == [150, 150, 150, 28, 28, 28]
    for name in ("lemon2024", "nah2023"):
        with pytest.raises(InputError, match="limits: got 'an arm whose joints have no limits'; allowed: an arm"):
            ArmLimits.of(preset(name).arm)


def test_the_change_of_torque_is_judged_on_whole_strikes_alone():
    limited = ArmLimits((JointLimits(torque=10.0, torque_rate=400.0), JointLimits(), JointLimits()))
    t = np.arange(0, 0.2, 0.01)[:, None]  # as `path` has them
    tau = np.hstack([np.clip(6 - 550 * (t - 0.12), -4, 50 * t), 1e4 * t, 0 * t])
    strike = path(np.repeat(REST, 20, axis=0)[:20], 0 * tau, tau)
    assert limited.of_candidates
    assert not LIMITS.of_candidates
    assert limited.violation(strike) == pytest.approx(550 / 400 - 1)
    peak = np.abs(tau[:, 0]).max()
    assert limited.violation_of_peaks(strike.approach(np.zeros(3))) == pytest.approx([peak / 10 - 1])
    said = str(limited.explain(strike, ("a", "b", "c")))
    assert said == "at 0.121 s the torque of a changes by -550 N m/s; its limit is 400 N m/s"
    sliding = str(dataclasses.replace(limited, slides=(0,)).explain(strike, ("a", "b", "c")))
    assert sliding == "at 0.121 s the force of a changes by -550 N/s; its limit is 400 N/s"


def test_limits_of_an_arm_know_which_of_its_joints_slide():
    hand = free_hand(np.eye(3))
    limits = ArmLimits.of(hand)
    assert limits.slides == limits.command.slides == (0, 1, 2)
    assert ArmLimits.of(preset("panda").arm).slides == ()


def test_what_is_kept_free_is_a_part_of_every_limit():
    """Of magnitudes the same part of each, of a range its middle."""
    arm = preset("panda").arm
    whole, left = ArmLimits.of(arm), ArmLimits.of(arm, keep_free=0.2)
    assert left.words == "the arm's limits, 20% of them kept free"
    for name in ("velocity", "acceleration", "jerk", "torque", "torque_rate"):
        ratio = [getattr(b, name) / getattr(a, name) for a, b in zip(whole.joints, left.joints, strict=True)]
        assert ratio == pytest.approx([0.8] * 7)
    middles, spans = (np.mean(whole.positions, axis=0), np.ptp(whole.positions, axis=0))
    np.testing.assert_allclose(np.mean(left.positions, axis=0), middles)
    np.testing.assert_allclose(np.ptp(left.positions, axis=0), 0.8 * spans)
    assert JointLimits((0.0, math.inf)).keeping_free(0.5) == JointLimits((0.0, math.inf))
    for share in (1.0, -0.1, math.nan):
        with pytest.raises(InputError, match="keep free: got"):
            ArmLimits.of(arm, keep_free=share)


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


def test_the_worst_instant_of_motors_in_words():
    v, tau = np.array([[0.0, 0.0], [5.0, -5.0]]), np.array([[1.0, 0.0], [0.5, -1.5]])
    said = str(MOTOR.explain(trajectory(v, tau), ("shoulder", "elbow")))
    assert said == ("at 0.010 s the elbow turns at -5.00 rad/s and asks for -1.50 N m, where the toy gives 1.00 N m")
    fast = str(MOTOR.explain(trajectory(3 * v, tau), ("shoulder", "elbow")))
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
