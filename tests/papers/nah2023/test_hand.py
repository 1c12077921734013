"""Planes, compliances and shares: closed forms, and an arm whose derivatives Pinocchio gives."""

from __future__ import annotations

import numpy as np
import pytest
from spatial_arms import random_arm

from papers.nah2023 import published
from papers.nah2023.hand import (
    LastNodes,
    Plane,
    hand_jacobian,
    joint_compliance,
    measure,
    shares,
    task_compliance,
)
from papers.nah2023.units import simulator
from whiptool.errors import InputError
from whiptool.models.kinematics import arm_frames, joint_points
from whiptool.models.presets import NAH2023
from whiptool.models.spatial_arm import IDENTITY, SpatialArm, SpatialLink
from whiptool.models.strike import default_bounds


def test_plane_of_an_ellipse_with_a_wave_across_it():
    """Half axes 3 and 2 in a tilted plane, a wave of amplitude 0.1 across it: each has variance half its square."""
    s = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    u, v, n = np.linalg.qr(np.array([[1.0, 2, 0], [0, 1, 1], [1, 0, 3]]))[0]
    points = 5 + np.outer(3 * np.cos(s), u) + np.outer(2 * np.sin(s), v) + np.outer(0.1 * np.sin(3 * s), n)
    plane = Plane.through(points)
    assert plane.centre == pytest.approx([5, 5, 5])
    assert plane.spread == pytest.approx(np.array([3, 2, 0.1]) / np.sqrt(2))
    assert abs(plane.axes[2] @ n) == pytest.approx(1)
    assert plane.outside == pytest.approx(0.01 / (9 + 4 + 0.01))


def test_shares_of_a_vector_that_turns_with_its_axes():
    """A vector at a fixed angle to axes that turn has the squares of its direction cosines, whatever its length."""
    t = np.linspace(0, 3, 50)
    c, s, o, i = np.cos(t), np.sin(t), np.zeros_like(t), np.ones_like(t)
    axes = np.stack([np.stack([c, s, o], -1), np.stack([-s, c, o], -1), np.stack([o, o, i], -1)], axis=-1)
    vectors = (1 + t)[:, None] * (axes @ np.array([0.6, 0.0, 0.8]))
    assert shares(vectors, axes) == pytest.approx([0.36, 0.0, 0.64])
    assert shares(np.array([[0.0, 2.0], [1.0, 0.0]]), np.eye(2)) == pytest.approx([0.2, 0.8])


def _two_links(l: float) -> SpatialArm:
    """Two links of length l in the x-z plane, hanging along -z, each hinge turning them toward +x."""
    body = (1.0, (0.0, 0.0, -l / 2), (0.01, 0.01, 0.01, 0, 0, 0), (0.0, -1.0, 0.0))
    links = (SpatialLink(*body, (0, 0, 0), IDENTITY), SpatialLink(*body, (0, 0, -l), IDENTITY))
    return SpatialArm(links, ("one", "two"), hand_position=(0, 0, -l))


def test_compliance_of_a_right_angled_arm_by_hand():
    """The elbow at 90 degrees: the shoulder moves the hand by l (1, 1), the elbow by l (0, 1), in x and z.

    With joint stiffnesses k1, k2 the compliance is l^2 [[1, 1], [1, 1]] / k1 + l^2 [[0, 0], [0, 1]] / k2.
    """
    l, k1, k2 = 0.3, 20.0, 10.0
    arm, q = _two_links(l), np.array([0.0, np.pi / 2])
    assert hand_jacobian(arm, q)[[0, 2]] == pytest.approx(np.array([[l, 0], [l, l]]), abs=1e-12)
    expected = l**2 * (np.array([[1, 1], [1, 1]]) / k1 + np.array([[0, 0], [0, 1]]) / k2)
    values, vectors = np.linalg.eigh(expected)
    found, axes = task_compliance(arm, np.diag([k1, k2]), q)
    assert found == pytest.approx([values[1], values[0], 0], abs=1e-12)
    assert abs(axes[[0, 2], 0] @ vectors[:, 1]) == pytest.approx(1)


def test_softest_axis_of_joints_is_that_of_the_smallest_stiffness():
    K = np.array([[5.0, 2.0], [2.0, 8.0]])  # eigenvalues 4 along (2, -1), 9 along (1, 2)
    assert abs(joint_compliance(K)[:, 0]) == pytest.approx(np.array([2, 1]) / np.sqrt(5))


