"""Replay of a joint trajectory with MuJoCo's position servos, as a model of a robot that runs an exported strike."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BPoly

from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.parameters import Model
from whiptool.models.strike import check_turns
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.interface import FASTEST
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.reference import ReferenceRollout, control_callback

BANDWIDTH = 30.0  # [Hz], natural frequency of the servos
ROTOR = 0.1  # [kg m2], inertia of a geared motor seen at its joint, as MuJoCo Menagerie has it for the UR5e


def replay_trajectory(model: Model, trajectory: JointTrajectory) -> Trajectory:
    """Return the motion of arm and whip while position servos follow a joint trajectory, at every step of MuJoCo.

    Each joint has a servo with MuJoCo's law, kp (u - q) - kv v, critically damped for its inertia at the start. That
    inertia includes a geared motor's, without which a servo could not hold a light wrist against the whip. The
    servos compensate gravity and centrifugal forces. Between the trajectory's samples they follow the quintic through
    positions, velocities and accelerations; the set point u leads by the servos' lag. The whip hangs at rest at the
    beginning.

    Args:
        model: Model of arm and whip.
        trajectory: Trajectory of the arm's joints, in their order.

    Raises:
        InputError: The trajectory has other joints.
    """
    named = zip(trajectory.joints, model.arm.names, strict=False)
    prefixed = len(trajectory.joints) == model.arm.n and all(given.endswith(own) for given, own in named)
    if trajectory.joints != model.arm.joints and not prefixed:
        rule = f"those of the arm of {model.name}, with any prefix: {', '.join(model.arm.names)}"
        raise InputError("joints of the trajectory", trajectory.joints, rule)
    check_turns("trajectory", trajectory.q, model.arm)
    omega = 2 * math.pi * BANDWIDTH
    rollout, path = ReferenceRollout(model, Controller(PositionControl())), _smooth(trajectory)
    data, mj, a = rollout.hang(trajectory.q[0]), rollout.mj, model.arm.n
    _fit_servos(mj, data, omega, a)
    end, steps = float(trajectory.t[-1]), math.ceil(trajectory.t[-1] / rollout.timestep - 1e-9)
    t = np.minimum(np.arange(steps + 1) * rollout.timestep, end)
    half = rollout.timestep / 2  # a step of Runge and Kutta's also asks at its middle
    at = np.minimum(np.arange(2 * steps + 3) * half, end)
    set_points = path(at) + 2 / omega * path(at, 1) + path(at, 2) / omega**2  # as far ahead as the servos lag behind
    q, v = np.empty((2, steps + 1, model.coordinates))
    tau, (tip, velocity) = np.empty((steps + 1, a)), np.empty((2, steps + 1, model.dimension))

    def act(_: mujoco.MjModel, acting: mujoco.MjData) -> None:
        if acting._address != own:  # the callback is one per process: leave other simulations alone
            return
        data.ctrl[:] = set_points[round(data.time / half)] + acting.qfrc_bias[:a] / mj.actuator_gainprm[:, 0]
        if rollout.has_forces:
            rollout.apply_forces(data)

    own, i, mj.opt.timestep = data._address, 0, rollout.timestep
    with control_callback(act) as gave_up:
        for i in range(steps + 1):
            mujoco.mj_forward(mj, data)
            (q[i], v[i]), (tip[i], velocity[i]) = rollout.coordinates(), rollout.tip()
            tau[i] = data.actuator_force
            if gave_up or not data.qvel @ data.qvel < FASTEST**2 or i == steps:
                break
            mujoco.mj_step(mj, data)
    done, none = slice(i + 1), np.zeros((i + 1, a, a))
    wanted = path(t[done]), path(t[done], 1)
    diverged = i < steps
    arm, moved, names = (tau[done], none, none), (tip[done], velocity[done]), model.coordinate_names
    return Trajectory(t[done], q[done], v[done], *wanted, *arm, *moved, diverged, names)


def _smooth(trajectory: JointTrajectory) -> BPoly:
    """Return the quintic through positions, velocities and accelerations at all instants."""
    return BPoly.from_derivatives(trajectory.t, np.stack([trajectory.q, trajectory.v, trajectory.a], axis=1))


def _fit_servos(mj: mujoco.MjModel, data: mujoco.MjData, omega: float, a: int) -> None:
    """Make the arm's motors geared position servos of a natural frequency [rad/s], critically damped."""
    mj.dof_armature[:a] += ROTOR
    mujoco.mj_forward(mj, data)
    M = np.empty((mj.nv, mj.nv))
    mujoco.mj_fullM(mj, data, M)
    inertia = np.diag(M)[:a]
    mj.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
    mj.actuator_gainprm[:, 0] = inertia * omega**2
    mj.actuator_biasprm[:, 1], mj.actuator_biasprm[:, 2] = -inertia * omega**2, -2 * inertia * omega
