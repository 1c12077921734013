"""Paths of a system and their exact derivatives, many at once: compiled code, or CasADi's interpreter without one."""

from __future__ import annotations

import ctypes
import re
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import casadi as ca
import numpy as np

from whiptool.dynamics.closed_loop import Structure
from whiptool.dynamics.stepping import FASTEST
from whiptool.identification.dynamics import Dynamics, SwingStructure, dynamics
from whiptool.rollout.compiler import has_simd, load_library
from whiptool.rollout.engine import RUNGS, wanted_rung
from whiptool.rollout.threads import cores, run_in_parts


@dataclass
class Lanes:
    """What is rolled out: L lanes, each a path and the direction along which its derivative is taken.

    Args:
        p, x0: Parameters (L, P) and start states (L, 2 n).
        steps: Number of steps of each lane, (L,).
        h: Step [s].
        dp, dx0: Directions, shaped like p and x0; None: no derivatives.
        u, du: Inputs at successive instants and their changes, (rows, instants' width); a lane needs steps + 2 rows.
        u_row, du_row: First row of each lane in them, (L,); a negative du_row: its inputs do not change.
        hold: Steps for which a torque is held.
        stride: Steps between samples.
        columns: Of the observation, to keep: (C,).
    """

    p: np.ndarray
    x0: np.ndarray
    steps: np.ndarray
    h: float
    columns: np.ndarray
    dp: np.ndarray | None = None
    dx0: np.ndarray | None = None
    u: np.ndarray | None = None
    du: np.ndarray | None = None
    u_row: np.ndarray | None = None
    du_row: np.ndarray | None = None
    hold: int = 1
    stride: int = 1

    @property
    def forward(self) -> bool:
        """Whether derivatives are taken."""
        return self.dp is not None

    @property
    def samples(self) -> np.ndarray:
        """Samples of each lane, (L,)."""
        return self.steps // self.stride + 1


class PathEngine:
    """Rolls the lanes of one structure out.

    Args:
        structure: Of the system.
        forward: With derivatives.
        rung: `simd`, `scalar` or `interpreter`; None: the best that works here.
    """

    def __init__(self, structure: Structure | SwingStructure, *, forward: bool, rung: str | None = None) -> None:
        self.system = dynamics(structure)
        self.forward = forward
        self._functions = _functions(self.system, forward=forward)
        self._roll, self.rung = None, "interpreter"
        wanted = RUNGS if rung is None else RUNGS[RUNGS.index(rung) :]
        for name in wanted[:-1]:
            if name == "simd" and not has_simd():
                continue
            library = _compile(self.system, self._functions, forward=forward, simd=name == "simd")
            if library is not None:
                self._roll, self.rung, self._lanes = library.whiptool_paths, name, int(library.whiptool_lanes())
                self._roll.restype = None
                self._roll.argtypes = [ctypes.POINTER(_Paths), ctypes.c_int64, ctypes.c_int64]
                break

    def __call__(self, lanes: Lanes, *, threads: int | None = None) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Samples of every lane, each (S, C), and their derivatives; NaN from where a path broke off."""
        assert lanes.forward == self.forward
        first = np.concatenate([[0], np.cumsum(lanes.samples)]).astype(np.int64)
        y = np.full((first[-1], len(lanes.columns)), np.nan)
        dy = np.full_like(y, np.nan) if self.forward else y[:0]
        if self._roll is None:
            self._interpret(lanes, first, y, dy)
        else:
            self._run(lanes, first, y, dy, threads)
        return np.split(y, first[1:-1]), np.split(dy, first[1:-1]) if self.forward else []

    def _run(self, lanes: Lanes, first: np.ndarray, y: np.ndarray, dy: np.ndarray, threads: int | None) -> None:
        order = np.argsort(-lanes.steps, kind="stable")  # lanes that end together; the longest first
        still = np.full(len(order), -1)
        arrays = {
            name: None if array is None else np.ascontiguousarray(array[order], dtype)
            for name, array, dtype in (
                ("p", lanes.p, float),
                ("x0", lanes.x0, float),
                ("dp", lanes.dp, float),
                ("dx0", lanes.dx0, float),
                ("steps", lanes.steps, np.int64),
                ("u_row", still if lanes.u_row is None else lanes.u_row, np.int64),
                ("du_row", still if lanes.du_row is None else lanes.du_row, np.int64),
                ("y_row", first[:-1], np.int64),
            )
        }
        arrays |= {
            "u": None if lanes.u is None else np.ascontiguousarray(lanes.u, float),
            "du": None if lanes.du is None else np.ascontiguousarray(lanes.du, float),
            "columns": np.ascontiguousarray(lanes.columns, np.int64),
            "y": y,
            "dy": dy,
        }
        io = _Paths(
            **{name: None if array is None else array.ctypes.data for name, array in arrays.items()},
            h=lanes.h,
            hold=lanes.hold,
            stride=lanes.stride,
            n_columns=len(lanes.columns),
        )
        assert self._roll is not None
        run_in_parts(self._roll, io, arrays, count=len(order), lanes=self._lanes, threads=threads or cores())

    def _interpret(self, lanes: Lanes, first: np.ndarray, y: np.ndarray, dy: np.ndarray) -> None:
        """All lanes at once, a step at a time, through CasADi's interpreter."""
        system, L = self.system, len(lanes.p)
        advance, observe, hold = (None if f is None else f.map(L) for f in self._functions)
        assert advance is not None
        assert observe is not None
        p, x = lanes.p.T, lanes.x0.T
        u = du = np.zeros((system.n_inputs, L))
        dp = lanes.dp.T if lanes.dp is not None else p
        dx = lanes.dx0.T if lanes.dx0 is not None else x
        alive = np.ones(L, bool)
        for i in range(int(lanes.steps.max()) + 1):
            t = np.full((1, L), i * lanes.h)
            if hold is not None and i % lanes.hold == 0:
                out = hold(x, t, p, dx, dp) if self.forward else (hold(x, t, p),)
                u, du = (z.full() for z in (*out, *out)[:2])
            elif hold is None and system.n_inputs:
                u = _inputs(lanes.u, lanes.u_row, lanes.steps, i, system.n_inputs, L)
                du = _inputs(lanes.du, lanes.du_row, lanes.steps, i, system.n_inputs, L)
            if i % lanes.stride == 0:
                out = observe(x, p, u, dx, dp, du) if self.forward else (observe(x, p, u),)
                seen = [z.full()[lanes.columns] for z in out]  # (C, L)
                for b in np.flatnonzero(alive & (i <= lanes.steps)):
                    for table, z in zip((y, dy), seen, strict=False):
                        table[first[b] + i // lanes.stride] = z[:, b]
            h = np.full((1, L), lanes.h)
            out = advance(x, t, h, p, u, dx, dp, du) if self.forward else (advance(x, t, h, p, u),)
            x, *change = (z.full() for z in out)
            alive &= (x[system.n :] ** 2).sum(axis=0) < FASTEST**2
            x[:, ~alive] = 0
            dx = change[0] if self.forward else x


def _inputs(
    table: np.ndarray | None, rows: np.ndarray | None, steps: np.ndarray, instant: int, width: int, count: int
) -> np.ndarray:
    """Inputs of every lane at one instant, (width, count)."""
    u = np.zeros((width, count))
    if table is not None and rows is not None:
        flat = table.ravel()
        for b in np.flatnonzero(rows >= 0):
            at = (rows[b] + min(instant, steps[b])) * table.shape[1]
            u[:, b] = flat[at : at + width]
    return u


class _Paths(ctypes.Structure):  # paths.cpp: struct Paths
    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("p", "x0", "dp", "dx0", "steps", "u_row", "du_row", "u", "du")),
        ("h", ctypes.c_double),
        ("hold", ctypes.c_int64),
        ("stride", ctypes.c_int64),
        ("columns", ctypes.c_void_p),
        ("n_columns", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("y_row", "y", "dy")),
    ]


