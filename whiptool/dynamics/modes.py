"""Small motions: the chain linearised at a posture, and the natural modes of the hanging whip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from whiptool.dynamics import inverse
from whiptool.dynamics.chain import Chain, chain_of, inverse_dynamics, passive_torque
from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.posture import start_posture
from whiptool.dynamics.structure import Structure
from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.models.kinematics import joint_points
from whiptool.models.numbers import whole
from whiptool.models.parameters import ArmLink, ArmParameters, Model


@dataclass(frozen=True)
class Linearisation:
    """Equations of small motions about a posture, `M ddx + C dx + K x = tau`.

    x are the deviations of the n joints of arm and whip from the posture [rad]; tau are torques, added to those that
    hold it [N m].
    A rod has two deviations: rotations towards the x and y axes of its frame. This frame is the world's, rotated by the
    smallest rotation that takes -z to the rod's direction. For a hanging rod they are tilts towards x and y.

    Args:
        M: Mass matrix [kg m^2], (n, n).
        C: Damping [N m s/rad], (n, n); away from rest with the velocity terms, not symmetric.
        K: Stiffness of springs and weight [N m/rad], (n, n); at rest symmetric, the potential energy's Hessian.
        A: State matrix of [x, dx], `[[0, 1], [-M^-1 K, -M^-1 C]]`, (2 n, 2 n). The joints of an arm of unknown inertia
            have no accelerations: their motion is prescribed.
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    A: np.ndarray


def linearise(chain: Chain | Model, q0: np.ndarray, v0: np.ndarray | None = None) -> Linearisation:
    """Return the exact derivatives of the chain's dynamics at a posture.

    Constant torques keep the joints' accelerations at zero there: at an equilibrium these torques are zero, elsewhere
    they are `bias_forces - passive_torque`. Quadratic air drag does not contribute to C at rest.

    Args:
        chain: Chain with numeric parameters; or a model, for the chain of its arm and whip.
        q0: Coordinates as in a trajectory: joint positions [rad], for rods unit vectors, (coordinates,).
        v0: Rates of the coordinates [rad/s, or 1/s for rods], (coordinates,); default: at rest.

    Raises:
        InputError: A length is wrong, a number is not finite, a rod's direction is not a unit vector, or its rate is
            not perpendicular to it.
    """
    size = chain.coordinates if isinstance(chain, Model) else chain.n
    states = []
    for name, given in (("q0", q0), ("v0", np.zeros(size) if v0 is None else v0)):
        state = np.asarray(given, float)
        if state.shape != (size,) or not np.isfinite(state).all():
            wrong = f"shape {state.shape}" if state.shape != (size,) else f"{state[~np.isfinite(state)][0]} among them"
            raise InputError(name, wrong, f"{size} finite numbers, one per joint or three per rod")
        states.append(state)
    if isinstance(chain, Model) and chain.dimension == 3:
        M, C, K = _in_space(chain, *states)
    else:
        M, C, K = _in_plane(chain, *states)
    M = (M + M.T) / 2  # of rounding
    prescribed = chain.arm.n if isinstance(chain, Model) and chain.arm.weightless else 0
    return Linearisation(M, C, K, _state_matrix(M, C, K, prescribed=prescribed))


def _in_plane(chain: Chain | Model, q0: np.ndarray, v0: np.ndarray) -> list[np.ndarray]:
    """M, C and K of a planar chain."""
    if isinstance(chain, Model):
        chain = chain_of(chain)
    q, v, a = (ca.SX.sym(name, chain.n) for name in "qva")
    force = ca.Function("force", [q, v, a], [inverse_dynamics(chain, q, v, a) - passive_torque(chain, q, v)])
    return _slopes(force, q0, v0)


