"""A library of past strikes: the strike whose tip passed nearest to a target is where a search for it begins.

Hindsight in its plainest form (see `whiptool.rl.hindsight`): every strike is an answer to all targets along its path.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from whiptool.given_files import read_arrays
from whiptool.models.strike import T_STAY, StrikeBounds
from whiptool.objective import Objective
from whiptool.optimizers.result import Result
from whiptool.rollout.compiled import CompiledRollout
from whiptool.whole_files import write_npz

RATE = 250.0  # [1/s] of the stored paths: the straight line between samples is then within about a millimetre
_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class StrikeLibrary:
    """Past strikes and the paths of their tips.

    Args:
        strikes: Strike vectors, (n, 2 a + 1).
        paths: Tip positions at equal intervals, (n, S, d) [m], with d the model's dimension, in single precision; NaN
            after a strike's end.
    """

    strikes: np.ndarray
    paths: np.ndarray

    @classmethod
    def random(
        cls, rollout: CompiledRollout, bounds: StrikeBounds, count: int, *, seed: int, t_stay: float = T_STAY
    ) -> StrikeLibrary:
        """Return a library of `count` uniformly random strikes."""
        strikes = bounds.sample(np.random.default_rng(seed), count)
        samples = int((bounds.upper[-1] + t_stay) * RATE) + 1
        paths = np.full((count, samples, rollout.model.dimension), np.nan, np.float32)
        for first in range(0, count, 4096):
            some = rollout.tip_path(strikes[first : first + 4096], t_stay=t_stay, rate=RATE)[1]
            paths[first : first + 4096, : some.shape[1]] = some
        return cls(strikes, paths)

    def nearest(self, target: np.ndarray | tuple[float, ...], count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Return the strikes whose tips passed nearest to a target, the nearest first.

        Args:
            target: Position of the target (x, y) or (x, y, z) [m].
            count: Number of strikes.

        Returns:
            Strike vectors, (count, 2 a + 1), and their miss distances [m], (count,).
        """
        distance = np.empty(len(self.strikes))
        for first in range(0, len(distance), _AT_ONCE):
            distance[first : first + _AT_ONCE] = _distance(self.paths[first : first + _AT_ONCE], np.asarray(target))
        order = np.argsort(distance, kind="stable")[:count]
        return self.strikes[order], distance[order]

    def save(self, path: Path | str) -> None:
        """Write an NPZ file, without pickle."""
        write_npz(path, {"strikes": self.strikes, "paths": self.paths})

    @classmethod
    def load(cls, path: Path | str) -> StrikeLibrary:
        """Read a library that `save` wrote.

        Raises:
            InputError: There is no such file, or it is not a library.
        """
        arrays = read_arrays(path, "library of strikes", {"strikes": "nm", "paths": "nSd"})
        return cls(arrays["strikes"], arrays["paths"])


def _distance(paths: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Of each path (b, S, d) from the target, (b,); infinite for a path without two samples."""
    start, step = paths[:, :-1] - target.astype(np.float32), np.diff(paths, axis=1)
    length2 = (step**2).sum(axis=2)
    s = np.clip(-(start * step).sum(axis=2) / np.where(length2 > 0, length2, 1), 0, 1)
    squared = ((start + s[..., None] * step) ** 2).sum(axis=2)
    return np.sqrt(np.where(np.isnan(squared), np.inf, squared).min(axis=1))


def warm_search(
    objective: Objective, method: str, library: StrikeLibrary, *, seed: int = 0, width: float = 0.1
) -> Result:
    """Try the library's strike that is nearest to the target; after a miss, search around it.

    Args:
        objective: Objective with the target; its bounds are reduced.
        method: As in `search`.
        library: Library of past strikes.
        seed: Seed of the method.
        width: Width of the box around the library's strike, as a fraction of the objective's box.

    Raises:
        InputError: The method is unknown, or does not fit the objective.
    """
    from whiptool.optimizers import search

    first = library.nearest(objective.target.position)[0][0]
    lower, upper = objective.bounds.box
    half = width * (upper - lower) / 2
    centre = np.clip(first, lower + half, upper - half)
    objective.bounds = StrikeBounds(tuple(centre - half), tuple(centre + half))
    return search(objective, method, seed=seed, first=first)


def library_search(objective: Objective, library: StrikeLibrary) -> Result:
    """Try the library's strikes, nearest to the target first, until the objective stops the search or all were
    tried."""
    from whiptool.optimizers import run_search

    def strikes(objective: Objective, *, seed: int) -> None:
        for strike in library.nearest(objective.target.position, len(library.strikes))[0]:
            objective.trial(strike)

    return run_search(objective, strikes, "library", seed=0)
