"""The driver's loop in Python around CasADi's interpreter: for machines without a compiler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from whiptool.dynamics.columns import Columns, outcome_columns, row_columns
from whiptool.dynamics.stepping import FASTEST
from whiptool.dynamics.system import System
from whiptool.rollout.batch import Batch, Rolled, empty_results
from whiptool.rollout.closest import closest_on_segments

_AT_ONCE = 64  # strikes whose steps are kept in memory


class InterpretedEngine:
    """An engine with the arguments and results of `driver.cpp`."""

    rung = "interpreter"

    def __init__(self, system: System, *, forward: bool) -> None:
        self.system, self.forward = system, forward
        self._step = system.step_forward if forward else system.step
        self._control = None
        if system.held:
            self._control = system.control_forward if forward else system.control

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out; `threads` is for engines that have them."""
        assert batch.forward == self.forward
        rolled = empty_results(batch, self.system)
        order = np.argsort(-batch.steps, kind="stable")
        for first in range(0, len(order), _AT_ONCE):
            which = order[first : first + _AT_ONCE]
            history = self._roll(batch, which, rolled)
            for lane, b in enumerate(which):
                self._conclude(batch, b, history, lane, rolled)
        return rolled

    def _roll(self, batch: Batch, which: np.ndarray, rolled: Rolled) -> _History:
        """Step strikes together, and note what is observed of them."""
        L, n, steps = len(which), self.system.n, batch.steps[which]
        at = _Instant(self.system, batch, which, forward=self.forward)
        step = _bind(self._step.map(L), at.step_inputs, at.step_outputs)
        control = None
        if self._control is not None:
            control = _bind(self._control.map(L), at.control_inputs, at.control_outputs)
        history = _History.of(int(steps.max()) + 1, L, self.system)
        alive, times = np.ones(L, bool), at.times(steps)
        for i in range(int(steps.max()) + 1):
            at.set_time(i, times)
            if control is None:
                at.set_inputs(i, steps)
            elif i % batch.hold == 0:
                control()
                at.hold()
            step()
            history.note(i, at, alive)
            if rolled.y is not None and i % batch.stride == 0:
                _observe(i, at, which, alive, batch, rolled)
            alive &= steps != i
            if not alive.any():
                break
            with np.errstate(over="ignore", invalid="ignore"):
                wild = alive & ~((at.following.x[:, n:] ** 2).sum(axis=1) < FASTEST**2)  # also true of NaN
            history.diverged |= wild
            alive &= ~wild
            for now, following in zip(at.state.both, at.following.both, strict=True):
                now[alive] = following[alive]
        return history

    def _conclude(self, batch: Batch, b: int, history: _History, lane: int, rolled: Rolled) -> None:
        """Write what came of one strike."""
        n, a, d = self.system.n, self.system.n_drive, self.system.dimension
        outcome, row = outcome_columns(a, d), row_columns(n, a, d)
        last = int(history.last[lane])
        rows, path, dpath = (x[: last + 1, lane] for x in (history.rows, history.path, history.dpath))
        out, t = rolled.out[b], rows[:, 0]
        nearest = closest_on_segments(path[:, :d], batch.target[b])
        when, tip, moved = 0.0, np.zeros(2 * d), np.zeros(2 * d)
        if last > 0:
            when, tip, moved = (nearest.between(x) for x in (t, path, dpath))
        away = tip[:d] - batch.target[b]
        out[outcome["distance"]], out[outcome["time"]] = nearest.distance, when
        out[outcome["tip"]], out[outcome["velocity"]] = tip[:d], tip[d:]
        out[outcome["slope"]] = away @ moved[:d] / nearest.distance if nearest.distance > 0 else 0.0
        out[outcome["diverged"]], out[outcome["last_step"]] = history.diverged[lane], last
        speeds = rows[:, row["x"]][:, n : n + a]
        out[outcome["max_joint_speed"]] = np.abs(speeds).max(axis=0)
        out[outcome["max_torque"]] = np.abs(rows[:, row["tau"]]).max(axis=0)
        if rolled.rows is not None:
            assert rolled.first_row is not None
            first = int(rolled.first_row[b])
            rolled.rows[first : first + len(rows)] = rows
        if rolled.path is not None:
            samples = np.arange(batch.samples) / batch.rate
            within = samples <= t[-1] + 1e-9 / batch.rate
            changes = (dpath, history.dtime[: last + 1, lane]) if self.forward else None
            rolled.path[b, within] = tip_at(samples[within], t, path, changes)