def test_jacobian_gives_the_velocity_of_the_hand_and_is_pinocchios():
    pinocchio = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(3)
    arm = random_arm(5, rng, prismatic=(2,))
    q, v = rng.normal(size=(7, 5)), rng.normal(size=(7, 5))
    velocity = np.einsum("bij,bj->bi", hand_jacobian(arm, q), v)
    assert velocity == pytest.approx(arm_frames(arm, q, v)[-1].velocity, abs=1e-12)
    model, parent = pinocchio.Model(), 0
    for link in NAH2023.arm.links:
        place = pinocchio.SE3(np.array(link.rotation, float), np.array(link.position, float))
        joint = pinocchio.JointModelRevoluteUnaligned(np.array(link.axis, float))
        parent = model.addJoint(parent, joint, place, f"joint{parent}")
    hand = pinocchio.SE3(np.eye(3), np.array(NAH2023.arm.hand_position, float))
    frame = model.addFrame(pinocchio.Frame("hand", parent, 0, hand, pinocchio.FrameType.OP_FRAME))
    angles = rng.normal(size=4)
    J = pinocchio.computeFrameJacobian(
        model, model.createData(), angles, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    assert hand_jacobian(NAH2023.arm, angles) == pytest.approx(J[:3], abs=1e-12)


class _Moved:
    """A strike of the two-link arm that moves its elbow alone, half as far as its reference."""

    def __init__(self, D: float) -> None:
        self.t = np.linspace(0, D + 0.4, 1401)
        angle = np.minimum(self.t / D, 1) * np.pi / 2
        rate = np.where(self.t <= D, np.pi / 2 / D, 0.0)
        self.q = np.stack([0 * angle, angle], axis=1)
        self.v = np.stack([0 * rate, rate], axis=1)
        self.q_d = 2 * self.q


def test_measures_of_a_hand_on_a_quarter_of_a_circle():
    """Planar to rounding. Of the joints' deviation all is the elbow's, the softer; at the hand the elbow's direction
    turns from across the softest axis to some way along it."""
    arm, K = _two_links(0.3), np.diag([20.0, 10.0])
    found = measure(arm, K, _Moved(1.0), 1.0)
    assert found.rms == pytest.approx(0, abs=1e-12)
    assert found.joint == pytest.approx([1, 0])
    angle = np.linspace(0, np.pi / 2, 2001)
    moves = np.stack([np.cos(angle), np.sin(angle)], axis=-1)  # of the hand, by the elbow
    elbow, shoulder = 0.3 * moves, 0.3 * (moves + np.array([1.0, 0.0]))
    C = np.einsum("ti,tj->tij", shoulder, shoulder) / 20 + np.einsum("ti,tj->tij", elbow, elbow) / 10
    softest = np.linalg.eigh(C)[1][:, :, 1]
    along = np.trapezoid(np.einsum("ti,ti->t", moves, softest) ** 2, angle) / (np.pi / 2)
    assert found.task[0] == pytest.approx(along, rel=2e-3)
    assert 0.5 < found.task[0] < 0.99


STRIKES = default_bounds(NAH2023.arm).sample(np.random.default_rng(0), 3)
TARGET = np.array([0.9, 0.6, -0.4])  # in reach of nodes in the middle of the whip


def _nearest(points: np.ndarray) -> tuple[float, int]:
    """Smallest distance of the segments between successive places (T, nodes, 3), and of which node."""
    best, which = np.inf, -1
    for node in range(points.shape[1]):
        for a, b in zip(points[:-1, node], points[1:, node], strict=True):
            if min(np.linalg.norm(a - TARGET), np.linalg.norm(b - TARGET)) > best + 0.05:
                continue
            along = np.clip((TARGET - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
            distance = float(np.linalg.norm(a + along * (b - a) - TARGET))
            best, which = (distance, node) if distance < best else (best, which)
    return best, which


def test_nearest_of_the_last_nodes_is_that_of_the_whole_trajectory():
    """Until the same instant whatever D is; the places are those of forward kinematics, not the engine's own."""
    rule = LastNodes(simulator(1), 15, 1.6)
    near = rule.approach(STRIKES, TARGET)
    which = set()
    for i, strike in enumerate(STRIKES):
        path = rule.trajectory(strike)
        assert path.t[-1] == pytest.approx(1.6)
        expected, node = _nearest(joint_points(NAH2023, path.q)[:, -15:])
        assert near.distance[i] == pytest.approx(expected, abs=1e-9)
        assert np.linalg.norm(near.tip[i] - TARGET) == pytest.approx(expected, abs=1e-9)
        which.add(node)
    assert which != {14}  # not the tip each time


def test_one_node_is_the_tip():
    rollout = simulator(1)
    stay = 1.6 - STRIKES[:1, -1]
    tip = rollout.approach(STRIKES[:1], TARGET, t_stay=float(stay[0]))
    one = rollout.nearest_node(STRIKES[:1], TARGET, nodes=[24], t_stay=stay)
    assert one.distance == pytest.approx(tip.distance, abs=1e-12)
    assert one.time == pytest.approx(tip.time, abs=1e-9)
    assert one.max_torque == pytest.approx(tip.max_torque)


@pytest.mark.parametrize("nodes", [[], [25], [-1]])
def test_nodes_that_are_not_there_are_refused(nodes):
    with pytest.raises(InputError, match="0 to 24"):
        simulator(1).nearest_node(STRIKES[:1], TARGET, nodes=nodes)


def test_published_strikes_come_as_near_as_published():
    """Within 1 mm of a hit at targets 1 to 5, 2 mm from the published distance at target 6."""
    rule = LastNodes(simulator(None), published.LAST_NODES, published.UNTIL)
    found = [
        float(rule.approach(strike[None], np.array(place)).distance[0])
        for strike, place in zip(published.STRIKES, published.TARGETS, strict=True)
    ]
    assert max(found[:5]) < published.HIT_RADIUS + 1e-3
    assert found[5] == pytest.approx(published.BEST[5], abs=2e-3)
