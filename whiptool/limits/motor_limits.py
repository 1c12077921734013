"""Limits of a motor: the line from stall torque to no-load speed, and the usage of it by a strike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from whiptool.errors import expect
from whiptool.extras import Registry
from whiptool.limits.limits import Limits
from whiptool.models.numbers import NoArray, number
from whiptool.models.spatial_arm import kept_free
from whiptool.models.trajectory import Approach, Trajectory


@dataclass(frozen=True)
class MotorLimits(NoArray, Limits, instead="its numbers by name"):
    """The speed-torque line of a motor at its supply voltage.

    When driving at speed w, a motor gives at most `stall_torque (1 - w / no_load_speed)`; when braking, at most its
    stall torque, by its current limit.

    Args:
        name: Name of the motor.
        stall_torque: Stall torque [N m].
        no_load_speed: No-load speed [rad/s].
        stall_current: Stall current [A].

    Raises:
        InputError: A number is not positive.
    """

    name: str
    stall_torque: float
    no_load_speed: float
    stall_current: float

    judges: ClassVar[str] = "motor"
    by_peaks: ClassVar[bool] = False  # the line joins speed and torque, whose peaks need not come at once

    def __post_init__(self) -> None:
        expect(str, name=self.name)
        for name in ("stall_torque", "no_load_speed", "stall_current"):
            number(name, getattr(self, name), low=0, strict=True)

    def keeping_free(self, share: float) -> MotorLimits:
        """Return the limits reduced by a fraction that must remain unused.

        Raises:
            InputError: The fraction is not in [0, 1).
        """
        left = 1.0 - kept_free(share)
        scaled = {name: left * getattr(self, name) for name in ("stall_torque", "no_load_speed", "stall_current")}
        return replace(self, **scaled)

    @property
    def words(self) -> str:
        return f"the {self.name}'s speed-torque line"

    @property
    def torque_constant(self) -> float:
        """Torque at the output per current [N m/A]."""
        return self.stall_torque / self.stall_current

    def available(self, v: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return the largest torque [N m] in a direction (+1, -1) at speeds v [rad/s]; negative beyond the no-load
        speed.
        """
        return self.stall_torque * np.minimum(1.0, 1.0 - v * direction / self.no_load_speed)

    def usage(self, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the usage of a motor's limits at speeds v [rad/s] and torques tau [N m], in their shape: 1 is on the
        speed-torque line, more exceeds it.

        It is `|tau| / stall_torque + (speed in the torque's direction, if any) / no_load_speed`, and at least `|v| /
        no_load_speed`, because beyond the no-load speed a motor cannot be controlled.
        """
        driving = np.maximum(v * np.sign(tau), 0.0) / self.no_load_speed
        return np.maximum(np.abs(tau) / self.stall_torque + driving, np.abs(v) / self.no_load_speed)

    def violation(self, trajectory: Trajectory) -> float:
        """Return the excess of the worst instant of a trajectory over the line, relative to it; at most 0 within the
        limits.
        """
        if trajectory.diverged:
            return math.inf
        a = trajectory.tau.shape[1]
        return float(self.usage(trajectory.v[:, :a], trajectory.tau).max()) - 1.0

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return the excess computed from the largest speed and the largest torque, which may occur at different
        instants.

        This is an upper bound of `violation`, used as a constraint of searches.

        Returns:
            One number per strike: shape () for an Outcome, (B,) for an Approach.
        """
        v, tau = np.asarray(near.max_joint_speed), np.asarray(near.max_torque)
        worst = np.max(tau / self.stall_torque + v / self.no_load_speed, axis=-1) - 1.0
        return np.where(np.asarray(near.diverged) | ~np.isfinite(worst), np.inf, worst)

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> str:
        """Return a description of the instant at which a trajectory uses the motors most."""
        a = trajectory.tau.shape[1]
        v, tau = trajectory.v[:, :a], trajectory.tau
        i, j = (int(x) for x in np.unravel_index(self.usage(v, tau).argmax(), tau.shape))
        left = float(self.available(v[i, j], np.sign(tau[i, j])))
        return (
            f"at {trajectory.t[i]:.3f} s the {joints[j]} turns at {v[i, j]:+.2f} rad/s "
            f"and asks for {tau[i, j]:+.2f} N m, where the {self.name} gives {max(left, 0.0):.2f} N m"
        )


# XM430-W350 at 12 V, from https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/: 4.1 N m at 2.3 A, 46 rev/min
XM430 = MotorLimits("XM430-W350", stall_torque=4.1, no_load_speed=46 * 2 * math.pi / 60, stall_current=2.3)
LIMITS: Registry[MotorLimits] = Registry("limits", MotorLimits, {"xm430": XM430})


def limits_preset(name: str) -> MotorLimits:
    """Return the limits of the motor called `name`.

    Raises:
        InputError: No motor has that name; the message lists the motors.
    """
    expect(str, name=name)
    return LIMITS.find(name)
