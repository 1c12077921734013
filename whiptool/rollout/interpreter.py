"""The driver's loop in Python around CasADi's interpreter: for machines without a compiler."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from whiptool.dynamics.closed_loop import Structure, closed_loop
from whiptool.dynamics.stepping import FASTEST
from whiptool.rollout.batch import Batch, Rolled, empty_results


class InterpretedEngine:
    """An engine with the arguments and results of `driver.cpp`, one strike after the other."""

    rung = "interpreter"

    def __init__(self, structure: Structure, *, forward: bool) -> None:
        self.structure, self.forward = structure, forward
        loop = closed_loop(structure)
        self._step = loop.step_forward if forward else loop.step
        self._control = None
        if structure.held:
            self._control = loop.control_forward if forward else loop.control

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out; `threads` is for engines that have them."""
        rolled = empty_results(batch, self.structure)
        for b in range(len(batch.p)):
            self._strike(batch, b, rolled)
        return rolled

    def _strike(self, batch: Batch, b: int, rolled: Rolled) -> None:
        n, a = self.structure.n, self.structure.n_arm
        steps, h, h_last = int(batch.steps[b]), batch.h[b], batch.h_last[b]
        x, t, dt, held = batch.x0[b].copy(), np.zeros(1), np.zeros(1), np.zeros(a)
        following, tip, tau = np.empty(2 * n), np.empty(4), np.empty(a)
        p = np.ascontiguousarray(batch.p[b])
        inputs, outputs = [x, t, dt, p, held], [following, tip, tau]
        control_inputs, control_outputs = [x, t, p], [held]
        dx, dnow, ddt, dheld = np.zeros(2 * n), np.zeros(1), np.zeros(1), np.zeros(a)
        dfollowing, dtip, dh, dh_last = np.zeros(2 * n), np.zeros(4), 0.0, 0.0
        if self.forward:
            assert batch.dp is not None
            assert batch.dx0 is not None
            assert batch.dh is not None
            assert batch.dh_last is not None
            dp = np.ascontiguousarray(batch.dp[b])
            dx[:], dh, dh_last = batch.dx0[b], batch.dh[b], batch.dh_last[b]
            inputs += [dx, dnow, ddt, dp, dheld]
            outputs += [dfollowing, dtip]
            control_inputs += [dx, dnow, dp]
            control_outputs += [dheld]
        step = _bind(self._step, inputs, outputs)
        control = None if self._control is None else _bind(self._control, control_inputs, control_outputs)
        rows, path, dpath = np.empty((steps + 1, 1 + 2 * n + a)), np.empty((steps + 1, 4)), np.empty((steps + 1, 4))
        dtime = np.empty(steps + 1)
        diverged, i = False, 0
        for i in range(steps + 1):
            end = i == steps and i > 0
            t[0] = (i - 1) * h + h_last if end else i * h
            dnow[0] = (i - 1) * dh + dh_last if end else i * dh
            dt[0], ddt[0] = (h_last, dh_last) if i + 1 == steps else (h, dh)
            if control is not None and i % batch.hold == 0:
                control()
            step()
            rows[i, 0], rows[i, 1 : 1 + 2 * n], rows[i, 1 + 2 * n :] = t[0], x, tau
            path[i], dpath[i], dtime[i] = tip, dtip, dnow[0]
            if i == steps:
                break
            if not following[n:] @ following[n:] < FASTEST**2:
                diverged = True
                break
            x[:], dx[:] = following, dfollowing
        i += 1
        rows, path, dpath, dtime = rows[:i], path[:i], dpath[:i], dtime[:i]
        nearest = _closest(rows[:, 0], path, dpath, batch.target[b])
        rolled.out[b] = [
            *nearest[:6],
            diverged,
            i - 1,
            nearest[6],
            *np.abs(rows[:, 1 + n : 1 + n + a]).max(axis=0),
            *np.abs(rows[:, 1 + 2 * n :]).max(axis=0),
        ]
        if rolled.rows is not None:
            assert rolled.first_row is not None
            first = int(rolled.first_row[b])
            rolled.rows[first : first + i] = rows
        if rolled.path is not None:
            samples = np.arange(batch.samples) / batch.rate
            within = samples <= rows[-1, 0] + 1e-9 / batch.rate
            values = hermite(samples[within], rows[:, 0], path, dpath if self.forward else None, dtime)
            rolled.path[b, within] = values


def _bind(function: ca.Function, inputs: list[np.ndarray], outputs: list[np.ndarray]) -> Callable[[], None]:
    """The function on these arrays: called without arguments, it reads and writes them in place."""
    buffer, evaluate = function.buffer()
    for i, array in enumerate(inputs):
        if function.numel_in(i):
            buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
    for i, array in enumerate(outputs):
        buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]
    evaluate.buffer_ = buffer  # keeps it alive
    return evaluate


def _closest(t: np.ndarray, path: np.ndarray, dpath: np.ndarray, target: np.ndarray) -> tuple:
    """Distance, time, velocity, tip, and slope of the distance at the closest approach on the tip's segments."""
    if len(t) < 2:
        return np.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    start, step = path[:-1, :2], np.diff(path[:, :2], axis=0)
    squared = (step**2).sum(axis=1)
    s = np.clip(((target - start) * step).sum(axis=1) / np.where(squared > 0, squared, 1), 0, 1)
    offset = start + s[:, None] * step - target
    i = int((offset**2).sum(axis=1).argmin())
    tip = path[i] + s[i] * (path[i + 1] - path[i])
    moved = dpath[i, :2] + s[i] * (dpath[i + 1, :2] - dpath[i, :2])
    d = float(np.hypot(*offset[i]))
    slope = float(offset[i] @ moved) / d if d > 0 else 0.0
    return d, t[i] + s[i] * (t[i + 1] - t[i]), tip[2], tip[3], tip[0], tip[1], slope


def hermite(at: np.ndarray, t: np.ndarray, path: np.ndarray, dpath: np.ndarray | None, dt: np.ndarray) -> np.ndarray:
    """The tip at times `at`, by cubics through positions and velocities (T, 4) at times t; derivatives behind it.

    With `dpath`, how path and grid times move (by dt) along a direction: the tip's change at fixed times.
    """
    if len(t) == 1:
        both = path[:1, :2] if dpath is None else np.hstack([path[:1, :2], dpath[:1, :2]])
        return np.repeat(both, len(at), axis=0)
    i = np.clip(np.searchsorted(t, at - 1e-12, side="left") - 1, 0, len(t) - 2)
    h = (t[i + 1] - t[i])[:, None]
    s = (at - t[i])[:, None] / h
    r = 1 - s

    def cubic(z: np.ndarray) -> np.ndarray:
        p0, v0, p1, v1 = z[i, :2], z[i, 2:], z[i + 1, :2], z[i + 1, 2:]
        return r**2 * ((1 + 2 * s) * p0 + s * h * v0) + s**2 * ((1 + 2 * r) * p1 - r * h * v1)

    if dpath is None:
        return cubic(path)
    p0, v0, p1, v1 = path[i, :2], path[i, 2:], path[i + 1, :2], path[i + 1, 2:]
    dstart, dspan = dt[i][:, None], (dt[i + 1] - dt[i])[:, None]
    ds = -(dstart + s * dspan) / h
    moved = ds * (6 * r * s * (p1 - p0) + h * (r * (r - 2 * s) * v0 - s * (2 * r - s) * v1))
    moved += dspan * r * s * (r * v0 - s * v1)
    return np.hstack([cubic(path), cubic(dpath) + moved])
