"""The compiled engine in C++, which simulates a batch in parts on all cores."""

from __future__ import annotations

import ctypes
import os
import re
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from whiptool.dynamics.integrator import GAMMA, W_A, W_B, W_GAMMA, W_SECOND, W_STIFF
from whiptool.dynamics.structure import outcome_columns, row_columns
from whiptool.dynamics.system import System, along
from whiptool.rollout.batch import Batch, Rolled, empty_results
from whiptool.rollout.compiler import load_library
from whiptool.rollout.interface import FASTEST

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

    If the wait is interrupted (Ctrl-C), parts go on running; each keeps a reference to the memory that it uses.

    Args:
        loop: A function of a compiled library, which releases the interpreter's lock.
        arguments: Arguments of the batch; it holds addresses of the buffers.
        buffers: The arrays behind these addresses.
        count: Size of the batch.
        lanes: Number of strikes that run at once on one core.
        threads: Number of parts that run at a time.
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


def driver_source() -> str:
    """Return the source of the C++ driver, with the number type and trigonometric functions that it uses."""
    return "".join(
        files("whiptool.rollout").joinpath(name).read_text() for name in ("lanes.h", "trigonometry.h", "driver.cpp")
    )


def generate_c(system: System, *, forward: bool) -> str:
    """Return the C code that the driver includes: sizes, columns, and the system's functions."""
    generator = ca.CodeGenerator("whiptool_generated.c", {"with_header": False})
    for function in system.functions.values():
        generator.add(along(function) if forward else function)
    # comparisons give numbers in C and masks in SIMD: let the driver say what they are
    code = re.sub(r"=\((\w+)<=(\w+)\);", r"=whiptool_le(\1,\2);", generator.dump())
    code = re.sub(r"static int (casadi_f\d+)", r"static inline __attribute__((always_inline)) int \1", code)
    return _constants(system) + code


def _constants(system: System) -> str:
    """Sizes and columns as C++ constants."""
    a, n, stored = system.n_drive, system.n, system.columns
    numbers = {"N_DRIVE": a, "N_LINKS": system.n_links, "NP": system.n_parameters, "N_INPUTS": system.n_inputs}
    numbers |= {"DIMENSION": system.dimension, "LINK_SIZE": system.link_size, "LINK": len(system.link_columns)}
    numbers |= {"FRAME": stored.frame.size, "DRIVE_MOVING": stored.motion.size, "MOVING": stored.moving.size}
    numbers |= {"CARRIED": stored.carried.size, "JOINT": stored.joint.size, "ACCELERATION": stored.acceleration.size}
    outward = system.functions["outward"]
    numbers |= {"TORQUE": outward.numel_out(2), "ARMATURE": outward.numel_out(3)}
    numbers |= {"TWIST": system.functions["twist"].numel_out(0)}
    numbers |= {"ANGLES": system.functions["hand"].numel_out(2)}
    numbers |= {f"FRAME_{name}": column for name, column in system.frame_columns.items()}
    numbers |= outcome_columns(a, system.dimension).constants("OUT")
    numbers |= row_columns(n, a, system.dimension).constants("ROW")
    lines = [f"constexpr int {name} = {value};" for name, value in numbers.items()]
    firsts, strides = zip(*system.link_columns.values(), strict=True)
    for name, values in (("LINK_FIRST", firsts), ("LINK_STRIDE", strides)):
        lines.append(f"constexpr int {name}[] = {{{', '.join(map(str, values))}}};")
    return "\n".join([*lines, *_method()]) + "\n"