def _functions(system: Dynamics, *, forward: bool) -> tuple[ca.Function, ca.Function, ca.Function | None]:
    """`advance`, `observe`, `hold`, each with its derivative along a direction of states, parameters and inputs."""
    found = (system.advance, system.observe, system.hold)
    return tuple(f if f is None or not forward else _along(f) for f in found)  # type: ignore[return-value]


def _along(function: ca.Function) -> ca.Function:
    """The function, and its derivative along (dx, dp, du): CasADi's forward mode; times and steps are fixed."""
    inputs = [ca.SX.sym(function.name_in(i), function.size_in(i)) for i in range(function.n_in())]
    moving = {"advance": [0, 3, 4], "observe": [0, 1, 2], "hold": [0, 2]}[function.name()]
    directions = [ca.SX.sym(f"d{i}", *inputs[i].shape) for i in moving]
    outputs = function.call(inputs)
    slopes = ca.forward(outputs, [inputs[i] for i in moving], [directions])[0]
    return ca.Function(function.name(), [*inputs, *directions], [*outputs, *slopes], {"cse": True})


def _compile(system: Dynamics, functions: tuple, *, forward: bool, simd: bool) -> ctypes.CDLL | None:
    generator = ca.CodeGenerator("whiptool_generated.c", {"with_header": False})
    for function in functions:
        if function is not None:
            generator.add(function)
    # comparisons give numbers in C and masks in SIMD: let the driver say what they are
    code = re.sub(r"=\((\w+)<=(\w+)\);", r"=whiptool_le(\1,\2);", generator.dump())
    defines = {
        "NX": 2 * system.n,
        "NP": system.n_parameters,
        "NU": system.n_inputs,
        "NU_ROW": max(system.n_inputs // 2, 1),
        "NY": 3 * system.n,
        "HELD": int(system.held),
        "FASTEST": FASTEST,
        "SIMD": int(simd),
        "FORWARD": int(forward),
    }
    return load_library(code, files("whiptool.identification").joinpath("paths.cpp").read_text(), defines)


@lru_cache(maxsize=64)
def find_paths(structure: Structure | SwingStructure, *, forward: bool) -> PathEngine:
    """The best engine for a structure, or the rung that WHIPTOOL_ENGINE names; one line in the log if it falls back."""
    return PathEngine(structure, forward=forward, rung=wanted_rung())
