"""How a tip arrives, by hand: with angles and numbers, one strike at a time."""

from __future__ import annotations

import math

import numpy as np


def angle_by_hand(velocity: np.ndarray, wanted: np.ndarray) -> float:
    """The angle between two vectors [rad]."""
    return math.acos(np.clip(velocity @ wanted / math.hypot(*velocity) / math.hypot(*wanted), -1, 1))


def hit_by_hand(
    miss: float, velocity: np.ndarray, wanted: np.ndarray | None, radius: float, cone: float, speed: float | None
) -> bool:
    """Whether a strike comes near enough, along the direction, fast enough."""
    within = wanted is None or angle_by_hand(velocity, wanted) <= cone
    along = math.hypot(*velocity) if wanted is None else float(velocity @ wanted)
    return miss <= radius and within and (speed is None or along >= speed)


def cost_by_hand(
    miss: float, velocity: np.ndarray, wanted: np.ndarray | None, radius: float, cone: float, speed: float | None
) -> float:
    """Miss distance, chord of the angle in chords of the cone, share of the speed that is missing, in quadrature."""
    parts = [miss]
    if wanted is not None:
        parts.append(radius * math.sin(angle_by_hand(velocity, wanted) / 2) / math.sin(cone / 2))
    if speed is not None:
        along = math.hypot(*velocity) if wanted is None else float(velocity @ wanted)
        parts.append(radius * min(max(1 - along / speed, 0.0), 1.0))
    return math.sqrt(sum(part**2 for part in parts))