def _in_space(model: Model, q0: np.ndarray, v0: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, C and K of an arm and whip in space."""
    controller = Controller()  # any: only arm and whip are used
    structure = Structure.of(model, controller)
    loop, n, a = closed_loop(structure), model.n, model.arm.n
    p = structure.pack(model, controller, np.ones((1, 2 * a + 1)))[0]
    if loop.hinges:
        return inverse.slopes(loop, p, q0, v0, _hinges, np.zeros((model.whip.N, 0)))
    across = _across_rods(q0[a:], v0[a:])  # (N, 3, 2)
    directions, rates = (x[a:].reshape(-1, 3) for x in (q0, v0))
    start, rate = np.r_[q0[:a], np.zeros(n - a)], np.r_[v0[:a], np.einsum("nij,ni->nj", across, rates).ravel()]
    return inverse.slopes(loop, p, start, rate, _near_rod, np.hstack([directions, across.reshape(-1, 6)]))


def _hinges(q: ca.SX, v: ca.SX, qdd: ca.SX, _: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """A universal joint's angles with two derivatives, and how they turn it, which is the angles themselves."""
    return q, v, qdd, ca.SX.eye(2)


def _near_rod(x: ca.SX, dx: ca.SX, ddx: ca.SX, at: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """A rod's direction with two derivatives (3, 1), for deviations x (2, 1) from its direction towards two axes, both
    in `at` (9, 1), and how x turns it (3, 2)."""
    moved = at[:3] + ca.mtimes(ca.reshape(at[3:], 2, 3).T, x)
    d = moved / ca.norm_2(moved)
    rate = ca.jtimes(d, x, dx)
    acceleration = ca.jtimes(rate, x, dx) + ca.jtimes(d, x, ddx)
    return d, rate, acceleration, ca.mtimes(ca.skew(d), ca.jacobian(d, x))


def _slopes(force: ca.Function, q0: np.ndarray, v0: np.ndarray) -> list[np.ndarray]:
    """Derivatives of a force (q, v, a) by accelerations, speeds and positions, (n, n) each.

    One direction after the other, through the recursion over the links: whole Jacobians of n joints, as expressions,
    are longer by n.
    """
    n = len(q0)
    point = [q0, v0, np.zeros(n)]
    along = force.forward(1).map(n)
    here = [np.repeat(x[:, None], n, axis=1) for x in (*point, np.zeros(n))]  # the last is the force itself, not used
    found = []
    for which in (2, 1, 0):
        directions = [np.zeros((len(x), n)) for x in point]
        directions[which] = np.eye(n)
        found.append(np.array(along(*here, *directions)))
    return found


def _across_rods(directions: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Two unit vectors across each of N rods (3 N,), (N, 3, 2)."""
    d, rate = directions.reshape(-1, 3), rates.reshape(-1, 3)
    length, along = np.abs((d**2).sum(axis=1) - 1), np.abs((d * rate).sum(axis=1))
    if length.max() > 1e-9:
        i = int(length.argmax())
        raise InputError(f"q0 of rod {i + 1}", d[i].tolist(), "a unit vector along the rod")
    if along.max() > 1e-9 * max(1.0, np.abs(rate).max()):
        i = int(along.argmax())
        raise InputError(f"v0 of rod {i + 1}", rate[i].tolist(), f"a rate perpendicular to the rod, {d[i].tolist()}")
    return np.array([_least_turn(row)[:, :2] for row in d])


def _least_turn(d: np.ndarray) -> np.ndarray:
    """The least rotation that takes -z to a unit vector (3,), (3, 3); to z, that about x."""
    if d[2] > 1 - 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    axis = np.cross([0, 0, -1], d)
    W = np.cross(np.eye(3), axis)
    return np.eye(3) + W + W @ W / (1 - d[2])


def _state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray, *, prescribed: int = 0) -> np.ndarray:
    """The state matrix (2 n, 2 n), in which the first `prescribed` of the coordinates do not accelerate."""
    n, free = len(M), slice(prescribed, None)
    accelerations = np.zeros((n, 2 * n))
    accelerations[free] = -np.linalg.solve(M[free, free], np.hstack([K, C])[free])
    return np.block([[np.zeros((n, n)), np.eye(n)], [accelerations]])


def _damped(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (2 n,) of `M ddx + C dx + K x = 0` and how x moves with each, (n, 2 n).

    Joints that no matrix couples, as the two directions of a whip in space that hangs straight, are solved apart: the
    time grows with the cube of a group's size.
    """
    from scipy.sparse.csgraph import connected_components

    coupled = sum(np.abs(X) > 1e-12 * np.sqrt(np.abs(np.outer(np.diag(X), np.diag(X)))) for X in (M, C, K))
    groups, of = connected_components(coupled, directed=False)
    eigenvalues, motions = np.zeros(0, complex), np.zeros((len(M), 0), complex)
    for group in range(groups):
        joints = np.flatnonzero(of == group)
        own, vectors = np.linalg.eig(_state_matrix(*(X[np.ix_(joints, joints)] for X in (M, C, K))))
        moved = np.zeros((len(M), len(own)), complex)
        moved[joints] = vectors[: len(joints)]
        eigenvalues, motions = np.r_[eigenvalues, own], np.hstack([motions, moved])
    return eigenvalues, motions


def _slowest_first(eigenvalues: np.ndarray) -> np.ndarray:
    """The order of eigenvalues (k,) by size, and by imaginary part where sizes differ by rounding alone."""
    sizes = np.abs(eigenvalues)
    return np.lexsort((eigenvalues.imag, np.round(sizes / max(sizes.max(), np.finfo(float).tiny), 12)))


def _displacements(model: Model, q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """How hand, nodes and tip move with small deviations x (k, n) of the joints from q, (k, N + 1, d)."""
    a, step = model.arm.n, 1e-6
    if model.whip.joints == "rod":
        moved = np.einsum("nij,knj->kni", _across_rods(q[a:], 0 * q[a:]), x[:, a:].reshape(len(x), -1, 2))
        x = np.hstack([x[:, :a], moved.reshape(len(x), -1)])
    return (joint_points(model, q + step * x) - joint_points(model, q - step * x))[:, a:] / (2 * step)


@dataclass(frozen=True)
class Modes:
    """Natural modes, lowest frequency first.

    Args:
        frequencies: Frequencies of the undamped whip [Hz], (k,).
        damping_ratios: Damping ratios of the damped whip, (k,): `-Re(lambda) / |lambda|` of the complex pair whose
            eigenvector is most like the undamped mode. NaN for overdamped modes, which have no complex pair, and whose
            real eigenvalues cannot be assigned to modes.
        shapes: Joint angles of each undamped mode, of rods their tilts towards x and y, (k, n), the largest being 1;
            zero for locked joints.
        displacements: Displacements of hand, nodes and tip in each undamped mode, per unit of its shape [m], (k, N + 1,
            2 or 3).
        eigenvalues: All 2 m of the damped motion of the m free joints [1/s], slowest first, (2 m,): complex in
            conjugate pairs, or real for overdamped motion.
    """

    frequencies: np.ndarray
    damping_ratios: np.ndarray
    shapes: np.ndarray
    displacements: np.ndarray
    eigenvalues: np.ndarray


_EXPLICIT = 5e-4  # [s]; where Runge and Kutta's method is stable at it, its steps are the cheaper ones
_RUNGE_KUTTA = 2.0  # largest eigenvalue times step that is taken


def explicit_timestep(model: Model) -> float:
    """Return a time step [s] at which the classical Runge-Kutta method is stable for all modes of the hanging whip.

    The method is stable for eigenvalues up to about 2.8 over the step; a fraction of that is used, as the whip does not
    hang during a strike. Dry friction is linearised at rest, as damping. A node with a universal joint at gimbal lock
    (bent by 90 degrees about its second hinge) has only its moment of inertia about the first hinge, against two
    dampers.
    """
    whip = model.whip
    damping = whip.per_node("b") + whip.per_node("dry_friction") / whip.friction_velocity
    locked = 0.0
    if whip.joints == "universal" and damping.any():
        own = whip.per_node("node_inertia")
        if not own.all():
            return 0.0
        locked = float((2 * damping / own).max())
    whip = replace(whip, joints="hinge", rest_angle_x=0.0, b=tuple(damping.tolist()))
    alone = Model(whip, ArmParameters((ArmLink(mass=1.0, length=1.0),)), gravity=model.gravity)
    return float(_RUNGE_KUTTA / max(locked, np.abs(hanging_modes(alone).eigenvalues).max()))


def stepped(
    model: Model, controller: Controller, *, free: Sequence[str] = (), timestep: float | None = None
) -> Structure:
    """Return the structure of a model and controller, with the integration method that needs less time.

    It is the classical Runge-Kutta method under position control, if that is stable at equal steps of `timestep` [s]
    (None: adaptive steps); else a Rosenbrock-W method. See `Structure.of`.
    """
    longest = _EXPLICIT if timestep is None else timestep
    explicit = controller.prescribed and longest <= explicit_timestep(model)
    return Structure.of(model, controller, free=free, explicit=explicit)


def hanging_modes(
    model: Model, *, fixed_arm: bool = True, count: int | None = None, posture: np.ndarray | None = None
) -> Modes:
    """Return the natural modes of the whip that hangs at rest below the arm.

    In space modes come in pairs in two directions. If nothing distinguishes the two directions, the two frequencies are
    equal and the directions arbitrary.

    Args:
        model: Whip, arm and gravity.
        fixed_arm: The arm is locked and the whip swings alone from the hand; otherwise all joints are free.
        count: Number of modes; default: the number of free joints.
        posture: Joint positions of the arm [rad], (a,), held by constant torques; default: 0, which for a planar arm is
            straight down.

    Raises:
        InputError: `count` is not in 1 .. number of free joints, the posture is of another arm, or the arm is free and
            its inertia is unknown.
    """
    from scipy.linalg import eigh
    from scipy.optimize import linear_sum_assignment

    a, n = model.arm.n, model.n
    at = np.zeros(a) if posture is None else np.asarray(posture, float)
    if at.shape != (a,) or not np.isfinite(at).all():
        raise InputError("posture", posture, f"{a} finite numbers, one per joint of the arm")
    if not fixed_arm and model.arm.weightless:
        unknown = f"an arm of which the inertia of {', '.join(model.arm.weightless)} is unknown"
        raise InputError("fixed_arm", unknown, "only fixed_arm=True")
    free = slice(a if fixed_arm else 0, n)
    m = n - a if fixed_arm else n
    k = m if count is None else count
    k = whole("count", k, high=m)
    hanging = start_posture(model, at[None])[0]
    linear = linearise(model, hanging)
    M, C, K = (matrix[free, free] for matrix in (linear.M, linear.C, linear.K))
    squares, undamped = (np.asarray(x) for x in eigh(K, M))  # columns with x^T M x = 1
    eigenvalues, damped = _damped(M, C, K)

    ratios = np.full(m, np.nan)
    swinging = np.flatnonzero(eigenvalues.imag > 1e-7 * np.abs(eigenvalues).max())  # smaller ones are rounding
    if len(swinging):
        lambdas, motions = eigenvalues[swinging], damped[:, swinging]
        norm = np.sqrt(np.einsum("im,ij,jm->m", motions.conj(), M, motions).real)
        likeness = np.abs(undamped.T @ M @ motions) / norm  # (m, pairs), 1 for the same shape
        modes, pairs = linear_sum_assignment(likeness, maximize=True)
        ratios[modes] = -lambdas.real[pairs] / np.abs(lambdas[pairs])
    shapes = np.zeros((m, n))
    shapes[:, free] = (undamped / undamped[np.abs(undamped).argmax(axis=0), np.arange(m)]).T
    return Modes(
        frequencies=np.sqrt(np.maximum(squares, 0))[:k] / (2 * np.pi),
        damping_ratios=ratios[:k],
        shapes=shapes[:k],
        displacements=_displacements(model, hanging, shapes[:k]),
        eigenvalues=eigenvalues[_slowest_first(eigenvalues)],
    )
