"""Compiled loops over a batch, in parts, on all cores."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np

_GROUPS = 8  # groups of lanes in one part at most

Loop = Callable[[Any, int, int], object]
Buffers = Mapping[str, np.ndarray | None]


def run_in_parts(
    loop: Loop,
    arguments: ctypes.Structure,
    buffers: Mapping[str, np.ndarray | None],
    count: int,
    lanes: int,
    threads: int,
) -> None:
    """Call `loop(arguments, first, number)` for all of a batch, in parts that threads take in turn.

    Whatever interrupts the wait (Ctrl-C) leaves parts running; each holds the memory that it reads and writes.

    Args:
        loop: A function of a compiled library, which releases the interpreter's lock.
        arguments: Arguments of the batch; it holds addresses of the buffers.
        buffers: The arrays behind these addresses.
        count: Size of the batch.
        lanes: How many run at once on one core.
        threads: How many parts are worked on at a time.
    """
    even = -(-count // (threads * lanes)) * lanes  # an even share, in whole groups of lanes
    size = max(lanes, min(_GROUPS * lanes, even))
    if threads == 1 or count <= size:
        loop(ctypes.byref(arguments), 0, count)
        return
    pool = _pool(threads)
    parts: list[Future] = []
    try:
        for first in range(0, count, size):
            parts.append(pool.submit(_part, loop, arguments, buffers, first, min(size, count - first)))
        for part in parts:
            part.result()
    finally:
        for part in parts:
            part.cancel()


def _part(loop: Loop, arguments: ctypes.Structure, buffers: Buffers, first: int, number: int):
    """Run one part; the pool keeps its arguments, `buffers` among them, until it ends."""
    loop(ctypes.byref(arguments), first, number)


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="whiptool")


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork
