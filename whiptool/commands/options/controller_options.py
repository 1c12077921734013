"""Options of the controller: control law, feedforward, torque limit and control period."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from whiptool.commands.options.option_group import Condition, Conditions, Names, OptionGroup
from whiptool.errors import InputError
from whiptool.words import as_named

if TYPE_CHECKING:
    from whiptool.impedance import Controller
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
    """Control law (oiac: online impedance adaptation), or a TOML file. The file has a table [controller], as
    config.toml of a run has. With position the joints follow the commanded path exactly, as those of stiff robots do.
    Default: position for a robot's arm, constant for nah2023, oiac for planar arms."""
    preset: Preset | None = None
    """Parameters of the control law. OIAC: printed (the paper's a = 0.2) or table4 (fitted to the errors of Table 4);
    default: table4. Constant impedance: nah2020 (Eq. 22), nah2023, ur5e or panda; default: that of the model, otherwise
    nah2020."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        self.build_controller()

    @property
    def law_or_file(self) -> str:
        """The given law or file; else the law of the given preset, or the default law of the model."""
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

    control_period: float | None = None
    """Hold the torque constant for this time [s], as a sampled controller does. Default: continuous control."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        super().check()
        if self.control_period is not None:
            number("--control-period", self.control_period, low=0, high=LONGEST_PERIOD, strict=True)

    def build_controller(self) -> Controller:
        """Return the controller that the options describe, or that of the file."""
        controller = super().build_controller()
        if self.in_file:
            return controller
        return replace(controller, control_period=self.control_period)
