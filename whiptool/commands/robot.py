"""Strike with a robot of yours: `python -m whiptool.robot strike RUN --robot ur://192.168.0.10`.

Dynamixel servos and their simulated twin are robots, too: `--robot dynamixel:/dev/ttyUSB0` and `--robot twin` are
`whiptool rig strike` with that `--port`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import Positional, arg

from whiptool.commands import cli, rig, run_folders
from whiptool.commands.cli import tell_when_interrupted
from whiptool.commands.options.model_options import ModelName, ModelOptions
from whiptool.commands.options.option_group import (
    Condition,
    Conditions,
    Interval,
    JsonOptions,
    OutputOptions,
    Ranges,
    SeedOptions,
    options_named,
)
from whiptool.commands.options.rig_options import (
    ADDRESS,
    VIRTUAL_CAMERAS,
    ask_to_release,
    confirmed_by,
    says_yes,
    virtual_film,
    watch_port,
)
from whiptool.commands.options.strike_options import LimitOptions
from whiptool.commands.options.target_options import GoalOptions
from whiptool.commands.simulate import check_width, strike_of
from whiptool.errors import NOTHING, InputError

if TYPE_CHECKING:
    from whiptool.impedance import Controller

SERVOS = "dynamixel:"
_SIMULATED = Condition("only with a virtual --camera, whose whip is simulated", lambda o: o.camera != "none")


@dataclass(frozen=True, kw_only=True)
class AddressOptions(JsonOptions):
    """Option for the address of a robot."""

    heading: ClassVar[str] = "robot"
    first: ClassVar[tuple[str, ...]] = ("robot",)

    robot: str = ""
    """Address of the robot, which has to be given: franka://HOST, ur://HOST, dynamixel:PORT (servos on a serial port,
    such as dynamixel:/dev/ttyUSB0) or twin (simulated servos)."""
    yes: bool = False
    """Do not ask before the robot moves. After a stop a person is asked all the same."""
    model: ModelName | None = None
    """Model of the robot (default: ur5e or fr3, by the address)."""

    def __post_init__(self) -> None:
        from whiptool.rig.robots.addresses import USUAL_MODELS

        if self.model is None:
            usual = USUAL_MODELS.get(self.robot.partition(ADDRESS)[0].lower())
            object.__setattr__(self, "model", usual)

    def check(self) -> None:
        from whiptool.rig.robots.addresses import split_address

        super().check()
        with options_named(self):
            split_address(self.robot)

    def needs(self) -> tuple[str, ...]:
        from whiptool.rig.robots.addresses import needs_of

        with options_named(self):
            return needs_of(self.robot) if ADDRESS in self.robot else ()


@dataclass(frozen=True, kw_only=True)
class RobotOptions(AddressOptions, OutputOptions, LimitOptions, ModelOptions, GoalOptions, SeedOptions):
    """Options of `robot strike`, which makes one strike with a robot."""

    of_this_call: ClassVar[tuple[str, ...]] = ("run", "yes")
    first: ClassVar[tuple[str, ...]] = ("run", "strike", "camera")
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {"true_model": _SIMULATED, "seed": _SIMULATED}
    ranges: ClassVar[Ranges] = {"rest": Interval(0, 600)}

    run: Positional[Annotated[Path | None, arg(metavar="[RUN]")]] = None
    """Run folder of optimize, simulate or map strike, whose strike the robot makes. Options that are not given are
    those of the run."""
    strike: tuple[float, ...] | None = None
    """All joint angles at the start, then all at the end [rad], and the duration [s], instead of those of a run."""
    rest: float = 3.0
    """Time at rest before the strike, in which the whip stops swinging [s]."""
    camera: Annotated[str, arg(metavar="{none,points,twin,d435-color,d435-infrared}")] = "none"
    """Virtual camera that films a simulated whip on the measured motion of the robot: none, points (positions of the
    tip with the errors of tracked images), twin or d435-infrared (both render infrared images) or d435-color (renders
    colour images)."""
    true_model: ModelName | None = None
    """Model of the simulated whip, if it differs from --model."""

    def check(self) -> None:
        super().check()
        if self.model is None:
            raise InputError("--model", NOTHING, "the model of the robot's arm and whip", "or give a run")
        if self.camera not in VIRTUAL_CAMERAS:
            raise InputError("--camera", self.camera, ", ".join(VIRTUAL_CAMERAS))
        if self.strike is None:
            raise InputError("--strike", NOTHING, "joint angles at start and end [rad], duration [s]; or a run")

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), *["cv2"] * (self.camera not in ("none", "points")))

    def build_controller(self) -> Controller:
        """Return position control: the robot's own controller follows the commanded joints."""
        from whiptool.impedance import Controller, PositionControl

        return Controller(PositionControl())

    def controller_label(self) -> str:
        """Return a description of the control law."""
        return "the robot's own position control"


