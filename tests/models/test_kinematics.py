"""Kinematics and its inverse: against closed forms, SciPy's rotations, and differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from random_space import pinocchio_of
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from spatial_arms import ARMS, random_arm, random_model

from whiptool.models import Model, WhipParameters, preset
from whiptool.models.kinematics import (
    HandKinematics,
    arm_frames,
    arm_poses,
    chain_motion,
    hanging_angles,
    quaternion_of,
    rotation_about,
    rotation_left,
    rotation_of,
    rotation_vector,
    skew,
    turning,
    universal_angles,
)

RNG = np.random.default_rng(4)


def test_vectors_come_back_from_their_rotations():
    vectors = RNG.uniform(-1.7, 1.7, (3, 5, 3))  # shorter than pi
    np.testing.assert_allclose(rotation_vector(rotation_of(vectors)), vectors, atol=1e-12)
    np.testing.assert_allclose(skew(vectors[0]) @ [1, 2, 3], np.cross(vectors[0], [1, 2, 3]), atol=1e-15)


def test_quaternions_turn_vectors_as_their_rotations_do_and_have_one_sign():
    R = Rotation.random(20, np.random.default_rng(1)).as_matrix()
    x, y, z, w = quaternion_of(R).T
    assert (w >= 0).all()
    np.testing.assert_allclose(x**2 + y**2 + z**2 + w**2, 1, atol=1e-14)
    turned = np.array([w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)]).T  # of (1, 0, 0)
    np.testing.assert_allclose(turned, R[:, :, 0], atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.3, 2.0, 3.1])
def test_what_is_left_is_along_the_axis_and_twice_the_sine_of_half_the_angle(angle):
    axis, present = np.array([2.0, -1.0, 2.0]) / 3, Rotation.random(None, np.random.default_rng(2)).as_matrix()
    left = rotation_left(rotation_of(angle * axis) @ present, present)
    np.testing.assert_allclose(left, 2 * np.sin(angle / 2) * axis, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.5, 2.5])
def test_a_rotation_vectors_change_turns_as_differences_say(size):
    vector, h = size * np.array([0.6, 0.0, -0.8]), 1e-6
    found = turning(vector)
    for column, step in zip(found.T, h * np.eye(3), strict=True):
        turned = rotation_of(vector + step) @ rotation_of(vector - step).T
        np.testing.assert_allclose(column, rotation_vector(turned) / (2 * h), atol=1e-8)


PRESETS_IN_SPACE = ("nah2023", "ur5e", "panda")
MODELS = [random_model(rng=np.random.default_rng(i), **arm) for i, arm in enumerate(ARMS.values())]
every_model = pytest.mark.parametrize("model", MODELS, ids=ARMS)
every_preset = pytest.mark.parametrize("name", PRESETS_IN_SPACE)


def random_state(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Positions and speeds of 6 states, (6, n) each."""
    q, v = np.random.default_rng(7).uniform(-2, 2, (2, 6, model.n))
    return q, v


def random_directions(shape: tuple[int, ...]) -> np.ndarray:
    d = np.random.default_rng(8).normal(size=(*shape, 3))
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def test_rotations_about_an_axis_are_scipys():
    axis, angles = np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25), np.linspace(-7, 7, 12).reshape(3, 4)
    ours = rotation_about(axis, angles)
    assert ours.shape == (3, 4, 3, 3)
    theirs = Rotation.from_rotvec(angles.reshape(-1, 1) * axis).as_matrix()
    np.testing.assert_allclose(ours.reshape(-1, 3, 3), theirs, atol=1e-15)


