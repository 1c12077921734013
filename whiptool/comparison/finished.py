"""The results of a comparison that has ended, in one small file: Figs. 6 and 7 are drawn without training."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.comparison.series import Series
from whiptool.errors import InputError
from whiptool.given_files import read_json
from whiptool.rl.task import OLD_OBSERVATIONS
from whiptool.whole_files import write_whole

FORMAT = 1  # raised when a key changes its meaning
_PLAIN = ("method", "observation", "convention", "hit_radius", "training_trials", "n_diverged", "wall_time")


@dataclass(frozen=True, eq=False)
class Results:
    """Results of a comparison.

    Args:
        series: Trials to the first hit, as `whiptool.comparison.collect` returns them.
        rewards: Mean reward of every episode by observation and learner, S seeds by E episodes, (S, E), rounded to two
            decimals.
        random_episodes: Number of initial random episodes, by observation.
        cap: Largest number of trials at each target.
        version: Version of the code that ran.
    """

    series: tuple[Series, ...]
    rewards: dict[str, dict[str, np.ndarray]]
    random_episodes: dict[str, int]
    cap: int
    version: str

    def at(self, hit_radius: float, *, convention: str = "mean-first") -> list[Series]:
        """Return the searches, and the learners under a convention, at a hit radius [m]."""
        return [one for one in self.series if one.hit_radius == hit_radius and one.convention in ("", convention)]

    def save(self, path: Path | str) -> None:
        """Write a JSON file; targets that were not hit are stored with 0 trials."""
        series = [
            {name: getattr(one, name) for name in _PLAIN}
            | {"trials": np.where(one.hit, one.trials, 0).tolist(), "notes": list(one.notes)}
            for one in self.series
        ]
        rewards = {o: {m: np.round(x, 2).tolist() for m, x in of.items()} for o, of in self.rewards.items()}
        table = {
            "format": FORMAT,
            "version": self.version,
            "cap": self.cap,
            "random_episodes": self.random_episodes,
            "rewards": rewards,
            "series": series,
        }
        write_whole(Path(path), json.dumps(table, allow_nan=False, separators=(",", ":")) + "\n")

    @classmethod
    def load(cls, path: Path | str) -> Results:
        """Read results that `save` wrote.

        Raises:
            InputError: The file is not there, is damaged, or is of another format.
        """
        try:
            table = read_json(path)
            if table["format"] != FORMAT:
                raise ValueError(f"format {table['format']}, not {FORMAT}")
            cap = int(table["cap"])
            return cls(
                series=tuple(_series(one, cap) for one in table["series"]),
                rewards={_now(o): {m: np.array(x) for m, x in of.items()} for o, of in table["rewards"].items()},
                random_episodes={_now(o): count for o, count in table["random_episodes"].items()},
                cap=cap,
                version=table["version"],
            )
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                "results", str(path), "a whole file that whiptool wrote", f"reason: {str(error)[:160]}"
            ) from None


def _now(observation: str) -> str:
    """Return an observation under the name that it has now."""
    return OLD_OBSERVATIONS.get(observation, observation)


def _series(table: Mapping[str, Any], cap: int) -> Series:
    trials = np.array(table["trials"])
    hit = trials > 0
    plain = {name: table[name] for name in _PLAIN} | {"observation": _now(table["observation"])}
    return Series(**plain, trials=np.where(hit, trials, cap), hit=hit, notes=tuple(table["notes"]), cap=cap)
