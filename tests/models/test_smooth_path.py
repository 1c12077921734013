"""Movements within limits of velocity, acceleration and jerk: durations in closed form, limits, ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models.presets import FR3_ARM
from whiptool.models.smooth_path import ACCELERATION, BRAKING, BRAKING_JERK, JERK, SPEED, path_between, path_to_rest
from whiptool.models.spatial_arm import JointLimits

FREE = JointLimits()
QUICK, SLOW = JointLimits((-3, 3), 2.0, 5.0, 60.0), JointLimits((-3, 3), 0.5, 4.0, 30.0)


def jerks(a: np.ndarray, rate: float) -> np.ndarray:
    return np.abs(np.diff(a, axis=0)).max(axis=0) * rate


def test_a_long_movement_lasts_as_long_as_its_seven_phases():
    """With all limits reached, span / v + v / a + a / j, rounded up to a sample."""
    q, v, a = path_between([0.0], [2.0], [QUICK], 1000.0, share=0.3)
    limits = 0.3 * 2.0, 0.3 * 5.0, 0.3 * 60.0
    expected = 2.0 / limits[0] + limits[0] / limits[1] + limits[1] / limits[2]
    assert len(q) - 1 == math.ceil(1000 * expected)
    for values, limit in ((np.abs(v).max(), limits[0]), (np.abs(a).max(), limits[1]), (jerks(a, 1000)[0], limits[2])):
        assert limit * 0.99 < values < limit * (1 + 1e-9)


def test_a_short_movement_lasts_as_long_as_its_jerks():
    """With only the jerk's limit reached, 4 (span / 2 j)^(1/3)."""
    q, _, _ = path_between([0.3], [0.301], [FREE], 10_000.0)
    assert (len(q) - 1) / 10_000 == pytest.approx(4 * (0.001 / 2 / JERK) ** (1 / 3), abs=1e-4)


@pytest.mark.parametrize("limits", [(QUICK, SLOW, FREE), (FREE, FREE, FREE), ()])
@pytest.mark.parametrize("end", [(1.0, -1.5, 2.0), (1.0, 0.0, 0.1), (0.5 + 1e-12, 0.2, 0.1)])
def test_joints_move_along_a_straight_line_within_their_limits(limits, end):
    start, rate = np.array([0.5, 0.2, 0.1]), 500.0
    q, v, a = path_between(start, end, limits, rate, share=0.5)
    np.testing.assert_array_equal(q[0], start)
    np.testing.assert_array_equal(q[-1], end)
    assert not v[[0, -1]].any()
    assert not a[-1].any()
    along = (q - start) @ (end - start) / max((end - start) @ (end - start), 1e-300)
    np.testing.assert_allclose(q, start + np.outer(along, end - start), atol=1e-12)
    of_joints = limits or (FREE,) * 3
    assert (np.abs(v).max(axis=0) <= [min(x.velocity / 2, SPEED) + 1e-9 for x in of_joints]).all()
    assert (np.abs(a).max(axis=0) <= [min(x.acceleration / 2, ACCELERATION) + 1e-9 for x in of_joints]).all()
    assert (jerks(a, rate) <= [min(x.jerk / 2, JERK) + 1e-6 for x in of_joints]).all()


@pytest.mark.parametrize("end", [(1.5, -1.0), (0.05, 0.02)])
def test_a_pendulum_hangs_still_after_a_movement_of_its_period(end):
    """A pendulum under a hand that moves by q, x'' = -w^2 x - q'', integrated: a fast movement leaves it swinging."""
    period, rate = 1.7, 1000.0
    left = []
    for sway in (0.0, period):
        q, v, a = path_between((0.0, 0.0), end, (FREE, FREE), rate, sway=sway)
        swing = np.exp(-2j * np.pi / period * np.arange(len(a)) / rate) @ a / rate  # its complex amplitude, times w
        left.append(np.abs(swing).max() * period / (2 * np.pi))
        assert not v[-1].any()
    assert left[1] < 1e-3 * np.abs(end).max()
    assert left[0] > 100 * left[1]
    v = min(SPEED / np.abs(end).max(), 1 / period)
    assert (len(q) - 1) / rate == pytest.approx(1 / v + period, rel=0.05)


def test_velocities_and_accelerations_of_movements_are_derivatives():
    for q, v, a in (
        path_between((0.0, 1.0), (1.0, 0.7), (QUICK, SLOW), 2000.0),
        path_to_rest((0.0, 1.0), (1.5, -0.3), (2.0, 1.0), (QUICK, SLOW), 2000.0),
    ):
        np.testing.assert_allclose(np.gradient(q, 1 / 2000, axis=0)[1:-1], v[1:-1], atol=2e-5)
        np.testing.assert_allclose(np.gradient(v, 1 / 2000, axis=0)[1:-1], a[1:-1], atol=60 / 2000)


