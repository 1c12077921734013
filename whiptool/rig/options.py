"""Options of everything that strikes with an arm: the real one or its twin, and how the control loop runs."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from whiptool.errors import InputError
from whiptool.options import ControllerOptions, ModelOptions, TargetOptions, refuse_idle, whole

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.rig.loop import LoopOptions


@dataclass(frozen=True, kw_only=True)
class ArmOptions(TargetOptions, ModelOptions, ControllerOptions):
    """Options of the arm that strikes: a rig or its twin."""

    usual_preset: ClassVar[str] = "printed"

    preset: str | None = None
    """OIAC parameters: printed or table4, which is stable only at rates far above 500; default: printed."""
    port: str = "twin"
    """Serial device such as /dev/ttyUSB0, or twin: the emulator behind the same protocol."""
    camera: str = "twin"
    """realsense, none, a RealSense recording (.db3); with the twin: d435-color, d435-infrared (= twin), points
    (the tip's position with the error of tracked images, no images), none."""
    rate: float = 500.0
    """Control cycles per second."""
    approach_speed: float = 0.2
    """Largest joint speed on the way to the strike's start [rad/s]; slow, for the whip must not swing there."""
    settle: float = 2.0
    """Wait at the start [s]; the whip's hinge is free, so waiting alone does not end a swing."""
    friction: bool = True
    """Of the twin: motors with friction and inertia."""
    latency: float = 0.001
    """Of the line, there and back [s]: the twin's, and as rehearsals have it."""
    yes: bool = False
    """Do not ask before a real arm moves."""
    seed: int = 0
    """Of the virtual camera's noise, and of what is random in a search."""
    out: Path | None = None
    """Run folder; default: runs/rig-DATE-TIME."""
    json: bool = False
    """Print one JSON object on stdout, and nothing else there."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number
        from whiptool.rig.loop import LONGEST_DELAY

        super().check()
        number("--latency", self.latency, low=0, high=LONGEST_DELAY)
        loop_options(self)
        whole("--seed", self.seed, low=0)
        if self.port != "twin":
            refuse_idle(self, {"friction": "nothing, unless --port twin is given"})

    def build_controller(self) -> Controller:
        """The controller that the options describe, or that of the file."""
        controller = super().build_controller()
        if controller.control_period is not None:
            allowed = "one without control_period: a rig holds every torque for a cycle of --rate"
            raise InputError("--controller", self.controller, allowed)
        return controller


def loop_options(options: ArmOptions) -> LoopOptions:
    """Return the settings of the control loop that the options describe."""
    from whiptool.rig.loop import LoopOptions

    return LoopOptions(
        rate=options.rate,
        t_stay=options.t_stay,
        settle=options.settle,
        approach_speed=options.approach_speed,
        delay=options.latency,
    )


def hardware_rig(options: ArmOptions, model, controller, loop: LoopOptions):
    """The real arm and camera that the options name."""
    from whiptool.rig.session import HardwareRig

    return HardwareRig(
        model,
        controller,
        port=options.port,
        camera=_camera(options.camera),
        target=options.build_target().position,
        options=loop,
        confirm=None if options.yes else _confirm,
    )


def _camera(name: str):
    """Return the real camera of that name; None for `none`."""
    if name == "none":
        return None
    from whiptool.vision.camera_model import camera_preset
    from whiptool.vision.realsense import RealSenseCamera

    return RealSenseCamera(camera_preset("d435-infrared"), file=None if name == "realsense" else Path(name))


def _confirm(strike) -> bool:
    print(f"The arm will move: {strike}. Is everybody away, the power switch at hand? [yes] ", end="", file=sys.stderr)
    return sys.stdin.readline().strip().lower() in ("yes", "y")
