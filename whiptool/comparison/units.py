"""Units of work, identified by a hash of class and fields, and the folder that stores their results.

Units run on this machine's cores or on a Ray cluster; the result does not depend on the number of workers, but on
another processor its last digits may differ, and with them which strike a search finds. Each result is a small file, so
that a killed run only loses unfinished units. If a worker process dies (killed, out of memory), its unit is run again.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import socket
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import optional
from whiptool.given_files import parsing, read_json
from whiptool.whole_files import write_whole
from whiptool.words import counted

R = TypeVar("R")
RETRIES = 2  # after the first worker that died over a unit


class UnitFailed(WhiptoolError):
    """A unit raised an error, or every worker that ran it died."""


Worked = Iterator[tuple[str, R]]
OnDeath = Callable[[list[str]], None]


def work_on(
    units: Mapping[str, Any],
    work: Callable[[Any], R],
    *,
    workers: int = 1,
    cluster: str | None = None,
    on_death: OnDeath = lambda names: None,
) -> Worked[R]:
    """Run units, which are sent to the workers, in any order, and yield each name and result as soon as it is complete.

    They run in `workers` processes on this machine (1: this process itself), or on the Ray cluster with an address
    (`auto`: the one this machine belongs to). When a worker dies, `on_death` gets the names of the units that may have
    been the cause; they are retried. UnitFailed is raised for a unit that raised an error or, when all others are done,
    that was given up after its last retry.
    """
    if workers < 1:
        raise InputError("workers", workers, "a whole number >= 1")
    if cluster is not None:
        return _on_ray(units, work, cluster, on_death)
    if workers == 1:
        return ((name, _opened(name, _sealed(work, unit))) for name, unit in units.items())
    return _in_processes(units, work, workers, on_death)


def _sealed(work: Callable[[Any], R], unit: Any) -> tuple[R | None, str | None]:
    """What came of a unit, an error of ours as its text: not every exception survives the way between processes."""
    try:
        return work(unit), None
    except WhiptoolError as error:
        return None, str(error)


def _opened(name: str, sealed: tuple[Any, str | None]) -> Any:
    result, error = sealed
    if error is not None:
        raise UnitFailed(f"{name}: {error}")
    return result


def _given_up(deaths: Counter[str]) -> None:
    lost = [name for name, count in deaths.items() if count > RETRIES]
    if lost:
        raise UnitFailed(f"{', '.join(lost)}: {RETRIES + 1} workers died over it; all other units are done")


def _in_processes(units: Mapping[str, Any], work: Callable[[Any], R], workers: int, on_death: OnDeath) -> Worked[R]:
    """In processes of loky, which notices when one of them dies, but not over which unit.

    So those that were being worked on then are tried again one at a time, and a second death has its name.
    """
    from concurrent.futures import FIRST_COMPLETED, Future, wait

    from loky import BrokenProcessPool, ProcessPoolExecutor

    waiting, suspects, deaths = deque(units), deque[str](), Counter[str]()
    while waiting or suspects:
        queue, crowd = (suspects, 1) if suspects else (waiting, min(workers, len(waiting)))
        running: dict[Future, str] = {}
        pool = ProcessPoolExecutor(max_workers=crowd, initializer=_die_with, initargs=(os.getpid(),))
        orderly = False
        try:
            while queue or running:
                while queue and len(running) < crowd:
                    future = pool.submit(_sealed, work, units[queue[0]])
                    running[future] = queue.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    name = running.pop(future)
                    yield name, _opened(name, result)
            orderly = True
        except BrokenProcessPool:
            for future, name in list(running.items()):  # what was done in the same moment stands
                if future.done() and future.exception() is None:
                    del running[future]
                    yield name, _opened(name, future.result())
            names = list(running.values())
            on_death(names)
            if len(names) == 1:
                deaths[names[0]] += 1
            suspects.extendleft(name for name in names if deaths[name] <= RETRIES)
        finally:
            pool.shutdown(wait=True, kill_workers=not orderly)
    _given_up(deaths)


def _die_with(parent: int) -> None:
    """Let this process end soon after its parent was killed: its successor may be at the same files already."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.2)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _on_ray(units: Mapping[str, Any], work: Callable[[Any], R], address: str, on_death: OnDeath) -> Worked[R]:
    """As tasks of one core each on a Ray cluster, where whiptool must be installed in the same version."""
    ray, exceptions = optional("ray", "cluster"), optional("ray.exceptions", "cluster")
    ours = not ray.is_initialized()
    if ours:
        try:
            if address != "auto":  # Ray itself would try for minutes
                host, _, port = address.removeprefix("ray://").rpartition(":")
                socket.create_connection((host, int(port)), timeout=10).close()
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
        except (OSError, ValueError, RuntimeError) as error:
            raise InputError("cluster", address, "auto, or a Ray cluster's address", f"reason: {error}") from None
    died = (
        exceptions.WorkerCrashedError,
        exceptions.NodeDiedError,
        exceptions.LocalRayletDiedError,
        exceptions.OutOfMemoryError,
        exceptions.ObjectLostError,
    )
    # Ray's own retries would tell of no death, and not end where the memory does not suffice
    task, deaths = ray.remote(num_cpus=1, max_retries=0)(_sealed), Counter[str]()
    running = {task.remote(work, unit): name for name, unit in units.items()}
    try:
        while running:
            (done, *_), _ = ray.wait(list(running), num_returns=1)
            name = running.pop(done)
            try:
                result = ray.get(done)
            except died:
                deaths[name] += 1
                on_death([name])
                if deaths[name] <= RETRIES:
                    running[task.remote(work, units[name])] = name
                continue
            yield name, _opened(name, result)
        _given_up(deaths)
    finally:
        for left in running:
            ray.cancel(left, force=True)
        if ours:
            ray.shutdown()


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
        """Run the unit and return plain data for JSON; checkpoints are kept if their folder is given and exists (on
        another machine it does not). The result does not depend on the simulator's threads.
        """

    def check(self, result: Mapping[str, Any]) -> None:  # noqa: B027  # of some units what is stored is only shown
        """Raise an exception if a stored result is not one that this unit can have had."""


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
    """Function that runs a unit, in this process or in a worker."""

    checkpoints: Path  # folder of checkpoints
    threads: int | None  # of the simulator; None: its default

    def __call__(self, unit: Unit) -> dict[str, Any]:
        """Run a unit and return its result."""
        return unit.run(self.checkpoints, self.threads)


class Store:
    """The results of units in a run folder, in `units/`, and their checkpoints; for `workers` and `cluster` see
    `work_on`.
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
        """Return the units' results by key; units without a stored result are run, with a progress bar."""
        from whiptool.progress import Progress

        by_key = {unit.key: unit for unit in units}
        results = {key: self._read(unit) for key, unit in by_key.items() if unit_file(self.units, key).exists()}
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

    def _read(self, unit: Unit) -> dict[str, Any]:
        path = unit_file(self.units, unit.key)
        try:
            with parsing(path, "JSON"):
                unit.check(result := read_json(path))
            return result
        except InputError as error:
            raise error.advising("delete it") from None


def unit_file(folder: Path, key: str) -> Path:
    """Return the file of a unit's result in the folder of results, by the unit's key."""
    return folder / f"{key}.json"


def older_results(folder: Path) -> str:
    """Return a note on results in a folder that an older version of whiptool wrote; empty without such results."""
    count = sum(not KEY.search(file.stem) for file in folder.glob("*.json"))
    return f"{folder}: {counted(count, 'result')} of an older version of whiptool" if count else ""
