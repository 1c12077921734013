"""Rehearsal: simulation of a strike at the loop's rate and delay before arming, which can refuse it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import Controller
from whiptool.limits.arm_limits import XM430, MotorLimits
from whiptool.models.parameters import AnyArm, Model
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.rig.dynamixel.control_table import CURRENT_MODE
from whiptool.rig.dynamixel.joints import Guards
from whiptool.rig.emulator.motor import Motor
from whiptool.rig.emulator.physics import Physics, TwinOptions
from whiptool.rig.loop_options import CappedLoop, LoopOptions
from whiptool.rollout.completed import States, complete_trajectory
from whiptool.rollout.interface import FASTEST

# A torque that alternates every period has 4, a smooth one nearly 0; quantised velocities alone make up to about 0.3
CHATTER = 0.6
STILL = 0.1  # [rad/s], below which an arm holds a posture


@dataclass(frozen=True)
class Rehearsal:
    """Result of simulating a strike with the rig's sampling.

    Args:
        trajectory: States and requested torques at every cycle; its stiffness `K` and damping `B` are those before
            `LoopOptions.caps` limit them.
        usage: Largest usage of the motors' limits; 1 is on the speed-torque line.
        chatter: Ratio of the root mean square of the torque's second difference to that of the torque, for the worst
            joint.
        refused: Reason why the strike must not be made; None: it may be made.
    """

    trajectory: Trajectory
    usage: float
    chatter: float
    refused: str | None


def rehearse(
    model: Model,
    controller: Controller,
    strike: Strike,
    options: LoopOptions | None = None,
    *,
    limits: MotorLimits = XM430,
    guards: Guards | None = None,
    motor: Motor | None = None,
    believed: Model | None = None,
) -> Rehearsal:
    """Simulate a strike at the loop's rate with the emulator's physics, and return whether it is refused.

    A controller that is stable in continuous time may be unstable if its torques are held for a period, since OIAC's
    gains grow with the square of the error. Then limit the gains (`caps`) or choose another strike.

    Args:
        model: Model of arm and whip.
        controller: The controller of the strike.
        strike: The strike; it starts at rest with the whip hanging.
        options: Settings of the loop: `rate`, `delay`, `t_stay`, `caps`, `margin`; default: `LoopOptions()` without
            delay.
        limits: Limits of the motors.
        guards: Limits of the run; a strike that exceeds those of position, speed or tracking error is refused.
        motor: Motor of the simulation; default: one without friction.
        believed: The posterior mean of whip and arm, with which the strike is simulated; default: the model. Gravity
            compensation always uses the model.

    Raises:
        InputError: The strike is of another arm.
    """
    controller.check_fits(model.arm)
    options, guards = options or LoopOptions(delay=0.0), guards or Guards()
    loop = CappedLoop(controller, Arm(model), strike, options.caps)
    played = _play(loop, believed or model, motor or Motor(), options)
    trajectory = complete_trajectory(believed or model, controller, strike, States(**played))
    usage = limits.violation(trajectory) + 1.0
    chatter = _chatter(trajectory.tau)
    refused = _verdict(trajectory, usage, chatter, options, limits, guards, model.arm)
    return Rehearsal(trajectory, usage, chatter, refused)


def _play(loop: CappedLoop, truth: Model, motor: Motor, options: LoopOptions) -> dict[str, Any]:
    """Return times, states and torques of every cycle of a loop on the twin's physics, and whether they diverged."""
    strike, period = loop.strike, 1.0 / options.rate
    twin = TwinOptions(truth, motor, start=strike.q_i, period=period, command_delay=options.delay, fineness=1)
    physics = Physics(twin)
    servos = physics.servos
    for servo in servos:
        servo.set("operating_mode", CURRENT_MODE)
        servo.set("torque_enable", 1)
    units = servos[0].units
    scale, most = motor.torque_constant * units.current, servos[0].get("current_limit")
    cycles = int(np.ceil((strike.D + options.t_stay) / period - 1e-9))
    t, rows_q, rows_v, rows_tau = [], [], [], []
    diverged = False
    for k in range(cycles):
        # what the loop sees: counts
        q = np.array([(servo.get("present_position") - 2048) * units.position for servo in servos])
        v = np.array([servo.get("present_velocity") * units.velocity for servo in servos])
        tau = loop.torque(k * period, q, v)
        t.append(k * period)
        rows_q.append(physics.data.qpos.copy())
        rows_v.append(physics.data.qvel.copy())
        rows_tau.append(tau)
        diverged = not physics.data.qvel @ physics.data.qvel < FASTEST**2 or not np.isfinite(tau).all()
        if diverged:
            break
        for servo, x in zip(servos, np.clip(np.rint(tau / scale), -most, most), strict=True):
            servo.set("goal_current", int(x))
        try:
            physics.advance_to((k + 1) * period)
        except (ValueError, OverflowError):  # not a number, or none that a register could be rounded to
            diverged = True
            break
    rows = {"q": rows_q, "v": rows_v, "tau": rows_tau}
    return {"t": np.array(t), **{name: np.array(x) for name, x in rows.items()}, "diverged": diverged}


def _chatter(tau: np.ndarray) -> float:
    """Second difference over value, root mean squares, of the worst joint; about 4 at the loop's own frequency."""
    if len(tau) < 3:
        return 0.0
    rough = np.sqrt((np.diff(tau, n=2, axis=0) ** 2).mean(axis=0))
    return float((rough / np.maximum(np.sqrt((tau**2).mean(axis=0)), 1e-9)).max())


def _verdict(
    path: Trajectory,
    usage: float,
    chatter: float,
    options: LoopOptions,
    limits: MotorLimits,
    guards: Guards,
    arm: AnyArm,
) -> str | None:
    a, cure = arm.n, "cap K and B, raise the rate, or take a slower strike"
    if path.diverged or chatter > CHATTER:
        return f"the controller is unstable at {options.rate:g} Hz (its torque alternates from cycle to cycle); {cure}"
    for end, i in (("start", 0), ("end", -1)):
        v, tau = path.v[i, :a], path.tau[i]
        if np.abs(v).max() < STILL and limits.usage(v, tau).max() > 1.0 - options.margin:
            asked = ", ".join(f"{joint} {abs(x):.2f} N m" for joint, x in zip(arm.joints, tau, strict=True))
            cure = f"{end} elsewhere, or take a lighter whip or arm"
            return f"the {limits.name} cannot hold the {end} posture, which takes {asked}; {cure}"
    if usage > 1.0 - options.margin:
        kept, worst = f"{options.margin:.0%} kept free", limits.explain(path, arm.joints)
        return f"it asks more than the motors give, with {kept}: {worst}; lengthen D or shorten the movement"
    speed = np.abs(path.v[:, :a]).max()
    if speed > guards.speed:
        return f"a joint reaches {speed:.2f} rad/s, and at most {guards.speed:.2f} rad/s are allowed; lengthen D"
    error = np.abs(path.q_d - path.q[:, :a]).max()
    if error > guards.tracking:
        most = f"at most {guards.tracking:.2f} rad are allowed"
        return f"a joint lags {error:.2f} rad behind its reference, and {most}; lengthen D"
    low, high = np.asarray(guards.low), np.asarray(guards.high)
    if (path.q[:, :a] < low).any() or (path.q[:, :a] > high).any():
        return f"a joint leaves the allowed range from {guards.low} to {guards.high} rad"
    return None
