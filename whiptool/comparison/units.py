"""Units of work, known by a hash of their kind and all their fields, and the folder in which their results are kept.

Each result is a small file, so that a killed run loses no more than those it was at.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.comparison.workers import work_on
from whiptool.errors import InputError
from whiptool.given_files import read_json
from whiptool.whole_files import write_whole
from whiptool.words import counted

KEY = re.compile(r"-[0-9a-f]{16}$")  # what the key of every unit ends in; results of older versions have no such ending


class Unit(ABC):
    """A part of a study, a frozen dataclass whose result depends only on its fields, on any machine.

    The seeds of random numbers are among the fields.
    """

    @cached_property
    def key(self) -> str:
        """Unique name of the unit, usable as a file name: readable words, and a hash of its class and fields."""
        plain = json.dumps(plain_of(self), sort_keys=True)
        return f"{_words(self)}-{hashlib.sha256(plain.encode()).hexdigest()[:16]}"

    @abstractmethod
    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Run the unit.

        Args:
            folder: Folder for checkpoints; None, or a folder that does not exist (on another machine): none are kept.
            threads: Threads of the simulator; the result does not depend on it.

        Returns:
            The result as plain data for JSON.
        """


def _words(unit: Any) -> str:
    """Return the kind of a unit and those of its short fields that are not as usual, for people who look at files."""
    words = [type(unit).__name__.removesuffix("Unit").lower()]
    for field in fields(unit):
        value = getattr(unit, field.name)
        if isinstance(value, str | int) and value != field.default:
            words.append(str(value) if isinstance(value, str) else f"{field.name}{value:d}")
    return re.sub(r"[^A-Za-z0-9.+-]", "_", "-".join(words))[:100]


def plain_of(value: Any) -> Any:
    """Return a value as plain data, from which its hash is computed: every object with its class and all its fields.

    Dataclass fields with `compare=False` are left out.

    Raises:
        TypeError: A part of the value cannot be converted.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.generic):
        return plain_of(value.item())
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return [value.dtype.str, value.shape, hashlib.sha256(value.tobytes()).hexdigest()]
    if isinstance(value, tuple | list):
        return [plain_of(x) for x in value]
    if isinstance(value, Mapping):
        return [[plain_of(name), plain_of(value[name])] for name in sorted(value)]
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        table = {field.name: getattr(value, field.name) for field in fields(value) if field.compare}
    elif hasattr(value, "__dict__") and not callable(value):
        table = vars(value)
    else:
        raise TypeError(f"a unit holds {value!r}, of which no key can be made")
    return [type(value).__name__, {name: plain_of(x) for name, x in table.items()}]


@dataclass(frozen=True)
class Work:
    """Function that runs a unit, in this process or in a worker.

    Args:
        checkpoints: Folder of checkpoints.
        threads: Threads of the simulator; None: its default.
    """

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
        """Return the units' results by key; units without a stored result are run, with a progress bar.

        Raises:
            UnitFailed: A unit failed; results of the others are kept.
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
                for checkpoint in self.checkpoints.glob(f"{key}.*"):
                    checkpoint.unlink(missing_ok=True)
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
    """Return the file of a unit's result in the folder of results, by the unit's key."""
    return folder / f"{key}.json"


def older_results(folder: Path) -> str:
    """Return a note on results in a folder that an older version of whiptool wrote; empty without such results."""
    count = sum(not KEY.search(file.stem) for file in folder.glob("*.json"))
    return f"{folder}: {counted(count, 'result')} of an older version of whiptool" if count else ""
