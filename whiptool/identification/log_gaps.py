"""Whether a log of joints, or of a hand, tells the motion of all that was read: without holes, to its end."""

from __future__ import annotations

import numpy as np

from whiptool.errors import InputError

_HOLE = 0.04  # [s] between samples, and four times the usual; the motion in a longer gap is unknown
_MOVED = 0.02  # [rad], [m] over a hole, or in so many seconds: less is not a motion
_SHORT = 0.05  # [s] in which speed is judged
_AT_REST = 0.1  # [s] that a log may end before the last reading, if the arm stands


def check_covers(name: str, t: np.ndarray, q: np.ndarray, first: float, last: float) -> None:
    """Refuse a log of joints or of a hand that does not cover the whole motion.

    Args:
        name: Name of the log, for messages.
        t, q: Times (S,) [s] and samples (S, a) [rad or m] of the log.
        first, last: Times of the first and last reading to predict [s].

    Raises:
        InputError: The log has a gap while the arm moves, starts late or ends early.
    """
    usual = max(_HOLE, 4 * float(np.median(np.diff(t))))
    gaps, moved = np.diff(t), np.abs(np.diff(q, axis=0)).max(axis=1)
    for i in np.flatnonzero((gaps > usual) & (moved > _MOVED) & (t[1:] > first) & (t[:-1] < last)):
        given = f"a hole of {gaps[i]:.3g} s from {t[i]:.3f} s, in which a joint moved by {moved[i]:.2g}"
        raise InputError(name, given, "no hole while the arm moves", "cut the recording before it, or record it again")
    rule, fix = "a log from rest, to the last reading", "cut the recording to what the log holds, or record it again"
    if t[0] > first + usual and _moves(q, t <= t[0] + _SHORT):
        raise InputError(name, f"a start at {t[0]:.3f} s, with the arm moving; readings from {first:.3f} s", rule, fix)
    early = last - t[-1]
    if early > _AT_REST or (early > usual and _moves(q, t >= t[-1] - _SHORT)):
        raise InputError(name, f"an end at {t[-1]:.3f} s; readings to {last:.3f} s", rule, fix)


def _moves(q: np.ndarray, which: np.ndarray) -> bool:
    """Whether a joint moves in a short span, by more than a log's noise."""
    return bool(np.ptp(q[which], axis=0).max(initial=0.0) > _MOVED)
