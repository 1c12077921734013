"""Derivatives of miss distances against central differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def differences(distance: Callable[[float], np.ndarray], size: float) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of distances (B,) by a number's change, by differences of two widths, and an estimate of their own error:
    that of the rounding, and how far the widths disagree."""
    values = {k: distance(k * size) for k in (-2, -1, 1, 2)}
    narrow, wide = (values[1] - values[-1]) / (2 * size), (values[2] - values[-2]) / (4 * size)
    return (4 * narrow - wide) / 3, np.abs(narrow - wide) / 3 + 1e-12 / size


def compare(slope: np.ndarray, distance: Callable[[float], np.ndarray], size: float) -> tuple[np.ndarray, np.ndarray]:
    """Which slopes (B,) are wrong by more than 1e-5 of themselves and the difference's own error; and where the
    difference holds still.

    At a kink (two approaches equally near, a step more) its two widths disagree, or, where the kink is inside both, a
    narrower one.
    """
    expected, own = differences(distance, size)
    still = own < 1e-3 * np.abs(expected) + 1e-4 * np.abs(expected).max()
    wrong = still & (np.abs(slope - expected) > 1e-5 * np.abs(expected) + 3 * own)
    if wrong.any():
        narrow, own = differences(distance, size / 30)
        still &= ~wrong
        wrong &= np.abs(slope - narrow) > 1e-5 * np.abs(narrow) + 3 * own
    return wrong, still
