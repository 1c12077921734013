"""Bases on walls and ceilings against turning by hand; sticks against bodies that are added up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from random_space import pinocchio_arm_of
from spatial_arms import ARMS, random_arm

from whiptool.commands.options.model_options import ModelOptions
from whiptool.errors import InputError
from whiptool.models import JointLimits, Model, SpatialArm, WhipParameters, in_space, preset
from whiptool.models.capsules import Capsule
from whiptool.models.kinematics import arm_frames
from whiptool.models.mount import default_floor, level_links, mount_rotation, mounted, with_stick
from whiptool.models.presets import PANDA_ARM, UR5E_ARM, rope
from whiptool.models.scene import Scene

Q = (0.3, -0.8, 0.5, -1.2, 0.4, 0.9, 0.1)


@pytest.mark.parametrize(
    ("given", "R"),
    [
        ("wall", [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        ("ceiling", [[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
        ((0.0, 0.0, np.pi / 2), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ("floor", np.eye(3)),
    ],
)
def test_hand_and_shapes_are_turned_about_the_base(given, R):
    np.testing.assert_allclose(mount_rotation(given), R, atol=1e-15)
    turned = mounted(PANDA_ARM, given)
    hands = [arm_frames(arm, np.array(Q))[-1] for arm in (PANDA_ARM, turned)]
    np.testing.assert_allclose(hands[1].origin, R @ hands[0].origin, atol=1e-15)
    np.testing.assert_allclose(hands[1].rotation, R @ hands[0].rotation, atol=1e-15)
    ends = [Scene(Model(rope(3), arm), of="apart").segments(np.array([Q])) for arm in (PANDA_ARM, turned)]
    for upright, other in zip(*ends, strict=True):
        np.testing.assert_allclose(other, upright @ np.transpose(R), atol=1e-15)


def test_the_option_turns_presets_too_and_refuses_what_is_no_rotation():
    assert ModelOptions(model="ur5e").mount == ("floor",)

    class InSpace(ModelOptions):
        in_space = True

    arm = InSpace(model="ur5e", mount=("ceiling",)).build_model().arm
    assert arm.links[:5] == mounted(UR5E_ARM, "ceiling").links[:5]  # the last holds a stick
    turned = InSpace(model="ur5e", mount=("3.141592653589793", "0", "0")).build_model().arm
    assert replace(turned, surface=arm.surface) == arm
    for mount in (("roof",), ("1", "2"), ("1", "2", "x"), ("wall", "high"), ("wall", "1", "2")):
        with pytest.raises(InputError, match=r"--mount: got .*allowed: floor, pedestal, wall, ceiling and its height"):
            InSpace(model="ur5e", mount=mount).build_model()
    for mount, said in (("pedestal",), "nothing; allowed: the height"), (("floor", "1"), "1.0; allowed: 0 on a floor"):
        with pytest.raises(InputError, match=f"--mount: got {said}"):
            InSpace(model="ur5e", mount=mount).build_model()
    with pytest.raises(InputError, match=r"--mount: got '90 rad of pitch'; .*are these degrees"):
        InSpace(model="ur5e", mount=("0", "90", "0")).build_model()
    with pytest.raises(InputError, match="arm in the plane"):
        ModelOptions(mount=("wall",)).build_model()
    with pytest.raises(InputError, match=r"tip: got 'tool0'; allowed: a tip only with a robot's file"):
        InSpace(model="ur5e", arm_tip="tool0").build_model()


@pytest.mark.parametrize(
    ("arm", "level", "floor"),
    [
        (UR5E_ARM, 1, 0.0),  # its pan turns about the vertical, its lift is 0.1625 m above the base
        (PANDA_ARM, 1, 0.0),
        (preset("nah2023").arm, 0, None),  # a shoulder stands on nothing
        (in_space(preset("lemon2024").arm), 0, None),
        (preset("lemon2024").arm, None, None),
        (mounted(PANDA_ARM, "wall"), 0, None),
        (mounted(PANDA_ARM, "ceiling"), 1, None),
        (mounted(PANDA_ARM, "ceiling", 2.4), 1, -2.4),
        (mounted(PANDA_ARM, "pedestal", 0.8), 1, -0.8),
        (mounted(PANDA_ARM, (0.0, 1.57, 0.0)), 0, None),  # a wall with few digits
    ],
)
def test_a_robot_stands_on_a_floor_where_its_shoulder_is_above_its_base(arm, level, floor):
    assert default_floor(arm) == floor
    if level is not None:
        assert level_links(arm) == level


def test_links_that_stay_at_their_height_are_not_compared_with_the_floor():
    """The Panda's first link begins 6 cm below its base; a robot that slides along a rail and turns above it."""
    scene = Scene(preset("panda"), 0.0, "apart")
    over = {scene.links_of(pair)[0] for pair in scene.pairs if scene.links_of(pair)[1] == -2}
    assert over == {1, 2, 3, 4, 5, 6}
    rail = replace(PANDA_ARM.links[0], axis=(1.0, 0.0, 0.0), kind="prismatic", limits=JointLimits((-1.0, 1.0)))
    on_rail = SpatialArm((rail, replace(PANDA_ARM.links[0], position=(0.0, 0.0, 0.0)), *PANDA_ARM.links[1:]))
    assert level_links(on_rail) == 2
    assert default_floor(on_rail) == 0.0


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


