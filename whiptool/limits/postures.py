"""Search in a box of postures for one that keeps limits at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_DRAWN, _BEST = 512, 8  # postures from the whole box, and how many of the best are improved
_ROUNDS, _AROUND = 8, 64  # of draws around these, in a box half as wide each time


def least_beyond(
    beyond: Callable[[np.ndarray], float], low: np.ndarray, high: np.ndarray, *, enough: float = 0.0
) -> tuple[float, np.ndarray, int]:
    """Return by how much the best posture of a box is beyond limits, the posture (a,), and how many were tried: the one
    next to zero, then random ones of the whole box, then some around the best.

    Args:
        beyond: Function of a posture (a,) that returns its excess over the limits.
        low, high: Corners of the box, (a,) [rad or m].
        enough: Excess at which the search ends.
    """
    rng, tried = np.random.default_rng(0), list[tuple[float, np.ndarray]]()
    for i in range(1 + _ROUNDS):
        drawn = rng.uniform(low, high, (_AROUND if i else _DRAWN, len(low)))
        if i:
            best = np.stack([q for _, q in sorted(tried, key=lambda x: x[0])[:_BEST]])
            drawn = np.tile(best, (_AROUND // _BEST, 1)) + (drawn - (low + high) / 2) / 2**i
        for q in np.clip(drawn if i else [np.zeros(len(low)), *drawn], low, high):
            tried.append((beyond(q), q))
            if tried[-1][0] <= enough:
                return *tried[-1], len(tried)
    return *min(tried, key=lambda x: x[0]), len(tried)