def test_a_movement_is_slowed_down_to_whole_steps():
    """At 3 Hz it is that of 3000 Hz, at c times the speed."""
    coarse, fine = (path_between((0.0,), (0.95,), (QUICK,), rate) for rate in (3.0, 3000.0))
    t = np.arange(len(coarse[0])) / 3
    c = (len(fine[0]) - 1) / 3000 / t[-1]
    assert c < 0.98
    for derivative, (values, expected) in enumerate(zip(coarse, fine, strict=True)):
        at = np.interp(c * t, np.arange(len(expected)) / 3000, expected[:, 0])
        np.testing.assert_allclose(values[:, 0], c**derivative * at, atol=1e-3)


def test_equal_postures_are_one_sample_at_rest():
    q, v, a = path_between((0.1, 0.2), (0.1, 0.2), (), 500.0)
    np.testing.assert_array_equal(q, [[0.1, 0.2]])
    assert not v.any()
    assert not a.any()


def test_a_stop_lasts_as_long_as_braking_within_the_limits():
    """From a velocity without acceleration v / a + a / j, on the way half of v times that; each joint by itself."""
    q, v, a = path_to_rest((1.0, 0.0), (2.0, -0.1), (0.0, 0.0), (JointLimits(acceleration=8.0, jerk=100.0), FREE), 1e4)
    expected = 2.0 / 8 + 8 / 100
    assert (len(q) - 1) / 1e4 == pytest.approx(expected, abs=1e-4)
    np.testing.assert_allclose(q[-1], [1.0 + 2.0 * expected / 2, -0.1 * math.sqrt(0.1 / BRAKING_JERK)], atol=1e-6)
    assert not v[-1].any()
    assert not a[-1].any()
    assert (np.abs(a).max(axis=0) <= np.array([8.0, BRAKING]) * (1 + 1e-9)).all()
    assert (jerks(a, 1e4) <= np.array([100.0, BRAKING_JERK]) * (1 + 1e-6)).all()


def test_a_stop_begins_beyond_limits_where_the_motion_is():
    q, v, a = path_to_rest((0.5,), (3.0,), (20.0,), (JointLimits((-1, 1), 2.0, 5.0, 1000.0),), 1000.0)
    assert (q[0, 0], v[0, 0], a[0, 0]) == (0.5, 3.0, 20.0)
    assert np.abs(a[20:]).max() <= 5.0 + 1e-9
    assert q[-1, 0] > 1.0  # too near to the limit to brake
    assert len(path_to_rest((0.5,), (0.0,), (0.0,), (), 500.0)[0]) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (((0.0,), (0.0, 1.0), (), 500.0), "end posture: got"),
        (((0.0,), (math.nan,), (), 500.0), r"end posture\[0\]: got nan"),
        (((0.0,), (1.0,), (FREE, FREE), 500.0), "limits: got 'those of 2 joints'"),
        (((0.0,), (1.0,), (), 0.0), "rate: got"),
    ],
)
def test_bad_arguments_of_a_movement_are_named(arguments, said):
    with pytest.raises(InputError, match=f"^{said}"):
        path_between(*arguments)
    with pytest.raises(InputError, match=r"^share: got 0"):
        path_between((0.0,), (1.0,), (), 500.0, share=0)
    with pytest.raises(InputError, match=r"^velocities: got"):
        path_to_rest((0.0,), (1.0, 0.0), (0.0,), (), 500.0)


def test_a_movement_is_slowed_down_to_velocities_of_its_positions():
    """Near the ends of the FR3's joints, where a fifth of their largest velocities is too much."""
    limits = FR3_ARM.joint_limits
    start, end = np.zeros(7), np.array([0.2, 1.767, 0.0, -0.5, 0.0, 1.5, 0.0])
    start[[3, 5]] = -0.5, 1.5
    q, v, _ = path_between(start, end, limits, 1000.0)
    allowed = [joint.velocities(q[:, j]) for j, joint in enumerate(limits)]
    assert all((v[:, j] >= low).all() and (v[:, j] <= high).all() for j, (low, high) in enumerate(allowed))
    plain = len(path_between(start, end, [JointLimits(velocity=x.fastest) for x in limits], 1000.0)[0])
    assert plain < len(q) < 1.5 * plain
    start[1] = limits[1].position[0]  # where no velocity is allowed, so that nothing is gained by slowness
    assert len(path_between(start, end, limits, 1000.0)[0]) < 5 * plain
