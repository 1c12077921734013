"""The reference rollout: MuJoCo steps, Pinocchio compensates gravity, the controller is plain NumPy."""

from __future__ import annotations

import math
import threading
from typing import Literal, get_args

import mujoco
import numpy as np

from whiptool.errors import InputError
from whiptool.impedance.controller import ControlLoop, Controller
from whiptool.models.arm import Arm
from whiptool.models.compiled import _FASTEST, complete_trajectory
from whiptool.models.mujoco_model import build_spec
from whiptool.models.parameters import Model, _number
from whiptool.models.posture import start_posture
from whiptool.models.trajectory import Trajectory
from whiptool.strike import Strike

Integrator = Literal["RK4", "Euler", "implicit", "implicitfast"]
TIMESTEP = 1e-4  # [s]
_callback = threading.Lock()  # MuJoCo's control callback is one per process


class ReferenceRollout:
    """Rolls strikes of one model and controller out in MuJoCo.

    A torque written to `ctrl` once a step is held over the integrator's stages, which makes any of them first order.
    A continuous controller therefore acts through MuJoCo's control callback, at every stage. Drag and smoothed
    friction, which MuJoCo lacks, act there too, as generalised forces.

    Args:
        model: Whip, arm, gravity.
        controller: Law and options.
        timestep: MuJoCo's step [s].
        integrator: One of MuJoCo's.
    """

    engine = "reference"

    def __init__(self, model: Model, controller: Controller, *, timestep: float = TIMESTEP,
                 integrator: Integrator = "RK4") -> None:  # fmt: skip
        if integrator not in get_args(Integrator):
            raise InputError("integrator", integrator, ", ".join(get_args(Integrator)))
        self.model, self.controller = model, controller
        self.timestep = _number("timestep", timestep, low=0, strict=True)
        self._mj = build_spec(model).compile()
        self._mj.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        self._data = mujoco.MjData(self._mj)
        self._arm = Arm(model)
        self._tip = self._mj.site("tip").id
        whip = model.whip
        zeros = np.zeros(model.arm.n)
        self._friction = np.r_[zeros, whip.per_node("dry_friction")]
        self._drag = whip.per_node("drag")
        self._nodes = np.array([self._mj.body(f"whip{i + 1}").id for i in range(whip.N)])
        self._has_forces = bool(self._friction.any() or self._drag.any())

    def trajectory(self, strike: Strike, *, t_stay: float) -> Trajectory:
        """The whole strike of `D + t_stay` seconds, at every step."""
        a, n = self.model.arm.n, self.model.n
        duration = strike.D + t_stay
        loop = self.controller.bind(self._arm, strike)
        period, hold = self.controller.control_period, 0
        if period is None:
            steps = math.ceil(duration / self.timestep - 1e-9)
            h, h_last = duration / steps, duration / steps
        else:
            hold = math.ceil(period / self.timestep - 1e-9)
            h = period / hold
            steps = math.ceil(duration / h - 1e-9)
            h_last = duration - (steps - 1) * h
        mj, data = self._mj, self._data
        mujoco.mj_resetData(mj, data)
        data.qpos[:] = start_posture(self.model, np.array([strike.q_i]))[0]
        times, q, v = np.empty(steps + 1), np.empty((steps + 1, n)), np.empty((steps + 1, n))
        tau, tip, velocity = np.empty((steps + 1, a)), np.empty((steps + 1, 2)), np.empty((steps + 1, 2))
        diverged, i = False, 0
        with _callback:
            mujoco.set_mjcb_control(self._control(loop, held=bool(hold)))
            try:
                for i in range(steps + 1):
                    t = i * h if i < steps else (i - 1) * h + h_last
                    data.time = t
                    mj.opt.timestep = h_last if i + 1 == steps else h
                    if hold and i % hold == 0:
                        data.ctrl[:] = loop.torque(t, data.qpos[:a], data.qvel[:a])
                    mujoco.mj_forward(mj, data)
                    times[i], q[i], v[i], tau[i] = t, data.qpos, data.qvel, data.ctrl
                    tip[i], velocity[i] = data.site_xpos[self._tip, ::2], self._tip_velocity()
                    if i == steps:
                        break
                    mujoco.mj_step(mj, data)
                    if not data.qvel @ data.qvel < _FASTEST**2 or data.time == 0:  # MuJoCo resets what it gives up
                        diverged = True
                        break
            finally:
                mujoco.set_mjcb_control(None)
        done = slice(i + 1)
        return complete_trajectory(
            self.model, self.controller, strike, t=times[done], q=q[done], v=v[done], tau=tau[done],
            diverged=diverged, tip=(tip[done], velocity[done]),
        )  # fmt: skip

    def _control(self, loop: ControlLoop, *, held: bool):
        a = self.model.arm.n

        def act(mj: mujoco.MjModel, data: mujoco.MjData) -> None:
            if not held:
                data.ctrl[:] = loop.torque(data.time, data.qpos[:a], data.qvel[:a])
            if self._has_forces:
                data.qfrc_applied[:] = self._forces(data)

        return act

    def _forces(self, data: mujoco.MjData) -> np.ndarray:
        """Generalised forces of smoothed friction and drag [N m], (n,)."""
        v = data.qvel
        force = -self._friction * v / np.sqrt(v**2 + self.model.whip.friction_velocity ** 2)
        if self._drag.any():
            # node i sits at its body's centre of mass; all joints before it move it about the y axis
            nodes, joints = data.xipos[self._nodes][:, ::2], data.xanchor[:, ::2]
            lever = nodes[:, None, :] - joints[None, :, :]  # (N, n, 2)
            J = np.stack([-lever[..., 1], lever[..., 0]], axis=1)  # (N, 2, n) of hinges about -y
            before = np.arange(self.model.n)[None, :] <= self.model.arm.n + np.arange(self.model.whip.N)[:, None]
            J *= before[:, None, :]
            u = J @ v  # (N, 2)
            drag = -self._drag[:, None] * np.sqrt((u**2).sum(axis=1, keepdims=True) + 1e-12) * u
            force = force + np.einsum("ikj,ik->j", J, drag)
        return force

    def _tip_velocity(self) -> np.ndarray:
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(self._mj, self._data, mujoco.mjtObj.mjOBJ_SITE, self._tip, velocity, 0)
        return velocity[[3, 5]]
