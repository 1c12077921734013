"""Units worked on and kept: one small file each, so that a killed run loses no more than those it was at."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from whiptool.comparison.learner_unit import Checkpoint
from whiptool.comparison.unit import KEY, Unit
from whiptool.comparison.workers import work_on
from whiptool.errors import InputError
from whiptool.given_files import read_json
from whiptool.whole_files import write_whole
from whiptool.words import counted


@dataclass(frozen=True)
class Work:
    """What is done with a unit, wherever that is."""

    checkpoints: Path
    threads: int | None

    def __call__(self, unit: Unit) -> dict[str, Any]:
        """Run a unit and return its result."""
        return unit.run(self.checkpoints, self.threads)


class Store:
    """The results of units in a run folder.

    Args:
        folder: An existing folder; `units/` and `checkpoints/` are made in it.
        workers, cluster: See `whiptool.comparison.workers.work_on`.
    """

    def __init__(self, folder: Path, *, workers: int = 1, cluster: str | None = None) -> None:
        self.units, self.checkpoints = (folder.resolve() / name for name in ("units", "checkpoints"))
        self.workers, self.cluster = workers, cluster
        self.deaths: list[list[str]] = []
        for path in (self.units, self.checkpoints):
            path.mkdir(exist_ok=True)
        if older := older_results(self.units):
            print(
                f"whiptool: {older}; they are not used, and what is needed of them is computed again", file=sys.stderr
            )

    def results(self, units: Sequence[Unit], *, desc: str = "") -> dict[str, dict[str, Any]]:
        """The units' results by key; those that are not there yet are worked on, with a progress bar.

        Raises:
            UnitFailed: One of them failed; what others gave is kept.
            InputError: A stored result is damaged.
        """
        from whiptool.progress import Progress

        by_key = {unit.key: unit for unit in units}
        results = {key: self._read(key) for key in by_key if unit_file(self.units, key).exists()}
        todo = {key: unit for key, unit in by_key.items() if key not in results}
        alone = self.workers == 1 and self.cluster is None
        work = Work(self.checkpoints, None if alone else max(1, (os.cpu_count() or 1) // self.workers))
        with Progress(
            total=len(by_key),
            initial=len(results),
            unit=" units",
            desc=desc,
            file=sys.stderr,
            dynamic_ncols=True,
            leave=False,
            delay=1,
        ) as bar:
            found = work_on(todo, work, workers=self.workers, cluster=self.cluster, on_death=self._on_death)
            for key, result in found:
                write_whole(unit_file(self.units, key), json.dumps(result, allow_nan=False))
                Checkpoint(self.checkpoints / f"{key}.pt").remove()
                results[key] = result
                bar.set_postfix_str(key, refresh=False)
                bar.update()
        return results

    def _on_death(self, keys: list[str]) -> None:
        self.deaths.append(keys)
        print(f"whiptool: a worker died at {' or '.join(keys)}; trying again", file=sys.stderr)

    def _read(self, key: str) -> dict[str, Any]:
        try:
            return read_json(unit_file(self.units, key))
        except InputError as error:
            raise error.renamed(error.name, "delete it") from None


def unit_file(folder: Path, key: str) -> Path:
    """Return the file of a unit's result in the folder of results."""
    return folder / f"{key}.json"


def older_results(folder: Path) -> str:
    """Return what there is to say of results of older versions in a folder, whose names left out fields of their units;
    empty without any."""
    count = sum(not KEY.search(file.stem) for file in folder.glob("*.json"))
    return f"{folder}: {counted(count, 'result')} of an older version of whiptool" if count else ""
