"""Options of a simulated strike: simulator, limits, and the trajectory file for a robot."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from tyro.conf import arg

from whiptool.commands.options.option_group import (
    Conditions,
    Interval,
    Names,
    OptionGroup,
    Ranges,
    check_place,
    options_named,
    unless,
    when,
)
from whiptool.errors import InputError
from whiptool.progress import note

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.limits.limits import Limits
    from whiptool.limits.robot_trajectory import Execution
    from whiptool.models.joint_trajectory import JointTrajectory
    from whiptool.models.parameters import Model
    from whiptool.models.strike import StrikePath
    from whiptool.rollout.compiled import CompiledRollout
    from whiptool.rollout.interface import Rollout

Simulator = Literal["compiled", "reference"]
MANY_COARSE = 0.1  # share of random strikes that a step may get wrong by more than 0.3 mm before it is said


@dataclass(frozen=True, kw_only=True)
class StepOptions(OptionGroup):
    """Options for the accuracy of the compiled simulator."""

    heading: ClassVar[str] = "simulation"
    only_with: ClassVar[Conditions] = {"tolerance": unless("timestep")}

    tolerance: float | None = None
    """Largest integration error of the miss distance [m] (default: 1e-4). The integration steps are chosen
    accordingly."""
    timestep: float | None = None
    """Use equal integration steps of this length [s], without an estimate of their error. Default: steps that
    --tolerance needs."""

    def check(self) -> None:
        from whiptool.models.numbers import number
        from whiptool.rollout.interface import COARSEST, FINEST, LARGEST_STEP, SMALLEST_STEP

        super().check()
        if self.timestep is not None:
            number("--timestep", self.timestep, low=SMALLEST_STEP, high=LARGEST_STEP)
        if self.tolerance is not None:
            number("--tolerance", self.tolerance, low=FINEST, high=COARSEST)

    def warn_if_coarse(self, model: Model, controller: Controller, target: tuple[float, ...], t_stay: float) -> None:
        """Warn on stderr if, with the given time step, the miss distances of random strikes are not accurate."""
        import numpy as np

        from whiptool.models.strike import default_bounds
        from whiptool.rollout.refinement import share_too_coarse

        if self.timestep is None:
            return
        share = share_too_coarse(
            model,
            controller,
            default_bounds(model.arm),
            timestep=self.timestep,
            t_stay=t_stay,
            target=np.array(target),
        )
        if share > MANY_COARSE:
            said = f"{share:.0%} of random strikes miss by other distances where steps have small errors"
            print(f"whiptool: --timestep {self.timestep:g} is too coarse: {said}", file=sys.stderr)

    def build_compiled(self, model: Model, controller: Controller) -> CompiledRollout:
        """Return the compiled simulator of a model and controller."""
        from whiptool.rollout.compiled import CompiledRollout

        return CompiledRollout(model, controller, tolerance=self.tolerance, timestep=self.timestep)


@dataclass(frozen=True, kw_only=True)
class SimulatorOptions(StepOptions):
    """Options for the simulator and its accuracy."""

    only_with: ClassVar[Conditions] = {
        "tolerance": unless("simulator", "reference"),
        "integrator": when("simulator", "reference"),
    }

    simulator: Simulator = "compiled"
    """Simulator: compiled (CasADi) or reference (MuJoCo)."""
    timestep: float | None = None
    """Use equal integration steps of this length [s]. Default: with compiled the steps that --tolerance needs; with
    reference at most 0.0001, for rods 0.0004."""
    integrator: Annotated[str, Names("whiptool.rollout.reference:INTEGRATORS")] | None = None
    """Integrator of the reference simulator; default: RK4 unless the whip is too stiff for it."""

    def build_rollout(self, model: Model, controller: Controller) -> Rollout:
        """Return the simulator that `--simulator` names."""
        if self.simulator == "compiled":
            return self.build_compiled(model, controller)
        from whiptool.rollout.reference import ReferenceRollout

        return ReferenceRollout(model, controller, timestep=self.timestep, integrator=self.integrator)


@dataclass(frozen=True, kw_only=True)
class LimitOptions(OptionGroup):
    """Options for the limits that strikes have to keep."""

    heading: ClassVar[str] = "limits"
    first: ClassVar[tuple[str, ...]] = (
        "limits",
        "floor",
    )
    only_with: ClassVar[Conditions] = {
        "keep_free": (unless("limits", "none"),),
        "floor": (unless("limits", "none"), unless("ignore_collisions")),
        "clearance": (unless("limits", "none"), unless("ignore_collisions")),
        "ignore_collisions": (unless("limits", "none"),),
        "speed_limits": (unless("limits", "none"),),
    }

    limits: Annotated[str, Names("whiptool.limits.arm_limits:LIMITS", others=("arm", "none"))] | None = None
    """Limits that strikes keep: those of XM430 servos (xm430), of the joints (arm) or none (default: arm if the joints
    have limits, else none). xm430 is the speed-torque line of that motor. optimize counts strikes that exceed a limit
    as misses; simulate reports them."""
    keep_free: float = 0.0
    """Fraction of the limits that strikes leave unused, such as 0.1 (default: 0)."""
    speed_limits: Annotated[tuple[str, ...], arg(metavar="POINT=SPEED")] = ()
    """Largest speeds of points of the arm [m/s], as a robot's safety configuration has them: joints by their names,
    flange, and hand, which is the stick's end; such as elbow=1.5 flange=1.5 (default: those in the arm's file)."""
    floor: Annotated[str | None, arg(metavar="HEIGHT|none")] = None
    """Floor's height above the base [m] (default: 0 under robots that stand). A floor below the base has a negative
    height: minus the height that --mount gives, if it does. Other arms have no floor by default. The base of a planar
    arm is its shoulder."""
    clearance: float = 0.0
    """Least distance between arm, whip and floor [m] (default: 0)."""
    ignore_collisions: bool = False
    """Do not check collisions of arm, whip and floor. Planar models never check collisions of arm and whip."""

    def check(self) -> None:
        from whiptool.limits.all_limits import floor_height
        from whiptool.models.numbers import LARGEST_GAP, metres
        from whiptool.models.spatial_arm import kept_free

        super().check()
        try:
            kept_free(self.keep_free)
        except InputError as error:
            raise error.renamed("--keep-free") from None
        metres("--clearance", self.clearance, longest=LARGEST_GAP, strict=False)
        if self.floor is not None:
            with options_named(self):
                floor_height(self.floor)

    def build_limits(self, model: Model, controller: Controller) -> list[Limits]:
        """Return the limits that strikes have to keep.

        Raises:
            InputError: The arm has no limits, its torques are not available, or --keep-free or --clearance is given
                without limits to apply to.
        """
        from whiptool.limits.all_limits import named_limits

        with options_named(self):
            return named_limits(vars(self), model, prescribed=controller.prescribed)


EXECUTION = ("posture", "rest", "trajectory_rate", "joint_prefix")  # options of `ExecutionOptions`


@dataclass(frozen=True, kw_only=True)
class ExecutionOptions(OptionGroup):
    """Options for how a robot makes a strike."""

    heading: ClassVar[str] = "trajectory for a robot"
    ranges: ClassVar[Ranges] = {
        "posture": Interval(),
        "trajectory_rate": Interval(1, 100_000),
        "rest": Interval(0, 600),
    }

    posture: tuple[float, ...] | None = None
    """Present posture of the robot [rad], from which the trajectory moves to the start of the strike. Default: the
    start of the strike."""
    rest: float = 3.0
    """Pause before the strike in the trajectory, in which the whip comes to rest [s]."""
    trajectory_rate: float | None = None
    """Samples per second in the trajectory. Default: as many as the robot's controller takes (panda 1000, ur5e 500), or
    500 where that is unknown."""
    joint_prefix: str = ""
    """Text before the joints' names in the trajectory, such as left_arm for a robot whose driver has this prefix."""

    def check_posture(self, model: Model) -> None:
        """Refuse a posture whose number of joints is not that of the model's arm.

        Raises:
            InputError: The numbers differ.
        """
        if self.posture is not None and len(self.posture) != model.arm.n:
            raise InputError("--posture", self.posture, f"{model.arm.n} numbers, for an arm of {model.arm.n} joints")

    def build_execution(self) -> Execution:
        """Return how a robot makes a strike."""
        from whiptool.limits.robot_trajectory import Execution

        return Execution(posture=self.posture, rate=self.trajectory_rate, rest=self.rest, prefix=self.joint_prefix)


