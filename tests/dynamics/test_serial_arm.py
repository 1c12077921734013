"""A serial arm's inertia, forces and hand: against Pinocchio, and weight by differences of the potential energy."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from spatial_arms import ARMS, random_arm

from whiptool.dynamics.serial_arm import Body, SerialArm, solve
from whiptool.impedance.arm import pinocchio_arm
from whiptool.models.kinematics import arm_frames
from whiptool.models.spatial_arm import SpatialArm

GRAVITY = 8.0
every_arm = pytest.mark.parametrize("name", ARMS)


def built(name: str) -> tuple[SpatialArm, SerialArm]:
    """A random arm, and the same of numbers in CasADi."""
    arm = random_arm(rng=np.random.default_rng(len(name)), **ARMS[name])
    return arm, SerialArm.of(arm)


def states(a: int) -> np.ndarray:
    """Four random q, v and a, (4, 3, a)."""
    return np.random.default_rng(a).uniform(-2, 2, (4, 3, a))


def symbols(a: int) -> list[ca.SX]:
    return [ca.SX.sym(name, a) for name in "qva"]


def motion_of(serial: SerialArm) -> ca.Function:
    q, v, _ = symbols(serial.n)
    return ca.Function("motion", [q, v], list(serial.motion(q, v, GRAVITY, serial.bodies)))


@every_arm
def test_inertia_and_bias_are_pinocchios(name: str):
    """By crba, and by rnea without acceleration; the bias holds the weight, too."""
    arm, serial = built(name)
    its, motion = pinocchio_arm(arm, GRAVITY), motion_of(serial)
    data = its.createData()
    for q, v, _ in states(arm.n):
        inertia, bias = (np.array(x) for x in motion(q, v)[:2])
        M = pin.crba(its, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(inertia, M, atol=1e-12)
        np.testing.assert_allclose(bias[:, 0], pin.rnea(its, data, q, v, np.zeros(arm.n)), atol=1e-11)


@every_arm
def test_the_hand_moves_as_pinocchios_frame(name: str):
    """Its Jacobian and, without acceleration of the joints, its own with gravity as the base's; angular part first."""
    arm, serial = built(name)
    its, motion = pinocchio_arm(arm, GRAVITY), motion_of(serial)
    data, frame, world = its.createData(), its.getFrameId("end"), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for q, v, _ in states(arm.n):
        _, _, jacobian, drift, *_ = (np.array(x) for x in motion(q, v))
        J = pin.computeFrameJacobian(its, data, q, frame, world).reshape(6, -1)
        np.testing.assert_allclose(jacobian, J[[3, 4, 5, 0, 1, 2]], atol=1e-12)
        pin.forwardKinematics(its, data, q, v, np.zeros(arm.n))
        pin.updateFramePlacements(its, data)
        its_drift = pin.getFrameClassicalAcceleration(its, data, frame, world)
        np.testing.assert_allclose(drift[:3, 0], its_drift.angular, atol=1e-11)
        np.testing.assert_allclose(drift[3:, 0], its_drift.linear + np.array([0, 0, GRAVITY]), atol=1e-11)


@every_arm
def test_weight_is_the_slope_of_the_potential_energy(name: str):
    """Of the masses' heights by plain forward kinematics, by central differences; as is its own energy."""
    arm, serial = built(name)
    q, *_ = symbols(arm.n)
    weight = ca.Function("weight", [q], [serial.weight(serial.posture(q), serial.bodies, GRAVITY)])
    potential = ca.Function("potential", [q], [serial.potential(serial.posture(q), GRAVITY)])

    def energy(at: np.ndarray) -> float:
        frames = arm_frames(arm, at)
        heights = [frame.carried(link.com).origin[2] for frame, link in zip(frames, arm.links, strict=False)]
        return GRAVITY * float(np.dot(arm.per_link("mass"), heights))

    h = 1e-5
    for at, _, _ in states(arm.n):
        slope = [(energy(at + h * e) - energy(at - h * e)) / (2 * h) for e in np.eye(arm.n)]
        np.testing.assert_allclose(np.array(weight(at))[:, 0], slope, atol=1e-7)
        assert float(potential(at)) == pytest.approx(energy(at), abs=1e-12)


@every_arm
def test_inverse_dynamics_is_pinocchios_and_kinetic_energy_that_of_the_moving_bodies(name: str):
    arm, serial = built(name)
    s = symbols(arm.n)
    inverse = ca.Function("inverse", s, [serial.inverse(*s, GRAVITY)])
    kinetic = ca.Function("kinetic", s[:2], [serial.kinetic(*s[:2])])
    its = pinocchio_arm(arm, GRAVITY)
    data = its.createData()
    for q, v, a in states(arm.n):
        torque = pin.rnea(its, data, q, v, a)
        np.testing.assert_allclose(np.array(inverse(q, v, a))[:, 0], torque, atol=1e-11)
        energy = arm.per_link("armature") @ v**2 / 2
        for frame, link in zip(arm_frames(arm, q, v), arm.links, strict=False):
            spin = frame.rotation.T @ frame.spin
            energy += link.mass * (frame.carried(link.com).velocity ** 2).sum() / 2
            energy += spin @ link.inertia_matrix @ spin / 2
        assert float(kinetic(q, v)) == pytest.approx(energy, rel=1e-12)


@every_arm
def test_places_of_links_and_hand_are_those_of_forward_kinematics(name: str):
    arm, serial = built(name)
    q, *_ = symbols(arm.n)
    at = serial.posture(q)
    found = ca.Function("places", [q], [ca.horzcat(*at.places, at.hand), at.hand_turned.matrix])
    for row, _, _ in states(arm.n):
        places, turned = (np.array(x) for x in found(row))
        frames = arm_frames(arm, row)
        np.testing.assert_allclose(places.T, [frame.origin for frame in frames], atol=1e-12)
        np.testing.assert_allclose(turned, frames[-1].rotation, atol=1e-12)


def test_bodies_on_one_link_add_up():
    """Two halves at two places are one body of their common centre and inertia about it (Steiner)."""
    _, serial = built("three joints")
    x = np.array([[0.1, 0.0, 0.05], [-0.2, 0.1, 0.0]])
    masses = np.array([1.0, 0.5])
    com = masses @ x / masses.sum()
    apart = x - com
    J = sum(m * ((r @ r) * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, apart, strict=True))
    halves = [Body(1, ca.SX(m), ca.SX(ca.DM(r)), ca.SX.zeros(3, 3)) for m, r in zip(masses, x, strict=True)]
    one = Body(1, ca.SX(masses.sum()), ca.SX(ca.DM(com)), ca.SX(ca.DM(J)))
    found = []
    for bodies in (halves, [one]):
        moved = SerialArm(**{**vars(serial), "bodies": bodies})
        found.append([np.array(y) for y in motion_of(moved)(*states(3)[0, :2])])
    for ours, its in zip(*found, strict=True):
        np.testing.assert_allclose(ours, its, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_small_systems_are_solved(n: int):
    rng = np.random.default_rng(n)
    A, b = rng.normal(size=(n, n)) * 0.3 + 3 * np.eye(n), rng.normal(size=n)
    found = ca.Function("x", [], [solve(ca.DM(A), ca.DM(b))])()["o0"]
    np.testing.assert_allclose(np.array(found)[:, 0], np.linalg.solve(A, b), rtol=1e-12)
