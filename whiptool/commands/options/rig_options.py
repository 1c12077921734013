"""Options of everything that strikes with an arm: the real arm or its twin, the control loop, and adaptation."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import arg

from whiptool.commands.options.controller_options import ControllerOptions, LawName, Preset
from whiptool.commands.options.live_options import LiveOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import (
    Condition,
    Conditions,
    Count,
    Interval,
    Names,
    OutputOptions,
    Ranges,
    ResumableOptions,
    SeedOptions,
    renaming,
    unless,
    when,
)
from whiptool.commands.options.strike_options import EXECUTION, ExecutionOptions
from whiptool.commands.options.target_options import GoalOptions, TargetOptions
from whiptool.errors import InputError

ADDRESS = "://"  # in the port of a robot with a driver
ROBOT = "robot"  # a port

if TYPE_CHECKING:
    from whiptool.adaptation.materials import Stock
    from whiptool.goals.target import Target
    from whiptool.impedance import Controller
    from whiptool.limits.limits import Limits
    from whiptool.models.parameters import Model
    from whiptool.rig.loop_options import LoopOptions
    from whiptool.rig.stops import Interlock
    from whiptool.rig.struck import Motion


@dataclass(frozen=True, kw_only=True)
class ArmOptions(OutputOptions, SeedOptions, ControllerOptions, ModelOptions, TargetOptions):
    """Options of the arm that strikes: a rig, or its simulated twin."""

    of_this_call: ClassVar[tuple[str, ...]] = ("yes",)
    heading: ClassVar[str] = "rig"
    first: ClassVar[tuple[str, ...]] = ("port", "camera")
    usual_preset: ClassVar[Preset] = "printed"
    only_with: ClassVar[Conditions] = {"friction": when("port", "twin")}

    controller: LawName | None = None
    """Control law (default: oiac, which is online impedance adaptation). It gives torques, so a rig does not take
    position. A TOML file has a table [controller], as config.toml of a run has."""
    preset: Preset | None = None
    """Parameters of the control law. OIAC: printed, or table4, which is stable only at rates far above 500 Hz; default:
    printed. Constant impedance: nah2020 (Eq. 22), nah2023, ur5e or panda; default: that of the model, otherwise
    nah2020."""
    port: str = "twin"
    """Serial device of the servos, or twin (a simulated rig). A device is, for example, /dev/ttyUSB0; twin emulates the
    servos and their protocol."""
    camera: Annotated[str, arg(metavar="{twin,d435-color,d435-infrared,points,realsense,none}|FILE.db3")] = "twin"
    """Camera, by --port:

    - twin: twin or d435-infrared (both render infrared images), d435-color (renders colour images), points (positions
      of the tip with the errors of tracked images) or none
    - servos: realsense, FILE.db3 (a RealSense recording) or none"""
    rate: float = 500.0
    """Rate of the control loop [Hz]."""
    approach_speed: float = 0.2
    """Largest joint speed on the way to the start of the strike [rad/s]. A low speed keeps the whip from swinging."""
    settle: float = 2.0
    """Waiting time at the start of the strike [s]. The whip's hinge is free, so a swing does not stop by waiting
    alone."""
    friction: bool = True
    """Give the twin's motors friction and inertia."""
    latency: float = 0.001
    """Round-trip latency of the serial line [s], for the twin and for the simulation before a strike."""
    yes: bool = False
    """Do not ask before a real arm moves."""

    def check(self) -> None:
        from whiptool.models.numbers import number
        from whiptool.rig.loop_options import LONGEST_DELAY

        super().check()
        number("--latency", self.latency, low=0, high=LONGEST_DELAY)
        loop_options(self)

    @property
    def camera_named(self) -> str:
        """Name of the camera for messages, which tells whether it is the default."""
        return self.camera if self.given("camera") else f"{self.camera} (the default)"

    def needs(self) -> tuple[str, ...]:
        film = self.camera == "realsense" or self.camera.endswith(".db3")
        images = self.camera not in ("points", "none")
        return ("dynamixel_sdk", *["pyrealsense2"] * film, *["cv2"] * images)

    def build_controller(self) -> Controller:
        """Return the controller that the options describe, or that of the file."""
        controller = super().build_controller()
        if controller.control_period is not None:
            allowed = "a controller without control_period, because a rig holds every torque for a cycle of --rate"
            raise InputError("--controller", self.controller, allowed)
        if controller.prescribed:
            raise InputError(
                "--controller", self.controller, "a law that gives torques: oiac, constant, or a file with one of them"
            )
        return controller


