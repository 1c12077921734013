"""The physics of the emulated rig, and its options: motors, and arm and whip in MuJoCo."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.presets import preset
from whiptool.rig.dynamixel.control_table import BAUD_RATES, Units
from whiptool.rig.emulator.controllers import OFF, PERIOD, Drive
from whiptool.rig.emulator.motor import Motor, Protection
from whiptool.rig.emulator.servo import Servo
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.reference import ReferenceRollout


@dataclass(frozen=True)
class TwinOptions:
    """Options of an emulated arm with servos.

    Args:
        model: Model of arm and whip; default: the preset `lemon2024`.
        motor: Motor of every joint; default: the XM430-W350 without friction. `HARDWARE` includes friction and inertia.
        start: Posture of the arm at time 0 [rad], with the whip hanging; default: straight down.
        lockstep: Time only advances with writes of Goal Current, by `period` each, so that runs are reproducible.
            False: real time.
        period: Control period in lock step [s].
        command_delay: Delay from writing a goal to its effect [s].
        sample_delay: Age of the state in the servos' registers [s].
        fineness: Factor by which the registers' counts are finer than those of real servos, a power of 2, to study
            quantisation.
        ids: Ids of the servos, shoulder first; default: 1, 2, ..
        baud: Baud rate to which the servos are set [bit/s].
        return_delay: Value of Return Delay Time(9) [2 us]; the factory setting is 250.
        timestep, integrator: MuJoCo's time step [s] and integrator; default: as in `ReferenceRollout`.
        protection: Thresholds at which a servo shuts itself down.
        reboot_time: Time for which a servo does not answer after a reboot [s]; default: `REBOOT` in real time, and 0 in
            lock step, where time does not pass by waiting.
    """

    model: Model = field(default_factory=lambda: preset("lemon2024"))
    motor: Motor = field(default_factory=Motor)
    start: tuple[float, ...] | None = None
    lockstep: bool = True
    period: float = 0.002
    command_delay: float = 0.0
    sample_delay: float = 0.0
    fineness: int = 1
    ids: tuple[int, ...] = ()
    baud: int = 1_000_000
    return_delay: int = 0
    timestep: float | None = None
    integrator: str | None = None
    protection: Protection = field(default_factory=Protection)
    reboot_time: float | None = None

    def __post_init__(self) -> None:
        number("period", self.period, low=1e-5, high=1.0)
        if self.reboot_time is not None:
            number("reboot_time", self.reboot_time, low=0)
        for name in ("command_delay", "sample_delay"):
            number(name, getattr(self, name), low=0, high=0.5)
        if self.baud not in BAUD_RATES.values():
            raise InputError("baud", self.baud, ", ".join(map(str, BAUD_RATES.values())))
        ids = self.ids or tuple(range(1, self.model.arm.n + 1))
        if len(set(ids)) != self.model.arm.n or not all(0 <= id <= 252 for id in ids):
            raise InputError("ids", ids, f"{self.model.arm.n} different numbers from 0 to 252")
        object.__setattr__(self, "ids", ids)

    def make_servos(self) -> list[Servo]:
        """Return the servos in their state after power-on."""
        rate = next(value for value, bps in BAUD_RATES.items() if bps == self.baud)
        usual = 0.0 if self.lockstep else REBOOT
        return [
            Servo(
                id,
                self.motor,
                units=Units(self.fineness),
                baud=rate,
                return_delay=self.return_delay,
                protection=self.protection,
                reboot_time=usual if self.reboot_time is None else self.reboot_time,
            )
            for id in self.ids
        ]


@dataclass(frozen=True)
class TwinTruth:
    """The true parameters of a twin, which are not available to the code that plans and controls strikes.

    Args:
        model: The true arm and whip.
        motor: The true motors.
        command_delay, sample_delay: Delays of commands and of samples on the bus [s].
        clock_offset: Time by which the camera's clock is late [s].
        seed: Seed of the camera's noise.
    """

    model: Model
    motor: Motor = field(default_factory=Motor)
    command_delay: float = 0.0
    sample_delay: float = 0.0
    clock_offset: float = 0.0
    seed: int = 0


RECORD_PERIOD = 1e-3  # [s]
REBOOT = 0.4  # [s], as users measured it on an XC330 (ROBOTIS-GIT/emanual, issue 1698); the manual gives no time
STILL = (1e-4, 1e-3)  # speed [rad/s] and acceleration [rad/s2] of every joint; an encoder counts 1.5e-3 rad


class Physics:
    """Simulated arm and whip, driven by the servos' motors.

    Model, integrator, step, drag and friction are those of `ReferenceRollout`; the motors add a current limit, friction
    and inertia. In real time, integration pauses while torque is off and nothing moves.

    Args:
        options: Options of the emulation.
        record: Keep the trajectory, a sample every `RECORD_PERIOD`.
    """

    def __init__(self, options: TwinOptions, *, record: bool = True) -> None:
        self.options, self.model, self.servos = options, options.model, options.make_servos()
        rollout = ReferenceRollout(self.model, Controller(), timestep=options.timestep, integrator=options.integrator)
        self.timestep = options.period / math.ceil(options.period / rollout.timestep - 1e-9)
        self._rollout, self._mj, self.data = rollout, rollout.mj, rollout.data
        self._mj.opt.timestep = self.timestep
        self._mj.dof_armature[: self.model.arm.n] = options.motor.inertia
        self._record_steps = max(1, round(RECORD_PERIOD / self.timestep))
        self._control_steps = max(1, round(PERIOD / self.timestep))
        self._kept = None if record else 0
        self.reset(options.start)

    def reset(self, start: Sequence[float] | None = None) -> None:
        """Return to time 0, with the arm's `a` joints at rest at the angles `start` [rad], (a,); default: straight
        down.
        """
        a = self.model.arm.n
        q_i = np.zeros(a) if start is None else np.asarray(start, float)
        if q_i.shape != (a,):
            raise InputError("start", start, f"{a} angles in rad")
        mujoco.mj_resetData(self._mj, self.data)
        self.data.qpos[:] = start_posture(self.model, q_i[None])[0]
        mujoco.mj_forward(self._mj, self.data)
        self.steps, self.last_driven = 0, 0.0  # and when a motor was last asked for current [s]
        self._goals: deque[tuple[float, list[Drive]]] = deque()
        self._acting = [OFF] * a
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self._rows: deque[tuple] = deque(maxlen=self._kept)
        self.currents, self.torques = [0.0] * a, [0.0] * a
        self._record()
        self.show()

    @property
    def t(self) -> float:
        """Time of the simulation [s]."""
        return self.steps * self.timestep

    @property
    def at_rest(self) -> bool:
        """Whether integration is skipped because torque is off and nothing moves; speeds below `STILL` count as
        zero."""
        if self.options.lockstep or any(self.currents) or any(servo.torque_on for servo in self.servos):
            return False  # the acceleration of a step with current says nothing of the next one without
        speed, acceleration = STILL
        return bool(np.abs(self.data.qvel).max() < speed and np.abs(self.data.qacc).max() < acceleration)

    def advance_to(self, t: float) -> None:
        """Integrate up to time t [s]."""
        end = round(t / self.timestep)
        if end <= self.steps:
            return
        if self.at_rest:
            self._stay_until(end)
        else:
            self._step_until(end)
        self.show()

    def _stay_until(self, end: int) -> None:
        """Let time pass for the servos alone: no current flows, and nothing moves."""
        dt, self.steps = (end - self.steps) * self.timestep, end
        for servo in self.servos:
            servo.current = 0.0
            servo.age(dt)
        self._record()

    def _step_until(self, end: int) -> None:
        mj, data, servos, h = self._mj, self.data, self.servos, self.timestep
        a = len(servos)
        motors = [servo.motor for servo in servos]
        delayed = self.options.sample_delay > 0
        has_forces = self._rollout.has_forces
        fixed_mode = all(servo.memory[11] == 0 for servo in servos)
        goals, aged = self._wanted(), self.steps
        acting: list[Drive] = []
        driven = False
        while self.steps < end:
            v = data.qvel[:a].tolist()
            if not fixed_mode and self.steps % self._control_steps == 0:  # these modes act on the state
                for servo, q_i, v_i in zip(servos, data.qpos[:a].tolist(), v, strict=True):
                    servo.q, servo.v = (servo.q, servo.v) if servo.stuck else (q_i, v_i)
                    servo.control()
                goals = self._wanted()
            wanted = self._delay(goals) if self.options.command_delay else goals
            if wanted is not acting:
                acting = wanted
                driven = any(current or low == high != 0.0 for current, low, high in acting)
            for i, motor in enumerate(motors):
                goal, low, high = acting[i]
                # with torque off the bridge is open: no current, whatever the speed
                current = motor.current(goal, v[i], low, high) if servos[i].torque_on else 0.0
                self.currents[i] = current
                self.torques[i] = motor.torque(current, v[i])
            data.ctrl[:] = self.torques
            if has_forces:
                self._rollout.apply_forces(data)
            mujoco.mj_step(mj, data)
            self.steps += 1
            if delayed:
                self._past.append((self.t, data.qpos[:a].copy(), data.qvel[:a].copy()))
            if self.steps % self._record_steps == 0:
                self._record()
            if self.steps - aged == 10 or self.steps == end:  # servos look after themselves every millisecond or so
                dt, aged = (self.steps - aged) * h, self.steps
                for i, servo in enumerate(servos):
                    servo.current = self.currents[i]
                    servo.age(dt)
                goals = self._wanted()  # a watchdog or a shutdown may have ended them
            if driven:
                self.last_driven = self.t

    def _wanted(self) -> list[Drive]:
        return [servo.drive() for servo in self.servos]

    def _delay(self, goals: list[Drive]) -> list[Drive]:
        """The goals of `command_delay` ago."""
        queue = self._goals
        if not queue or queue[-1][1] != goals:
            queue.append((self.t + self.options.command_delay, goals))
        while queue and queue[0][0] <= self.t + 1e-12:
            self._acting = queue[0][1]
            if len(queue) == 1:
                break
            queue.popleft()
        return self._acting

    def show(self) -> None:
        """Write the measured position, speed and current into the servos' registers."""
        a = len(self.servos)
        q, v, t = self.data.qpos[:a], self.data.qvel[:a], self.t
        if self.options.sample_delay and self._past:
            while len(self._past) > 1 and self._past[1][0] <= t - self.options.sample_delay + 1e-12:
                self._past.popleft()
            _, q, v = self._past[0]
        for i, servo in enumerate(self.servos):
            servo.feel(float(q[i]), float(v[i]), self.currents[i], t)

    def _record(self) -> None:
        data = self.data
        self._rows.append((self.t, data.qpos.copy(), data.qvel.copy(), tuple(self.currents), tuple(self.torques)))

    def trajectory(self) -> dict[str, np.ndarray]:
        """Return the T stored samples by name: times t (T,) [s], positions q and velocities v of the model's n joints
        (T, n), current [A] and torque [N m] of the arm's `a` joints (T, a), positions of the tip (T, 2) [m].
        """
        from whiptool.models.kinematics import joint_points

        t, q, v, current, torque = (np.array(x) for x in zip(*self._rows, strict=True))
        tip = joint_points(self.model, q)[:, -1]
        return {"t": t, "q": q, "v": v, "current": current, "torque": torque, "tip": tip}