@every_model
def test_frames_of_links_are_pinocchios(model):
    """Places, rotations, velocities and angular velocities behind every joint, hinges and slides among them."""
    its, a = pinocchio_of(model), model.arm.n
    data = its.createData()
    q, v = random_state(model)
    frames = arm_frames(model.arm, q[:, :a], v[:, :a])
    assert len(frames) == a + 1
    for i in range(len(q)):
        pin.forwardKinematics(its, data, q[i], v[i])
        for joint in range(1, a + 1):
            frame = frames[joint - 1]
            motion = pin.getVelocity(its, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            np.testing.assert_allclose(frame.origin[i], data.oMi[joint].translation, atol=1e-14)
            np.testing.assert_allclose(frame.rotation[i], data.oMi[joint].rotation, atol=1e-14)
            np.testing.assert_allclose(frame.velocity[i], motion.linear, atol=1e-13)
            np.testing.assert_allclose(frame.spin[i], motion.angular, atol=1e-13)


@every_model
def test_hand_and_nodes_are_pinocchios(model):
    its, a = pinocchio_of(model), model.arm.n
    data, lengths = its.createData(), model.whip.per_node("l")
    q, v = random_state(model)
    points = chain_motion(model, q, v)[0]
    assert points.shape == (6, a + 1 + model.whip.N, 3)
    hand = pin.SE3(np.array(model.arm.hand_rotation), np.array(model.arm.hand_position))
    frames = arm_frames(model.arm, q[:, :a])
    for i in range(len(q)):
        pin.forwardKinematics(its, data, q[i])
        at_hand = data.oMi[a] * hand
        np.testing.assert_allclose(points[i, a], at_hand.translation, atol=1e-14)
        np.testing.assert_allclose(frames[-1].rotation[i], at_hand.rotation, atol=1e-14)
        for node, length in enumerate(lengths):
            joint = data.oMi[its.getJointId(f"y{node}")]
            np.testing.assert_allclose(points[i, a + 1 + node], joint.act(np.array([0, 0, -length])), atol=1e-13)


@pytest.mark.parametrize("joints", ["universal", "rod"])
@every_model
def test_velocities_are_the_slopes_of_places(model, joints):
    model = replace(model, whip=replace(model.whip, joints=joints, node_inertia=0.0))
    rng, h = np.random.default_rng(9), 1e-6
    q, v = rng.uniform(-1, 1, (2, 4, model.coordinates))
    ahead, behind = (chain_motion(model, q + sign * h * v)[0] for sign in (1, -1))
    velocities = chain_motion(model, q, v)[1]
    np.testing.assert_allclose(velocities, (ahead - behind) / (2 * h), atol=2e-8)
    assert np.abs(velocities).max() > 0.1
    assert not chain_motion(model, q)[1].any()  # at rest unless speeds are given


@every_model
def test_a_place_of_a_link_moves_with_its_link(model):
    """As `carried` says, against the slope of where the place is."""
    a, h, place = model.arm.n, 1e-6, (0.1, -0.2, 0.3)
    q, v = (x[:, :a] for x in random_state(model))
    ahead, behind = (arm_frames(model.arm, q + sign * h * v)[-2].carried(place).origin for sign in (1, -1))
    moved = arm_frames(model.arm, q, v)[-2].carried(place)
    np.testing.assert_allclose(moved.velocity, (ahead - behind) / (2 * h), atol=1e-8)


def test_rods_are_laid_end_to_end():
    model = preset("ur5e")
    model = replace(model, whip=WhipParameters(N=3, l=(0.1, 0.2, 0.3), m=0.01, k=0.1, b=0.01, joints="rod"))
    q = np.zeros(6 + 9)
    q[6:] = np.eye(3).ravel()
    points = chain_motion(model, q)[0]
    hand = arm_frames(model.arm, q[:6])[-1].origin
    np.testing.assert_allclose(points[-4:] - hand, [[0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0], [0.1, 0.2, 0.3]], atol=1e-15)


@every_preset
def test_universal_nodes_point_where_rods_do(name):
    """Any directions, and both ways to write a chain down give the same places."""
    model = preset(name)
    a, whip = model.arm.n, replace(model.whip, N=4, l=0.1, m=0.01, k=0.1, b=0.01, node_inertia=0.0)
    rods, hinges = (replace(model, whip=replace(whip, joints=joints)) for joints in ("rod", "universal"))
    q = np.concatenate(
        [np.random.default_rng(10).uniform(-3, 3, (20, a)), 1.7 * random_directions((20, 4)).reshape(20, 12)], axis=1
    )
    angles = universal_angles(model.arm, q)  # of directions of any length
    assert angles.shape == (20, a + 8)
    unit = np.concatenate([q[:, :a], q[:, a:] / 1.7], axis=1)
    np.testing.assert_allclose(chain_motion(hinges, angles)[0], chain_motion(rods, unit)[0], atol=1e-14)


@every_preset
def test_a_whip_hangs_straight_down_wherever_the_hand_is(name):
    model = preset(name)
    model = replace(model, whip=replace(model.whip, joints="universal"))
    a = model.arm.n
    q = np.zeros((50, model.n))
    q[:, :a] = np.random.default_rng(2).uniform(-3, 3, (50, a))
    q[:, a : a + 2] = hanging_angles(model.arm, q[:, :a])
    points = chain_motion(model, q)[0]
    down = np.zeros((50, model.whip.N, 3))
    down[..., 2] = -model.whip.per_node("l")
    np.testing.assert_allclose(np.diff(points[:, a:], axis=1), down, atol=1e-14)


@pytest.mark.parametrize("name", PRESETS_IN_SPACE)
def test_poses_are_those_of_frames(name):
    arm = preset(name).arm
    q = np.random.default_rng(0).uniform(-2, 2, (5, arm.n))
    origins, rotations = arm_poses(arm, q)
    for i, frame in enumerate(arm_frames(arm, q)):
        np.testing.assert_allclose(origins[:, i], frame.origin, atol=1e-14)
        np.testing.assert_allclose(rotations[:, i], frame.rotation, atol=1e-14)


RNG_INVERSE_KINEMATICS = np.random.default_rng(3)
PLANAR, UR5E, PANDA = (preset(name).arm for name in ("lemon2024", "ur5e", "panda"))
SLIDING = random_arm(5, RNG_INVERSE_KINEMATICS, prismatic=(1, 3))
HOMES = {
    "plane": (PLANAR, [0.4, 1.5]),
    "ur5e": (UR5E, [0, -1.2, 1.5, -0.5, -1.5, 0.5]),
    "panda": (PANDA, [0, -0.5, 0, -2.0, 0, 1.7, 0.7]),
    "sliding": (SLIDING, [0.3, 0.1, -0.4, 0.2, 0.5]),
}
CASES = [(arm, home, False) for arm, home in HOMES.values()]
CASES += [(*HOMES[name], True) for name in ("ur5e", "panda")]
every_case = pytest.mark.parametrize(("arm", "home", "orientation"), CASES)


@every_case
def test_the_hand_is_where_the_arms_frames_have_it_and_moves_as_they_do(arm, home, orientation):
    kinematics = HandKinematics(arm, np.array(home), orientation=orientation)
    q, v = (
        home + 0.5 * RNG_INVERSE_KINEMATICS.normal(size=(5, len(home))),
        RNG_INVERSE_KINEMATICS.normal(size=(5, len(home))),
    )
    speeds = np.einsum("bmj,bj->bm", kinematics.jacobian(q), v)
    if arm.dimension == 2:
        theta, omega, l = np.cumsum(q, axis=1), np.cumsum(v, axis=1), arm.per_link("length")
        place = np.stack([(l * np.sin(theta)).sum(1), -(l * np.cos(theta)).sum(1)], axis=1)
        speed = np.stack([(l * np.cos(theta) * omega).sum(1), (l * np.sin(theta) * omega).sum(1)], axis=1)
    else:
        hand = arm_frames(arm, q, v)[-1]
        place, speed = hand.origin, np.hstack([hand.velocity, hand.spin])[:, : kinematics.size]
    np.testing.assert_allclose(kinematics.coordinates(q)[:, : arm.dimension], place, atol=1e-14)
    np.testing.assert_allclose(speeds, speed, atol=1e-13)


@every_case
def test_postures_hold_the_hand_and_change_with_it_as_differences_say(arm, home, orientation):
    kinematics = HandKinematics(arm, np.array(home), orientation=orientation)
    x = kinematics.coordinates(home + 0.15 * RNG_INVERSE_KINEMATICS.normal(size=(6, len(home))))
    found = kinematics.solve(x)
    assert (found.missed < 1e-9).all()
    np.testing.assert_allclose(kinematics.coordinates(found.q), x, atol=1e-9)
    h, slopes = 1e-6, found.slopes @ kinematics.spins(x)
    for j, step in enumerate(h * np.eye(kinematics.size)):
        change = (kinematics.solve(x + step).q - kinematics.solve(x - step).q) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], change, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5e", "panda", "sliding"])
