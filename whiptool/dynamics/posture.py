"""The state at the start of a strike: the arm at q_i, the whip at rest below the hand."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure
from whiptool.impedance.controller import Controller
from whiptool.models.kinematics import arm_frames, hanging_angles
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm

_AT_ONCE = 24  # postures in one call
_FEW = 6  # one by one is as fast


def hangs_straight(model: Model) -> bool:
    """Whether the whip hangs straight down: its hinge has no spring, and no joint a rest angle."""
    return hinge_is_free(model) and not model.whip.rest_angles.any()


def hinge_is_free(model: Model) -> bool:
    """Whether the whip's hinge has no spring, so that the whip's shape at rest does not depend on the arm."""
    return not any(model.whip.per_node(name)[0] for name in ("k", "cubic_stiffness"))


def start_posture(model: Model, q_i: np.ndarray) -> np.ndarray:
    """Return the joint positions at the start [rad], (B, n), for arm postures q_i (B, a); for rods the arm's positions
    and the rods' directions, (B, a + 3 N).

    A whip that does not hang straight starts in the equilibrium of gravity and springs, found by Newton's method from
    straight down.
    """
    a, n, hinges = model.arm.n, model.coordinates, model.whip.kind.hinges
    q = np.zeros((len(q_i), n))
    q[:, :a] = q_i
    if not hinges:
        q[:, a + 2 :: 3] = -1
    elif model.dimension == 3:
        q[:, a : a + 2] = hanging_angles(model.arm.in_space(), q_i)
    else:
        q[:, a] = -q_i.sum(axis=1)
    if hangs_straight(model):
        return q
    if not hinge_is_free(model) or model.dimension == 3:
        _settle(model, q)
        return q
    hanging = np.zeros((1, n))
    _settle(model, hanging)
    q[:, a:] += hanging[0, a:]
    return q


def _settle(model: Model, q: np.ndarray) -> None:
    """Moves the whip's joints to where weight and springs balance, in place."""
    a = model.arm.n
    controller = Controller()  # any: only the whip's potential energy is used
    structure = Structure.of(model, controller)
    p = structure.pack(model, controller, np.zeros((1, 2 * a + 1)))
    moving = np.arange(len(q))
    for _ in range(100):
        step = _newton_step(structure, q[moving], p)
        largest = np.abs(step).max(axis=1)
        found = q[moving, a:] - step * (0.5 / np.maximum(largest, 0.5))[:, None]
        if structure.joints == "rod":
            directions = found.reshape(len(found), -1, 3)
            directions /= np.linalg.norm(directions, axis=2, keepdims=True)
        q[moving, a:] = found
        moving = moving[largest >= 1e-12]
        if not len(moving):
            return


