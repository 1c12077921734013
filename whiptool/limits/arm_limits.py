"""Limits of an arm's joints: position, velocity, acceleration, jerk, torque and rate of torque."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from whiptool.errors import InputError
from whiptool.limits.limits import ROUNDING, CommandLimits, Limits
from whiptool.models.parameters import AnyArm
from whiptool.models.spatial_arm import JointLimits, limit_unit
from whiptool.models.trajectory import Approach, Trajectory

PERIOD = 1e-3  # [s] from one torque command to the next, of robots that limit its change (Franka's interface)


def torque_rates(t: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rates of change of torques over intervals of 1 ms.

    Args:
        t: Times [s], (T,), increasing.
        tau: Torques of the arm's a joints [N m], (T, a), interpolated linearly.

    Returns:
        Times at the end of each millisecond (S,) [s], and rates (S, a) [N m/s]; S is 0 for a strike shorter than 1 ms.
    """
    at = t[0] + PERIOD * np.arange(int((t[-1] - t[0]) / PERIOD + 1e-9) + 1)
    sampled = np.stack([np.interp(at, t, each) for each in tau.T], axis=1)
    return at[1:], np.diff(sampled, axis=0) / PERIOD


FOLLOWED, PRESCRIBED = 0.9, 1.0 - ROUNDING  # shares of the velocities that searches command
_NAMES = ("position", "velocity", "torque")


def _limited(joints: Sequence[JointLimits]) -> bool:
    """Whether any joint has a limit."""
    return any(joint != JointLimits() for joint in joints)


