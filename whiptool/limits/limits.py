"""What limits of strikes are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Protocol

import numpy as np

from whiptool.limits.command_limits import CommandLimits
from whiptool.models.trajectory import Approach, Trajectory


class Smooth(Protocol):
    """Differentiable constraints of a strike: functions that are at most 0 if the strike keeps a limit."""

    def constraints(self, strike: np.ndarray, /) -> tuple[np.ndarray, np.ndarray]:
        """Return the functions (m,) and their derivatives (m, 2 a + 1) at a strike, (2 a + 1,)."""
        ...

    def kept(self, strikes: np.ndarray, /) -> np.ndarray:
        """Return whether strikes (B, 2 a + 1) keep the constraints, (B,)."""
        ...


class Limits(ABC):
    """Limits that a strike has to keep: `MotorLimits`, the `ArmLimits` of joints, `Clearance`.

    `judges` names them, and `by_peaks` is true if the peak values of a strike suffice to check it.
    """

    judges: ClassVar[str]
    by_peaks: ClassVar[bool]

    @property
    @abstractmethod
    def words(self) -> str:
        """The limits in words."""

    @property
    def command(self) -> CommandLimits | None:
        """Limits of the commanded path; None if it has no limits."""
        return None

    @property
    def smooth(self) -> Sequence[Smooth]:
        """What a search can keep beforehand."""
        return ()

    @property
    def positions(self) -> np.ndarray | None:
        """Lowest and highest position of each joint [rad or m], (2, a); None: no limits."""
        return None

    @property
    def of_candidates(self) -> bool:
        """Whether whole strikes have to be judged where they would be hits or the best."""
        return False

    @abstractmethod
    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return the excess of strikes over the limits by their peak values alone, (B,); at most 0 if they certainly
        keep the limits."""

    @abstractmethod
    def violation(self, trajectory: Trajectory) -> float:
        """Return the excess of a strike over the limits; at most 0 if it keeps them."""

    @abstractmethod
    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> str:
        """Return a description of the limit that a strike uses most."""
