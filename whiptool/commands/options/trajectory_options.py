"""Options of a joint trajectory that a robot can run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from whiptool.commands.options.option_group import Conditions, OptionGroup, check_place, when
from whiptool.errors import InputError
from whiptool.progress import note

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.limits.all_limits import Limits
    from whiptool.models.joint_trajectory import JointTrajectory
    from whiptool.models.parameters import Model
    from whiptool.models.strike import StrikePath

_WRITERS = {".csv": "save_csv", ".yaml": "save_goal", ".yml": "save_goal"}


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions(OptionGroup):
    """Options for writing the strike as a joint trajectory for a robot."""

    heading: ClassVar[str] = "trajectory for a robot"
    first: ClassVar[tuple[str, ...]] = ("export_trajectory",)
    only_with: ClassVar[Conditions] = dict.fromkeys(("trajectory_rate", "posture", "rest"), when("export_trajectory"))
    of_this_call: ClassVar[tuple[str, ...]] = ("export_trajectory", "trajectory_rate", "posture", "rest")

    export_trajectory: Path | None = None
    """File for the strike as a joint trajectory, for a robot. A .csv file holds positions, velocities and
    accelerations; a .yaml file is the goal of a ROS 2 FollowJointTrajectory action. For a strike in hand space the
    poses of the hand are written too, as further columns of FILE.csv or as FILE-hand.yaml."""
    trajectory_rate: float = 500.0
    """Samples per second in the file of --export-trajectory."""
    posture: tuple[float, ...] | None = None
    """Present posture of the robot [rad], from which the exported trajectory moves to the start of the strike. Default:
    the start of the strike."""
    rest: float = 3.0
    """Pause before the strike in the exported trajectory, in which the whip comes to rest [s]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        super().check()
        for angle in self.posture or ():
            number("--posture", angle)
        number("--trajectory-rate", self.trajectory_rate, low=1, high=100_000)
        number("--rest", self.rest, low=0, high=600)
        if self.export_trajectory is None:
            return
        if self.export_trajectory.suffix not in _WRITERS:
            raise InputError("--export-trajectory", str(self.export_trajectory), "a file named .csv, .yaml or .yml")
        check_place("--export-trajectory", self.export_trajectory)

    def check_posture(self, model: Model) -> None:
        """Refuse a posture whose number of joints is not that of the model's arm.

        Raises:
            InputError: The numbers differ.
        """
        if self.posture is not None and len(self.posture) != model.arm.n:
            raise InputError("--posture", self.posture, f"{model.arm.n} numbers, for an arm of {model.arm.n} joints")

    def build_trajectory(
        self, model: Model, strike: StrikePath, t_stay: float, given: Sequence[Limits] = ()
    ) -> JointTrajectory | None:
        """Return the trajectory of a strike with the movement to its start and a rest; None if no option asks for one.

        Args:
            model: Model whose arm's limits the trajectory always has to keep.
            strike: The strike.
            t_stay: Time after the strike [s].
            given: Further limits for the arm; the motion of the whip is not checked, see `refuse_beyond`.

        Raises:
            InputError: The trajectory exceeds a limit, or on it the arm comes too close to itself or the floor.
        """
        if self.export_trajectory is None:
            return None
        from whiptool.limits.arm_limits import ArmLimits
        from whiptool.limits.clearance import Clearance
        from whiptool.models.joint_trajectory import JointTrajectory

        limits = next((x.joints for x in given if isinstance(x, ArmLimits)), model.arm.joint_limits)
        options = {"start": self.posture, "rate": self.trajectory_rate, "rest": self.rest, "t_stay": t_stay}
        found = JointTrajectory.of_strike(strike, model.arm.names, limits=limits, **options)
        slides = [joint in model.arm.slides for joint in model.arm.joints]
        touches = (x.beyond_on_way(found.t, found.q) for x in given if isinstance(x, Clearance))
        self.refuse_beyond(
            found.beyond(limits, slides=slides) or next((said for said in touches if said is not None), None)
        )
        return found

    def refuse_beyond(self, words: str | None) -> None:
        """Refuse to write a strike that exceeds a limit.

        Args:
            words: Description of the exceeded limit; None: all are kept.

        Raises:
            InputError: A limit is exceeded, and the options ask for a trajectory.
        """
        if words is not None and self.export_trajectory is not None:
            raise InputError("--export-trajectory", str(self.export_trajectory), f"a strike within limits; {words}")

    def write_trajectory(self, trajectory: JointTrajectory | None, controller: Controller) -> None:
        """Write a trajectory to the file that the options name, and the hand's poses to another file next to it if that
        file has none; print on stderr which controller a robot needs to make the same strike.

        Args:
            trajectory: From `build_trajectory`; None: nothing is written.
            controller: Controller of the strike.

        Raises:
            InputError: A file cannot be written.
        """
        path = self.export_trajectory
        if trajectory is None or path is None:
            return
        writers = {path: _WRITERS[path.suffix]}
        if trajectory.hand is not None and path.suffix != ".csv":
            writers[path.with_stem(f"{path.stem}-hand")] = "save_hand"
        try:
            for file, writer in writers.items():
                getattr(trajectory, writer)(file)
        except OSError as error:
            rule = f"a file that can be written ({error.strerror})"
            raise InputError("--export-trajectory", str(path), rule) from None
        follows = (
            "" if controller.prescribed else "; these are references: the robot needs the same impedance controller"
        )
        note(f"wrote {' and '.join(map(str, writers))}{follows}")