class _Value:
    """Numbers of L lanes, (L, size), and in forward mode how they change."""

    def __init__(self, L: int, size: int, *, forward: bool) -> None:
        self.x = np.zeros((L, size))
        self.d = np.zeros((L, size))
        self.both = [self.x, self.d] if forward else [self.x]


class _Instant:
    """What the step reads and writes of L lanes."""

    def __init__(self, system: System, batch: Batch, which: np.ndarray, *, forward: bool) -> None:
        L, n, a, d = len(which), system.n, system.n_drive, system.dimension

        def value(size: int) -> _Value:
            return _Value(L, size, forward=forward)

        def along(values: Sequence[_Value]) -> list[np.ndarray]:
            """The numbers, then in forward mode their changes."""
            return [x.x for x in values] + ([x.d for x in values] if forward else [])

        self._batch, self._which, self._forward = batch, which, forward
        self.state, self.following, self.p = value(2 * n), value(2 * n), value(system.n_parameters)
        self.t, self.h, self.u, self.u_end = value(1), value(1), value(system.n_inputs), value(system.n_inputs)
        self.tip, self.tau, self.seen = value(2 * d), value(a), value(system.n_observed)
        self.state.x[:], self.p.x[:] = batch.x0[which], batch.p[which]
        if forward:
            assert batch.dx0 is not None
            assert batch.dp is not None
            self.state.d[:], self.p.d[:] = batch.dx0[which], batch.dp[which]
        self.step_inputs = along([self.state, self.t, self.h, self.p, self.u, self.u_end])
        self.step_outputs = along([self.following, self.tip, self.tau, self.seen])
        self.control_inputs, self.control_outputs = along([self.state, self.t, self.p]), along([self.u])

    def times(self, steps: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return times and steps of every instant, each (T, L), and how they change; a last step may be shorter."""
        batch, which = self._batch, self._which
        pairs = [(batch.h, batch.h_last)]
        if self._forward:
            assert batch.dh is not None
            assert batch.dh_last is not None
            pairs.append((batch.dh, batch.dh_last))
        i = np.arange(int(steps.max()) + 1)[:, None]
        end, last = (steps == i) & (i > 0), steps == i + 1
        found = []
        for usual, shorter in ((x[which], y[which]) for x, y in pairs):
            t = np.where(end, (i - 1) * usual + shorter, i * usual)
            found.append((t, np.where(last, shorter, usual)))
        return found

    def set_time(self, i: int, times: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Set time and step to those of instant i."""
        for t, h, (at, step) in zip(self.t.both, self.h.both, times, strict=True):
            t[:, 0], h[:, 0] = at[i], step[i]

    def set_inputs(self, i: int, steps: np.ndarray) -> None:
        """Set the inputs at the step's start and end; a strike that ended waits for the others."""
        batch, which = self._batch, self._which
        given = [(batch.u, batch.u_row), (batch.du, batch.du_row)]
        for k, values in ((i, self.u), (i + 1, self.u_end)):
            for x, (table, rows) in zip(values.both, given, strict=False):
                if table is None or rows is None:
                    continue
                moves = rows[which] >= 0
                x[moves] = table[rows[which][moves] + np.minimum(k, steps[moves] + 1)]

    def hold(self) -> None:
        """Keep the held torque to the step's end."""
        for start, end in zip(self.u.both, self.u_end.both, strict=True):
            end[:] = start


@dataclass
class _History:
    """Every step of L strikes: rows (T, L, columns), tip and its change (T, L, 2 d), change of the time (T, L)."""

    columns: Columns
    rows: np.ndarray
    path: np.ndarray
    dpath: np.ndarray
    dtime: np.ndarray
    last: np.ndarray
    diverged: np.ndarray

    @classmethod
    def of(cls, T: int, L: int, system: System) -> _History:
        d = system.dimension
        columns = row_columns(system.n, system.n_drive, d)
        rows = np.empty((T, L, columns.width))
        path, dpath, dtime = np.empty((T, L, 2 * d)), np.zeros((T, L, 2 * d)), np.zeros((T, L))
        return cls(columns, rows, path, dpath, dtime, last=np.zeros(L, int), diverged=np.zeros(L, bool))

    def note(self, i: int, at: _Instant, alive: np.ndarray) -> None:
        """Note instant i of the strikes that still move."""
        columns = self.columns
        self.rows[i, :, columns["t"]] = at.t.x
        self.rows[i, :, columns["x"]] = at.state.x
        self.rows[i, :, columns["tau"]] = at.tau.x
        self.rows[i, :, columns["tip"].start : columns["velocity"].stop] = at.tip.x
        self.path[i], self.dpath[i], self.dtime[i] = at.tip.x, at.tip.d, at.t.d[:, 0]
        self.last[alive] = i


def _observe(i: int, at: _Instant, which: np.ndarray, alive: np.ndarray, batch: Batch, rolled: Rolled) -> None:
    """Write what is observed of the strikes that still move."""
    assert rolled.y is not None
    assert rolled.y_row is not None
    rows = rolled.y_row[which[alive]] + i // batch.stride
    rolled.y[rows] = at.seen.x[alive][:, batch.columns]
    if rolled.dy is not None:
        rolled.dy[rows] = at.seen.d[alive][:, batch.columns]


def _bind(function: ca.Function, inputs: list[np.ndarray], outputs: list[np.ndarray]) -> Callable[[], None]:
    """The function on these arrays: called without arguments, it reads and writes them in place."""
    buffer, evaluate = function.buffer()
    for i, array in enumerate(inputs):
        if function.numel_in(i):
            buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
    for i, array in enumerate(outputs):
        if function.numel_out(i):
            buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]
    evaluate.buffer_ = buffer  # keeps it alive
    return evaluate


