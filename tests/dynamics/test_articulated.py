"""The articulated-body algorithm link by link: rotations against SciPy, chains against Pinocchio.

Whole models in space stand in `test_space.py`.
"""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from whiptool.dynamics.articulated import (
    Axis,
    Link,
    SpatialAcceleration,
    SpatialCarried,
    SpatialFrame,
    Turned,
    accelerate,
    drag_force,
    give_way,
    inward,
    outward,
    symmetric,
    turn,
    upper,
)

X, Y, DOWN_Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)
SKEW = tuple((np.array([1.0, -2.0, 2.0]) / 3).tolist())
AT_REST = Turned(ca.densify(ca.SX.eye(3)), ca.SX(0))


def matrix(axis: Axis, angle: float) -> np.ndarray:
    return Rotation.from_rotvec(angle * np.array(axis)).as_matrix()


def operations(x: ca.SX, of: ca.SX, *kinds: int) -> int:
    """How many operations of these kinds an expression takes."""
    f = ca.Function("f", [of], [x])
    return sum(f.instruction_id(k) in kinds for k in range(f.n_instructions()))


@pytest.mark.parametrize("axis", [X, Y, DOWN_Y, (0.0, 0.0, 1.0), SKEW])
def test_turns_are_scipys(axis: Axis):
    q = ca.SX.sym("q")
    f = ca.Function("turn", [q], [turn(axis, q)])
    for angle in (-2.5, 0.0, 0.3, 3.0):
        np.testing.assert_allclose(np.array(f(angle)), matrix(axis, angle), atol=1e-15)
    along_a_frame = max(map(abs, axis)) == 1
    constant = sum(x.is_constant() for x in ca.vertsplit(ca.vec(turn(axis, q))))
    assert constant == (5 if along_a_frame else 0)  # what does not turn is the number 0 or 1


def test_hinges_and_offsets_multiply_up():
    """Among them parallel and antiparallel ones, through a fixed turn that keeps their axis."""
    q, rng = ca.SX.sym("q", 5), np.random.default_rng(0)
    fixed = [matrix(SKEW, 0.4), matrix(Y, 1.1), np.eye(3), matrix(SKEW, -2.0), matrix(X, 0.2)]
    axes = [Y, Y, DOWN_Y, SKEW, X]
    turned, world = AT_REST, []
    for k in range(5):
        turned, along = turned.offset(fixed[k]).hinged(axes[k], q[k])
        world.append(along)
    found = ca.Function("turned", [q], [turned.matrix, turned.settled.matrix, ca.horzcat(*world)])
    for angles in rng.uniform(-3, 3, (3, 5)):
        R, settled, alongs = (np.array(x) for x in found(angles))
        expected = np.eye(3)
        for k in range(5):
            expected = expected @ fixed[k]
            np.testing.assert_allclose(alongs[:, k], expected @ axes[k], atol=1e-14)
            expected = expected @ matrix(axes[k], angles[k])
        np.testing.assert_allclose(R, expected, atol=1e-14)
        np.testing.assert_allclose(settled, expected, atol=1e-14)


def test_angles_of_parallel_hinges_are_summed_before_the_sine():
    q = ca.SX.sym("q", 4)
    parallel = skew = AT_REST
    for k in range(4):
        parallel = parallel.hinged(DOWN_Y if k % 2 else Y, q[k])[0]
        skew = skew.hinged(X if k % 2 else Y, q[k])[0]
    assert operations(parallel.matrix, q, ca.OP_SIN) == 1
    assert operations(skew.matrix, q, ca.OP_SIN) == 4


HINGES: tuple[tuple[Axis, ...], ...] = ((SKEW,), (X, DOWN_Y), (SKEW, Y, X), (DOWN_Y,), (DOWN_Y,))
LENGTHS, MASSES = np.array([0.3, 0.2, 0.25, 0.15, 0.1]), np.array([1.0, 0.4, 0.7, 0.2, 0.05])
COMS, INERTIAS = np.array([0.12, 0.2, 0.1, 0.15, 0.07]), np.array([0.01, 0.0, 0.02, 1e-4, 1e-3])
DRAGS, RATIO, GRAVITY = np.array([0.0, 0.3, 0.0, 0.2, 0.1]), 0.3, 9.0
N = sum(map(len, HINGES))
ARMATURES = np.random.default_rng(1).uniform(0.01, 0.1, N)


def chain() -> ca.Function:
    """Accelerations, ends and their velocities of a chain from a base at rest, for q, v, tau (N, 1)."""
    q, v, tau = (ca.SX.sym(name, N) for name in ("q", "v", "tau"))
    parts = [slice(i, j) for i, j in pairwise(np.cumsum([0, *map(len, HINGES)]).tolist())]
    links = [
        Link(ca.SX(LENGTHS[i]), ca.SX(MASSES[i]), ca.SX(COMS[i]), ca.SX(INERTIAS[i]), ca.SX(DRAGS[i]), ca.SX(RATIO))
        for i in range(len(HINGES))
    ]
    frame, frames, moving = SpatialFrame.at_rest(), [], []
    for link, axes, part in zip(links, HINGES, parts, strict=True):
        frame, moves = outward(frame, q[part], v[part], link, axes)
        frames.append(frame)
        moving.append(moves)
    carried, joints = SpatialCarried(), []
    for i in reversed(range(len(links))):
        carried = inward(carried, moving[i], links[i])
        carried, joint = give_way(carried, moving[i].axes, tau[parts[i]], ca.SX(ca.DM(ARMATURES[parts[i]])))
        joints.append(joint)
    at, found = SpatialAcceleration(ca.SX.zeros(3), ca.vertcat(0, 0, GRAVITY)), []
    for joint, moves in zip(reversed(joints), moving, strict=True):
        qdd, at = accelerate(at, joint, moves)
        found.append(qdd)
    places, velocities = (ca.horzcat(*(getattr(f, x) for f in frames)) for x in ("place", "velocity"))
    return ca.Function("chain", [q, v, tau], [ca.vertcat(*found), places, velocities, at.angular, at.linear])


