"""Synthetic tip-level recordings for the tests of identification: a camera that errs by white noise."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from whiptool.impedance import Controller
from whiptool.models import Model
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout import CompiledRollout


def film(
    model: Model,
    vector: np.ndarray,
    rng: np.random.Generator | None = None,
    *,
    markers: tuple[str, ...] = ("tip",),
    sigma: float = 5e-3,
    handle_sigma: float = 2e-3,
    joint_noise: float = 3e-4,
    rate: float = 60.0,
    delay: float = 0.0,
    exposure: float = 0.0,
    controller: Controller | None = None,
    timestep: float = 1e-4,
) -> StrikeRecording:
    """One strike, filmed; without a generator, without noise. The clock is `delay` late."""
    rollout = CompiledRollout(model, controller or Controller(), timestep=timestep)
    path = rollout.trajectory(Strike.from_vector(vector), t_stay=0.3)
    q = CubicSpline(path.t, path.q)
    t = np.arange(0.004, path.t[-1] - exposure - 0.002, 1 / rate)
    length = np.r_[model.arm.per_link("length"), model.whip.per_node("l")]
    a = model.arm.n
    links = [{"tip": model.n, "handle": a}.get(m) or a + int(m.removeprefix("node")) for m in markers]

    def points(t: np.ndarray) -> np.ndarray:
        theta = np.cumsum(q(t), axis=1)
        ends = np.stack([np.sin(theta), -np.cos(theta)], axis=2) * length[:, None]
        return np.cumsum(ends, axis=1)[:, [i - 1 for i in links]]

    spread = np.linspace(-0.5, 0.5, 401) * exposure if exposure else [0.0]
    seen = np.mean([points(t + s) for s in spread], axis=0)
    errors = np.tile([handle_sigma if m == "handle" else sigma for m in markers], (len(t), 1))
    log = np.arange(0, path.t[-1], 1e-3)
    joints = q(log)[:, :a]
    if rng is not None:
        seen = seen + errors[..., None] * rng.standard_normal(seen.shape)
        joints = joints + joint_noise * rng.standard_normal(joints.shape)
    return StrikeRecording(
        t=t + delay,
        points=seen,
        markers=markers,
        sigma=errors,
        exposure=exposure,
        strike=Strike.from_vector(vector),
        joints_t=log,
        joints_q=joints,
    )