def _newton_step(structure: Structure, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return Newton's steps (B, m) towards balance, which are to be subtracted."""
    slope, hessian = _slopes(structure, q, p)
    if structure.joints == "rod":
        return _solve_across(hessian, slope, q[:, structure.n_arm :])
    # a negative curvature would lead uphill: damp until the Hessian is positive
    shift = np.maximum(0.0, 1e-9 - np.linalg.eigvalsh(hessian)[:, :1])
    damped = hessian + shift[..., None] * np.eye(slope.shape[1])
    return np.linalg.solve(damped, slope[..., None])[..., 0]


def start_derivative(model: Model, structure: Structure, q: np.ndarray, p: np.ndarray, dp: np.ndarray) -> np.ndarray:
    """Return the changes (B, n) of the start postures q (B, n) if the parameters p (B, P) change by dp (B, P).

    A bent whip stays in equilibrium: `H dq_whip = -(change of the energy's gradient)`, with H the energy's Hessian.
    """
    a = structure.n_arm
    dq = np.zeros_like(q)
    dq[:, :a] = dp[:, :a]  # q_i stands first
    if not len(q):
        return dq
    springs = ["whip.k", *(["whip.cubic_stiffness"] if "cubic_stiffness" in structure.optional else [])]
    hinge = [structure.columns(name).start for name in springs]  # a spring at the hinge would bend the whip
    bent = {"rest_angle", "rest_angle_x"} & set(structure.optional)
    if hangs_straight(model) and not bent and not dp[:, hinge].any():
        if model.whip.kind.hinges and model.dimension == 3:
            dq[:, a : a + 2] = _hanging_change(model.arm.in_space(), q[:, :a], dq[:, :a])
        elif model.dimension == 2:
            dq[:, a] = -dp[:, :a].sum(axis=1)
        return dq  # rods hang down whatever the arm does
    change = _along(structure, q, p, dq, dp)[1]
    starts, which = np.unique(np.hstack([q, p]), axis=0, return_inverse=True)  # strikes come once for each direction
    hessians = _slopes(structure, *np.split(starts, [q.shape[1]], axis=1))[1][which.ravel()]
    if structure.joints == "rod":
        dq[:, a:] = -_solve_across(hessians, change, q[:, a:])
    else:
        dq[:, a:] = -np.linalg.solve(hessians, change[..., None])[..., 0]
    return dq


def _solve_across(A: np.ndarray, b: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Solve `A x = b` for changes x (B, 3 N) of rods' directions, all across them; A (B, 3 N, 3 N) has rank 2 N."""
    B, N = len(directions), directions.shape[1] // 3
    across = _tangents(directions.reshape(B, N, 3))
    reduced = np.einsum("bnia,bnimj,bmjc->bnamc", across, A.reshape(B, N, 3, N, 3), across, optimize=True)
    right = np.einsum("bnia,bni->bna", across, b.reshape(B, N, 3))
    reduced, right = reduced.reshape(B, 2 * N, 2 * N), right.reshape(B, 2 * N, 1)
    try:
        found = np.linalg.solve(reduced, right)
    except np.linalg.LinAlgError:  # nothing holds a rod: neither weight nor a spring
        found = np.linalg.pinv(reduced) @ right
    return np.einsum("bnia,bna->bni", across, found.reshape(B, N, 2)).reshape(B, 3 * N)


def _tangents(directions: np.ndarray) -> np.ndarray:
    """Two unit vectors across each of unit vectors (B, N, 3) and across each other, (B, N, 3, 2)."""
    axis = np.eye(3)[np.abs(directions).argmin(axis=2)]  # the coordinate axis that is most across
    first = np.cross(directions, axis)
    first /= np.linalg.norm(first, axis=2, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=3)


def _hanging_change(arm: SpatialArm, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Change (B, 2) of `hanging_angles` along changes of the arm's joints (B, a)."""
    hand = arm_frames(arm, q, dq)[-1]
    down = np.array([0.0, 0.0, -1.0])
    g = np.einsum("bji,j->bi", hand.rotation, down)  # in the hand's frame
    dg = -np.einsum("bji,bj->bi", hand.rotation, np.cross(hand.spin, down))
    across = g[:, 1] ** 2 + g[:, 2] ** 2  # zero where the whip hangs along the first hinge: its angle is any
    across = np.where(across > 0, across, np.inf)
    dx = (g[:, 1] * dg[:, 2] - g[:, 2] * dg[:, 1]) / across
    return np.stack([dx, dg[:, 0] / np.sqrt(across)], axis=1)


def _slopes(structure: Structure, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (B, m) and Hessians (B, m, m) of the potential energy by the whip's m joints."""
    slope, hessian = _of_rows(closed_loop(structure).whip_hessian, q, np.broadcast_to(p, (len(q), p.shape[1])))
    m = slope.shape[1]
    return slope, hessian.reshape(len(q), m, m).transpose(0, 2, 1)  # CasADi stores columns


def _along(structure: Structure, q: np.ndarray, p: np.ndarray, dq: np.ndarray, dp: np.ndarray) -> list[np.ndarray]:
    """Slopes of the potential energy by the whip's joints and their change, (B, m) each; see `whip_balance`."""
    return _of_rows(closed_loop(structure).whip_balance, q, p, dq, np.broadcast_to(dp, p.shape))


def _of_rows(function: ca.Function, *rows: np.ndarray) -> list[np.ndarray]:
    """Return the function's values at rows (B, ...) each, shape (B, size) each; matrices stand by columns."""
    B = len(rows[0])
    at_once = _AT_ONCE if B > _FEW else 1
    mapped, found = _mapped(function, at_once), []
    for i in range(0, B, at_once):
        count = min(at_once, B - i)
        columns = [np.pad(x[i : i + count], ((0, at_once - count), (0, 0)), "edge").T for x in rows]
        found.append([x.full().T.reshape(at_once, -1)[:count] for x in mapped(*columns)])
    return [np.concatenate(parts) for parts in zip(*found, strict=True)]


@lru_cache(maxsize=16)
def _mapped(function: ca.Function, at_once: int) -> ca.Function:
    return function.map(at_once)