def loop_options(options: ArmOptions) -> LoopOptions:
    """Return the settings of the control loop that the options describe."""
    from whiptool.rig.loop_options import LoopOptions

    return LoopOptions(
        rate=options.rate,
        t_stay=options.t_stay,
        settle=options.settle,
        approach_speed=options.approach_speed,
        delay=options.latency,
    )


def hardware_rig(options: ArmOptions, model, controller, loop: LoopOptions, interlock: Interlock):
    """Return the hardware rig that the options describe; after a stop, a file blocks later calls with this port.

    Raises:
        InputError: The serial device or the camera does not exist; they are not opened yet.
    """
    from whiptool.rig.dynamixel.line import check_present
    from whiptool.rig.session import HardwareRig, ServoLine

    check_present(options.port)
    camera = _camera(options.camera)
    if camera is not None:
        camera.check_present()
    watch_port(interlock, options.port)
    return HardwareRig(
        model,
        controller,
        ServoLine(options.port),
        camera=camera,
        target=options.build_target().position,
        options=loop,
        confirm=None if options.yes else confirm,
        interlock=interlock,
    )


VIRTUAL_CAMERAS = ("none", "points", "twin", "d435-color", "d435-infrared")


def confirmed_by(*, yes: bool, limits: Sequence[Limits]) -> Callable[[Motion], bool] | None:
    """Return what asks a person before a robot moves; None: `--yes` answers.

    Args:
        yes: Whether `--yes` is given.
        limits: Limits that strikes have to keep.

    Raises:
        InputError: `--yes` is given, and a check is switched off or has nothing to check by, such as the height of a
            floor: a person has to answer then.
    """
    from whiptool.limits.all_limits import unchecked_by

    if yes and (unchecked := unchecked_by(limits)):
        fix = "leave out --yes, or give what is missing, such as the height of the base in --mount wall 1.7"
        raise InputError("--yes", f"with NOT checked: {', '.join(unchecked)}", "only if all is checked", fix)
    return None if yes else confirm


def virtual_film(camera: str, true: Model, seed: Sequence[int], target: tuple[float, ...], late: float = 0.0):
    """Return virtual cameras as an option `--camera` names them; None for `none`.

    Args:
        camera: A name in `VIRTUAL_CAMERAS`.
        true: True model of arm and whip.
        seed: Seed of the noise.
        target: Position of the target [m].
        late: Offset of the cameras' clock [s].
    """
    import numpy as np

    from whiptool.rig.virtual_film import VirtualFilm

    if camera == "none":
        return None
    name = "d435-infrared" if camera == "twin" else camera
    return VirtualFilm(name, true, np.random.default_rng(list(seed)), target, late)


def mark_of_port(port: str) -> Path:
    """Return the file that records a fault for later calls, of the servos on a serial device or of a robot's address,
    however either is spelled.
    """
    from whiptool.rig.robots.addresses import state_file

    return state_file("stopped", port)


def watch_port(interlock: Interlock, port: str) -> None:
    """Have an interlock read and write the file of an arm's port; simulated arms and the user's own have none."""
    if port not in ("twin", ROBOT):
        interlock.watch(mark_of_port(port))


def ask_to_release(interlock: Interlock, port: str, run_folder: Path | None = None) -> None:
    """After a stop, ask a person to confirm that its cause is removed; nothing moves before the answer.

    Call this before a new run folder is made.

    Args:
        interlock: Interlock of the rig.
        port: Port or address of the arm.
        run_folder: Folder of a run to go on with, in which a stop may be recorded, too.

    Raises:
        Locked: The question was not answered with yes.
        InputError: Another program uses the arm.
    """
    from whiptool.rig.stops import STOPPED

    watch_port(interlock, port)
    if run_folder is not None:
        interlock.watch(run_folder / STOPPED)
    with interlock.held():  # or the stop of a program that uses the arm now would be released
        if interlock.stop is None:
            return
        asked = "Is the cause found and gone, and everybody away? Type yes to go on: "
        if says_yes(f"The arm was stopped: {interlock.stop}. {asked}"):
            interlock.release()
        interlock.check()


def _camera(name: str):
    """Return the real camera of that name; None for `none`."""
    if name == "none":
        return None
    from whiptool.recording.camera import camera_preset
    from whiptool.vision.source import RealSenseCamera

    return RealSenseCamera(camera_preset("d435-infrared"), file=None if name == "realsense" else Path(name))


