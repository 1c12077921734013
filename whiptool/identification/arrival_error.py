"""How far a direction of arrival may be off, where the path of the tip is known with an error."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

PACE = 0.05  # [s] in which the distance between the true and the known path changes by its own size
_STILL = 1e-3  # [m/s], below which a tip has no direction


def direction_error(error: np.ndarray | float, speed: np.ndarray) -> np.ndarray:
    """Return the standard error of a direction [rad]: that of the place over what the tip moves on in `PACE`.

    Args:
        error: Standard error of the place [m], one number or like `speed`.
        speed: Of the tip [m/s], any shape.
    """
    return np.arctan(error / (np.maximum(speed, _STILL) * PACE))


def angle_probability(angle: np.ndarray, cone: float, error: np.ndarray) -> np.ndarray:
    """Return the probability that a direction lies within a cone.

    Args:
        angle: From the middle of the cone, as it is known [rad], any shape.
        cone: [rad]
        error: Standard error of the angle [rad], like `angle`, positive.
    """
    return ndtr((cone - angle) / error) - ndtr((-cone - angle) / error)
