"""Limits of an arm's joints: position, velocity, acceleration, jerk, torque and rate of torque."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.extras import Registry
from whiptool.limits.limits import ROUNDING, CommandLimits, Limits
from whiptool.models.excess import Excess
from whiptool.models.numbers import NoArray, number
from whiptool.models.parameters import AnyArm
from whiptool.models.spatial_arm import JointLimits, kept_free, limit_unit
from whiptool.models.trajectory import Approach, Trajectory

PERIOD = 1e-3  # [s] from one torque command to the next, of robots that limit its change (Franka's interface)


def torque_rates(t: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of intervals of 1 ms [s], (S,), and the rates of change over them [N m/s], (S, a), of torques
    (T, a) [N m] at increasing times (T,) [s], interpolated linearly; S is 0 for a strike shorter than 1 ms.
    """
    at = t[0] + PERIOD * np.arange(int((t[-1] - t[0]) / PERIOD + 1e-9) + 1)
    sampled = np.stack([np.interp(at, t, each) for each in tau.T], axis=1)
    return at[1:], np.diff(sampled, axis=0) / PERIOD


FOLLOWED, PRESCRIBED = 0.9, 1.0 - ROUNDING  # shares of the velocities that searches command
RESTING = 1e-9  # [rad/s or m/s] and less is no velocity
_NAMES = ("position", "velocity", "torque")
_SAID = {"velocity": "speed", "torque": "torque", "position": "position"}  # of `_NAMES`, for people


def _limited(joints: Sequence[JointLimits]) -> bool:
    """Whether any joint has a limit."""
    return any(joint != JointLimits() for joint in joints)


def unlimited(joints: Sequence[JointLimits], names: Sequence[str]) -> dict[str, list[str]]:
    """Return the names of the joints that have no limit of speed, torque or position, by these words."""
    lacking = {
        word: [own for own, joint in zip(names, joints, strict=True) if not np.isfinite(getattr(joint, name)).all()]
        for name, word in _SAID.items()
    }
    return {word: found for word, found in lacking.items() if found}