def confirm(motion: Motion) -> bool:
    """Return whether a person agrees that an arm moves as planned."""
    switch = "the emergency stop in hand" if ADDRESS in motion.port else "the power switch at hand"
    unchecked = f" NOT checked: {', '.join(motion.unchecked)}." if motion.unchecked else ""
    return says_yes(
        f"The arm at {motion.port} will move for {motion.duration:.1f} s, its joints by up to {motion.reach:.2f} rad "
        f"({motion.joint}).{unchecked} Is everybody away, {switch}? Type yes to go on: "
    )


def says_yes(question: str) -> bool:
    """Return whether a person types yes, in capitals or not; all else is no, also what a terminal had before."""
    if sys.stdin.isatty():
        import termios

        termios.tcflush(sys.stdin, termios.TCIFLUSH)
    print(question, end="", file=sys.stderr, flush=True)
    answer = sys.stdin.readline()
    if not answer.endswith("\n"):
        print(file=sys.stderr)  # no one pressed Enter: what follows begins on a new line
    return answer.strip().lower() == "yes"


CAMERAS = ("tip", "points", "twin", "d435-color", "d435-infrared")


FASTEST_TIP = 343.0  # [m/s], of sound


_OF_RIGS = unless("port", ROBOT, why=", where your own program commands and records")


_NOT_AT_REST = Condition(
    "only with a real arm: the twin is already at the start of its strike", lambda o: o.port != "twin"
)


_SERVOS = Condition("only with servos", lambda o: o.camera != "tip" and ADDRESS not in o.port)
_SIMULATED = Condition(
    "only with a simulated whip", lambda o: o.port == "twin" or (ADDRESS in o.port and o.camera != "none")
)


_OF_MATERIAL = Condition(
    "only with --material, or with --youngs-modulus and --density; or give --model or --prior",
    lambda o: any(x is not None for x in (o.material, o.youngs_modulus, o.density)),
)
_IN_SPACE = Condition("only for a model in space", lambda o: o.find_model().dimension == 3)


