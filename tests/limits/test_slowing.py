"""Velocities that decrease towards the ends of joints: libfranka's numbers, sampled paths, and differences."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from robot_files import as_urdf

from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.limits import CommandLimits
from whiptool.models.files import read_robot
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.presets import FR3_ARM
from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import Strike, default_bounds
from whiptool.models.trajectory import Trajectory

FR3 = ArmLimits.of(FR3_ARM, prescribed=True)
LOW, HIGH = np.array([joint.position for joint in FR3_ARM.joint_limits]).T


def strikes(count: int, seed: int = 0) -> np.ndarray:
    return default_bounds(FR3_ARM).sample(np.random.default_rng(seed), count)


def test_the_fr3_has_the_velocities_of_libfranka():
    """`computeUpperLimitsJointVelocity` and `computeLowerLimitsJointVelocity` of its rate_limiting.h, as printed."""
    speeds = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
    offsets, twice = (0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35), (12.0, 5.17, 7.00, 8.00, 34.0, 11.0, 34.0)
    high = (2.75010, 1.79180, 2.90650, -0.1458, 2.81010, 4.52050, 3.01960)
    low = (-2.750100, -1.791800, -2.906500, -3.048100, -2.810100, 0.54092, -3.019600)
    for q in np.random.default_rng(0).uniform(LOW, HIGH, (100, 7)):
        for j, joint in enumerate(dataclasses.replace(x, position_margin=0.0) for x in FR3_ARM.joint_limits):
            upper = min(speeds[j], max(0.0, -offsets[j] + math.sqrt(max(0.0, twice[j] * (high[j] - q[j]))))) - 1e-3
            lower = max(-speeds[j], min(0.0, offsets[j] - math.sqrt(max(0.0, twice[j] * (q[j] - low[j]))))) + 1e-3
            assert joint.velocities(q[j]) == pytest.approx([min(lower, 0), max(upper, 0)], abs=1e-12)


def test_shortened_strikes_are_within_the_limits_and_at_one_of_them():
    """On paths of 1000 samples; a strike that was shortened comes within 1 % of a limit of some joint."""
    wild = strikes(100)
    tame = FR3.command.shortened(wild)
    assert (FR3.command.violation(wild) > 0).mean() > 0.8
    assert (FR3.command.violation(tame) <= 0).all()
    assert FR3.command.kept(tame).all()
    slowed = 0
    for before, vector in zip(wild, tame, strict=True):
        q, v, a = Strike.from_vector(vector).reference(np.linspace(0, vector[-1], 1001))
        for j, joint in enumerate(FR3_ARM.joint_limits):
            lowest, highest = joint.velocities(q[:, j])
            assert (v[:, j] <= highest + 1e-9).all()
            assert (v[:, j] >= lowest - 1e-9).all()
            if vector[7 + j] != before[7 + j] and np.abs(a[:, j]).max() < 9.9:
                near = np.minimum(highest - v[:, j], v[:, j] - lowest)[v[:, j] != 0]
                slowed += 1
                assert not len(near) or near.min() < 0.03
    assert slowed > 30


def test_constraints_have_exact_derivatives():
    for vector in FR3.command.shortened(strikes(10)) + 1e-3:
        values, slopes = FR3.command.constraints(vector)
        assert values.shape == (2 * 3 * 7 + 2 * 7,)
        differences = [
            (FR3.command.constraints(vector + e)[0] - FR3.command.constraints(vector - e)[0]) / 2e-6
            for e in 1e-6 * np.eye(15)
        ]
        np.testing.assert_allclose(slopes, np.transpose(differences), atol=1e-5 * np.abs(slopes).max())


def test_constraints_say_what_shortening_does():
    for vector in strikes(100):
        tame = (FR3.command.shortened(vector[None])[0] == vector).all()
        assert (FR3.command.constraints(vector)[0] <= 0).all() == tame
    assert (FR3.command.constraints(FR3.command.shortened(strikes(1))[0])[0] <= 1e-9).all()


def test_a_commanded_velocity_is_told_with_the_limit_at_its_position():
    vector = strikes(1)[0]
    vector[[3, 10, 14]] = -2.6, -0.3, 1.5
    vector[[0, 1, 2, 4, 5, 6]] = vector[[7, 8, 9, 11, 12, 13]] = 0.0, 0.0, 0.0, 0.0, 1.5, 0.0
    q, v, _ = Strike.from_vector(vector).reference(np.linspace(0, 1.5, 1000))
    excess = v[:, 3] - FR3_ARM.joint_limits[3].velocities(q[:, 3])[1]
    i = excess.argmax()
    assert excess[i] > 0
    said = str(FR3.command.explain(vector, FR3_ARM.joints))
    assert f"the velocity of joint4 is commanded to be {v[i, 3]:+.2f} rad/s at {q[i, 3]:+.2f} rad; its limit" in said


def test_a_motion_is_judged_by_its_positions():
    """A joint at 2 rad/s, which is allowed in the middle and too fast 0.2 rad before its end."""
    limits = ArmLimits((JointLimits((-2, 2), velocity=2.62, deceleration=6.0, velocity_offset=0.3),))
    assert limits.of_candidates

    def moving(q: float) -> Trajectory:
        zero, tip = np.zeros((2, 1)), np.zeros((2, 3))
        return Trajectory(np.array([0.0, 1e-3]), zero + q, zero + 2, zero, zero, zero, zero, zero, tip, tip)

    bound = math.sqrt(12 * 0.2) - 0.3
    assert limits.violation(moving(0.0)) == pytest.approx(2 / 2.62 - 1)
    assert limits.violation(moving(1.8)) == pytest.approx((2 - bound) / 2.62)
    assert "its limit is -2.62 to 1.25 rad/s at this position" in str(limits.explain(moving(1.8), ["elbow"]))


@pytest.mark.parametrize(("file", "share"), [(False, 0.0), (True, 0.0), (False, 0.2)])
def test_exported_samples_keep_the_limits(file, share, tmp_path):
    """Strikes at the limits, from postures anywhere, at the robot's 1 kHz: as given, and between samples.

    The limits are those of the preset, or of a URDF of the robot, which states no accelerations.
    """
    arm = FR3_ARM
    if file:
        (tmp_path / "fr3.urdf").write_text(as_urdf(FR3_ARM))
        arm = read_robot(tmp_path / "fr3.urdf")
    limits = ArmLimits.of(arm, prescribed=True, keep_free=share)
    rng, (low, high) = np.random.default_rng(1), limits.positions
    wild = strikes(8, seed=1)
    wild[:, :7] = np.clip(wild[:, :7], low, high)
    too_fast = 0
    for before, vector in zip(wild, limits.command.shortened(wild), strict=True):
        options = {"start": rng.uniform(low, high), "limits": limits.joints, "rate": 1000.0, "rest": 0.05}
        found = JointTrajectory.of_strike(Strike.from_vector(vector), FR3_ARM.names, **options)
        assert found.beyond(limits.joints) is None
        for j, joint in enumerate(FR3_ARM.joint_limits):
            lowest, highest = joint.velocities(found.q[:, j])
            assert (found.v[:, j] <= highest + 1e-9).all()
            assert (found.v[:, j] >= lowest - 1e-9).all()
        found = JointTrajectory.of_strike(Strike.from_vector(before), FR3_ARM.names, **options)
        too_fast += "its limit at this position" in str(found.beyond(limits.joints))
    assert share or not file or too_fast > 4  # with accelerations, most are beyond these first


def test_strikes_of_other_robots_are_shortened_as_before():
    """A deceleration without effect changes nothing."""
    plain = JointLimits((-9, 9), velocity=2.0, acceleration=9.0)
    braked = JointLimits((-9, 9), velocity=2.0, acceleration=9.0, deceleration=1e6)
    vectors = np.random.default_rng(0).uniform((-2, -2, 0.3), (2, 2, 1.5), (50, 3))
    one, other = (CommandLimits((joint,)).shortened(vectors) for joint in (plain, braked))
    np.testing.assert_allclose(one, other)