def pinocchio_chain() -> tuple[pin.Model, list[int]]:
    """The same in Pinocchio, each hinge a joint of its own, and the joints that carry the links."""
    model, parent, place, carriers = pin.Model(), 0, pin.SE3.Identity(), []
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    for i, axes in enumerate(HINGES):
        for k, axis in enumerate(axes):
            kind = pin.JointModelRevoluteUnaligned(np.array(axis))
            parent = model.addJoint(parent, kind, place, f"{i}-{k}")
            place = pin.SE3.Identity()
        body = pin.Inertia(MASSES[i], np.array([0, 0, -COMS[i]]), INERTIAS[i] * np.eye(3))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        carriers.append(parent)
        place = pin.SE3(np.eye(3), np.array([0, 0, -LENGTHS[i]]))
    model.armature[:] = ARMATURES
    return model, carriers


def test_a_chain_moves_as_in_pinocchio():
    """Links behind one, two and three hinges, point masses and bodies, with rotors, and drag by virtual work."""
    ours, (its, carriers) = chain(), pinocchio_chain()
    data, rng, world = its.createData(), np.random.default_rng(2), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for _ in range(5):
        q, v, tau = rng.uniform(-2, 2, (3, N))
        pin.forwardKinematics(its, data, q, v)
        pin.computeJointJacobians(its, data, q)
        drag, ends, speeds = np.zeros(N), [], []
        for i, joint in enumerate(carriers):
            R = data.oMi[joint].rotation
            r = R @ [0, 0, -LENGTHS[i]]
            J = pin.getJointJacobian(its, data, joint, world)
            J = J[:3] - pin.skew(r) @ J[3:]
            u, down = J @ v, -R[:, 2]
            along = (u @ down) * down
            drag -= DRAGS[i] * J.T @ (np.linalg.norm(u) * (u - along + RATIO * along))
            ends.append(data.oMi[joint].translation + r)
            speeds.append(u)
        expected = pin.aba(its, data, q, v, tau + drag)
        qdd, places, velocities, angular, linear = (np.array(x) for x in ours(q, v, tau))
        np.testing.assert_allclose(qdd[:, 0], expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_allclose(places.T, ends, atol=1e-13)
        np.testing.assert_allclose(velocities.T, speeds, atol=1e-13)
        pin.forwardKinematics(its, data, q, v, expected)
        last = pin.getClassicalAcceleration(its, data, carriers[-1], world)
        omega, r = (
            pin.getVelocity(its, data, carriers[-1], world).angular,
            ends[-1] - data.oMi[carriers[-1]].translation,
        )
        of_end = last.linear + np.cross(last.angular, r) + np.cross(omega, np.cross(omega, r)) + [0, 0, GRAVITY]
        np.testing.assert_allclose(angular[:, 0], last.angular, atol=1e-8 * np.abs(last.angular).max())
        np.testing.assert_allclose(linear[:, 0], of_end, atol=1e-8 * np.abs(of_end).max())


def test_drag_by_hand():
    """All along a link alike, or only across it; 5 m/s in three and four."""
    velocity, down = ca.SX(ca.DM([3.0, 0.0, -4.0])), ca.SX(ca.DM([0.0, 0.0, -1.0]))

    def force(drag: float, ratio: float) -> list[float]:
        link = Link(*(ca.SX(x) for x in (1.0, 1.0, 1.0, 0.0, drag, ratio)))
        return np.array(ca.DM(ca.Function("drag", [], [drag_force(link, velocity, down)])()["o0"]))[:, 0].tolist()

    assert force(0.1, 1.0) == pytest.approx([-1.5, 0, 2.0])
    assert force(0.1, 0.0) == pytest.approx([-1.5, 0, 0.0])
    assert force(0.1, 0.5) == pytest.approx([-1.5, 0, 1.0])
    assert force(0.0, 1.0) == [0, 0, 0]


def test_a_locked_rotor_carries_the_whole_link():
    """A hinge with a huge armature gives nothing way: what is carried behind it is carried before it."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6))
    A = root @ root.T
    J, H, M = (ca.SX(ca.DM(x)) for x in (A[:3, :3], A[:3, 3:], A[3:, 3:]))
    carried = SpatialCarried(J, H, M, *(ca.SX(ca.DM(rng.normal(size=3))) for _ in range(2)))
    axis = ca.SX(ca.DM(SKEW))
    for armature, stays in ((1e12, True), (0.0, False)):
        felt, _ = give_way(carried, axis, ca.SX(0), ca.SX(armature))
        parts = [np.array(ca.DM(x)) for x in felt]
        same = [np.allclose(x, np.array(ca.DM(y)), atol=1e-9) for x, y in zip(parts, carried, strict=True)]
        assert all(same) == stays
    # a free hinge without torque transmits no moment about its axis, whatever the accelerations
    assert parts[0] @ SKEW == pytest.approx([0, 0, 0], abs=1e-9)
    assert np.array(SKEW) @ parts[1] == pytest.approx([0, 0, 0], abs=1e-9)
    assert float(np.array(SKEW) @ parts[3][:, 0]) == pytest.approx(0, abs=1e-9)


def test_symmetric_matrices_are_their_upper_entries():
    A = np.arange(9.0).reshape(3, 3)
    A = A + A.T
    np.testing.assert_array_equal(np.array(ca.DM(symmetric(upper(ca.SX(ca.DM(A)))))), A)