@dataclass(frozen=True)
class ArmLimits(Limits):
    """Limits of each joint of an arm.

    Position, velocity and torque are checked on the simulated motion; acceleration, jerk and velocities that depend on
    the position on the commanded path, for which manufacturers state them; the latter and the rate of change of torque
    (`torque_rates`) on the whole trajectory, too, but only for strikes that would be hits or the best.

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
            given, rule = "an arm whose joints have no limits", "an arm whose joints have limits"
            raise InputError("limits", given, rule, "give the limits of a motor (xm430), or none")

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
        lacking = [
            f"{word} of {'all joints' if len(names) == arm.n else ', '.join(names)}"
            for word, names in unlimited(joints, arm.joints).items()
        ]
        if lacking:
            words += f" (it has none for the {', the '.join(lacking)}; arm.limits in a model file gives them)"
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
        """Lowest and highest position that each joint reaches [rad or m], (2, a); infinite without a limit."""
        return np.array([joint.reachable for joint in self.joints]).T

    @property
    def of_candidates(self) -> bool:
        """Whether a joint has a limit that peak values do not show: of its torque rate, or of velocity by position.

        A strike that would be a hit or the best is then checked over its whole trajectory.
        """
        return self._of_rates or any(joint.by_position for joint in self.joints)

    @property
    def _of_rates(self) -> bool:
        return any(math.isfinite(joint.torque_rate) for joint in self.joints)

    def usage(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the fraction of each limit that states use: above 1 they exceed it; 0 without a limit.

        Args:
            q, v, tau: Positions [rad or m], velocities [per s] and torques [N m; N for a prismatic joint], (..., a).

        Returns:
            Usage of position, velocity and torque, (..., 3, a). It is 0 for a position in the middle of its range; if a
            range has only one end, each radian or metre beyond it counts as 1.
        """
        low, high = np.array([joint.position for joint in self.joints]).T
        velocity, torque = (np.array([getattr(joint, name) for joint in self.joints]) for name in ("fastest", "torque"))
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
        """Return the excess over the limits from the peak values of each joint, (B,), which suffice since each limit
        concerns one quantity; infinite if positions are limited but unknown.
        """
        v, tau = np.asarray(near.max_joint_speed), np.asarray(near.max_torque)
        positions = near.positions
        if positions is None:
            unlimited = not np.isfinite([joint.position for joint in self.joints]).any()
            positions = np.full((*v.shape[:-1], 2, v.shape[-1]), 0.0 if unlimited else np.nan)
        at_both = (positions, *(np.stack([x, x], axis=-2) for x in (v, tau)))  # the lowest and the highest, (B, 2, a)
        worst = self.usage(*at_both).max(axis=(-3, -2, -1)) - 1.0
        return np.where(np.asarray(near.diverged) | ~np.isfinite(worst), np.inf, worst)

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> Excess:
        """Return a description of the instant at which a trajectory uses a limit most."""
        usage = self._usage_of(trajectory)
        t, of_rates, rates = self._rate_usage_of(trajectory)
        if of_rates.max() > usage.max():
            i, j = (int(x) for x in np.unravel_index(of_rates.argmax(), of_rates.shape))
            unit, effort = limit_unit("torque_rate", slides=j in self.slides), self._effort(j)
            rate = f"{rates[i, j]:+.0f} {unit}; its limit is {self.joints[j].torque_rate:.0f} {unit}"
            return Excess(f"the {effort} of {joints[j]} changes by {rate}", float(t[i]))
        i, what, j = (int(x) for x in np.unravel_index(usage.argmax(), usage.shape))
        value = (trajectory.q, trajectory.v, trajectory.tau)[what][i, j]
        limits, unit = self.joints[j], limit_unit(_NAMES[what], slides=j in self.slides)
        quantity = ("position", "velocity", self._effort(j))[what]
        allowed = f"{limits.torque:.2f} {unit}"
        if what == 0 or (what == 1 and limits.by_position):
            low, high = limits.position if what == 0 else limits.velocities(trajectory.q[i, j])
            allowed = f"{low:.2f} to {high:.2f} {unit}" + " at this position" * what
        elif what == 1:
            allowed = f"{limits.fastest:.2f} {unit}"
        words = f"the {quantity} of {joints[j]} is {value:+.2f} {unit}; its limit is {allowed}"
        return Excess(words, float(trajectory.t[i]))

    def _effort(self, joint: int) -> str:
        return "force" if joint in self.slides else "torque"

    def _usage_of(self, trajectory: Trajectory) -> np.ndarray:
        """Usage of position, velocity and torque, (T, 3, a); here velocities are judged by the position, too."""
        a = trajectory.tau.shape[1]
        q, v = trajectory.q[:, :a], trajectory.v[:, :a]
        used = self.usage(q, v, trajectory.tau)
        for j, joint in enumerate(self.joints):
            if joint.by_position:
                lowest, highest = joint.velocities(q[:, j])
                speed, bound = np.abs(v[:, j]), np.where(v[:, j] < 0, -lowest, highest)
                within = np.minimum(speed / np.maximum(bound, RESTING), 1.0)
                used[:, 1, j] = np.where(speed <= bound + RESTING, within, 1 + (speed - bound) / joint.fastest)
        return used

    def _rate_usage_of(self, trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (S,), what changes of torques use of their limits, and the changes [N m/s or N/s], (S, a)."""
        t, rates = torque_rates(trajectory.t, trajectory.tau) if self._of_rates else _NO_RATES
        if not len(t):
            return np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1))
        return t, np.abs(rates) / np.array([joint.torque_rate for joint in self.joints]), rates


_NO_RATES = np.zeros(0), np.zeros((0, 1))


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

    def explain(self, trajectory: Trajectory, joints: Sequence[str]) -> Excess:
        """Return a description of the instant at which a trajectory uses the motors most."""
        a = trajectory.tau.shape[1]
        v, tau = trajectory.v[:, :a], trajectory.tau
        i, j = (int(x) for x in np.unravel_index(self.usage(v, tau).argmax(), tau.shape))
        left = float(self.available(v[i, j], np.sign(tau[i, j])))
        words = (
            f"the {joints[j]} turns at {v[i, j]:+.2f} rad/s and asks for {tau[i, j]:+.2f} N m, where the {self.name} "
            f"gives {max(left, 0.0):.2f} N m"
        )
        return Excess(words, float(trajectory.t[i]))


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
