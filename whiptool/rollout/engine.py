"""Engines: the fastest that works is chosen, and CasADi's interpreter serves machines without a compiler."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache, partial

import casadi as ca
import numpy as np

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure, outcome_columns, row_columns
from whiptool.dynamics.swing import SwingStructure, swing
from whiptool.dynamics.system import System
from whiptool.errors import InputError
from whiptool.models.trajectory import ClosestApproach, closest_on_segments
from whiptool.rollout.batch import Batch, Engine, Rolled, empty_results
from whiptool.rollout.interface import FASTEST
from whiptool.rollout.native import NativeEngine

_AT_ONCE = 64  # strikes whose steps are kept in memory
_IN_A_ROW = 16  # steps that CasADi takes in one call


class InterpretedEngine:
    """Engine that simulates a `Batch` by evaluating the system's CasADi functions, without compilation."""

    rung = "interpreter"

    def __init__(self, system: System, *, forward: bool) -> None:
        self.system, self.forward = system, forward
        self._step = system.step_forward if forward else system.step
        self._several = lru_cache(maxsize=8)(partial(several, self._step, forward=forward))
        self._control = None
        if system.held:
            self._control = system.control_forward if forward else system.control

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out; `threads` is for engines that have them."""
        assert batch.forward == self.forward
        if batch.by_hand:
            raise InputError("engine", self.rung, "simd or scalar, to follow the hand", "install a C++ compiler")
        batch = batch.in_equal_steps()
        rolled = empty_results(batch, self.system)
        order = np.argsort(-batch.steps, kind="stable")
        for first in range(0, len(order), _AT_ONCE):
            which = order[first : first + _AT_ONCE]
            history = self._roll(batch, which)
            for lane, b in enumerate(which):
                self._conclude(batch, b, history, lane, rolled)
        return rolled

    def _roll(self, batch: Batch, which: np.ndarray) -> _History:
        """Step strikes together, some steps in a row; strikes that ended or diverged are ignored."""
        count = _IN_A_ROW if self._control is None else batch.hold
        history = _History(self.system, batch, which, count)
        steps = self._several(len(which), count, observed=batch.columns is not None)
        control = None if self._control is None else self._control.map(len(which))
        for first in range(0, len(history.t[0]), count):
            if control is not None:
                _call(control, history.held_inputs(first), history.held(first))
                history.hold(first, count)
            _call(steps, history.inputs(first, count), history.outputs(first, count))
            history.end(first, count)
            if not history.alive.any():
                break
        return history

    def _conclude(self, batch: Batch, b: int, history: _History, lane: int, rolled: Rolled) -> None:
        """Write what came of one strike."""
        n, a, d = self.system.n, self.system.n_drive, self.system.dimension
        outcome = outcome_columns(a, d)
        done = slice(int(history.last[lane]) + 1)
        t, x, tau = (values[0][done, lane] for values in (history.t, history.x, history.tau))
        path = history.tip[0][done, lane]
        dpath = history.tip[-1][done, lane] if self.forward else np.zeros_like(path)
        out = rolled.out[b]
        nearest = closest_on_segments(path[:, :d], batch.target[b])
        when, tip, moved, shifted = 0.0, np.zeros(2 * d), np.zeros(2 * d), np.zeros(2 * d)
        if len(t) > 1:
            when, tip, moved = (nearest.between(values) for values in (t[:, 0], path, dpath))
            shifted = _share_slope(path[:, :d], dpath[:, :d], batch.target[b], nearest) * nearest.along(path)
        away = tip[:d] - batch.target[b]
        out[outcome["distance"]], out[outcome["time"]] = nearest.distance, when
        out[outcome["tip"]], out[outcome["velocity"]] = tip[:d], tip[d:]
        out[outcome["slope"]] = away @ moved[:d] / nearest.distance if nearest.distance > 0 else 0.0
        out[outcome["tip_slope"]], out[outcome["velocity_slope"]] = np.split(moved + shifted, 2)
        out[outcome["diverged"]], out[outcome["last_step"]] = history.diverged[lane], history.last[lane]
        out[outcome["max_joint_speed"]] = np.abs(x[:, n : n + a]).max(axis=0)
        out[outcome["max_torque"]] = np.abs(tau).max(axis=0)
        out[outcome["lowest"]], out[outcome["highest"]] = x[:, :a].min(axis=0), x[:, :a].max(axis=0)
        out[outcome["effort"]] = np.trapezoid(tau**2, t, axis=0)
        changes = [values[-1][done, lane] for values in (history.t, history.tau)] if self.forward else [0 * t, 0 * tau]
        out[outcome["effort_slope"]], out[outcome["max_torque_slope"]] = _torque_slopes(t, tau, *changes)
        if rolled.rows is not None:
            assert rolled.first_row is not None
            row, rows = row_columns(n, a, d), slice(int(rolled.first_row[b]), int(rolled.first_row[b]) + len(t))
            for name, values in (("t", t), ("x", x), ("tau", tau), ("tip", path[:, :d]), ("velocity", path[:, d:])):
                rolled.rows[rows, row[name]] = values
        if rolled.path is not None:
            samples = np.arange(batch.samples) / batch.rate
            within = samples <= t[-1, 0] + 1e-9 / batch.rate
            changes = (dpath, history.t[1][done, lane, 0]) if self.forward else None
            rolled.path[b, within] = tip_at(samples[within], t[:, 0], path, changes, moving=batch.moving)
        if rolled.y is not None:
            assert rolled.y_row is not None
            seen = [values[done, lane][:: batch.stride, batch.columns] for values in history.seen]
            rows = slice(int(rolled.y_row[b]), int(rolled.y_row[b]) + len(seen[0]))
            rolled.y[rows] = seen[0]
            if rolled.dy is not None:
                rolled.dy[rows] = seen[1]


def _torque_slopes(t: np.ndarray, tau: np.ndarray, dt: np.ndarray, dtau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how effort and largest torque of each joint change, (a,) each.

    Args:
        t, tau: Times (T, 1) [s], torques (T, a) [N m].
        dt, dtau: How they change.
    """
    of_effort = np.trapezoid(2 * tau * dtau, t, axis=0) + np.trapezoid(tau**2, dt, axis=0)
    largest = np.abs(tau).argmax(axis=0), np.arange(tau.shape[1])
    return of_effort, np.where(tau[largest] < 0, -dtau[largest], dtau[largest])


