"""The driver's loop in Python around CasADi's interpreter: for machines without a compiler."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from whiptool.models.closed_loop import Structure, closed_loop
from whiptool.models.stepping import FASTEST
from whiptool.models.trajectory import Trajectory


def interpreted_engine(structure: Structure) -> Callable[..., np.ndarray]:
    """An engine with the arguments and results of `driver.cpp`: outcome columns, shape (B, 7 + 2 a)."""
    loop = closed_loop(structure)
    n, a = structure.n, structure.n_arm
    state, time, step_size, held = np.empty(2 * n), np.empty(1), np.empty(1), np.empty(a)
    following, tip, tau = np.empty(2 * n), np.empty(4), np.empty(a)
    parameters = np.empty(structure.n_parameters)

    def bind(function: ca.Function, inputs: list[np.ndarray], outputs: list[np.ndarray]) -> Callable[[], None]:
        buffer, evaluate = function.buffer()
        for i, array in enumerate(inputs):
            if array.size and function.numel_in(i):
                buffer.set_arg(i, array.data)  # pyright: ignore[reportCallIssue]
        for i, array in enumerate(outputs):
            buffer.set_res(i, array.data)  # pyright: ignore[reportCallIssue]
        evaluate.buffer_ = buffer  # type: ignore[attr-defined]  # keeps it alive
        return evaluate

    def engine(p, x0, target, h, h_last, steps, hold, rows) -> np.ndarray:
        step = bind(loop.step, [state, time, step_size, parameters, held], [following, tip, tau])
        control = bind(loop.control, [state, time, parameters], [held]) if structure.held else None
        outcomes, first = np.empty((len(p), 7 + 2 * a)), 0
        for b in range(len(p)):
            state[:], parameters[:] = x0[b], p[b]
            table = np.empty((steps[b] + 1, 1 + 2 * n + a))
            path = np.empty((steps[b] + 1, 4))
            diverged, i = False, 0
            for i in range(steps[b] + 1):
                time[0] = i * h[b] if i < steps[b] or i == 0 else (i - 1) * h[b] + h_last[b]
                step_size[0] = h_last[b] if i + 1 == steps[b] else h[b]
                if control is not None and i % hold == 0:
                    control()
                step()
                table[i, 0], table[i, 1 : 1 + 2 * n], table[i, 1 + 2 * n :], path[i] = time[0], state, tau, tip
                if i == steps[b]:
                    break
                speed = following[n:] @ following[n:]
                if not speed < FASTEST**2:
                    diverged = True
                    break
                state[:] = following
            table, path = table[: i + 1], path[: i + 1]
            empty = np.empty((0, a))
            part = Trajectory(
                t=table[:, 0],
                q=table[:, 1 : 1 + n],
                v=table[:, 1 + n : 1 + 2 * n],
                q_d=empty,
                v_d=empty,
                tau=table[:, 1 + 2 * n :],
                K=empty,
                B=empty,
                tip=path[:, :2],
                tip_velocity=path[:, 2:],
                diverged=diverged,
            )
            near = part.approach(target[b])
            outcomes[b] = np.concatenate(
                [
                    near.distance,
                    near.time,
                    near.speed,
                    near.tip[0],
                    near.diverged,
                    [i],
                    near.max_joint_speed[0],
                    near.max_torque[0],
                ]
            )
            if rows is not None:
                rows[first : first + len(table)] = table
                first += steps[b] + 1
        return outcomes

    return engine