_WRITERS = {".csv": "save_csv", ".yaml": "save_goal", ".yml": "save_goal", ".mcap": ""}


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions(ExecutionOptions):
    """Options for writing the strike as a joint trajectory for a robot."""

    first: ClassVar[tuple[str, ...]] = ("export_trajectory",)
    only_with: ClassVar[Conditions] = dict.fromkeys(EXECUTION, when("export_trajectory"))
    of_this_call: ClassVar[tuple[str, ...]] = ("export_trajectory", *EXECUTION)

    export_trajectory: Path | None = None
    """Joint trajectory for a robot, as .csv, .yaml (ROS 2 goal) or .mcap. A .csv file holds positions, velocities and
    accelerations; a .yaml or .yml file is the goal of a FollowJointTrajectory action; a .mcap file is for Foxglove and
    Rerun. For a strike in hand space the poses of the hand are written too, as further columns of FILE.csv, as
    FILE-hand.yaml, or as a topic of FILE.mcap."""

    def check(self) -> None:
        super().check()
        if self.export_trajectory is None:
            return
        if self.export_trajectory.suffix not in _WRITERS:
            raise InputError(
                "--export-trajectory", str(self.export_trajectory), "a file named .csv, .yaml, .yml or .mcap"
            )
        check_place("--export-trajectory", self.export_trajectory)

    def needs(self) -> tuple[str, ...]:
        as_mcap = self.export_trajectory is not None and self.export_trajectory.suffix == ".mcap"
        return (*super().needs(), *["mcap", "rosbags"] * as_mcap)

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
        found, beyond = self.build_execution().of_strike(model, strike, t_stay, given)
        self.refuse_beyond(beyond)
        return found

    def refuse_beyond(self, words: str | None) -> None:
        """Refuse to write a strike that exceeds a limit.

        Args:
            words: Description of the exceeded limit; None: all are kept.

        Raises:
            InputError: A limit is exceeded, and the options ask for a trajectory.
        """
        if words is not None and self.export_trajectory is not None:
            given, rule = str(self.export_trajectory), "only for a strike within limits"
            raise InputError("--export-trajectory", given, rule, words)

    def write_trajectory(self, trajectory: JointTrajectory | None, controller: Controller) -> None:
        """Write a trajectory to the file that the options name. If that file cannot hold the hand's poses, write them
        to another file next to it. Print on stderr which controller a robot needs to make the same strike.

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
        if trajectory.hand is not None and writers[path] == "save_goal":
            writers[path.with_stem(f"{path.stem}-hand")] = "save_hand"
        try:
            for file, writer in writers.items():
                if writer:
                    getattr(trajectory, writer)(file)
                else:
                    from whiptool.recording.mcap_file import write_commanded_mcap

                    write_commanded_mcap(file, trajectory)
        except OSError as error:
            rule = "a file that can be written"
            raise InputError("--export-trajectory", str(path), rule, f"reason: {error.strerror}") from None
        follows = (
            "" if controller.prescribed else "; these are references: the robot needs the same impedance controller"
        )
        note(f"wrote {' and '.join(map(str, writers))}{follows}")