@dataclass(frozen=True, kw_only=True)
class RecoverOptions(AddressOptions):
    """Options of `robot recover`, which acknowledges a fault of a robot."""


def played_by_robot(run_folder: Path) -> RobotOptions:
    """Return the options for the best strike of a run.

    Raises:
        InputError: The folder is not a run of optimize, simulate or map strike, or has no strike.
    """
    return strike_of(run_folder, RobotOptions)


def _strike(options: RobotOptions) -> int:
    from whiptool.models.files import load_model
    from whiptool.models.strike import JointSpace
    from whiptool.rig.loop_options import LoopOptions
    from whiptool.rig.robots.addresses import robot_at
    from whiptool.rig.robots.robot_rig import RobotRig
    from whiptool.rig.stops import STOPPED, Interlock

    model = options.build_model()
    space, target = JointSpace(model.arm), options.build_target(model)
    assert options.strike is not None
    robot = robot_at(options.robot, model)
    check_width(options, space)
    target.check_reach(model)
    limits, interlock = options.build_limits(model, options.build_controller()), Interlock()
    tell_when_interrupted(lambda: interlock.torque)
    ask_to_release(interlock, options.robot)
    true = model if options.true_model is None else load_model(options.true_model)
    arm = RobotRig(
        model,
        robot,
        port=options.robot,
        confirm=confirmed_by(yes=options.yes, limits=limits),
        limits=limits,
        film=virtual_film(options.camera, true, [options.seed], target.position),
        target=target.position,
        options=LoopOptions(t_stay=options.t_stay, settle=options.rest),
        interlock=interlock,
    )
    config = run_folders.configuration(options, "robot strike", model, options.build_controller())
    with run_folders.new_folder(options, "robot", config) as folder:
        interlock.watch(folder.path / STOPPED)
        return rig.strike_and_tell(options, arm, space.strike(options.strike), model, target, folder)


def _recover(options: RecoverOptions) -> int:
    """Acknowledge a fault after a person has removed its cause; nothing moves."""
    from whiptool.models.files import load_model
    from whiptool.rig.robots.addresses import robot_at
    from whiptool.rig.stops import Interlock, NotConfirmed

    robot, interlock = robot_at(options.robot, load_model(options.model or "ur5e")), Interlock()
    watch_port(interlock, options.robot)
    with interlock.held():
        stopped = "" if interlock.stop is None else f"The arm was stopped: {interlock.stop}. "
        question = (
            f"{stopped}Acknowledge the fault of {options.robot}? "
            "Is its cause gone, and everybody away? Type yes to go on: "
        )
        if (stopped or not options.yes) and not says_yes(question):
            raise NotConfirmed("nothing was acknowledged")
        robot.recover()
        interlock.release()
    options.tell({"recovered": True}, f"{options.robot}: the fault is acknowledged; nothing moved")
    return 0


_STRIKE = (
    "Make one strike with a robot, and save the recording. "
    "Example: python -m whiptool.robot strike runs/optimize --robot ur://192.168.0.10"
)
_RECOVER = (
    "Acknowledge a fault of a robot once its cause is gone; nothing moves. "
    "Example: python -m whiptool.robot recover --robot franka://172.16.0.2"
)
_of_robots = cli.subcommands(
    "robot",
    {
        "strike": (_STRIKE, cli.command(RobotOptions, "robot strike", _STRIKE, _strike, of_run=played_by_robot)),
        "recover": (_RECOVER, cli.command(RecoverOptions, "robot recover", _RECOVER, _recover)),
    },
    note="\n\nKeep the robot's emergency stop within reach; these commands do not replace it.",
)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line; with servos it is that of `whiptool rig`."""
    words = list(sys.argv[1:] if args is None else args)
    port = _port_of_servos(words)
    return _of_robots(words) if port is None else rig.main(port)


def _port_of_servos(words: Sequence[str]) -> list[str] | None:
    """Return the words with `--port` in place of a `--robot` that is servos or their twin; None for other robots."""
    for i, word in enumerate(words):
        name, equals, value = word.partition("=")
        if name != "--robot":
            continue
        address = value if equals else next(iter(words[i + 1 :]), "")
        if address == "twin" or address.startswith(SERVOS):
            rest = words[i + 1 :] if equals else words[i + 2 :]
            return [*words[:i], "--port", address.removeprefix(SERVOS), *rest]
    return None
