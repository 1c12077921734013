"""Limits of what is commanded: closed forms against derivatives of sampled paths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.limits import CommandLimits
from whiptool.models import JointLimits, Strike, default_bounds, preset

SLOW = JointLimits(velocity=2.0, acceleration=9.0, jerk=200.0)
BRISK = JointLimits(acceleration=4.0)
LIMITS = CommandLimits((SLOW, BRISK, JointLimits()), share=0.8)  # of the velocity, that searches command


def strikes(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.hstack([rng.uniform(-2, 2, (count, 6)), rng.uniform(0.3, 1.5, (count, 1))])


def test_what_is_used_is_what_differences_of_the_reference_say():
    for vector in strikes(10):
        strike = Strike.from_vector(vector)
        t = np.linspace(0, strike.D, 20_001)
        _, _, a = strike.reference(t)
        jerk = np.abs(np.diff(a, axis=0)).max(axis=0) / (t[1] - t[0])
        expected = [np.zeros(3), np.abs(a).max(axis=0) / (9, 4, math.inf), jerk / (200, math.inf, math.inf)]
        np.testing.assert_allclose(LIMITS.usage(vector[None])[0], expected, rtol=1e-3)


def test_shortened_strikes_are_at_their_limits_and_others_stay():
    wild = strikes(200)
    tame = LIMITS.shortened(wild)
    np.testing.assert_array_equal(tame[:, [0, 1, 2, 6]], wild[:, [0, 1, 2, 6]])
    assert (LIMITS.violation(wild) > 0).any()
    assert (LIMITS.violation(tame) <= 0).all()
    speeds = [np.abs(Strike.from_vector(x).reference(np.array([x[-1] / 2]))[1][0]) for x in tame]
    used = np.c_[np.array(speeds)[:, 0] / (0.8 * 2), LIMITS.usage(tame)[:, 1, :2], LIMITS.usage(tame)[:, 2, 0]]
    changed = (tame[:, 3:5] != wild[:, 3:5]).T
    np.testing.assert_allclose(used[changed[0]][:, [0, 1, 3]].max(axis=1), 1, rtol=2e-6)
    np.testing.assert_allclose(used[changed[1]][:, 2], 1, rtol=2e-6)
    assert (used <= 1 + 1e-12).all()
    np.testing.assert_array_equal(tame[:, 5], wild[:, 5])


def test_constraints_say_the_same_and_have_exact_derivatives():
    for vector in strikes(20):
        values, slopes = LIMITS.constraints(vector)
        assert values.shape == (8,)  # four limits, to both sides
        tame = (LIMITS.shortened(vector[None])[0] == vector).all()
        assert (values <= 0).all() == tame
        differences = [
            (LIMITS.constraints(vector + e)[0] - LIMITS.constraints(vector - e)[0]) / 2e-6 for e in 1e-6 * np.eye(7)
        ]
        np.testing.assert_allclose(slopes, np.transpose(differences), atol=1e-7 * np.abs(slopes).max())


def test_the_panda_has_its_maker_s_limits_and_the_ur5e_none_of_acceleration():
    panda = ArmLimits.of(preset("panda").arm).command
    assert panda.largest[1] == pytest.approx([15, 7.5, 10, 12.5, 15, 20, 20], rel=1e-5)
    assert panda.largest[2] == pytest.approx([7500, 3750, 5000, 6250, 7500, 10000, 10000], rel=1e-5)
    # libfranka's reserve: what the largest accelerations add in three lost packets, and 0.001 rad/s
    reserve = 1e-3 + 3e-3 * np.array([15, 7.5, 10, 12.5, 15, 20, 20])
    assert panda.largest[0] == pytest.approx(0.9 * (np.array([2.175] * 4 + [2.61] * 3) - reserve))
    ur5e = preset("ur5e").arm
    assert not np.isfinite(ArmLimits.of(ur5e).command.largest[1:]).any()
    assert ArmLimits.of(ur5e, prescribed=True).command.largest[0] == pytest.approx([math.pi] * 6, rel=2e-6)
    quick = default_bounds(ur5e).sample(np.random.default_rng(0), 10)
    assert (ArmLimits.of(ur5e).command.violation(quick) <= 0).all()


def test_in_words():
    strike = np.array([0.0, 0, 0, 0.5, 1.0, 0, 1.0])
    said = "the acceleration of b is commanded up to 5.77 {0}; its limit is 4 {0}"
    assert str(LIMITS.explain(strike, "abc")) == said.format("rad/s^2")
    sliding = CommandLimits(LIMITS.joints, slides=(1,))
    assert str(sliding.explain(strike, "abc")) == said.format("m/s^2")


def test_what_is_kept_is_where_no_function_is_above_zero():
    some = strikes(60)
    some[:, 3:6] = some[:, :3] + 0.15 * (some[:, 3:6] - some[:, :3])
    expected = [(LIMITS.constraints(strike)[0] <= 0).all() for strike in some]
    assert 0 < sum(expected) < 60
    np.testing.assert_array_equal(LIMITS.kept(some), expected)
    assert LIMITS.kept(LIMITS.shortened(strikes(60))).all()
