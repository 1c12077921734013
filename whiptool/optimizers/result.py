"""How every search ends: a status with its message, and one Result."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from whiptool.errors import no_attribute
from whiptool.models.numbers import NoArray
from whiptool.models.strike import AnyStrike
from whiptool.objective import Outcome, Trial
from whiptool.words import counted


class Status(Enum):
    """Why a search ended."""

    HIT = "hit"
    CONVERGED = "converged"
    MAX_TRIALS = "max_trials"
    MAX_TIME = "max_time"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


MESSAGES = {
    Status.HIT: "the target was hit",
    Status.CONVERGED: "the method ended by its own criterion",
    Status.MAX_TRIALS: "the budget of trials is used up",
    Status.MAX_TIME: "the budget of time is used up",
    Status.INTERRUPTED: "interrupted; what was found so far is kept",
    Status.FAILED: "the method gave up",
}


@dataclass(frozen=True)
class Result(NoArray, instead="its strike or outcome"):
    """Result of a search.

    Args:
        method: Name of the method on the command line.
        status, message: Why the search ended.
        strike, outcome: The best strike and its outcome; None if there was no trial.
        trace: All trials in order.
        n_diverged: Number of trials that diverged.
        wall_time: Wall time [s].
    """

    method: str
    status: Status
    message: str
    strike: AnyStrike | None
    outcome: Outcome | None
    trace: tuple[Trial, ...]
    n_diverged: int
    wall_time: float

    def __repr__(self) -> str:
        found = self.outcome
        miss = "" if found is None or found.lost else f"miss {found.miss_distance:.4f} m: "
        best = "no trial" if found is None else f"best {miss}{found.status}"
        return f"Result({self.method}: {self.status.value}, {counted(self.n_trials, 'trial')}, {best})"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> None:
            cures = dict.fromkeys(("miss", "distance", "cost"), "result.miss_distance is the best strike's")
            raise no_attribute(self, name, cures)

    def uninterrupted(self) -> Result:
        """Return the result itself, or raise KeyboardInterrupt if the search was interrupted by Ctrl-C.

        Raises:
            KeyboardInterrupt: The search was interrupted.
        """
        if self.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return self

    @property
    def hit(self) -> bool:
        """Whether the best strike hits."""
        return self.outcome is not None and self.outcome.hit

    @property
    def miss_distance(self) -> float:
        """Miss distance of the best strike [m]; infinite if all strikes were refused or diverged."""
        return float("inf") if self.outcome is None or self.outcome.lost else self.outcome.miss_distance

    @property
    def first_hit(self) -> int | None:
        """Number of the first trial that hit, from 1; None if none did."""
        return next((trial.number for trial in self.trace if trial.outcome.hit), None)

    @property
    def n_trials(self) -> int:
        """Number of trials of the search."""
        return len(self.trace)
