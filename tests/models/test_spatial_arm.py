"""Arms in space: names of their joints, checks of their numbers, changes by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from spatial_arms import ARMS, random_arm, random_model

from whiptool.errors import InputError
from whiptool.models import (
    ArmLink,
    ArmParameters,
    JointLimits,
    Model,
    SpatialArm,
    SpatialLink,
    WhipParameters,
    in_space,
    preset,
)
from whiptool.models.kinematics import arm_frames, chain_motion
from whiptool.models.spatial_arm import checked_joints, joint_name, subscripts


@pytest.mark.parametrize(
    ("count", "usual"),
    [(1, ("shoulder",)), (2, ("shoulder", "elbow")), (3, ("joint1", "joint2", "joint3"))],
)
def test_joints_of_no_name_get_the_usual_ones(count, usual):
    assert checked_joints((), count) == usual
    assert checked_joints([], count) == usual


def test_given_names_are_kept_in_their_order():
    assert checked_joints(["wrist_2", "a", "Base3"], 3) == ("wrist_2", "a", "Base3")


@pytest.mark.parametrize(
    "given",
    [
        "ab", 3, None,  # no row of names
        ("a",), ("a", "b", "c"), ("a", "a"),  # not two different ones
        ("a", 2), ("a", ""), ("a", "2b"), ("a", "b-c"), ("a", "_b"),  # no names
        ("a", "whip1"), ("a", "tip"), ("a", "target"), ("a", "grip"), ("a", "world"), ("a", "com"), ("a", "end"),
    ],
)  # fmt: skip
def test_names_that_cannot_be_are_refused_with_the_rule(given):
    with pytest.raises(InputError) as caught:
        checked_joints(given, 2)
    assert (caught.value.name, caught.value.given) == ("joints", given)
    assert caught.value.allowed.startswith("2 different names, one per link, of letters and digits")


@given(st.text())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_any_name_from_elsewhere_becomes_one_that_is_allowed(given):
    name = joint_name(given)
    assert checked_joints((name,), 1) == (name,)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("elbow", "elbow"), ("shoulder-joint", "shoulder_joint"), ("panda/joint 1", "panda_joint_1"),
        ("1st", "joint_1st"), ("tip_joint", "joint_tip_joint"), ("whip1", "joint_whip1"), ("Gelenk ä", "Gelenk__"),
    ],
)  # fmt: skip
def test_names_from_elsewhere_change_as_little_as_they_must(given, name):
    assert joint_name(given) == name


@pytest.mark.parametrize(
    ("joints", "short"),
    [
        (("shoulder", "elbow"), ("s", "e")),  # initials that differ
        (("shoulder", "elbow", "wrist"), ("s", "e", "w")),
        (("shoulder", "slide"), ("shoulder", "slide")),  # that do not
        (("joint1", "joint2", "joint3"), ("1", "2", "3")),
        (("joint1",), ("1",)),
        (("joint2", "joint1"), ("joint2", "joint1")),  # not counted in order
        (("Shoulder", "slide"), ("S", "s")),
    ],
)
def test_subscripts(joints, short):
    assert subscripts(joints) == short


GOOD = {
    "mass": 1.0,
    "com": (0, 0, 0.1),
    "inertia": (0.1, 0.1, 0.05, 0, 0, 0),
    "axis": (0, 0, 1),
    "position": (0, 0, 0.3),
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": -1}, "mass: got -1"),
        ({"com": (0, 0)}, r"com: got \(0, 0\); allowed: 3 finite numbers"),
        ({"com": (0, 0, float("nan"))}, r"com\[2\]"),
        ({"inertia": (0.1, 0.1, 0.05)}, "inertia: .*6 finite numbers"),
        ({"inertia": (0.1, 0.1, -0.05, 0, 0, 0)}, "inertia: .*principal moments"),
        ({"inertia": (0.1, 0.1, 0.1, 0.2, 0, 0)}, "inertia: .*principal moments"),
        ({"mass": 0}, "inertia: .*zeros if mass is 0"),
        ({"axis": (0, 0, 2)}, "axis: .*a unit vector"),
        ({"axis": (0, 0, 0)}, "axis: .*a unit vector"),
        ({"rotation": ((1, 0, 0), (0, 1, 0), (0, 0, -1))}, "rotation: .*determinant 1"),
        ({"rotation": ((1, 0, 0), (0, 1, 0.1), (0, 0, 1))}, "rotation: .*orthogonal"),
        ({"rotation": 3}, "rotation: got 3"),
        ({"kind": "ball"}, "kind: got 'ball'; allowed: revolute or prismatic"),
        ({"friction": -1}, "friction"),
        ({"limits": 3}, "limits: got 3"),
    ],
)  # fmt: skip
def test_bad_links_are_named(change, message):
    with pytest.raises(InputError, match=f"^{message}"):
        SpatialLink(**{**GOOD, **change})


@pytest.mark.parametrize(
    ("limits", "message"),
    [({"position": (1, 1)}, "position"), ({"position": 3}, "position"), ({"velocity": 0}, "velocity"),
     ({"torque": float("nan")}, "torque"), ({"jerk": -1}, "jerk"), ({"deceleration": 6}, "deceleration"),
     ({"velocity_offset": 0.3}, "velocity_offset"), ({"velocity": 1, "velocity_margin": 1}, "velocity_margin")],
)  # fmt: skip
def test_bad_limits_are_named(limits, message):
    with pytest.raises(InputError, match=f"^{message}: got .*allowed: "):
        JointLimits(**limits)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_velocities_by_position_are_a_parabola_of_speed(share):
    """Towards its ends at -1 and 1 it is sqrt(2 d s) - v_o, less the reserve; of that, a share is kept free."""
    limits = JointLimits((-1, 1), velocity=3.0, deceleration=8.0, velocity_offset=0.2, velocity_margin=0.1)
    q = np.linspace(-1.2, 1.2, 25)
    nearer = dataclasses.replace(limits, position_margin=0.1)
    np.testing.assert_allclose(nearer.velocities(q)[1], limits.velocities(q + 0.1)[1])
    np.testing.assert_allclose(nearer.velocities(q)[0], limits.velocities(q - 0.1)[0])
    left = 1 - share
    low, high = (
        [left * max(min(np.sqrt(16 * max(left + sign * x, 0)) - 0.2, 3.0) - 0.1, 0) for x in q] for sign in (1, -1)
    )
    np.testing.assert_allclose(limits.keeping_free(share).velocities(q), [-np.array(low), high], atol=1e-12)
    assert limits.keeping_free(share).fastest == pytest.approx(left * 2.9)
    np.testing.assert_array_equal(JointLimits(velocity=2.0).velocities(q), np.outer([-2, 2], np.ones(25)))
    ends = np.array(limits.reachable)
    assert limits.velocities(ends)[1, 1] == pytest.approx(0.1) == -limits.velocities(ends)[0, 0]
    assert JointLimits((-1, 1), velocity=2.0).reachable == (-1, 1)


def test_bad_arms_are_named():
    slide = SpatialLink(**GOOD, kind="prismatic")
    for arm, message in (
        ({"links": ()}, "links: .*one or more SpatialLink"),
        ({"links": (slide,)}, r"links\[0\]\.limits\.position: .*finite for a prismatic joint"),
        ({"links": (SpatialLink(**GOOD),), "joints": ("tip",)}, "joints: .*are taken"),
        ({"links": (SpatialLink(**GOOD),), "hand_position": (0, 0)}, "hand_position"),
        ({"links": (SpatialLink(**GOOD),), "hand_rotation": ((1,),)}, "hand_rotation"),
    ):
        with pytest.raises(InputError, match=f"^{message}"):
            SpatialArm(**arm)


def test_a_whip_is_of_its_arm_s_space():
    lemon = preset("lemon2024")
    universal = dataclasses.replace(lemon.whip, joints="universal")
    with pytest.raises(InputError, match=r"^whip.joints: got 'hinge'; allowed: universal or rod"):
        Model(lemon.whip, in_space(lemon.arm))
    with pytest.raises(InputError, match=r"^whip.joints: got 'universal'; allowed: hinge"):
        Model(universal, lemon.arm)


def test_numbers_of_few_digits_become_rotations_and_zeros_stay_zero():
    half = np.sqrt(0.5)
    link = SpatialLink(
        **{**GOOD, "axis": (0.7071068, 0.7071068, 0)},
        rotation=((half, -half, 1e-17), (half, half, -1e-16), (0, 0, 1 + 1e-15)),
    )
    R = np.array(link.rotation)
    assert R[0, 2] == R[1, 2] == 0.0
    assert R[2, 2] == 1.0
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.linalg.norm(link.axis) == pytest.approx(1, abs=1e-15)
    assert dataclasses.replace(link) == link  # checking again changes nothing


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_every_number_of_a_model_in_space_can_be_changed_by_name(arm):
    model = random_model(rng=np.random.default_rng(1), **arm)
    known = model.parameters()
    assert {"arm.mass[0]", "arm.com[0].x", "arm.inertia[0].yz", "arm.hand_position.z", "whip.node_inertia"} <= set(
        known
    )
    for name, value in known.items():
        if ".inertia" in name and value == 0:
            continue  # of a massless link
        new = value * 1.01 + (0.001 if ".inertia" not in name else 0)
        changed = model.with_parameters({name: new})
        assert changed != model
        assert changed.parameters() == {**known, name: pytest.approx(new)}
        assert changed.with_parameters({name: value}) == model
    with pytest.raises(InputError, match=r"^parameter: got 'arm.length\[0\]'"):
        model.with_parameters({"arm.length[0]": 1.0})


def test_sizes_of_models_in_space():
    model = preset("nah2023")
    assert (model.dimension, model.n, model.reach) == (3, 4 + 50, pytest.approx(2.385))
    assert model.farthest_miss((1, 2, 2)) == pytest.approx(2.385 + 3)
    assert preset("lemon2024").dimension == 2


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_no_hand_is_farther_than_the_arm_is_long(arm):
    rng = np.random.default_rng(2)
    arm = random_arm(rng=rng, **arm)
    limits = np.array([link.limits.position for link in arm.links])
    q = rng.uniform(*limits.T, (2000, arm.n))
    far = np.linalg.norm(arm_frames(arm, q)[-1].origin, axis=-1)
    assert far.max() <= arm.length


def test_a_planar_arm_in_space_moves_alike():
    planar = ArmParameters((ArmLink(1.0, 0.4, com=0.1, inertia=0.01, friction=0.3), ArmLink(0.5, 0.3)))
    whip = WhipParameters(N=2, l=(0.1, 0.2), m=0.1, k=0.1, b=0.01)
    model = Model(dataclasses.replace(whip, joints="universal"), in_space(planar))
    q, v = np.random.default_rng(3).normal(size=(2, 4))
    theta, omega, length = np.cumsum(q), np.cumsum(v), np.array([0.4, 0.3, 0.1, 0.2])
    ends = np.cumsum(length * np.array([np.sin(theta), -np.cos(theta)]), axis=1)
    speeds = np.cumsum(length * omega * np.array([np.cos(theta), np.sin(theta)]), axis=1)
    spread = np.zeros((2, 6))
    spread[:, [0, 1, 3, 5]] = q, v  # a universal node's second hinge is the plane's
    points, velocities = chain_motion(model, *spread)
    np.testing.assert_allclose(points[1:, [0, 2]].T, ends, atol=1e-15)
    np.testing.assert_allclose(velocities[1:, [0, 2]].T, speeds, atol=1e-14)
    assert not points[:, 1].any()
