"""Options of the controller: control law, feedforward, torque limit, control period, and joint or hand space."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np

from whiptool.commands.options.option_group import Condition, Conditions, Interval, Names, OptionGroup, Ranges, when
from whiptool.errors import InputError
from whiptool.words import as_named

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.impedance.controller import HandControl
    from whiptool.impedance.laws import Law
    from whiptool.models.parameters import Model

Preset = Annotated[str, Names("whiptool.impedance:OIAC_PRESETS", "whiptool.impedance:CONSTANT_PRESETS")]
LawName = Annotated[str, Names("whiptool.impedance:LAWS", beside="|FILE.toml")]
_NOT_IN_FILE = Condition("only without a file as --controller: write it into the file", lambda o: not o.in_file)
_NOT_POSITION = Condition(
    "only without position control; give --controller constant", lambda o: o.law_or_file != "position"
)
LONGEST_PERIOD = 0.1  # [s]; an arm that is looked at more rarely is not controlled


@dataclass(frozen=True, kw_only=True)
class LawOptions(OptionGroup):
    """Options that choose the control law."""

    heading: ClassVar[str] = "controller"
    first: ClassVar[tuple[str, ...]] = ("controller",)
    usual_preset: ClassVar[Preset] = "table4"
    takes_hand: ClassVar[bool] = False  # whether the command takes controllers of the hand
    only_with: ClassVar[Conditions] = {"preset": (_NOT_IN_FILE, _NOT_POSITION)}

    controller: LawName | None = None
    """Control law: oiac (adapts the impedance online, default in the plane), constant (default of nah2023) or position
    (default in space). With position the joints follow the commanded path exactly, as those of stiff robots do. A TOML
    file has a table [controller], as config.toml of a run has."""
    preset: Preset | None = None
    """Parameters of the control law. OIAC: printed (the paper's a = 0.2) or table4 (fitted to the errors of Table 4);
    default: table4. Constant impedance: nah2020 (Eq. 22), nah2023, ur5e or panda; default: that of the model, otherwise
    nah2020."""

    def check(self) -> None:
        super().check()
        self.build_controller()

    @property
    def law_or_file(self) -> str:
        """Name of the given control law, or the path of its file; else the law of the given preset, or the model's
        default law.
        """
        from whiptool.impedance import CONSTANT_PRESETS, LAWS, default_controller

        if self.controller is not None:
            return as_named(self.controller, LAWS)
        model = self._model()
        if model is None or model.dimension == 2:
            return "oiac"
        if self.preset is not None:
            return "constant" if self.preset in CONSTANT_PRESETS else "oiac"
        return default_controller(model).law.kind

    def _model(self) -> Model | None:
        """The model, of commands that have one."""
        find = getattr(self, "find_model", None)
        return None if find is None else find()

    @property
    def in_file(self) -> bool:
        """Whether the controller is given by a file."""
        return self.law_or_file.endswith(".toml")

    def build_controller(self) -> Controller:
        """Return the controller with the chosen law, or that of the file.

        Raises:
            InputError: No controller has that name, the file contains none, or an option is given that belongs in the
                file.
        """
        from whiptool.impedance import Controller
        from whiptool.impedance.controller import read_controller

        if not self.in_file:
            return Controller(law=self._named_law())
        path = Path(self.law_or_file)
        if not path.is_file():
            raise InputError(
                "--controller", str(path), "a TOML file with a table [controller]", "there is no such file"
            )
        found = read_controller(path)
        if found.hand is not None and not self.takes_hand:
            rule = "a controller of the joints, without a table [controller.hand], for this command"
            raise InputError("--controller", str(path), rule)
        return found

    def _named_law(self) -> Law:
        from whiptool.impedance import LAWS, constant_preset, oiac_preset

        constant = self._constant  # before errors are named after the preset: the model may be none
        try:
            if self.law_or_file == "oiac":
                return oiac_preset(self.usual_preset if self.preset is None else self.preset)
            if self.law_or_file == "constant":
                return constant_preset(constant)
        except InputError as error:  # a preset of the other law
            raise error.renamed("--preset") from None
        try:
            return LAWS.find(self.law_or_file)()
        except InputError as error:
            raise InputError("--controller", error.given, f"{error.allowed}, or a .toml file") from None
        except TypeError:
            fix = "write a file with its parameters"
            raise InputError(
                "--controller", self.law_or_file, "a law whose parameters all have defaults", fix
            ) from None

    @property
    def _constant(self) -> str:
        """The preset of the constant law: as given, or that of the model's arm, or the paper's."""
        from whiptool.impedance import CONSTANT_PRESETS

        model = self._model()
        return self.preset or (model.name if model is not None and model.name in CONSTANT_PRESETS else "nah2020")

    def law_label(self) -> str:
        """Return a description of the control law."""
        if self.in_file:
            return f"the controller of {Path(self.law_or_file).name}"
        if self.law_or_file == "position":
            return "position control"
        if self.law_or_file == "constant":
            return "constant impedance" + (f" {self._constant}" if self._constant != "nah2020" else "")
        if self.law_or_file == "oiac":
            return f"OIAC {self.usual_preset if self.preset is None else self.preset}"
        return self.law_or_file


@dataclass(frozen=True, kw_only=True)
class ControllerOptions(LawOptions):
    """Options for the control law, feedforward and torque limit."""

    only_with: ClassVar[Conditions] = dict.fromkeys(("feedforward", "torque_limit"), (_NOT_IN_FILE, _NOT_POSITION))

    feedforward: bool = False
    """Add the torque that the arm without the whip needs to follow the reference."""
    torque_limit: float | None = None
    """Largest absolute torque of every joint [N m]. Default: no limit."""

    def build_controller(self) -> Controller:
        """Return the controller that the options describe, or that of the file."""
        controller = super().build_controller()
        if self.in_file:
            return controller
        return replace(controller, feedforward=self.feedforward, torque_limit=self.torque_limit)

    def controller_label(self) -> str:
        """Return a description of the controller."""
        return self.law_label() + (" with feedforward" if self.feedforward else "")


@dataclass(frozen=True, kw_only=True)
class SimulatedControllerOptions(ControllerOptions):
    """Options for the controller of a simulated arm, with the control period, which a rig sets by --rate."""

    only_with: ClassVar[Conditions] = {"control_period": (_NOT_IN_FILE, _NOT_POSITION)}
    ranges: ClassVar[Ranges] = {"control_period": Interval(0, LONGEST_PERIOD, strict=True)}

    control_period: float | None = None
    """Hold the torque constant for this time [s], as a sampled controller does. Default: continuous control."""

    def build_controller(self) -> Controller:
        """Return the controller that the options describe, or that of the file."""
        controller = super().build_controller()
        if self.in_file:
            return controller
        return replace(controller, control_period=self.control_period)


_GAINS = ("stiffness", "damping", "turn_stiffness", "turn_damping")
_OF_CONSTANT = when("controller", "constant", of="law_or_file")
Matrix = tuple[tuple[float, ...], ...]
Space = Literal["joint", "hand", "pose"]


@dataclass(frozen=True, kw_only=True)
class SpaceOptions(SimulatedControllerOptions):
    """Options for the coordinates of strikes (joint or hand space), and for the controller in these coordinates."""

    first: ClassVar[tuple[str, ...]] = ("space",)
    takes_hand: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(("home", "null_damping"), when("space", "hand", "pose")),
        **dict.fromkeys(_GAINS[:2], (when("space", "hand", "pose"), _OF_CONSTANT)),
        **dict.fromkeys(_GAINS[2:], (when("space", "pose"), _OF_CONSTANT)),
        "feedforward": when("space", "joint"),
    }
    ranges: ClassVar[Ranges] = dict.fromkeys(("null_damping", *_GAINS), Interval(0))

    space: Space = "joint"
    """Strikes as joint angles (joint), the hand's position (hand), or its position and orientation (pose). The hand is
    where the whip is attached; pose takes an arm of 3 joints or more in the plane, of 6 or more in space. In hand space
    the impedance acts on the errors of the hand [m, m/s; rad, rad/s]; with --controller position the joints follow the
    path of the hand exactly."""
    home: tuple[float, ...] | None = None
    """Home posture for hand space [rad], near which the arm stays. Default: a posture in which the hand moves
    easily."""
    null_damping: float = 1.0
    """Damping of joint motions that do not move the hand, in hand space [N m s/rad]."""
    stiffness: float | None = None
    """Stiffness of the hand in all directions, for --controller constant in hand space [N/m]; default: a natural
    frequency of 3 Hz, critically damped."""
    damping: float | None = None
    """Damping of the hand in all directions, for --controller constant in hand space [N s/m]; default: as for
    --stiffness."""
    turn_stiffness: float | None = None
    """Rotational stiffness of the hand about all axes, for --space pose [N m/rad]; default: a natural frequency of 3
    Hz, critically damped."""
    turn_damping: float | None = None
    """Rotational damping of the hand about all axes, for --space pose [N m s/rad]; default: as for --turn-stiffness."""

    def build_controller(self) -> Controller:
        """Return the controller that the options or the file describe.

        Raises:
            InputError: An option is given that belongs in the file, or that has no effect in hand space.
        """
        controller = super().build_controller()
        if self.space == "joint":
            return controller
        if self.in_file:
            raise InputError("--space", self.space, f"only without --controller {self.law_or_file}",
                             "write a table [controller.hand] into the file")  # fmt: skip
        return replace(controller, hand=self._hand())

    def law_label(self) -> str:
        """Return a description of the control law; constant impedance of the hand has no presets."""
        if self.space == "joint":
            return super().law_label()
        named = "constant impedance" if self.law_or_file == "constant" else super().law_label()
        return named + (" of the hand's pose" if self.space == "pose" else " of the hand")

    def _hand(self) -> HandControl:
        from whiptool.impedance.controller import HandControl

        try:
            return HandControl(self.home, self.null_damping, orientation=self.space == "pose")
        except InputError as error:
            raise error.renamed("--home" if "posture" in error.name else "--null-damping") from None

    def _named_law(self):
        if self.space == "joint" or self.law_or_file != "constant":
            return super()._named_law()
        if self.preset is not None:
            raise InputError(
                "--preset", self.preset, f"only without --space {self.space}; give --stiffness and --damping"
            )
        from whiptool.impedance import ConstantImpedance
        from whiptool.impedance.controller import hand_impedance

        model = self._model()
        assert model is not None  # every command with a space has one
        usual, d = hand_impedance(model, self._hand()), model.dimension
        K = _with_blocks(usual.K, d, self.stiffness, self.turn_stiffness)
        return ConstantImpedance(K, _with_blocks(usual.B, d, self.damping, self.turn_damping))


def _with_blocks(usual: Matrix | float, d: int, of_place: float | None, of_turn: float | None) -> Matrix:
    """Return gains, those of place or turns alike in all directions and on their own where they are given."""
    gains = np.array(usual)
    for block, others, given in ((slice(d), slice(d, None), of_place), (slice(d, None), slice(d), of_turn)):
        if given is not None:
            gains[block, block] = given * np.eye(len(gains[block]))
            gains[block, others] = gains[others, block] = 0.0
    return tuple(map(tuple, gains.tolist()))
