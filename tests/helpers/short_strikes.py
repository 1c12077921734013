"""A limit of whole strikes that is easily told: how long they last."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from whiptool.models.excess import Excess
from whiptool.models.trajectory import Approach, Trajectory


class ShortStrikes:
    """Strikes must not last longer; peaks say nothing of it.

    Args:
        longest: With what follows the movement [s].
    """

    judges: ClassVar[str] = "length"
    by_peaks: ClassVar[bool] = True
    words = "a short strike"
    command = None
    positions = None
    smooth = ()
    of_candidates = True

    def __init__(self, longest: float) -> None:
        self.longest, self.judged = longest, 0

    def violation_of_peaks(self, outcome: Approach, /) -> np.ndarray:
        """Below zero, but where it diverged."""
        return np.where(outcome.diverged, np.inf, -1.0)

    def violation(self, trajectory: Trajectory, /) -> float:
        """By how much it is too long [s]."""
        self.judged += 1
        return float(trajectory.t[-1]) - self.longest

    def explain(self, trajectory: Trajectory, joints: Sequence[str], /) -> Excess:
        """Its length in words."""
        return Excess(f"it lasts {trajectory.t[-1]:.2f} s")
