"""The compiled engine: the driver in C++ around the code that CasADi generates, threads over parts of a batch."""

from __future__ import annotations

import ctypes
import re

import casadi as ca
import numpy as np

from whiptool.dynamics.closed_loop import ClosedLoop, Structure
from whiptool.rollout.batch import Batch, Rolled, empty_results
from whiptool.rollout.threads import cores, run_in_parts


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
        rolled = empty_results(sorted_batch, self.structure)
        buffers = {name: getattr(sorted_batch, name) for name in Batch.PER_STRIKE}
        buffers |= {"out": rolled.out, "rows": rolled.rows, "first_row": rolled.first_row, "path": rolled.path}
        addresses = {name: _address(array) for name, array in buffers.items()}
        strikes = _Strikes(**addresses, hold=batch.hold, samples=batch.samples, rate=batch.rate)
        run_in_parts(self._roll, strikes, buffers, count=len(order), lanes=self.lanes, threads=threads or cores())
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        first_row = None if rolled.first_row is None else rolled.first_row[back]
        path = None if rolled.path is None else rolled.path[back]
        return Rolled(rolled.out[back], path, rolled.rows, first_row)


def _address(array: np.ndarray | None) -> int | None:
    if array is None:
        return None
    assert array.flags.c_contiguous
    return array.ctypes.data
