"""Options of commands that strike with an arm, real or simulated: port, camera and control loop."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import arg

from whiptool.commands.options.controller_options import ControllerOptions, Preset
from whiptool.commands.options.option_group import Conditions, OutputOptions, SeedOptions, when
from whiptool.commands.options.target_options import ModelOptions, TargetOptions
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.rig.loop_options import LoopOptions
    from whiptool.rig.stops import Interlock


@dataclass(frozen=True, kw_only=True)
class ArmOptions(OutputOptions, SeedOptions, ControllerOptions, ModelOptions, TargetOptions):
    """Options of the arm that strikes: a rig, or its simulated twin."""

    of_this_call: ClassVar[tuple[str, ...]] = ("yes",)
    heading: ClassVar[str] = "rig"
    first: ClassVar[tuple[str, ...]] = ("port", "camera")
    usual_preset: ClassVar[Preset] = "printed"
    only_with: ClassVar[Conditions] = {"friction": when("port", "twin")}

    preset: Preset | None = None
    """Parameters of the control law. OIAC: printed, or table4, which is stable only at rates far above 500 Hz; default:
    printed. Constant impedance: nah2020 (Eq. 22), nah2023, ur5e or panda; default: that of the model, otherwise
    nah2020."""
    port: str = "twin"
    """Serial device of the servos, or twin (a simulated rig). A device is, for example, /dev/ttyUSB0; twin emulates the
    servos and their protocol."""
    camera: Annotated[str, arg(metavar="{twin,d435-color,d435-infrared,points,realsense,none}|FILE.db3")] = "twin"
    """Camera, or none (points: positions without images). With a real arm: realsense, or a RealSense recording. With
    the twin: twin or d435-infrared (rendered infrared images), d435-color (colour images), or points (positions of the
    tip with the error of tracked images)."""
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
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number
        from whiptool.rig.loop_options import LONGEST_DELAY

        super().check()
        number("--latency", self.latency, low=0, high=LONGEST_DELAY)
        loop_options(self)

    def needs(self) -> tuple[str, ...]:
        """Return the modules of extras that the command imports with these options."""
        film = self.camera == "realsense" or self.camera.endswith(".db3")
        images = self.camera not in ("points", "none")
        return ("dynamixel_sdk", *["pyrealsense2"] * film, *["cv2"] * images)

    def build_controller(self) -> Controller:
        """Return the controller that the options describe, or that of the file."""
        controller = super().build_controller()
        if controller.control_period is not None:
            allowed = "one without control_period: a rig holds every torque for a cycle of --rate"
            raise InputError("--controller", self.controller, allowed)
        if controller.prescribed:
            raise InputError("--controller", self.controller, "one that gives torques: oiac, constant, or their file")
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
    from whiptool.rig.dynamixel.port import check_present
    from whiptool.rig.session import HardwareRig, ServoLine

    check_present(options.port)
    camera = _camera(options.camera)
    if camera is not None:
        camera.check_present()
    interlock.watch(mark_of_port(options.port))
    return HardwareRig(
        model,
        controller,
        ServoLine(options.port),
        camera=camera,
        target=options.build_target().position,
        options=loop,
        confirm=None if options.yes else _confirm,
        interlock=interlock,
    )


def mark_of_port(port: str) -> Path:
    """Return the file that records a fault of the servos on a serial device for later calls."""
    from platformdirs import user_state_path

    return (
        user_state_path("whiptool")
        / "stopped"
        / (Path(port).resolve().as_posix().strip("/").replace("/", "-") + ".json")
    )


def ask_to_release(interlock: Interlock, run_folder: Path) -> None:
    """After a stop, ask a person to confirm that its cause is removed; nothing moves before the answer.

    Args:
        interlock: Interlock of the rig.
        run_folder: Run folder, in which a stop is recorded.

    Raises:
        Locked: The question was not answered with yes.
    """
    from whiptool.rig.stops import STOPPED

    interlock.watch(run_folder / STOPPED)
    if interlock.stop is None:
        return
    question = (
        f"The arm was stopped: {interlock.stop}. Is the cause found and gone, and everybody away? Type yes to go on: "
    )
    if _says_yes(question):
        interlock.release()
    interlock.check()


def _camera(name: str):
    """Return the real camera of that name; None for `none`."""
    if name == "none":
        return None
    from whiptool.recording.camera import camera_preset
    from whiptool.vision.source import RealSenseCamera

    return RealSenseCamera(camera_preset("d435-infrared"), file=None if name == "realsense" else Path(name))


def _confirm(strike) -> bool:
    return _says_yes(f"The arm will move: {strike}. Is everybody away, the power switch at hand? Type yes to go on: ")


def _says_yes(question: str) -> bool:
    """Whether a person types yes, in capitals or not; everything else, and no answer at all, is no."""
    print(question, end="", file=sys.stderr, flush=True)
    answer = sys.stdin.readline()
    if not answer.endswith("\n"):
        print(file=sys.stderr)  # no one pressed Enter: what follows begins on a new line
    return answer.strip().lower() == "yes"
