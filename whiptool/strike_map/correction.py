"""Corrections of strikes to first order: the least change, in widths of the box, that leaves nothing of the goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_ROUNDS = 20  # in which numbers that leave the box are put on its side, or let off it


@dataclass(frozen=True, eq=False)
class Correction:
    """How B strikes are to change.

    Args:
        change: Change of each number, (B, m).
        size: Norm of the change in widths, (B,).
        left: Remaining residuals to first order [m], (B,).
    """

    change: np.ndarray
    size: np.ndarray
    left: np.ndarray


def correct(
    residuals: np.ndarray,
    slopes: np.ndarray,
    room: tuple[np.ndarray, np.ndarray],
    widths: np.ndarray,
    *,
    damping: float | np.ndarray = 1e-4,
) -> Correction:
    """Return the damped least-squares change of strikes within a box (Levenberg 1944, Marquardt 1963).

    It minimises |r + J x|^2 + damping^2 |x / widths|^2; numbers that would leave the box stay on its side
    (an active-set method: Stark and Parker 1995).

    Args:
        residuals: r [m], (B, r).
        slopes: J, (B, r, m).
        room: Least and largest change of each number, (B, m) each.
        widths: By which changes are measured, (m,).
        damping: [m], one or one each, (B,).
    """
    B, r, m = slopes.shape
    low, high = (np.broadcast_to(side, (B, m)) / widths for side in room)
    J = slopes * widths
    held = np.zeros((B, m), bool)
    x = np.zeros((B, m))
    ridge = np.broadcast_to(np.square(damping), (B,))[:, None, None]
    for _ in range(_ROUNDS):
        free = np.where(held[:, None, :], 0.0, J)
        rest = residuals + np.einsum("brm,bm->br", J, np.where(held, x, 0.0))
        dual = _solved(free @ free.swapaxes(1, 2) + ridge * np.eye(r), rest)
        x = np.where(held, x, -np.einsum("brm,br->bm", free, dual))
        out = (x < low) | (x > high)
        x = np.clip(x, low, high)
        downhill = -np.einsum("brm,br->bm", J, residuals + np.einsum("brm,bm->br", J, x)) - ridge[:, 0] * x
        inward = held & (((x == low) & (downhill > 0)) | ((x == high) & (downhill < 0)))
        settled = ~out.any(axis=1, keepdims=True)  # only then is it known which sides hold nothing back
        if settled.all() and not inward.any():
            break
        strongest = np.argmax(np.where(inward, np.abs(downhill), 0.0), axis=1)
        released = inward & settled & (np.arange(m) == strongest[:, None])  # singly: else they alternate
        held = (held | out) & ~released
    left = np.linalg.norm(residuals + np.einsum("brm,bm->br", J, x), axis=1)
    return Correction(x * widths, np.linalg.norm(x, axis=1), left)


def _solved(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the solutions (B, r) of A x = b, A (B, r, r) symmetric; where a slope is beyond all bounds, those of least
    norm: the damping is then lost in rounding errors."""
    try:
        return np.linalg.solve(A, b[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return np.einsum("brs,bs->br", np.linalg.pinv(A, hermitian=True), b)