@pytest.mark.parametrize(("base", "axis", "sign"), [("wall", 0, 1.0), ("ceiling", 2, -1.0)])
def test_a_wall_and_a_ceiling_are_surfaces_of_arm_and_whip(base, axis, sign):
    """Distances by the capsules' ends and radii; a robot that is mounted upright has no other surface than a floor."""
    arm = mounted(PANDA_ARM, base)
    assert PANDA_ARM.surface is None
    np.testing.assert_allclose(arm.surface, sign * np.eye(3)[axis], atol=1e-15)
    assert mounted(PANDA_ARM, (0.0, 1.0, 0.0)).surface is None
    model = Model(rope(3), arm)
    scene = Scene(model, -3.0, ("apart", "whip"))
    rods = np.tile([0.6, 0.0, -0.8], 3)
    q = np.array([[*Q, *rods]])
    starts, ends = scene.segments(q)
    distances = scene.distances(q)[0][0]
    pairs = [k for k, (_, j) in enumerate(scene.pairs) if j == len(scene.bodies) + 1]
    assert {scene.bodies[scene.pairs[k][0]].link for k in pairs} == {-3, *range(1, 7)}
    for k in pairs:
        i = scene.pairs[k][0]
        height = min(sign * starts[0, i, axis], sign * ends[0, i, axis])
        if scene.bodies[i].capsule.exact:
            assert distances[k] == pytest.approx(height - scene.bodies[i].capsule.radius, abs=1e-12)
        assert scene.names_of(scene.pairs[k])[1] == f"the {base}"
    below = [k for k, (_, j) in enumerate(scene.pairs) if j == len(scene.bodies)]
    assert {scene.names_of(scene.pairs[k])[1] for k in below} == {"the floor"}
    nearest = min(distances[k] for k in pairs)
    others = np.arange(len(scene.pairs))
    found = scene.contacts(q, np.isin(others, pairs).astype(int), [np.inf, np.inf])[1]
    assert found is not None
    assert found.distance == pytest.approx(nearest, abs=1e-9)
    np.testing.assert_allclose(found.normal, -np.array(arm.surface), atol=1e-9)


def test_a_pedestal_is_a_column_below_the_base():
    """Distances of a whip that hangs straight down from a column that is as thick as the base."""
    arm = mounted(UR5E_ARM, "pedestal", 0.8)
    assert arm.base[:-1] == UR5E_ARM.base
    assert arm.links == UR5E_ARM.links
    table = Capsule((1.0, 0.0, 0.0), (1.0, 0.0, 0.1), 0.5, name="table")  # which makes it no thicker
    assert mounted(replace(UR5E_ARM, base=(*UR5E_ARM.base, table)), "pedestal", 0.8).base[-1] == arm.base[-1]
    model = Model(rope(3), arm)
    scene = Scene(model, None, "whip")
    column = [k for k, (i, _) in enumerate(scene.pairs) if scene.bodies[i].capsule == arm.base[-1]]
    q = np.array([[0.3, -1.2, 1.0, 0.2, 0.7, 0.1, *np.tile([0.0, 0.0, -1.0], 3)]])
    starts, ends = scene.segments(q)
    distances = scene.distances(q)[0][0]
    radius = UR5E_ARM.base[0].radius
    for k in column:
        whip = scene.pairs[k][1]
        x, y, _ = starts[0, whip]
        high, low = starts[0, whip, 2], ends[0, whip, 2]
        above = max(0.0, low, -0.8 - high)  # the whip hangs straight down
        aside = max(0.0, float(np.hypot(x, y)) - radius)
        assert distances[k] == pytest.approx(np.hypot(aside, above), abs=1e-6)
    assert len(column) == 3


def test_the_height_of_a_mount_that_is_not_given_is_said():
    (note,) = mounted(PANDA_ARM, "wall").notes
    assert "height of the wall mount is not given" in note
    assert not mounted(PANDA_ARM, "wall", 1.7).notes
    with pytest.raises(InputError, match="height"):
        mounted(PANDA_ARM, "wall", -1.0)