@dataclass(frozen=True)
class ArmLimits(Limits):
    """Limits of each joint of an arm.

    Position, velocity and torque are checked on the simulated motion; acceleration and jerk on the commanded path, for
    which manufacturers state them; the rate of change of torque (`torque_rates`) on the whole trajectory, only for
    strikes that would be hits or the best.

    Args:
        joints: Limits of each joint; see `JointLimits`.
        words: Description of the limits.
        share: Fraction of the velocity limits that searches command; below 1 if the joints only approximately follow
            the command.
        slides: Indices of the prismatic joints, from 0; the others are revolute.

    Raises:
        InputError: No joint has a limit.
    """

    joints: tuple[JointLimits, ...]
    words: str = "the arm's limits"
    share: float = FOLLOWED
    slides: tuple[int, ...] = ()

    judges: ClassVar[str] = "joint"
    by_peaks: ClassVar[bool] = True  # each limit is of one quantity

    def __post_init__(self) -> None:
        if not _limited(self.joints):
            raise InputError("limits", "none", "an arm whose joints have limits")

    @classmethod
    def of(cls, arm: AnyArm, *, keep_free: float = 0.0, prescribed: bool = False) -> ArmLimits:
        """Return the limits of an arm.

        Args:
            arm: Arm whose joints have limits.
            keep_free: Fraction of every limit that must remain unused.
            prescribed: Whether joints move exactly as commanded (position control).

        Raises:
            InputError: The arm has no limits, such as a planar arm; or `keep_free` is not in [0, 1).
        """
        joints = tuple(joint.keeping_free(keep_free) for joint in arm.joint_limits)
        words = "the arm's limits" + (f", {keep_free:.0%} of them kept free" if keep_free else "")
        slides = tuple(np.flatnonzero(~arm.turns).tolist())
        return cls(joints, words, PRESCRIBED if prescribed else FOLLOWED, slides)

    @staticmethod
    def are_in(arm: AnyArm) -> bool:
        """Whether an arm has any limits."""
        return _limited(arm.joint_limits)

    @property
    def command(self) -> CommandLimits:
        """Limits of the commanded path, for searches and checks."""
        return CommandLimits(self.joints, self.share, self.slides)

    @property
    def smooth(self) -> tuple[CommandLimits, ...]:
        return (self.command,)

    @property
    def positions(self) -> np.ndarray:
        """Lowest and highest position of each joint [rad or m], (2, a); infinite without a limit."""
        return np.array([joint.position for joint in self.joints]).T

    @property
    def of_candidates(self) -> bool:
        """Whether a joint has a limit on its torque rate, which peak values do not show.

        A strike that would be a hit or the best is then checked over its whole trajectory.
        """
        return any(math.isfinite(joint.torque_rate) for joint in self.joints)

    def usage(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the fraction of each limit that states use: above 1 they exceed it; 0 without a limit.

        Args:
            q, v, tau: Positions, velocities and torques, (..., a).

        Returns:
            Usage of position, velocity and torque, (..., 3, a). It is 0 for a position in the middle of its range; if a
            range has only one end, each radian or metre beyond it counts as 1.
        """
        low, high = np.array([joint.position for joint in self.joints]).T
        velocity, torque = (
            np.array([getattr(joint, name) for joint in self.joints]) for name in ("velocity", "torque")
        )
        half = np.where(np.isfinite(high - low), (high - low) / 2, 1.0)
        beyond = np.maximum(low - q, q - high) / half  # -inf where there is no end
        return np.stack([np.maximum(1 + beyond, 0), np.abs(v) / velocity, np.abs(tau) / torque], axis=-2)

    def violation(self, trajectory: Trajectory) -> float:
        """Return the largest relative excess of a trajectory over a limit; at most 0 within all limits."""
        if trajectory.diverged:
            return math.inf
        worst = max(self._usage_of(trajectory).max(), self._rate_usage_of(trajectory)[1].max())
        return float(worst) - 1.0

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        """Return the excess over the limits from the peak values of each joint, which suffice since each limit concerns
        one quantity.

        Returns:
            One number per strike, (B,) for an `Approach`; infinite if positions are limited but unknown.
        """
        v, tau = np.asarray(near.max_joint_speed), np.asarray(near.max_torque)
        positions = near.positions
        if positions is None:
            unlimited = not np.isfinite([joint.position for joint in self.joints]).any()
            positions = np.full((*v.shape[:-1], 2, v.shape[-1]), 0.0 if unlimited else np.nan)
        at_both = (positions, *(np.stack([x, x], axis=-2) for x in (v, tau)))  # the lowest and the highest, (B, 2, a)
        worst = self.usage(*at_both).max(axis=(-3, -2, -1)) - 1.0
        return np.where(np.asarray(near.diverged) | ~np.isfinite(worst), np.inf, worst)

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> str:
        """Return a description of the instant at which a trajectory uses a limit most."""
        usage = self._usage_of(trajectory)
        t, of_rates, rates = self._rate_usage_of(trajectory)
        if of_rates.max() > usage.max():
            i, j = (int(x) for x in np.unravel_index(of_rates.argmax(), of_rates.shape))
            unit, effort = limit_unit("torque_rate", slides=j in self.slides), self._effort(j)
            rate = f"{rates[i, j]:+.0f} {unit}; its limit is {self.joints[j].torque_rate:.0f} {unit}"
            return f"at {t[i]:.3f} s the {effort} of {joints[j]} changes by {rate}"
        i, what, j = (int(x) for x in np.unravel_index(usage.argmax(), usage.shape))
        value = (trajectory.q, trajectory.v, trajectory.tau)[what][i, j]
        limit, unit = getattr(self.joints[j], _NAMES[what]), limit_unit(_NAMES[what], slides=j in self.slides)
        quantity = ("position", "velocity", self._effort(j))[what]
        allowed = f"{limit[0]:.2f} to {limit[1]:.2f} {unit}" if what == 0 else f"{limit:.2f} {unit}"
        return (
            f"at {trajectory.t[i]:.3f} s the {quantity} of {joints[j]} is {value:+.2f} {unit}; its limit is {allowed}"
        )

    def _effort(self, joint: int) -> str:
        return "force" if joint in self.slides else "torque"

    def _usage_of(self, trajectory: Trajectory) -> np.ndarray:
        a = trajectory.tau.shape[1]
        return self.usage(trajectory.q[:, :a], trajectory.v[:, :a], trajectory.tau)

    def _rate_usage_of(self, trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (S,), what changes of torques use of their limits, and the changes [N m/s or N/s], (S, a)."""
        t, rates = torque_rates(trajectory.t, trajectory.tau) if self.of_candidates else _NO_RATES
        if not len(t):
            return np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1))
        return t, np.abs(rates) / np.array([joint.torque_rate for joint in self.joints]), rates


_NO_RATES = np.zeros(0), np.zeros((0, 1))