def _method() -> list[str]:
    """The numbers of the Rosenbrock-W method of third order as C++ constants, in the form that `integrator` states."""
    back = [[-g / (2 * W_GAMMA) for g in row] for row in W_STIFF]
    error = [b - c for b, c in zip(W_B, W_SECOND, strict=True)]
    found = [f"constexpr int STAGES = {len(W_B)}, ERROR_ORDER = EXPLICIT ? 4 : 3;"]
    found.append(f"constexpr double W_WIDER = {W_GAMMA / GAMMA!r};")
    for name, rows in (("W_A", W_A), ("W_BACK", back)):
        text = ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in rows)
        found.append(f"constexpr double {name}[STAGES][STAGES] = {{{text}}};")
    for name, values in (("W_B", W_B), ("W_ERROR", error)):
        found.append(f"constexpr double {name}[STAGES] = {{{', '.join(map(repr, values))}}};")
    return found


_FUNCTIONS = ("whiptool_lanes", "whiptool_roll")  # of the library


class _Strikes(ctypes.Structure):  # driver.cpp: struct Strikes
    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("p", "x0", "target", "h", "h_last", "steps")),
        ("hold", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("dp", "dx0", "dh", "dh_last", "u", "du", "u_row", "du_row")),
        *((name, ctypes.c_void_p) for name in ("out", "rows", "first_row", "path")),
        *((name, ctypes.c_int64) for name in ("samples", "moving", "by_hand")),
        ("rate", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("y", "dy", "columns")),
        ("n_columns", ctypes.c_int64),
        ("stride", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("y_row", "tolerance", "knot", "weight")),
        ("period", ctypes.c_double),
    ]


class NativeEngine:
    """The C++ driver compiled for one system; it simulates `lanes` strikes at once on each core."""

    def __init__(self, library: ctypes.CDLL, system: System, rung: str) -> None:
        self.system, self.rung = system, rung
        self.lanes = int(library.whiptool_lanes())
        self._roll = library.whiptool_roll
        self._roll.restype = None
        self._roll.argtypes = [ctypes.POINTER(_Strikes), ctypes.c_int64, ctypes.c_int64]

    @classmethod
    def compiled(cls, system: System, *, forward: bool, simd: bool) -> NativeEngine | None:
        """Return the system's engine, from the cache or newly compiled; None if no compiler works."""
        defines = {
            "HELD": int(system.held),
            "PRESCRIBED": int(system.prescribed),
            "EXPLICIT": int(system.explicit),
            "FASTEST": FASTEST,
            "SIMD": int(simd),
            "FORWARD": int(forward),
        }
        library = load_library(generate_c(system, forward=forward), driver_source(), defines, _FUNCTIONS)
        return None if library is None else cls(library, system, "simd" if simd else "scalar")

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out with this number of threads; None: one per core."""
        keys = (-batch.steps,) if batch.tolerance is None else (-batch.steps, batch.tolerance)
        order = np.lexsort(keys)  # lanes that take as many steps; the longest first
        ordered = batch.take(order)
        rolled = empty_results(batch, self.system)
        out, path = np.empty_like(rolled.out), None if rolled.path is None else rolled.path.copy()
        buffers = {name: getattr(ordered, name) for name in (*Batch.PER_STRIKE, "u", "du", "columns", "weight")}
        buffers |= {"out": out, "rows": rolled.rows, "path": path, "y": rolled.y, "dy": rolled.dy}
        for name in ("first_row", "y_row"):  # results of lanes that stand elsewhere now
            rows = getattr(rolled, name)
            buffers[name] = None if rows is None else np.ascontiguousarray(rows[order])
        addresses = {name: _address(array) for name, array in buffers.items()}
        names = ("hold", "samples", "moving", "by_hand", "rate", "stride", "period")
        numbers = {name: getattr(batch, name) for name in names}
        strikes = _Strikes(**addresses, **numbers, n_columns=0 if batch.columns is None else len(batch.columns))
        run_in_parts(self._roll, strikes, buffers, count=len(order), lanes=self.lanes, threads=threads or cores())
        rolled.out[order] = out
        if rolled.path is not None:
            rolled.path[order] = path
        return rolled


def _address(array: np.ndarray | None) -> int | None:
    if array is None:
        return None
    assert array.flags.c_contiguous
    return array.ctypes.data
