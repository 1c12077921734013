"""Units worked on and kept: one small file each, so that a killed run loses no more than those it was at."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from whiptool.errors import InputError
from whiptool.given_files import read_json
from whiptool.options.budget import OLD_OBSERVATIONS
from whiptool.studies.comparison.learner_unit import Checkpoint
from whiptool.studies.comparison.units import Unit
from whiptool.studies.workers import work_on
from whiptool.whole_files import write_whole


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
        workers, cluster: See `whiptool.studies.workers.work_on`.
    """

    def __init__(self, folder: Path, *, workers: int = 1, cluster: str | None = None) -> None:
        self.units, self.checkpoints = (folder.resolve() / name for name in ("units", "checkpoints"))
        self.workers, self.cluster = workers, cluster
        self.deaths: list[list[str]] = []
        for path in (self.units, self.checkpoints):
            path.mkdir(exist_ok=True)

    def results(self, units: Sequence[Unit], *, desc: str = "") -> dict[str, dict[str, Any]]:
        """The units' results by name; those that are not there yet are worked on, with a progress bar.

        Raises:
            UnitFailed: One of them failed; what others gave is kept.
            InputError: A stored result is damaged.
        """
        from whiptool.progress import Progress

        names = {unit.name: unit for unit in units}
        results = {name: self._read(name) for name in names if self._file(name).exists()}
        todo = {name: unit for name, unit in names.items() if name not in results}
        alone = self.workers == 1 and self.cluster is None
        work = Work(self.checkpoints, None if alone else max(1, (os.cpu_count() or 1) // self.workers))
        with Progress(
            total=len(names),
            initial=len(results),
            unit=" units",
            desc=desc,
            file=sys.stderr,
            dynamic_ncols=True,
            leave=False,
            delay=1,
        ) as bar:
            found = work_on(todo, work, workers=self.workers, cluster=self.cluster, on_death=self._on_death)
            for name, result in found:
                write_whole(self._file(name), json.dumps(result, allow_nan=False))
                Checkpoint(self.checkpoints / f"{name}.pt").remove()
                results[name] = result
                bar.set_postfix_str(name, refresh=False)
                bar.update()
        return results

    def _on_death(self, names: list[str]) -> None:
        self.deaths.append(names)
        print(f"whiptool: a worker died at {' or '.join(names)}; trying again", file=sys.stderr)

    def _file(self, name: str) -> Path:
        return unit_file(self.units, name)

    def _read(self, name: str) -> dict[str, Any]:
        try:
            return read_json(self._file(name))
        except InputError as error:
            raise error.renamed(error.name, "delete it") from None


def unit_file(folder: Path, name: str) -> Path:
    """Return the file of a unit's result; an older run named it by what the learner's observation was called then."""
    for old, new in OLD_OBSERVATIONS.items():
        older = folder / f"{name.replace(f'-{new}-seed', f'-{old}-seed')}.json"
        if older.exists():
            return older
    return folder / f"{name}.json"
