"""Movements of joints that keep limits of velocity, acceleration and jerk: between two postures, and to a stop.

The profiles are time-optimal (Berscheid and Kroeger, "Jerk-limited Real-time Trajectory Generation with Arbitrary
Target States", RSS 2021), computed by `ruckig`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Synchronization, Trajectory

from whiptool.errors import InputError
from whiptool.models.numbers import number, numbers
from whiptool.models.spatial_arm import JointLimits

GENTLE = 0.2  # share of the joints' limits that the way to a strike's start uses
SPEED, ACCELERATION, JERK = 1.0, 2.0, 20.0  # of that way at most [rad/s, rad/s^2, rad/s^3; m for prismatic joints]
LONGEST_SWAY = 10.0  # [s]
BRAKING, BRAKING_JERK = 10.0, 500.0  # of a stop, where a joint has no such limit [rad/s^2, rad/s^3; m if prismatic]

_SLOWER, _SLOWEST = 10, 20  # times that a movement is slowed down by velocity limits of positions, and by how much

Path: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]  # positions, velocities, accelerations, (T, n) each


def path_between(
    q_from: Sequence[float] | np.ndarray,
    q_to: Sequence[float] | np.ndarray,
    limits: Sequence[JointLimits],
    rate: float,
    *,
    share: float = GENTLE,
    sway: float = 0.0,
) -> Path:
    """Return positions, velocities and accelerations, (T, n) each, at k / `rate` of the fastest movement from rest to
    rest along the straight line between two postures (n,) [rad or m]; one sample if these are equal.

    No joint exceeds `share`, in (0, 1], of its limits, nor 1 rad/s, 2 rad/s^2 or 20 rad/s^3 (of a prismatic joint m
    instead of rad); where a limit of velocity depends on the position, all joints are slowed down until it is kept.
    They begin and end together, at a sample; the last sample is at rest at `q_to`.

    `sway` is the period [s] in which what the arm carries swings, such as a hanging whip. The arm speeds up and slows
    down over one period each, after which hardly a swing is left; 0: as fast as the limits allow.
    """
    start = np.array(numbers("start posture", tuple(q_from)))
    end = np.array(numbers("end posture", tuple(q_to), len(start)))
    span = end - start
    step, share = 1 / number("rate", rate, low=1), _share(share)
    allowed = [
        (min(share * x.fastest, SPEED), min(share * x.acceleration, ACCELERATION), min(share * x.jerk, JERK))
        for x in _of_joints(limits, len(start))
    ]
    if not span.any():
        return start[None], np.zeros((1, len(start))), np.zeros((1, len(start)))
    moving = span != 0
    most = (np.array(allowed)[moving] / np.abs(span[moving])[:, None]).min(axis=0)  # of the covered fraction of the way
    if number("sway", sway, low=0, high=LONGEST_SWAY):
        most = _without_swing(most, sway)
    profile = _planned(((0.0,), (0.0,), (0.0,)), most, to=1.0)
    T = math.ceil(profile.duration / step - 1e-9)
    for _ in range(_SLOWER):
        slower = profile.duration / (T * step)  # a whole number of steps, so that the end is a sample
        s, v, a = _sampled(profile, np.arange(T + 1) * step * slower)
        q, v, a = start + s * span, slower * v * span, slower**2 * a * span
        excess = _too_fast(q, v, limits)
        if excess <= 1 or excess > _SLOWEST:  # more than that: it begins or ends where no velocity is allowed
            break
        T = math.ceil(1.001 * T * min(excess, 2.0))
    q[-1], v[-1], a[-1] = end, 0.0, 0.0
    return q, v, a


def _too_fast(q: np.ndarray, v: np.ndarray, limits: Sequence[JointLimits]) -> float:
    """The largest ratio of velocities to limits that depend on the position; 0 without these."""
    excess = 0.0
    for j, joint in enumerate(limits):
        if joint.by_position:
            lowest, highest = joint.velocities(q[:, j])
            allowed = np.where(v[:, j] < 0, -lowest, highest)
            excess = max(excess, float((np.abs(v[:, j]) / np.maximum(allowed, 1e-9)).max()))
    return excess


def path_to_rest(
    q: Sequence[float] | np.ndarray,
    v: Sequence[float] | np.ndarray,
    a: Sequence[float] | np.ndarray,
    limits: Sequence[JointLimits],
    rate: float,
    *,
    share: float = 1.0,
) -> Path:
    """Return positions, velocities and accelerations, (T, n) each, at k / `rate` of the fastest stop from a motion q
    [rad or m], v and a [per s, s^2], (n,) each; the first sample is this motion. Each joint brakes on its own.

    Joints use `share`, in (0, 1], of their limits of acceleration and jerk; where one is missing, 10 rad/s^2 or 500
    rad/s^3 is taken (of a prismatic joint m instead of rad). A joint that is beyond a limit at the beginning returns
    within it as fast as its other limits allow. Limits of position are not considered: a joint that is too near to one
    to brake passes it.
    """
    n = len(start := numbers("positions", tuple(q)))
    now = (start, numbers("velocities", tuple(v), n), numbers("accelerations", tuple(a), n))
    step, share = 1 / number("rate", rate, low=1), _share(share)
    joints = _of_joints(limits, n)
    braking = [share * (x.acceleration if math.isfinite(x.acceleration) else BRAKING) for x in joints]
    jerk = [share * (x.jerk if math.isfinite(x.jerk) else BRAKING_JERK) for x in joints]
    profile = _planned(now, np.array([[math.inf] * n, braking, jerk]))
    T = math.ceil(profile.duration / step - 1e-9)
    positions, velocities, accelerations = _sampled(profile, np.arange(T + 1) * step)
    velocities[-1], accelerations[-1] = 0.0, 0.0
    return positions, velocities, accelerations


def _without_swing(most: np.ndarray, period: float) -> np.ndarray:
    """Return limits (3,) with which a way of length 1 has phases of acceleration and deceleration of one period each.

    A constant acceleration that lasts for a whole period of an undamped pendulum leaves it at rest: its Fourier
    transform is zero at the pendulum's frequency. The rounding by the jerk does not change that.
    """
    velocity, acceleration, jerk = most
    v = min(velocity, acceleration * period, 1 / period)
    v = min(v, 1 / (period + v / period / jerk))  # short of which the two phases would overlap
    return np.array([v, v / period, jerk])


def _planned(now: Sequence[tuple[float, ...]], most: np.ndarray, *, to: float | None = None) -> Trajectory:
    """Return the profile from a state (positions, velocities, accelerations) to rest, at the position `to` of the only
    coordinate or, for None, anywhere; `most` are largest velocity, acceleration, jerk, (3,) or (3, n).
    """
    n = len(now[0])
    wanted, profile = InputParameter(n), Trajectory(n)
    wanted.current_position, wanted.current_velocity, wanted.current_acceleration = map(list, now)
    highest = np.minimum(most, 1e9).reshape(3, -1).tolist()
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = highest
    if to is None:
        wanted.control_interface, wanted.synchronization = ControlInterface.Velocity, Synchronization.No
    else:
        wanted.target_position = [to]
    result = Ruckig(n).calculate(wanted, profile)
    if result not in (Result.Working, Result.Finished):
        raise InputError("movement", now, "a state from which ruckig finds a movement within the limits", str(result))
    return profile


def _sampled(profile: Trajectory, t: np.ndarray) -> Path:
    """Positions, velocities and accelerations of a profile at times (T,), (T, n) each."""
    q, v, a = np.array([profile.at_time(x) for x in t.tolist()]).transpose(1, 0, 2)
    return q, v, a


def _of_joints(limits: Sequence[JointLimits], n: int) -> Sequence[JointLimits]:
    joints = limits or [JointLimits()] * n
    if len(joints) != n:
        raise InputError("limits", f"those of {len(joints)} joints", f"the limits of {n} joints")
    return joints


def _share(share: float) -> float:
    return number("share", share, low=0, high=1, strict=True)
