"""The trajectory that a robot is given for a strike: from where it stands, without leaving the whip swinging."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from whiptool.dynamics.modes import hanging_modes
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Limits
from whiptool.models.joint_trajectory import RATE, REST, JointTrajectory
from whiptool.models.parameters import Model
from whiptool.models.smooth_path import LONGEST_SWAY
from whiptool.models.strike import StrikePath


@dataclass(frozen=True, kw_only=True)
class Execution:
    """How a robot makes a strike.

    Args:
        posture: Present positions of the robot's joints [rad or m], (n,); None: it stands at the strike's start.
        rate: Samples per second [1/s]; None: those that the robot's controller takes, or 500 where they are unknown.
        rest: Time at rest before the strike [s].
        prefix: What the robot's controller has before each joint's name, such as `left_`.
    """

    posture: tuple[float, ...] | None = None
    rate: float | None = None
    rest: float = REST
    prefix: str = ""

    def of_strike(
        self, model: Model, strike: StrikePath, t_stay: float, limits: Sequence[Limits] = ()
    ) -> tuple[JointTrajectory, str | None]:
        """Return the trajectory of a strike, and a description of what it exceeds.

        It exceeds a limit of the joints, or on it the arm comes too close to itself or the floor; the motion of the
        whip is not checked.

        Args:
            model: Model of arm and whip, whose arm's limits always count.
            strike: The strike.
            t_stay: Time after the strike [s].
            limits: Further limits.

        Raises:
            InputError: A value is out of range, or the posture has another number of joints.
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
        said = found.beyond(joints, slides=[joint in arm.slides for joint in arm.joints])
        touches = (x.beyond_on_way(found.t, found.q) for x in limits if isinstance(x, Clearance))
        return found, said or next((one for one in touches if one is not None), None)


def swing_period(model: Model) -> float:
    """Return the period of the slowest swing of the hanging whip [s], at most 10 s."""
    slowest = float(hanging_modes(model, count=1).frequencies[0])
    return 1 / max(slowest, 1 / LONGEST_SWAY)
