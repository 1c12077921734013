"""A stick in the hand: against point masses along it, and the kinetic energy that they have."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from random_space import pinocchio_arm_of
from spatial_arms import ARMS, random_arm

from whiptool.errors import InputError
from whiptool.models import Model, WhipParameters
from whiptool.models.kinematics import arm_frames
from whiptool.models.robots import UR5E_ARM
from whiptool.models.stick import with_stick

WHIP = WhipParameters(N=1, l=0.1, m=0.01, k=0, b=0, joints="universal")


def test_a_stick_is_a_rigid_rod_at_the_hand():
    """Mass, static moment and inertia of many points, some of them along the stick."""
    rng = np.random.default_rng(4)
    arm = random_arm(2, rng)
    long = with_stick(arm, length=0.5, mass=0.2)
    hand, axes = np.array(arm.hand_position), np.array(arm.hand_rotation)
    np.testing.assert_allclose(long.hand_position, hand - 0.5 * axes[:, 2], atol=1e-15)
    np.testing.assert_array_equal(long.hand_rotation, arm.hand_rotation)
    before, after = arm.links[-1], long.links[-1]
    assert after.mass == pytest.approx(before.mass + 0.2)
    x, w = np.polynomial.legendre.leggauss(4)
    points, masses = hand - (0.25 * (1 + x))[:, None] * axes[:, 2], 0.2 * w / 2

    def about_joint(link):
        c = np.array(link.com)
        return link.inertia_matrix + link.mass * (c @ c * np.eye(3) - np.outer(c, c))

    rod = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    np.testing.assert_allclose(about_joint(after), about_joint(before) + rod, atol=1e-14)
    static = before.mass * np.array(before.com) + masses @ points
    np.testing.assert_allclose(after.mass * np.array(after.com), static, atol=1e-15)


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_kinetic_energy_is_more_by_that_of_the_stick_s_points(arm):
    """Of the arm in Pinocchio with and without, at any posture and speed; the last link may be massless."""
    arm = random_arm(rng=np.random.default_rng(5), **arm)
    long = with_stick(arm, length=0.7, mass=0.3)
    bare, held = (pinocchio_arm_of(Model(WHIP, x)) for x in (arm, long))
    x, w = np.polynomial.legendre.leggauss(3)
    rng = np.random.default_rng(6)
    for q, v in rng.uniform(-2, 2, (5, 2, arm.n)):
        hand = arm_frames(arm, q, v)[-1]
        speeds = np.array([hand.carried((0, 0, -0.35 * (1 + s))).velocity for s in x])  # along the hand's -z
        of_stick = 0.3 / 2 * w @ (speeds**2).sum(axis=1) / 2
        before, after = (pin.computeKineticEnergy(its, its.createData(), q, v) for its in (bare, held))
        assert after - before == pytest.approx(of_stick, rel=1e-9)


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_the_far_end_is_the_hand(arm):
    arm = random_arm(rng=np.random.default_rng(7), **arm)
    q, v = np.random.default_rng(8).uniform(-2, 2, (2, arm.n))
    ours = arm_frames(with_stick(arm, length=0.7, mass=0.3), q, v)[-1]
    end = arm_frames(arm, q, v)[-1].carried((0, 0, -0.7))
    for part in ("origin", "rotation", "velocity", "spin"):
        np.testing.assert_allclose(getattr(ours, part), getattr(end, part), atol=1e-14, err_msg=part)


def test_a_stick_without_mass_or_length():
    arm = random_arm(3, np.random.default_rng(9))
    assert with_stick(arm, length=0.5, mass=0.0).links[-1].mass == arm.links[-1].mass
    massless = random_arm(3, np.random.default_rng(9), massless=(2,))
    assert with_stick(massless, length=0.5, mass=0.0).links == massless.links
    grip = with_stick(massless, length=0.0, mass=0.2)  # a point mass at the hand
    assert grip.hand_position == massless.hand_position
    assert (grip.links[-1].mass, grip.links[-1].com) == (0.2, pytest.approx(massless.hand_position))
    assert not any(grip.links[-1].inertia)


@pytest.mark.parametrize(
    ("length", "mass", "message"),
    [(-1, 0.1, "stick length: got -1"), (0.5, -0.1, "stick mass: got -0.1"), (float("inf"), 0.1, "stick length"),
     (0.5, float("nan"), "stick mass"), ("long", 0.1, "stick length: got 'long'")],
)  # fmt: skip
def test_bad_sticks_are_named(length, mass, message):
    arm = random_arm(1, np.random.default_rng(0))
    with pytest.raises(InputError, match=f"^{message}"):
        with_stick(arm, length=length, mass=mass)


def test_the_stick_is_a_capsule_where_the_arm_has_any():
    bare, stick = UR5E_ARM, with_stick(UR5E_ARM, length=0.5, mass=0.1, radius=0.01)
    last = stick.links[-1].capsules[-1]
    assert len(stick.links[-1].capsules) == len(bare.links[-1].capsules) + 1
    assert (last.start, last.end, last.radius) == (bare.hand_position, stick.hand_position, 0.01)
    arm = random_arm(2, np.random.default_rng(0))
    assert not with_stick(arm, length=0.5, mass=0.1).links[-1].capsules
