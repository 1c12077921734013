"""Engines that roll batches of strikes out: SIMD C++, scalar C++, or CasADi's interpreter, the best that works here."""

from __future__ import annotations

import ctypes
import logging
import os
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files
from typing import ClassVar, Protocol

import casadi as ca
import numpy as np

from whiptool.errors import InputError
from whiptool.models.closed_loop import ClosedLoop, Structure, closed_loop
from whiptool.models.compiler import has_simd, load_library
from whiptool.models.stepping import FASTEST

log = logging.getLogger("whiptool")

RUNGS = ("simd", "scalar", "interpreter")
VARIABLE = "WHIPTOOL_ENGINE"
_GROUPS = 8  # groups of lanes per task of the thread pool


@dataclass
class Batch:
    """Strikes to roll out, and what comes of them; B strikes, a arm joints, n joints, P parameters.

    Args:
        p: Parameters, (B, P).
        x0: States at the start, (B, 2 n).
        target: (B, 2) [m].
        h, h_last, steps, hold: As `time_grid` gives them.
        dp, dx0, dh, dh_last: Direction of each strike along which derivatives are taken, shaped like what they change;
            None: no derivatives.
        rate, samples: The tip's path is wanted at `samples` times, `rate` times a second.
        with_rows: Trajectories are wanted at every step.
    """

    p: np.ndarray
    x0: np.ndarray
    target: np.ndarray
    h: np.ndarray
    h_last: np.ndarray
    steps: np.ndarray
    hold: int
    dp: np.ndarray | None = None
    dx0: np.ndarray | None = None
    dh: np.ndarray | None = None
    dh_last: np.ndarray | None = None
    rate: float = 0.0
    samples: int = 0
    with_rows: bool = False

    _PER_STRIKE: ClassVar = ("p", "x0", "target", "h", "h_last", "steps", "dp", "dx0", "dh", "dh_last")

    def take(self, order: np.ndarray) -> Batch:
        """The strikes in another order."""
        arrays = {name: getattr(self, name) for name in self._PER_STRIKE}
        return replace(self, **{k: None if x is None else np.ascontiguousarray(x[order]) for k, x in arrays.items()})

    @property
    def forward(self) -> bool:
        """Whether derivatives are taken."""
        return self.dp is not None


@dataclass
class Rolled:
    """What came of a batch.

    Args:
        out: Miss distance, its time, tip speed, tip x, tip y, diverged, last step, derivative of the miss distance,
            then largest speed and torque of each arm joint: (B, 8 + 2 a).
        path: Tip at equal times, (B, samples, 2), or with derivatives (B, samples, 4); NaN after the strike's end.
        rows: Time, state, torques at every step, strike after strike; `first_row` says where each begins.
    """

    out: np.ndarray
    path: np.ndarray | None = None
    rows: np.ndarray | None = None
    first_row: np.ndarray | None = None


class Engine(Protocol):
    """Rolls batches of one structure out."""

    rung: str

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out."""
        ...


class _Strikes(ctypes.Structure):  # driver.cpp: struct Strikes
    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("p", "x0", "target", "h", "h_last", "steps")),
        ("hold", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("dp", "dx0", "dh", "dh_last", "out", "rows", "first_row", "path")),
        ("samples", ctypes.c_int64),
        ("rate", ctypes.c_double),
    ]


def wanted_rung() -> str | None:
    """The rung that the environment variable forces, if any.

    Raises:
        InputError: It names none.
    """
    name = os.environ.get(VARIABLE) or None
    if name is not None and name not in RUNGS:
        raise InputError(VARIABLE, name, ", ".join(RUNGS))
    return name


def generate_c(loop: ClosedLoop, *, forward: bool) -> str:
    """C code of the loop's step, and of its controller where the torque is held."""
    generator = ca.CodeGenerator("whiptool_generated.c", {"with_header": False})
    generator.add(loop.step_forward if forward else loop.step)
    if loop.structure.held:
        generator.add(loop.control_forward if forward else loop.control)
    # comparisons give numbers in C and masks in SIMD: let the driver say what they are
    return re.sub(r"=\((\w+)<=(\w+)\);", r"=whiptool_le(\1,\2);", generator.dump())


class NativeEngine:
    """The driver in C++, compiled for one structure; threads over chunks of strikes."""

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
        pointers = {name: _address(getattr(sorted_batch, name)) for name in Batch._PER_STRIKE}
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


def empty_results(batch: Batch, structure: Structure) -> Rolled:
    """Arrays for the results of a batch."""
    B, columns = len(batch.p), 1 + 2 * structure.n + structure.n_arm
    rolled = Rolled(np.empty((B, 8 + 2 * structure.n_arm)))
    if batch.samples:
        rolled.path = np.full((B, batch.samples, 4 if batch.forward else 2), np.nan)
    if batch.with_rows:
        rolled.first_row = np.concatenate([[0], np.cumsum(batch.steps + 1)[:-1]]).astype(np.int64)
        rolled.rows = np.empty((int((batch.steps + 1).sum()), columns))
    return rolled


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache(maxsize=4)
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, thread_name_prefix="whiptool")


os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork


@lru_cache(maxsize=64)
def find_engine(structure: Structure, *, forward: bool, rung: str | None) -> Engine:
    """The best engine for a structure, or the given rung.

    A compiler without SIMD support falls to scalar code, no working compiler to the interpreter, each with one line
    in the log.
    """
    from whiptool.models.interpreter import InterpretedEngine

    wanted = RUNGS if rung is None else RUNGS[RUNGS.index(rung) :]
    loop = closed_loop(structure)
    for name in wanted[:-1]:
        if name == "simd" and not has_simd():
            continue
        defines = {
            "NQ": structure.n,
            "NA": structure.n_arm,
            "NP": structure.n_parameters,
            "HELD": int(structure.held),
            "FASTEST": FASTEST,
            "SIMD": int(name == "simd"),
            "FORWARD": int(forward),
        }
        driver = files("whiptool.models").joinpath("driver.cpp").read_text()
        library = load_library(generate_c(loop, forward=forward), driver, defines)
        if library is not None:
            return NativeEngine(library, structure, name)
    return InterpretedEngine(structure, forward=forward)
