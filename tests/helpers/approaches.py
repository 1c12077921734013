"""Closest approaches of which no more is told than how near strikes come, and how fast."""

from __future__ import annotations

import numpy as np

from whiptool.models.trajectory import Approach


def approaches(distance: np.ndarray, velocity: np.ndarray | None = None) -> Approach:
    """Of distances of any shape [m], and velocities, one more axis [m/s]; those without a finite distance diverged."""
    flat = np.asarray(distance, float).ravel()
    moving = np.zeros((len(flat), 2)) if velocity is None else np.asarray(velocity, float).reshape(len(flat), -1)
    nothing = np.zeros((len(flat), 2))
    return Approach(flat, np.zeros(len(flat)), moving, nothing, nothing, nothing, ~np.isfinite(flat))
