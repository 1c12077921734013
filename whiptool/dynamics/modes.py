"""Small motions: the chain linearised at a posture, and the natural modes of the hanging whip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from whiptool.dynamics.chain import Chain, bias_forces, chain_of, mass_matrix, passive_torque
from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.models.parameters import ArmLink, ArmParameters, Model, whole


@dataclass(frozen=True)
class Linearisation:
    """`M ddx + C dx + K x = tau` for small deviations x [rad] of the n joints from a posture, and torques tau [N m]
    beyond those that hold it.

    Args:
        M: Mass matrix [kg m^2], (n, n).
        C: Damping [N m s/rad], (n, n); away from rest with the velocity terms, not symmetric.
        K: Stiffness of springs and weight [N m/rad], (n, n); at rest symmetric, the potential energy's Hessian.
        A: State matrix of [x, dx], `[[0, 1], [-M^-1 K, -M^-1 C]]`, (2 n, 2 n).
    """

    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    A: np.ndarray


def linearise(chain: Chain | Model, q0: np.ndarray, v0: np.ndarray | None = None) -> Linearisation:
    """Exact derivatives of the chain's dynamics at a posture.

    The joints' accelerations are taken to be zero there, held so by constant torques: about an equilibrium these are
    zero, elsewhere they are `bias_forces - passive_torque`. Air drag is quadratic and has no part in C at rest.

    Args:
        chain: Of numbers; or a model, whose whole chain of arm and whip is meant.
        q0: Joint positions [rad], (n,).
        v0: Joint velocities [rad/s], (n,); default: at rest.

    Raises:
        InputError: A length is not n, a number is not finite, or the whip is of rods.
    """
    n = chain.n
    states = []
    for name, given in (("q0", q0), ("v0", np.zeros(n) if v0 is None else v0)):
        state = np.asarray(given, float)
        if state.shape != (n,) or not np.isfinite(state).all():
            raise InputError(name, given, f"{n} finite numbers, one per joint")
        states.append(state)
    M, C, K = (_in_space if isinstance(chain, Model) and chain.dimension == 3 else _in_plane)(chain, *states)  # type: ignore[arg-type]
    M = (M + M.T) / 2  # of rounding
    return Linearisation(M, C, K, _state_matrix(M, C, K))


def _in_plane(chain: Chain | Model, q0: np.ndarray, v0: np.ndarray) -> list[np.ndarray]:
    """M, C and K of a planar chain."""
    if isinstance(chain, Model):
        chain = chain_of(chain)
    q, v = ca.SX.sym("q", chain.n), ca.SX.sym("v", chain.n)
    force = bias_forces(chain, q, v) - passive_torque(chain, q, v)  # M ddq + force = tau
    matrices = ca.Function("linearise", [q, v], [mass_matrix(chain, q), ca.jacobian(force, v), ca.jacobian(force, q)])
    return [np.array(x) for x in matrices(q0, v0)]


def _in_space(model: Model, q0: np.ndarray, v0: np.ndarray) -> list[np.ndarray]:
    """M, C and K of an arm and a whip of universal nodes.

    Raises:
        InputError: The whip is of rods, which have no joint angles.
    """
    from whiptool.dynamics.closed_loop import Structure, closed_loop
    from whiptool.impedance.controller import Controller

    if model.whip.joints == "rod":
        raise InputError("whip.joints", "rod", "universal")
    controller = Controller()  # any: only arm and whip are used
    structure = Structure.of(model, controller)
    loop, n = closed_loop(structure), model.n
    q, v, a = (ca.SX.sym(name, n) for name in ("q", "v", "a"))
    force = loop.inverse_dynamics(q, v, a)
    slopes = ca.Function("linearise", [q, v, a, loop.p], [ca.jacobian(force, x) for x in (a, v, q)], {"cse": True})
    p = structure.pack(model, controller, np.ones((1, 2 * model.arm.n + 1)))[0]
    return [np.array(x) for x in slopes(q0, v0, 0, p)]


def _state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    n = len(M)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.hstack([K, C]))]])  # (2 n, 2 n)


@dataclass(frozen=True)
class Modes:
    """Natural modes, lowest frequency first.

    Args:
        frequencies: Of the undamped whip [Hz], (k,).
        damping_ratios: Of the damped whip, (k,): `-Re(lambda) / |lambda|` of the pair of complex eigenvalues whose
            motion is most like the undamped mode. NaN where no pair is left for a mode: an overdamped mode does
            not swing, its eigenvalues are real, and with several such modes nothing says which two belong together.
        shapes: Joint angles of each undamped mode, (k, n), the largest being 1; zero for locked joints.
        eigenvalues: All 2 m of the damped motion of the m free joints [1/s], slowest first, (2 m,): complex in
            conjugate pairs, or real for overdamped motion.
    """

    frequencies: np.ndarray
    damping_ratios: np.ndarray
    shapes: np.ndarray
    eigenvalues: np.ndarray


_STRIKE = 2.0  # [s] that a mode has to grow in
_RUNGE_KUTTA = 2.0  # largest eigenvalue times step that is taken


def steady_timestep(model: Model, largest: float) -> float:
    """A step [s] at which the compiled rollout's integrator lets no mode of the hanging whip grow.

    The integrator takes damping implicitly and springs explicitly: like Heun's method it multiplies the swing of a mode
    of frequency w and damping ratio z by about `1 + (w h)^4 / 8 - z w h` in a step h. Half of what that allows is
    taken, for the whip does not hang in a strike, and no step in which a mode turns by more than half a radian. Modes
    that hardly swing (a damping ratio above 1/2) limit nothing.

    Args:
        model: Whip, arm and gravity.
        largest: No more than this [s].
    """
    whip = model.whip
    stiffest, lightest = whip.per_node("k").max(), (whip.per_node("m") * whip.per_node("l") ** 2).min()
    if largest * np.sqrt(16 * stiffest / lightest) < 0.5:  # no chain of such joints is faster
        return largest
    if model.dimension == 3:  # a hanging whip swings in two directions as one in the plane does
        whip = replace(whip, joints="hinge", node_inertia=0.0)
        model = Model(whip, ArmParameters((ArmLink(mass=1.0, length=1.0),)), gravity=model.gravity)
    eigenvalues = hanging_modes(model).eigenvalues
    swinging = eigenvalues[eigenvalues.imag > 0]  # one of each pair
    w = np.abs(swinging)
    z = -swinging.real / w
    w, z = w[z < 0.5], z[z < 0.5]
    steps = np.cbrt(8 * (z + 0.05 / (_STRIKE * w))) / w
    return float(min([largest, *np.minimum(steps / 2, 0.5 / w)]))


def explicit_timestep(model: Model) -> float:
    """A step [s] at which the classical Runge-Kutta method lets no mode of the hanging whip grow.

    Eigenvalues up to some 2.8 over the step are damped; a part of that is taken, for the whip does not hang in a
    strike. Dry friction counts as the damping that it is at rest. A universal node that is bent by 90 degrees about its
    second hinge (gimbal lock) turns about its first one with its own moment of inertia alone, between two dampers.

    Args:
        model: Whip, arm and gravity.
    """
    whip = model.whip
    damping = whip.per_node("b") + whip.per_node("dry_friction") / whip.friction_velocity
    locked = 0.0
    if whip.joints == "universal" and damping.any():
        own = whip.per_node("node_inertia")
        if not own.all():
            return 0.0
        locked = float((2 * damping / own).max())
    whip = replace(whip, joints="hinge", node_inertia=0.0, b=tuple(damping.tolist()))
    alone = Model(whip, ArmParameters((ArmLink(mass=1.0, length=1.0),)), gravity=model.gravity)
    return float(_RUNGE_KUTTA / max(locked, np.abs(hanging_modes(alone).eigenvalues).max()))


def hanging_modes(model: Model, *, fixed_arm: bool = True, count: int | None = None) -> Modes:
    """Modes of the whip that hangs at rest below the straight, hanging arm.

    Args:
        model: Whip, arm and gravity.
        fixed_arm: The arm is locked and the whip swings alone from the hand; otherwise all joints are free.
        count: How many modes; default: as many as joints are free.

    Raises:
        InputError: `count` is not in 1 .. number of free joints, or the whip is of rods.
    """
    a, n = model.arm.n, model.n
    free = slice(a if fixed_arm else 0, n)
    m = n - a if fixed_arm else n
    k = m if count is None else count
    k = whole("count", k, high=m)
    linear = linearise(model, start_posture(model, np.zeros((1, a)))[0])
    M, C, K = (matrix[free, free] for matrix in (linear.M, linear.C, linear.K))
    squares, undamped = eigh(K, M)  # columns with x^T M x = 1
    eigenvalues, damped = np.linalg.eig(_state_matrix(M, C, K))

    ratios = np.full(m, np.nan)
    swinging = np.flatnonzero(eigenvalues.imag > 1e-7 * np.abs(eigenvalues).max())  # smaller ones are rounding
    if len(swinging):
        lambdas, motions = eigenvalues[swinging], damped[:m, swinging]
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
        eigenvalues=eigenvalues[np.lexsort((eigenvalues.imag, np.abs(eigenvalues)))],
    )
