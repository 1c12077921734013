"""Work units on this machine's cores or on a Ray cluster; what a unit gives does not depend on where it was worked.

A worker process that dies (killed, out of memory) takes nothing with it but its unit, which is tried again.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import optional

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
    """Run units in any order, and yield each result as soon as it is complete.

    Args:
        units: Units by name; they and `work` are sent to the workers.
        work: Function that processes a unit.
        workers: Processes on this machine; 1: this process itself.
        cluster: Address of a Ray cluster, or `auto` for the one that this machine belongs to; None: this machine.
        on_death: Called when a worker dies, with the names of the units that may have been the cause; they are retried.

    Yields:
        A unit's name and the result of `work`.

    Raises:
        InputError: The cluster does not exist, Ray is missing, or the number of workers is not positive.
        UnitFailed: A unit raised an error; or, when all others are done, a unit was given up after its last retry.
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
            raise InputError("cluster", address, f"auto, or a Ray cluster's address ({error})") from None
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