def _share_slope(path: np.ndarray, dpath: np.ndarray, target: np.ndarray, nearest: ClosestApproach) -> float:
    """Return how the share of the segment at which a path comes closest changes as the path moves.

    Args:
        path, dpath: Places (T, d) [m], and how they change.
        target: (d,) [m].
        nearest: Nearest of the path to the target; at a segment's end the share does not change.
    """
    if not 0 < nearest.share < 1:
        return 0.0
    step, dstep = nearest.along(path), nearest.along(dpath)
    away, moved = path[nearest.segment] - target, dpath[nearest.segment]
    return -float(moved @ step + away @ dstep + 2 * nearest.share * (step @ dstep)) / float(step @ step)


class _History:
    """Every instant of L strikes: numbers, (T, L, size), and in forward mode how they change.

    Args:
        system: System of the strikes.
        batch: All strikes.
        which: Those to roll out, (L,).
        count: Steps in a row; T is a multiple of it.

    Attributes:
        t, h, x, u: Time, step, state and input; states and inputs have an instant more.
        p: Parameters, (L, P).
        tip, tau, seen: The tip's position and velocity, the drive's torques, what is observed.
        last: The last instant of each strike, (L,).
        alive, diverged: Whether it still moves, and whether it diverged, (L,).
    """

    def __init__(self, system: System, batch: Batch, which: np.ndarray, count: int) -> None:
        L, self.steps, step = len(which), batch.steps[which], system.step
        T = count * -(-(int(self.steps.max()) + 1) // count)
        given = [(batch.x0, batch.p, batch.h, batch.h_last, batch.u, batch.u_row)]
        if batch.dp is not None:
            assert batch.dx0 is not None
            assert batch.dh is not None
            assert batch.dh_last is not None
            given.append((batch.dx0, batch.dp, batch.dh, batch.dh_last, batch.du, batch.du_row))
        self.t, self.h, self.x, self.u, self.p, self.tip, self.tau, self.seen = ([] for _ in range(8))
        for x0, p, h, h_last, u, u_row in given:
            t, steps = _times(T, self.steps, h[which], h_last[which])
            self.t.append(t)
            self.h.append(steps)
            self.x.append(np.empty((T + 1, L, x0.shape[1])))
            self.x[-1][0] = x0[which]
            self.p.append(np.ascontiguousarray(p[which]))
            self.u.append(np.zeros((T + 1, L, step.size1_in("u"))))
            if u is not None and u_row is not None:
                _fill(self.u[-1], u, u_row[which], self.steps)
            self.tip.append(np.empty((T, L, step.size1_out("tip"))))
            self.tau.append(np.empty((T, L, step.size1_out("tau"))))
            self.seen.append(np.empty((T, L, step.size1_out("observed") if batch.columns is not None else 0)))
        self.last = np.zeros(L, int)
        self.alive, self.diverged = np.ones(L, bool), np.zeros(L, bool)

    def inputs(self, first: int, count: int) -> list[np.ndarray]:
        """Return what `several` reads."""
        now, inputs = slice(first, first + count), slice(first, first + count + 1)
        found = []
        for x, t, h, p, u in zip(self.x, self.t, self.h, self.p, self.u, strict=True):
            found += [x[first], t[now], h[now], p, u[inputs]]
        return found

    def outputs(self, first: int, count: int) -> list[np.ndarray]:
        """Return what `several` writes."""
        now, following = slice(first, first + count), slice(first + 1, first + count + 1)
        found = []
        for x, tip, tau, seen in zip(self.x, self.tip, self.tau, self.seen, strict=True):
            found += [x[following], tip[now], tau[now], seen[now]]
        return found

    def held_inputs(self, first: int) -> list[np.ndarray]:
        """Return what the controller reads."""
        return [of for x, t, p in zip(self.x, self.t, self.p, strict=True) for of in (x[first], t[first], p)]

    def held(self, first: int) -> list[np.ndarray]:
        """Return where the controller writes."""
        return [u[first] for u in self.u]

    def hold(self, first: int, count: int) -> None:
        """Keep the controller's torque for some steps."""
        for u in self.u:
            u[first + 1 : first + count + 1] = u[first]

    def end(self, first: int, count: int) -> None:
        """Find which strikes ended or diverged in the last steps."""
        n = self.x[0].shape[2] // 2
        with np.errstate(over="ignore", invalid="ignore"):
            squared = np.einsum("klj,klj->kl", *[self.x[0][first + 1 : first + count + 1, :, n:]] * 2)
            wild = ~(squared < FASTEST**2)  # also true of NaN
        left = self.steps - first
        before = np.where(wild.any(axis=0), wild.argmax(axis=0), count)  # instants until the speed left all bounds
        broke = self.alive & (before < np.minimum(left, count))
        ended = self.alive & ~broke & (left < count)
        self.last[self.alive] = first + count - 1
        self.last[broke] = first + before[broke]
        self.last[ended] = self.steps[ended]
        self.diverged |= broke
        self.alive &= ~(broke | ended)


def _times(T: int, steps: np.ndarray, h: np.ndarray, h_last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and steps, each (T, L, 1), of strikes whose last step is another, or how they change."""
    i = np.arange(T)[:, None]
    t = np.where((steps == i) & (i > 0), (i - 1) * h + h_last, i * h)
    return t[..., None].copy(), np.where(steps == i + 1, h_last, h)[..., None].copy()


def _fill(to: np.ndarray, table: np.ndarray, rows: np.ndarray, steps: np.ndarray) -> None:
    """Write each strike's inputs, (T, L, inputs), from its first row on; a negative row means none."""
    moves = rows >= 0
    instants = np.minimum(np.arange(len(to))[:, None], steps[moves] + 1)
    to[:, moves] = table[rows[moves] + instants]


def several(step: ca.Function, L: int, count: int, *, forward: bool, observed: bool) -> ca.Function:
    """Return a function that makes `count` successive steps of L strikes.

    Its arguments are x (2 n, L), t and h (1, count L), p (P, L) and u (inputs, (count + 1) L), ordered by instant. It
    returns the following states, tips, torques and observed quantities; in `forward` mode also their derivatives.
    """
    together, sides = step.map(L), 2 if forward else 1
    sizes = [step.size1_in(i) for i in range(5)]
    widths = [L, count * L, count * L, L, (count + 1) * L]
    inputs = [ca.MX.sym(f"i{i}", size, width) for i, (size, width) in enumerate(zip(sizes, widths, strict=True))]
    inputs += [ca.MX.sym(f"d{i}", x.size1(), x.size2()) for i, x in enumerate(inputs)] if forward else []
    state = [inputs[5 * side] for side in range(sides)]
    parts = [[ca.horzsplit(inputs[5 * side + i], L) for i in (1, 2, 4)] for side in range(sides)]
    written: list[list[ca.MX]] = [[] for _ in range(4 * sides)]
    for k in range(count):
        arguments = []
        for side in range(sides):
            t, h, u = parts[side]
            arguments += [state[side], t[k], h[k], inputs[5 * side + 3], u[k], u[k + 1]]
        results = together.call(arguments)
        state = [results[4 * side] for side in range(sides)]
        for column, result in zip(written, results, strict=True):
            column.append(ca.MX(result))
    if not observed:
        for side in range(sides):
            written[4 * side + 3] = [ca.MX(0, count * L)]
    return ca.Function("several", inputs, [ca.horzcat(*column) for column in written])


def _call(function: ca.Function, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> None:
    """Evaluate a function on arrays, whose last axis is its rows, in place."""
    buffer, evaluate = function.buffer()
    # CasADi's types ask for a size, which a memory view brings along
    for i, array in enumerate(inputs):
        if function.numel_in(i):
            buffer.set_arg(i, array.data)  # pyrefly: ignore[missing-argument]
    for i, array in enumerate(outputs):
        if function.numel_out(i):
            buffer.set_res(i, array.data)  # pyrefly: ignore[missing-argument]
    evaluate()


def tip_at(
    at: np.ndarray,
    t: np.ndarray,
    path: np.ndarray,
    moved: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    moving: bool = False,
) -> np.ndarray:
    """Return the tip at times `at`, by cubic interpolation of positions and velocities.

    Args:
        at: Times, (S,) [s].
        t, path: Times (T,) [s], and positions and velocities (T, 2 d).
        moved: Derivatives of path (T, 2 d) and of times (T,) along a direction; the tip's derivative at fixed times is
            then appended.
        moving: Whether velocities follow the positions.

    Returns:
        Positions of the tip, (S, d) [m], or with velocities (S, 2 d), each followed by derivatives with `moved`.
    """
    from scipy.interpolate import CubicHermiteSpline

    d = path.shape[1] // 2
    if len(t) == 1:
        shown = slice(None) if moving else slice(d)
        both = [path[:1, shown]] + ([] if moved is None else [moved[0][:1, shown]])
        return np.repeat(np.hstack(both), len(at), axis=0)
    at = np.minimum(at, t[-1])
    cubic = CubicHermiteSpline(t, path[:, :d], path[:, d:])
    found = [cubic(at)] + ([cubic(at, 1)] if moving else [])
    if moved is None:
        return np.hstack(found)
    dpath, dt = moved
    i = np.clip(np.searchsorted(t, at - 1e-12, side="left") - 1, 0, len(t) - 2)
    h = (t[i + 1] - t[i])[:, None]
    s = (at - t[i])[:, None] / h
    dstart, dspan = dt[i, None], (dt[i + 1] - dt[i])[:, None]
    later = -(dstart + s * dspan)  # the step that holds a fixed time moves: its share of the step changes, and its span
    r, v0, v1 = 1 - s, path[i, d:], path[i + 1, d:]
    change = CubicHermiteSpline(t, dpath[:, :d], dpath[:, d:])
    found.append(change(at) + later * cubic(at, 1) + dspan * r * s * (r * v0 - s * v1))
    if moving:  # the acceleration is that of the step that ends at a time, as in the other engines
        bend = ((6 - 12 * s) * (path[i + 1, :d] - path[i, :d]) / h + (6 * s - 4) * v0 + (6 * s - 2) * v1) / h
        by_span = r * (r - 2 * s) * v0 - s * (2 * r - s) * v1 - cubic(at, 1)
        found.append(change(at, 1) + later * bend + dspan / h * by_span)
    return np.hstack(found)


RUNGS = ("simd", "scalar", "interpreter")
VARIABLE = "WHIPTOOL_ENGINE"


def wanted_rung() -> str | None:
    """Return the engine (`simd`, `scalar` or `interpreter`) that the environment variable sets, if any.

    Raises:
        InputError: The variable names no engine.
    """
    name = os.environ.get(VARIABLE) or None
    if name is not None and name not in RUNGS:
        raise InputError(VARIABLE, name, ", ".join(RUNGS))
    return name


@lru_cache(maxsize=64)
def find_engine(structure: Structure | SwingStructure, *, forward: bool, rung: str | None) -> Engine:
    """Return the fastest engine that works on this machine and simulates strikes of a structure.

    Args:
        structure: Structure of the equations of motion: of arm and whip, or of a whip on a prescribed base.
        forward: Whether the engine also computes directional derivatives.
        rung: First engine to try: `simd`, `scalar` or `interpreter`; None: `simd`.

    If SIMD code does not compile, scalar code is used; without a working compiler, the interpreter. Each is reported in
    the log.
    """
    wanted = RUNGS if rung is None else RUNGS[RUNGS.index(rung) :]
    system = closed_loop(structure) if isinstance(structure, Structure) else swing(structure)
    for name in wanted[:-1]:
        engine = NativeEngine.compiled(system, forward=forward, simd=name == "simd")
        if engine is not None:
            return engine
    return InterpretedEngine(system, forward=forward)
