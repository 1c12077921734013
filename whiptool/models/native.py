"""The compiled engine: the driver in C++ around the code that CasADi generates, threads over chunks of strikes."""

from __future__ import annotations

import ctypes
import os
import re
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import casadi as ca
import numpy as np

from whiptool.models.batch import Batch, Rolled, empty_results
from whiptool.models.closed_loop import ClosedLoop, Structure

_GROUPS = 8  # groups of lanes per task of the thread pool


def generate_c(loop: ClosedLoop, *, forward: bool) -> str:
    """C code of the loop's step, and of its controller where the torque is held."""
    generator = ca.CodeGenerator("whiptool_generated.c", {"with_header": False})
    generator.add(loop.step_forward if forward else loop.step)
    if loop.structure.held:
        generator.add(loop.control_forward if forward else loop.control)
    # comparisons give numbers in C and masks in SIMD: let the driver say what they are
    return re.sub(r"=\((\w+)<=(\w+)\);", r"=whiptool_le(\1,\2);", generator.dump())


class _Strikes(ctypes.Structure):  # driver.cpp: struct Strikes
    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("p", "x0", "target", "h", "h_last", "steps")),
        ("hold", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("dp", "dx0", "dh", "dh_last", "out", "rows", "first_row", "path")),
        ("samples", ctypes.c_int64),
        ("rate", ctypes.c_double),
    ]


class NativeEngine:
    """The driver, compiled for one structure; `lanes` strikes run at once on each core."""

    def __init__(self, library: ctypes.CDLL, structure: Structure, rung: str) -> None:
        self.structure, self.rung = structure, rung
        self.lanes = int(library.whiptool_lanes())
        self._roll = library.whiptool_roll
        self._roll.restype = None
        self._roll.argtypes = [ctypes.POINTER(_Strikes), ctypes.c_int64, ctypes.c_int64]

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out, on all cores unless told otherwise."""
        order = np.argsort(-batch.steps, kind="stable")  # lanes that end together; the longest first
        sorted_batch = batch.take(order)
        B = len(order)
        rolled = empty_results(sorted_batch, self.structure)
        pointers = {name: _address(getattr(sorted_batch, name)) for name in Batch.PER_STRIKE}
        strikes = _Strikes(
            **pointers,
            hold=batch.hold,
            samples=batch.samples,
            rate=batch.rate,
            out=_address(rolled.out),
            rows=_address(rolled.rows),
            first_row=_address(rolled.first_row),
            path=_address(rolled.path),
        )
        workers = threads or cores()
        even = -(-B // (workers * self.lanes)) * self.lanes  # an even share, in whole groups of lanes
        chunk = max(self.lanes, min(_GROUPS * self.lanes, even))
        starts = range(0, B, chunk)
        if workers == 1 or len(starts) == 1:
            self._roll(ctypes.byref(strikes), 0, B)
        else:
            roll, reference = self._roll, ctypes.byref(strikes)
            list(_pool(workers).map(lambda b: roll(reference, b, min(chunk, B - b)), starts))
        back = np.empty_like(order)
        back[order] = np.arange(B)
        first_row = None if rolled.first_row is None else rolled.first_row[back]
        path = None if rolled.path is None else rolled.path[back]
        return Rolled(rolled.out[back], path, rolled.rows, first_row)


def _address(array: np.ndarray | None) -> int | None:
    if array is None:
        return None
    assert array.flags.c_contiguous
    return array.ctypes.data


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache(maxsize=4)
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, thread_name_prefix="whiptool")


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork
