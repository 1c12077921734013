"""Predict where an arm rests before a strike: an impedance law carries weight only with a position error."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from whiptool.impedance.laws import Law
from whiptool.recording.strike_recording import StrikeRecording

Sag = Callable[[np.ndarray], np.ndarray]  # from postures q_i (B, a) to how far off the arm stands (B, a) [rad]
_RIDGE = 0.03  # of a posture's sines, below which it tells nothing of a link's weight
_FIRST, _ROUNDS, _DIFFERENCE, _LARGEST = 0.1, 60, 1e-6, 0.2  # [rad]


def expected_sag(law: Law, recordings: Sequence[StrikeRecording | None]) -> Sag | None:
    """Return a function that predicts how far the arm at rest deviates from a commanded posture, from earlier
    recordings.

    The uncompensated gravity torque of link j and the links after it is `c_j sin(theta_j)` at the joints up to j, with
    theta_j the link's angle to the vertical. The measured errors at rest give the controller's torques, these give c by
    least squares, and c predicts the errors at other postures.

    Args:
        law: Control law of the arm.
        recordings: Recordings of earlier strikes; those without measured joints are ignored.

    Returns:
        A function from commanded postures q_i (B, a) to deviations (B, a) [rad]; None if no joints were measured, or no
        joint deviated.
    """
    rows, torques = [], []
    for recording in recordings:
        sag = None if recording is None else recording.sag
        if sag is None:
            continue
        assert recording is not None
        assert recording.strike is not None
        rows.append(_levers(np.array([recording.strike.q_i]) + sag)[0])
        torques.append(_held(law, -sag[None])[0])
    if not rows or not np.any(torques):
        return None
    M, tau = np.vstack(rows), np.concatenate(torques)
    left = np.linalg.solve(M.T @ M + _RIDGE**2 * np.eye(M.shape[1]), M.T @ tau)

    def stands(q_i: np.ndarray) -> np.ndarray:
        first = _errors(law, _levers(q_i) @ left)
        return -_errors(law, _levers(q_i - first) @ left)

    return stands


def _levers(q: np.ndarray) -> np.ndarray:
    """Torque of every joint by the unbalanced moment of every link, (B, a, a)."""
    return np.triu(np.ones((q.shape[1],) * 2)) * np.sin(np.cumsum(q, axis=1))[:, None, :]


def _held(law: Law, e: np.ndarray) -> np.ndarray:
    """The law's torques at rest for errors e (B, a) [N m]."""
    return np.einsum("bij,bj->bi", law.gains(e, np.zeros_like(e))[0], e)


def _errors(law: Law, torque: np.ndarray) -> np.ndarray:
    """The errors at which the law holds torques (B, a) at rest, by Newton's method from beyond; at most `_LARGEST`."""
    size = np.linalg.norm(torque, axis=1, keepdims=True)
    e = _FIRST * torque / np.maximum(size, 1e-12)
    a = e.shape[1]
    for _ in range(_ROUNDS):
        steps = _DIFFERENCE * np.eye(a)
        slopes = [(_held(law, e + step) - _held(law, e - step)) / (2 * _DIFFERENCE) for step in steps]
        J = np.stack(slopes, axis=2) + 1e-9 * np.eye(a)
        move = np.linalg.solve(J, (torque - _held(law, e))[..., None])[..., 0]
        e = np.clip(e + move, -_LARGEST, _LARGEST)
        if np.abs(move).max(initial=0.0) < 1e-7:
            break
    return np.where(size > 1e-9, e, 0.0)
