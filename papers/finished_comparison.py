"""Reads the run folder of a comparison that has ended as the results that Figs. 6 and 7 are drawn from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from papers.reproduce import ReproduceOptions
from whiptool.commands.compare import CompareOptions
from whiptool.commands.run_folders import stored_options
from whiptool.comparison.finished import Results
from whiptool.comparison.plan import LEARNERS, PAPER_METHODS, Comparison
from whiptool.comparison.series import collect
from whiptool.comparison.units import older_results, unit_file
from whiptool.errors import InputError
from whiptool.given_files import read_json, read_toml
from whiptool.rl.task import OBSERVATIONS
from whiptool.runs import CONFIG

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