@dataclass(frozen=True, kw_only=True)
class AdaptOptions(ResumableOptions, LiveOptions, GoalOptions, ExecutionOptions, ArmOptions):
    """Options of `adapt`, which strikes, films, identifies the whip and plans again until an unknown whip hits."""

    of_this_call: ClassVar[tuple[str, ...]] = ("posture",)
    first: ClassVar[tuple[str, ...]] = ("port", "camera", "family", "material")
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(("camera", "yes"), (_OF_RIGS,)),
        "settle": (_OF_RIGS, _NOT_AT_REST),
        "approach_speed": (_OF_RIGS, _NOT_AT_REST, _SERVOS),
        **dict.fromkeys(("rate", "friction", "latency", "limits"), (_OF_RIGS, _SERVOS)),
        **dict.fromkeys(EXECUTION, when("port", ROBOT)),
        "family": (_SIMULATED,),
        **dict.fromkeys(("direction", "arrival_angle"), (_IN_SPACE,)),
        "length": (when("material", why="; or give --model or --prior"),),
        "diameter": (_OF_MATERIAL,),
    }
    ranges: ClassVar[Ranges] = {
        "least_speed": Interval(0, FASTEST_TIP),
        "max_strikes": Count(),
        "starts": Count(high=1000),
    }

    controller: LawName | None = None
    """Control law (default: oiac, online impedance adaptation, while an arm in space and a robot always take position).
    A TOML file has a table [controller], as config.toml of a run has."""
    port: str = "twin"
    """Serial device of servos, twin (simulated rig), a robot's address (franka://HOST or ur://HOST), or robot (by
    files: any robot plays trajectory.csv, you add recorded.csv). A device is, for example, /dev/ttyUSB0; twin emulates
    the servos and their protocol. With robot, each strike is written as trajectory.csv and, for ROS 2, trajectory.yaml;
    put its recording next to them as recorded.csv and use --resume."""
    camera: Annotated[str, arg(metavar="{tip,points,twin,d435-color,d435-infrared,realsense,none}|FILE.db3")] = "points"
    """Camera, by --port:

    - twin: points (tip with the errors of tracked images), twin or d435-infrared (render infrared images), d435-color
      (renders colour images) or tip (tip with 5 mm noise at 60 Hz, no servos)
    - a robot's address: the same but tip, or none (you film a real whip)
    - servos: realsense or FILE.db3 (its recording). With a robot's address all but none film a simulated whip on the
      measured motion of the robot; with none, put what your cameras saw into the run folder as recorded.csv and use
      --resume."""
    family: Annotated[str, Names("whiptool.adaptation.twins:FAMILIES")] = "strange"
    """Deviation of the simulated whip from --model: small (kin), large (strange) or twice that (stranger). kin: a
    uniform whip near the model; strange: tapered, with a bead, a soft joint and more; stranger: the same deviations,
    doubled."""
    material: Annotated[str, Names("whiptool.adaptation.materials:MATERIALS")] | None = None
    """Known material of the whip, for the prior (default: that of --model). It sets the prior mean; the prior
    covariance is that of materials in general."""
    diameter: float | None = None
    """Measured diameter of a whip of --material [m] (of a chain: of its wire), or the diameter that belongs to
    --youngs-modulus."""
    length: float | None = None
    """Measured length of a whip of --material [m]."""
    max_strikes: int = 6
    """Largest number of strikes. Measurements before the first strike do not count."""
    whip: Annotated[str, Names("whiptool.adaptation.prior:WHIPS")] = "profile"
    """Parametrisation of the whip that is identified: profile (tapers, drag, friction, rest curvature) or uniform (k,
    b, m, l)."""
    prior: str | None = None
    """TOML file that replaces the default prior of the parameters that it names, with lines such as "profile.length" =
    {value = 0.9, error = 0.05}."""
    known: tuple[str, ...] = ()
    """Recordings of earlier strikes with the same whip, which contain the tip and the commanded strike."""
    limits: Annotated[str, Names("whiptool.limits.arm_limits:LIMITS")] | None = None
    """Motor whose limits strikes have to keep; default: xm430, but none for --camera tip, which has no motors."""
    still: bool = True
    """Film the hanging whip before the first strike, to measure its length. Not needed with --wiggle or --known."""
    wiggle: bool = False
    """Begin with a short, slow movement that is planned for its information gain about the whip."""
    starts: int = 3
    """Number of starting points of every fit."""
    seed: int = 0
    """Seed of the twin's whip and all other random numbers (default: 0)."""

    @property
    def own_controller(self) -> bool:
        """Whether the arm is a robot that follows joint positions by its own controller."""
        return self.port == ROBOT or ADDRESS in self.port

    @property
    def material_of_model(self) -> dict[str, float]:
        """Material parameters that the options give to the model's whip, by name; `diameter` is left out with
        --material.
        """
        given = super().material_of_model
        return {name: x for name, x in given.items() if self.material is None or name != "diameter"}

    def check(self) -> None:
        from whiptool.models.files import load_model

        super().check()
        servos = not self.own_controller and (self.port, self.camera) != ("twin", "tip")
        if load_model(self.model).dimension == 3 and servos:
            raise InputError(
                "--model", self.model, "a model in the plane, unless --port is a robot or --camera tip is given"
            )
        if self.port == "twin" and self.camera not in CAMERAS:
            raise InputError("--camera", self.camera, ", ".join(CAMERAS) + " with --port twin")
        if ADDRESS in self.port and self.camera not in VIRTUAL_CAMERAS:
            raise InputError("--camera", self.camera, ", ".join(VIRTUAL_CAMERAS) + " with a robot")
        if servos and self.port != "twin" and self.camera != "realsense" and not self.camera.endswith(".db3"):
            raise InputError("--camera", self.camera_named, "realsense or a .db3 recording, with a real arm")
        if self.wiggle and not self.still:
            raise InputError(
                "--no-still",
                "together with --wiggle",
                "one of them",
                "--wiggle also measures the whip before the first strike",
            )
        self.build_stock()

    def build_stock(self) -> Stock | None:
        """Return the whips that can be made of the given material; None if no material was given."""
        from whiptool.adaptation.materials import stock_of_material

        if self.material is None:
            return None
        return stock_of_material(self.material, diameter=self.diameter, length=self.length)

    def needs(self) -> tuple[str, ...]:
        page = ("viser",) if self.live else ()
        if ADDRESS in self.port:
            from whiptool.rig.robots.addresses import needs_of

            with renaming({"robot": "--port"}):
                of_driver = needs_of(self.port)
            return (*page, *of_driver, *["cv2"] * (self.camera not in ("none", "points")))
        return page if self.camera == "tip" or self.port == ROBOT else super().needs()

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target with direction and speed of arrival; a least speed of 0 requires no speed."""
        return GoalOptions.build_target(replace(self, least_speed=self.least_speed or None), model)

    def build_controller(self) -> Controller:
        """Return the controller that the options describe; for an arm in space or a robot, position control."""
        from whiptool.models.files import load_model

        if not self.own_controller and load_model(self.model).dimension == 2:
            return super().build_controller()
        from whiptool.impedance import Controller, PositionControl

        return Controller(PositionControl())
