"""The trajectory that a robot is given for a strike: from where it stands, without leaving the whip swinging."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from whiptool.dynamics.modes import hanging_modes
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.limits.all_limits import AllLimits, limits_given
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Limits
from whiptool.models.joint_trajectory import RATE, REST, JointTrajectory
from whiptool.models.parameters import Model
from whiptool.models.smooth_path import LONGEST_SWAY
from whiptool.models.strike import Strike, StrikePath
from whiptool.rollout.compiled import CompiledRollout

LIFTED = (
    "raise the arm by hand until stick and whip hang clear, give the base its height above the floor (mount pedestal "
    "HEIGHT) if it has one, or choose another target"
)
_MODELS = 4  # models whose simulator and slowest swing are kept: a planner judges many strikes of one
WAY = 0.1  # [s] between the instants of the way at which the hanging whip is looked at


@dataclass(frozen=True, kw_only=True)
class Execution:
    """How a robot makes a strike."""

    posture: tuple[float, ...] | None = None  # present joint positions [rad or m], (n,); None: the strike's start
    rate: float | None = None  # samples per second [1/s]; None: the robot controller's, or 500 where unknown
    rest: float = REST  # time at rest before the strike [s]
    prefix: str = ""  # what the robot's controller has before each joint's name, such as `left_`

    def refused_posture(self, model: Model, limits: Sequence[Limits]) -> str | None:
        """Return why no strike is possible from the robot's present posture, in which the arm without its whip is too
        close to itself or the floor; None: it is not, or the posture is not known.
        """
        if self.posture is None or len(self.posture) != model.arm.n:
            return None
        q = np.array([self.posture])
        found = (x.beyond_on_way(np.zeros(1), q) for x in limits if isinstance(x, Clearance))
        beyond = next((one for one in found if one is not None), None)
        return None if beyond is None else f"where the robot stands {beyond.words}: move it by hand to another posture"

    def of_strike(
        self, model: Model, strike: StrikePath, t_stay: float, limits: Sequence[Limits] = ()
    ) -> tuple[JointTrajectory, str | None]:
        """Return the trajectory of a strike and `t_stay` [s] after it, and a description of what it exceeds; None:
        nothing.

        It exceeds a limit of the model's arm or a further one, on it the arm comes too close to itself or the floor, or
        on the way to the strike's start the hanging whip does to the floor; the motion of the whip in the strike is not
        checked. The model of an unknown whip is its posterior mean.
        """
        arm = model.arm
        joints = next((x.joints for x in limits if isinstance(x, ArmLimits)), arm.joint_limits)
        found = JointTrajectory.of_strike(
            strike,
            [self.prefix + name for name in arm.names],
            start=self.posture,
            limits=joints,
            rate=self.rate or arm.rate or RATE,
            rest=self.rest,
            t_stay=t_stay,
            sway=0.0 if self.posture is None else swing_period(model),
        )
        begins = beginning(strike, found, t_stay)
        beyond = found.beyond(joints, slides=[joint in arm.slides for joint in arm.joints])
        if beyond is None and (said := self.refused_posture(model, limits)):
            return found, said
        clearances = [x for x in limits if isinstance(x, Clearance)]
        of_arm = (x.beyond_on_way(found.t, found.q) for x in clearances)
        beyond = beyond or next((one for one in of_arm if one is not None), None)
        if beyond is not None:
            return found, beyond.by_parts(begins)
        way = found.t <= (begins if self.posture is not None else 0.0)
        way = np.flatnonzero(way)[:: max(1, round(WAY / float(found.t[1])))]
        of_whip = (x.whip_on_way(found.t[way], found.q[way], model) for x in clearances)
        low = next((one for one in of_whip if one is not None), None)
        cure = "" if self.posture is None else f"; {LIFTED}"
        return found, None if low is None else low.by_parts(begins) + cure

    def judged(
        self, model: Model, strike: Strike, t_stay: float, limits: Sequence[Limits]
    ) -> tuple[JointTrajectory, str | None]:
        """Return the trajectory of a strike and a description of what it exceeds as `of_strike` does, and judge the
        simulated strike, too.
        """
        found, said = self.of_strike(model, strike, t_stay, limits)
        if said is None and limits:
            path = _followed(model).trajectory(strike, t_stay=t_stay)
            if path.diverged:
                return found, "the simulation diverged"
            kept = AllLimits(limits_given(limits, model, prescribed=True))
            beyond = kept.worst(path, model.arm.joints, strike)
            said = None if beyond is None else beyond.by_parts(0.0)
        return found, said


@lru_cache(maxsize=_MODELS)
def _followed(model: Model) -> CompiledRollout:
    """The simulator of an arm that follows its command exactly: one for all the strikes that are judged."""
    return CompiledRollout(model, Controller(PositionControl()))


def beginning(strike: StrikePath, trajectory: JointTrajectory, t_stay: float) -> float:
    """Return the time of a trajectory [s] at which its strike begins, also of a strike that does not move; `t_stay` is
    the time after the strike [s].
    """
    step = float(trajectory.t[1])
    after = sum(math.ceil(span / step - 1e-9) for span in (strike.D, t_stay))
    return float(trajectory.t[-1 - after])


@lru_cache(maxsize=_MODELS)
def swing_period(model: Model) -> float:
    """Return the period of the slowest swing of the hanging whip [s], at most 10 s."""
    slowest = float(hanging_modes(model, count=1).frequencies[0])
    return 1 / max(slowest, 1 / LONGEST_SWAY)
