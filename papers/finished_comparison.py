"""The results of a comparison that has ended, in one small file: Figs. 6 and 7 are drawn without training."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from papers.reproduce import ReproduceOptions
from whiptool.commands.compare import CompareOptions
from whiptool.commands.run_folders import stored_options
from whiptool.comparison.plan import LEARNERS, PAPER_METHODS, Comparison
from whiptool.comparison.series import Series, collect
from whiptool.comparison.units import older_results, unit_file
from whiptool.errors import InputError
from whiptool.given_files import read_json, read_toml
from whiptool.rl.task import OBSERVATIONS, OLD_OBSERVATIONS
from whiptool.runs import CONFIG
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
            raise InputError("results", str(path), f"a whole file that whiptool wrote ({error})"[:200]) from None


def _now(observation: str) -> str:
    """Return an observation under the name that it has now."""
    return OLD_OBSERVATIONS.get(observation, observation)


def _series(table: Mapping[str, Any], cap: int) -> Series:
    trials = np.array(table["trials"])
    hit = trials > 0
    plain = {name: table[name] for name in _PLAIN} | {"observation": _now(table["observation"])}
    return Series(**plain, trials=np.where(hit, trials, cap), hit=hit, notes=tuple(table["notes"]), cap=cap)


_RENAMED = {"cap": "max_trials"}  # of options of older runs


def read_run(folder: Path | str) -> Results:
    """The results in the run folder of `whiptool.compare` or `whiptool.reproduce`.

    Raises:
        InputError: It is not such a folder, or not all of its units are finished.
    """
    folder = Path(folder)
    config = read_toml(folder / CONFIG)
    kinds: dict[str, type[Any]] = {"compare": CompareOptions, "reproduce": ReproduceOptions}
    kind = kinds.get(config.get("command", ""))
    if kind is None:
        raise InputError("run folder", str(folder), "a run folder of whiptool.compare or whiptool.reproduce")
    mine = {f.name for f in fields(kind)}  # older runs hold options that there are no more
    begun = {_RENAMED.get(name, name): value for name, value in config["options"].items()}
    options = stored_options(kind, {name: value for name, value in begun.items() if name in mine}, folder)
    methods, observations = PAPER_METHODS, OBSERVATIONS
    if kind is CompareOptions:
        methods, observations = options.methods, options.observation
    comparison = options.comparison(methods, observations)
    units = comparison.units()
    files = {unit.key: unit_file(folder / "units", unit.key) for unit in units}
    missing = sum(not file.exists() for file in files.values())
    if missing:
        older = older_results(folder / "units")
        allowed = f"all {len(files)} units ({missing} are not there{'; ' if older else ''}{older})"
        raise InputError("run folder", str(folder), allowed, "finish it with --resume")
    results = {key: read_json(file) for key, file in files.items()}
    return Results(
        series=tuple(collect(units, results)),
        rewards=_rewards(comparison, results),
        random_episodes={o: comparison.training(o).random_episodes for o in comparison.observations},
        cap=comparison.scene.cap,
        version=config["version"],
    )


def _rewards(comparison: Comparison, results: Mapping[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    rewards: dict[str, dict[str, np.ndarray]] = {}
    for o in comparison.observations:
        for method in (m for m in LEARNERS if m in comparison.methods):
            rows = [results[unit.key]["rewards"] for unit in comparison.learner_units(method, o)]
            shortest = min(map(len, rows))  # training that diverged ends before
            rewards.setdefault(o, {})[method] = np.array([row[:shortest] for row in rows])
    return rewards
