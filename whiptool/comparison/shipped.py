"""Results of a comparison in one small file, so that Figs. 6 and 7 can be drawn where nothing was trained."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.comparison.plan import LEARNERS, OBSERVATIONS, PAPER_METHODS, Comparison
from whiptool.comparison.series import Series, collect
from whiptool.errors import InputError
from whiptool.models.files import read_toml
from whiptool.runs import CONFIG
from whiptool.whole_files import write_whole

FORMAT = 1  # raised when a key changes its meaning
_PLAIN = ("method", "observation", "convention", "hit_radius", "training_trials", "n_diverged", "wall_time")


@dataclass(frozen=True, eq=False)
class Results:
    """What a comparison came to.

    Args:
        series: Trials to the first hit, as `whiptool.comparison.collect` gives them.
        rewards: By observation and learner: mean reward of every episode, (S, E), to two digits after the point.
        random_episodes: By observation: episodes before anything is learned.
        cap: Trials at most at each target.
        version: Of the code that ran.
    """

    series: tuple[Series, ...]
    rewards: dict[str, dict[str, np.ndarray]]
    random_episodes: dict[str, int]
    cap: int
    version: str

    def at(self, hit_radius: float, *, convention: str = "mean-first") -> list[Series]:
        """The searches, and the learners under a convention, at a hit radius [m]."""
        return [one for one in self.series if one.hit_radius == hit_radius and one.convention in ("", convention)]

    def save(self, path: Path | str) -> None:
        """Write a JSON file; a target that was not hit counts 0 trials in it."""
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
        """Read what `save` wrote.

        Raises:
            InputError: The file is not there, is damaged, or is of another format.
        """
        try:
            table = json.loads(Path(path).read_text(encoding="utf-8"))
            if table["format"] != FORMAT:
                raise ValueError(f"format {table['format']}, not {FORMAT}")
            cap = int(table["cap"])
            return cls(
                series=tuple(_series(one, cap) for one in table["series"]),
                rewards={o: {m: np.array(x) for m, x in of.items()} for o, of in table["rewards"].items()},
                random_episodes=table["random_episodes"],
                cap=cap,
                version=table["version"],
            )
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError("results", str(path), f"a whole file that whiptool wrote ({error})"[:200]) from None


def read_run(folder: Path | str) -> Results:
    """The results in the run folder of `whiptool.compare` or `whiptool.reproduce`.

    Raises:
        InputError: It is no such folder, or not all of its units are finished.
    """
    from whiptool.cli import stored_options
    from whiptool.compare import CompareOptions
    from whiptool.reproduce import ReproduceOptions

    folder = Path(folder)
    config = read_toml(folder / CONFIG)
    kinds: dict[str, type[Any]] = {"compare": CompareOptions, "reproduce": ReproduceOptions}
    kind = kinds.get(config.get("command", ""))
    if kind is None:
        raise InputError("run folder", str(folder), "one of whiptool.compare or whiptool.reproduce")
    mine = {f.name for f in fields(kind)}  # older runs hold options that there are no more
    options = stored_options(kind, {k: v for k, v in config["options"].items() if k in mine}, folder)
    methods, observations = PAPER_METHODS, OBSERVATIONS
    if kind is CompareOptions:
        methods, observations = options.methods, options.observation
    comparison = options.comparison(methods, observations)
    units = comparison.units()
    files = {unit.name: folder / "units" / f"{unit.name}.json" for unit in units}
    missing = [name for name, file in files.items() if not file.exists()]
    if missing:
        fix = "finish it with --resume"
        raise InputError("run folder", str(folder), f"all {len(files)} units ({len(missing)} are not there)", fix)
    results = {name: json.loads(file.read_text(encoding="utf-8")) for name, file in files.items()}
    return Results(
        series=tuple(collect(units, results)),
        rewards=_rewards(comparison, results),
        random_episodes={o: comparison.training(o)[2] for o in comparison.observations},
        cap=comparison.scene.cap,
        version=config["version"],
    )


def _rewards(comparison: Comparison, results: Mapping[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    rewards: dict[str, dict[str, np.ndarray]] = {}
    for o in comparison.observations:
        for method in (m for m in LEARNERS if m in comparison.methods):
            rows = [results[unit.name]["rewards"] for unit in comparison.learner_units(method, o)]
            shortest = min(map(len, rows))  # training that diverged ends before
            rewards.setdefault(o, {})[method] = np.array([row[:shortest] for row in rows])
    return rewards


def _series(table: Mapping[str, Any], cap: int) -> Series:
    trials = np.array(table["trials"])
    hit = trials > 0
    plain = {name: table[name] for name in _PLAIN}
    return Series(**plain, trials=np.where(hit, trials, cap), hit=hit, notes=tuple(table["notes"]), cap=cap)
