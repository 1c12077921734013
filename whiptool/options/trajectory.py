"""Options of a joint trajectory that a robot can run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from whiptool.errors import InputError
from whiptool.options.base import OptionGroup, refuse_idle

if TYPE_CHECKING:
    from whiptool.models.joint_space import StrikePath
    from whiptool.models.joint_trajectory import JointTrajectory
    from whiptool.models.parameters import Model

_IDLE = "nothing without --export-trajectory"
_WRITERS = {".csv": "save_csv", ".yaml": "save_goal", ".yml": "save_goal"}


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions(OptionGroup):
    """The strike as a joint trajectory for a robot."""

    of_this_call: ClassVar[tuple[str, ...]] = ("export_trajectory", "trajectory_rate", "posture", "rest")

    export_trajectory: Path | None = None
    """Write the strike's joint positions, velocities and accelerations for a robot: as FILE.csv, or as the goal of a
    ROS 2 FollowJointTrajectory action, FILE.yaml."""
    trajectory_rate: float = 500.0
    """Samples a second of that file."""
    posture: tuple[float, ...] | None = None
    """Present posture of the robot, from which that file leads to the strike's start [rad]; default: it is there."""
    rest: float = 3.0
    """Rest before the strike in that file, in which the whip comes to hang still [s]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number

        super().check()
        for angle in self.posture or ():
            number("--posture", angle)
        number("--trajectory-rate", self.trajectory_rate, low=1, high=100_000)
        number("--rest", self.rest, low=0, high=600)
        if self.export_trajectory is None:
            refuse_idle(self, dict.fromkeys(("trajectory_rate", "posture", "rest"), _IDLE))
        elif self.export_trajectory.suffix not in _WRITERS:
            raise InputError("--export-trajectory", str(self.export_trajectory), "a file named .csv, .yaml or .yml")

    def check_posture(self, model: Model) -> None:
        """Refuse a posture of another number of joints than the model's arm has.

        Raises:
            InputError: It is one.
        """
        if self.posture is not None and len(self.posture) != model.arm.n:
            raise InputError("--posture", self.posture, f"{model.arm.n} numbers, for an arm of {model.arm.n} joints")

    def build_trajectory(self, model: Model, strike: StrikePath, t_stay: float) -> JointTrajectory | None:
        """Return a strike with the way to its start and a rest before it; None: the options ask for none.

        Raises:
            InputError: It is beyond a limit of the arm.
        """
        if self.export_trajectory is None:
            return None
        from whiptool.models.arm_limits import limits_of
        from whiptool.models.joint_trajectory import JointTrajectory

        limits = limits_of(model.arm)
        options = {"start": self.posture, "rate": self.trajectory_rate, "rest": self.rest, "t_stay": t_stay}
        found = JointTrajectory.of_strike(strike, model.arm.joints, limits=limits, **options)
        beyond = found.beyond(limits)
        if beyond is not None:
            raise InputError("--export-trajectory", str(self.export_trajectory), f"a strike within limits; {beyond}")
        return found

    def write_trajectory(self, trajectory: JointTrajectory) -> None:
        """Write a trajectory to the file that the options name.

        Raises:
            InputError: The file cannot be written.
        """
        path = self.export_trajectory
        assert path is not None
        try:
            getattr(trajectory, _WRITERS[path.suffix])(path)
        except OSError as error:
            rule = f"a file that can be written ({error.strerror})"
            raise InputError("--export-trajectory", str(path), rule) from None