def tip_at(
    at: np.ndarray, t: np.ndarray, path: np.ndarray, moved: tuple[np.ndarray, np.ndarray] | None = None
) -> np.ndarray:
    """Return the tip at times `at`, by cubics through positions and velocities.

    Args:
        at: (S,) [s]
        t, path: Times (T,) [s]; positions and velocities, (T, 2 d).
        moved: How path (T, 2 d) and times (T,) move along a direction: the tip's change at fixed times comes behind it.

    Returns:
        (S, d), or with `moved` (S, 2 d).
    """
    d = path.shape[1] // 2
    if len(t) == 1:
        both = path[:1, :d] if moved is None else np.hstack([path[:1, :d], moved[0][:1, :d]])
        return np.repeat(both, len(at), axis=0)
    at = np.minimum(at, t[-1])
    cubic = CubicHermiteSpline(t, path[:, :d], path[:, d:])
    if moved is None:
        return cubic(at)
    dpath, dt = moved
    i = np.clip(np.searchsorted(t, at - 1e-12, side="left") - 1, 0, len(t) - 2)
    h = t[i + 1] - t[i]
    s = (at - t[i]) / h
    dstart, dspan = dt[i], dt[i + 1] - dt[i]
    later = -(dstart + s * dspan)  # the step that holds a fixed time moves: its share of the step changes, and its span
    r = 1 - s
    by_span = (r * s)[:, None] * (r[:, None] * path[i, d:] - s[:, None] * path[i + 1, d:])
    change = CubicHermiteSpline(t, dpath[:, :d], dpath[:, d:])(at)
    return np.hstack([cubic(at), change + later[:, None] * cubic(at, 1) + dspan[:, None] * by_span])
