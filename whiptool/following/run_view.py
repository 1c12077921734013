"""What is shown of a run while it goes on: charts, points in the scene, and the strike to play."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from whiptool.goals.target import Target
from whiptool.models import Model
from whiptool.models.trajectory import Trajectory
from whiptool.models.visuals import Look


@dataclass(frozen=True, eq=False)
class Curve:
    """One quantity over the trials, episodes, strikes or parts of a run.

    Args:
        name: What it is, for a legend.
        x: Numbers of the trials, (K,), ascending.
        y: Its values, (K,); NaN where a value is missing.
    """

    name: str
    x: np.ndarray
    y: np.ndarray

    def thinned(self, most: int) -> Curve:
        """Return the curve with about `most` points or fewer: of each stretch the lowest and the highest."""
        bins = max(most // 2, 1)
        if len(self.x) <= 2 * bins:
            return self
        kept = {0, len(self.x) - 1}
        for part in np.array_split(np.flatnonzero(np.isfinite(self.y)), bins):
            if len(part):
                kept |= {int(part[np.argmin(self.y[part])]), int(part[np.argmax(self.y[part])])}
        rows = np.array(sorted(kept))
        return Curve(self.name, self.x[rows], self.y[rows])


@dataclass(frozen=True)
class Chart:
    """Curves with common axes.

    Args:
        title: What they show.
        across: What is counted along x, such as `trial`.
        unit: Unit of the values; empty for a number without unit.
        curves: The curves, one or more.
        logarithmic: Whether the values are positive and best read on a logarithmic axis.
    """

    title: str
    across: str
    unit: str
    curves: tuple[Curve, ...]
    logarithmic: bool = False

    @property
    def full_title(self) -> str:
        """Title with the unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class Chosen:
    """The strike of a run that is worth playing: the best so far, or the last.

    Args:
        number: Number of its trial, episode, strike or part.
        said: What it is, in words.
        vector: Its numbers, (m,); empty where they are only found by `Followed.motion`.
        state: Counts what else changes its motion, such as estimates of the whip.
    """

    number: int
    said: str
    vector: tuple[float, ...] = ()
    state: int = 0

    def is_other(self, before: Chosen | None) -> bool:
        """Whether another strike is chosen than before, or the same one of another state of the run."""
        return before is None or (self.number, self.vector, self.state) != (before.number, before.vector, before.state)


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """A strike that can be played.

    Args:
        model, trajectory, target: Its model, its trajectory, and what it is meant to hit.
        looks: Visual shapes of the robot, see `whiptool.models.files.robot_looks`; None: the shapes of the model.
    """

    model: Model
    trajectory: Trajectory
    target: Target
    looks: Sequence[Look] | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """Joints of a real arm over a strike.

    Args:
        t: Times from the strike's first cycle [s], (C,), ascending.
        q: Positions of the arm's joints [rad or m], (C, a).
    """

    t: np.ndarray
    q: np.ndarray

    def at(self, t: float) -> np.ndarray:
        """Return the positions at a time, (a,), those of the nearest end outside the times."""
        return np.array([np.interp(t, self.t, q) for q in self.q.T])


@dataclass(frozen=True, eq=False)
class RunView:
    """What is shown of a run at one moment.

    Args:
        heading: Which run it is.
        finished: Whether the run has written its result.
        facts: Numbers in words, by what they are.
        charts: How the run converges, learns or narrows its belief.
        points: Points in the scene by what they are, (K, d) each [m].
        chosen: The strike to play; None before the first.
        measured: What was measured of that strike, which is shown as it happens; None: the strike is simulated alone.
    """

    heading: str
    finished: bool
    facts: Mapping[str, str]
    charts: tuple[Chart, ...]
    points: Mapping[str, np.ndarray] = field(default_factory=dict)
    chosen: Chosen | None = None
    measured: Measured | None = None