def test_no_posture_that_holds_the_hand_there_is_nearer(name):
    arm, home = HOMES[name]
    kinematics = HandKinematics(arm, np.array(home))
    x = kinematics.coordinates(home + 0.2 * RNG_INVERSE_KINEMATICS.normal(size=len(home)))
    holds = {"type": "eq", "fun": lambda q: kinematics.coordinates(q) - x, "jac": kinematics.jacobian}
    other = minimize(
        lambda q: ((q - home) ** 2).sum() / 2,
        np.array(home),
        jac=lambda q: q - home,
        constraints=[holds],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert other.success
    np.testing.assert_allclose(kinematics.solve(x).q, other.x, atol=1e-6)


def test_two_joints_in_the_plane_against_the_law_of_cosines():
    l1, l2 = PLANAR.per_link("length")
    kinematics = HandKinematics(PLANAR, np.array([0.4, 1.5]))
    r, angle = (
        RNG_INVERSE_KINEMATICS.uniform(0.3, 0.6, 20),
        RNG_INVERSE_KINEMATICS.uniform(0.6, 1.6, 20),
    )  # from straight down
    found = kinematics.solve(np.stack([r * np.sin(angle), -r * np.cos(angle)], axis=1))
    elbow = np.arccos((r**2 - l1**2 - l2**2) / (2 * l1 * l2))
    shoulder = angle - np.arctan2(l2 * np.sin(elbow), l1 + l2 * np.cos(elbow))
    np.testing.assert_allclose(found.q, np.stack([shoulder, elbow], axis=1), atol=1e-9)


def test_what_is_out_of_reach_is_not_found():
    kinematics = HandKinematics(UR5E, np.array(HOMES["ur5e"][1]))
    found = kinematics.solve(np.array([[2.5, 0.0, 0.3], [0.8, 0.1, 0.4]]))
    assert np.isinf(found.missed).tolist() == [True, False]
