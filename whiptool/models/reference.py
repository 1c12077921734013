"""The reference rollout: MuJoCo steps, Pinocchio compensates gravity, the controller is plain NumPy."""

from __future__ import annotations

import threading
from typing import Literal, get_args

import mujoco
import numpy as np
from scipy.linalg import eigh

from whiptool.errors import InputError
from whiptool.impedance.controller import Controller, ControlLoop
from whiptool.models.arm import Arm
from whiptool.models.mujoco_model import build_spec
from whiptool.models.parameters import Model, number
from whiptool.models.posture import start_posture
from whiptool.models.stepping import FASTEST, time_grid
from whiptool.models.trajectory import Trajectory, complete_trajectory
from whiptool.strike import Strike

Integrator = Literal["RK4", "Euler", "implicit", "implicitfast"]
TIMESTEP = 1e-4  # [s], largest
_callback = threading.Lock()  # MuJoCo's control callback is one per process


class ReferenceRollout:
    """Rolls strikes of one model and controller out in MuJoCo.

    A torque written to `ctrl` once a step is held over the integrator's stages, which makes any of them first order.
    A continuous controller therefore acts through MuJoCo's control callback, at every stage. Drag and smoothed
    friction, which MuJoCo lacks, act there too, as generalised forces.

    Args:
        model: Whip, arm, gravity.
        controller: Law and options.
        timestep: MuJoCo's step [s]; default: 0.1 ms, less where the whip's damping would make RK4 unstable.
        integrator: One of MuJoCo's.
    """

    engine = "reference"

    def __init__(
        self, model: Model, controller: Controller, *, timestep: float | None = None, integrator: str = "RK4"
    ) -> None:
        if integrator not in get_args(Integrator):
            raise InputError("integrator", integrator, ", ".join(get_args(Integrator)))
        self.model, self.controller = model, controller
        self._mj = build_spec(model).compile()
        if timestep is None:
            timestep = min(TIMESTEP, _stable_timestep(self._mj, model))
        self.timestep = number("timestep", timestep, low=0, strict=True)
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
        loop = self.controller.bind(self._arm, strike)
        grid = time_grid(
            np.array([strike.D + t_stay]), timestep=self.timestep, control_period=self.controller.control_period
        )
        h, h_last, steps = (x[0].item() for x in grid[:3])
        hold = grid[3] if self.controller.control_period is not None else 0
        mj, data = self._mj, self._data
        mujoco.mj_resetData(mj, data)
        data.qpos[:] = start_posture(self.model, np.array([strike.q_i]))[0]
        times, q, v = np.empty(steps + 1), np.empty((steps + 1, n)), np.empty((steps + 1, n))
        tau, tip, velocity = np.empty((steps + 1, a)), np.empty((steps + 1, 2)), np.empty((steps + 1, 2))
        diverged, i = False, 0
        with _callback:
            mujoco.set_mjcb_control(self._control(loop, held=bool(hold)))
            mujoco.set_mju_user_warning(lambda message: None)  # divergence is reported, not logged into a file
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
                    if not data.qvel @ data.qvel < FASTEST**2 or data.time == 0:  # MuJoCo resets what it gives up
                        diverged = True
                        break
            finally:
                mujoco.set_mjcb_control(None)
                mujoco.set_mju_user_warning(None)
        done = slice(i + 1)
        return complete_trajectory(
            self.model,
            self.controller,
            strike,
            t=times[done],
            q=q[done],
            v=v[done],
            tau=tau[done],
            diverged=diverged,
            tip=(tip[done], velocity[done]),
        )

    def _control(self, loop: ControlLoop, *, held: bool):
        a = self.model.arm.n

        own = self._data._address

        def act(mj: mujoco.MjModel, data: mujoco.MjData) -> None:
            if data._address != own:  # the callback is one per process: leave other simulations alone
                return
            if not held:
                data.ctrl[:] = loop.torque(data.time, data.qpos[:a], data.qvel[:a])
            if self._has_forces:
                data.qfrc_applied[:] = self._forces(data)

        return act

    def _forces(self, data: mujoco.MjData) -> np.ndarray:
        """Generalised forces of smoothed friction and drag [N m], (n,)."""
        v = data.qvel
        force = -self._friction * v / np.sqrt(v**2 + self.model.whip.friction_velocity**2)
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


def _stable_timestep(mj: mujoco.MjModel, model: Model) -> float:
    """A step [s] well inside RK4's stability limit (2.78 over the fastest decay) for damping and friction."""
    rng, data = np.random.default_rng(0), mujoco.MjData(mj)
    whip = model.whip
    damping = mj.dof_damping + np.r_[np.zeros(model.arm.n), whip.per_node("dry_friction")] / whip.friction_velocity
    fastest = 1e-9
    for _ in range(20):  # the limit depends on the posture
        data.qpos[:] = rng.normal(0, 0.5, model.n)
        mujoco.mj_forward(mj, data)
        M = np.empty((model.n, model.n))
        mujoco.mj_fullM(mj, data, M)
        fastest = max(fastest, eigh(np.diag(damping), M, eigvals_only=True)[-1])
    return 2.0 / fastest
