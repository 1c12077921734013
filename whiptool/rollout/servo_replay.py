"""A joint trajectory played by MuJoCo's position servos: what a robot would make of an exported strike."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BPoly

from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.impedance.position import PositionControl
from whiptool.models.joint_trajectory import RATE, JointTrajectory
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.reference import ReferenceRollout
from whiptool.rollout.trajectory import Trajectory

BANDWIDTH = 30.0  # [Hz], of the servos


def replay_trajectory(
    model: Model, trajectory: JointTrajectory, *, rate: float = RATE, bandwidth: float = BANDWIDTH
) -> Trajectory:
    """Return what arm and whip do while servos follow a joint trajectory, at every step of MuJoCo.

    Each joint has a critically damped servo with MuJoCo's law, kp (u - q) - kv v. Its set point u, which is held for a
    period of the servos, is where the trajectory is in the middle of that period, ahead by what servos of this bandwidth
    lag behind its velocity and acceleration. The whip hangs still at the beginning.

    Args:
        model: Arm and whip.
        trajectory: Of the arm's joints, by their names.
        rate: Set points a second [1/s].
        bandwidth: Of the servos [Hz].

    Raises:
        InputError: The trajectory is of other joints, or a number is out of range.
    """
    if trajectory.joints != model.arm.joints:
        raise InputError("trajectory of the joints", trajectory.joints, f"one of {', '.join(model.arm.joints)}")
    period = 1 / number("rate", rate, low=1)
    fastest = 2 * math.pi * number("bandwidth", bandwidth, low=0, strict=True)
    rollout, path = ReferenceRollout(model, Controller(PositionControl())), _smooth(trajectory)
    rollout.use_servos(np.array([trajectory.q[0]]), fastest)

    def set_point(t: float) -> np.ndarray:
        middle = min((math.floor(t / period + 1e-9) + 0.5) * period, float(trajectory.t[-1]))
        return path(middle) + 2 / fastest * path(middle, 1) + path(middle, 2) / fastest**2

    return rollout.play(set_point, trajectory)


def _smooth(trajectory: JointTrajectory) -> BPoly:
    """The quintic through positions, velocities and accelerations at all instants."""
    return BPoly.from_derivatives(trajectory.t, np.stack([trajectory.q, trajectory.v, trajectory.a], axis=1))
