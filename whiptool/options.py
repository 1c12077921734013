"""Groups of options, of which every command is composed: it has those groups whose options it uses, and no others."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from whiptool.errors import InputError
from whiptool.models.strike import T_STAY

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.impedance.law import Law
    from whiptool.models.parameters import Model
    from whiptool.rollout.compiled import CompiledRollout
    from whiptool.rollout.interface import Rollout
    from whiptool.target import Target

LAWS = ("oiac", "constant")
MANY_COARSE = 0.1  # share of random strikes that a step may get wrong by more than 0.3 mm before it is said
LONGEST_STAY = 60.0  # [s]
LONGEST_PERIOD = 0.1  # [s]; an arm that is looked at more rarely is not controlled
MANY, MANY_TARGETS = 2**31 - 1, 1_000_000


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every command's options are: they check themselves before anything is computed."""

    def check(self) -> None:
        """Refuse values that break a rule of their own.

        Raises:
            InputError: One does; it is named.
        """


@dataclass(frozen=True, kw_only=True)
class TargetOptions(Options):
    """What is struck at, and for how long the tip is watched."""

    target: tuple[float, ...] = (1.3, 0.0)
    """Target position x y [m], from the shoulder, y up."""
    hit_radius: float = 0.06
    """The target is hit when the tip comes this close [m]."""
    t_stay: float = T_STAY
    """The strike is watched this long after the movement ended [s]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number

        super().check()
        self.build_target()
        number("--t-stay", self.t_stay, low=0, high=LONGEST_STAY)

    def build_target(self) -> Target:
        """Target position and hit radius."""
        from whiptool.target import Target

        return Target(self.target, self.hit_radius)


@dataclass(frozen=True, kw_only=True)
class ModelOptions(Options):
    """Which whip and arm."""

    model: str = "lemon2024"
    """Preset (lemon2024, nah2020-n10, nah2020-n15, nah2020-n20, nah2020-fitted; in space nah2023, ur5e, panda) or the
    path of a .toml file, or of a robot in URDF (.urdf) or MJCF (.xml), which gets the rope of ur5e."""

    def build_model(self) -> Model:
        """The model that `--model` names."""
        from whiptool.models.files import find_model

        return find_model(self.model)


@dataclass(frozen=True, kw_only=True)
class LawOptions(Options):
    """Options that choose the impedance law."""

    usual_preset: ClassVar[str] = "table4"

    controller: str = "oiac"
    """Control law: oiac or constant; or a .toml file with a table [controller] (a run has one)."""
    preset: str | None = None
    """OIAC parameters: printed (the paper's a = 0.2) or table4 (fitted to the errors of Table 4); default: table4.
    Constant impedance: nah2020 (Eq. 22), nah2023, ur5e or panda; default: the model's, or nah2020."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        self.build_controller()

    @property
    def in_file(self) -> bool:
        """Whether the controller, with all its options, stands in a file."""
        return self.controller.endswith(".toml")

    def build_controller(self) -> Controller:
        """The controller of that law, or that of the file.

        Raises:
            InputError: There is none of that name, the file holds none, or an option is given that the file has.
        """
        from whiptool.impedance import Controller
        from whiptool.impedance.files import read_controller

        if not self.in_file:
            return Controller(law=self._named_law())
        self.refuse_beside_file("--preset", self.preset)
        if not Path(self.controller).is_file():
            raise InputError(
                "--controller", self.controller, "a TOML file with a table [controller]", "there is no such file"
            )
        return read_controller(Path(self.controller))

    def refuse_beside_file(self, option: str, value: object) -> None:
        """Refuse an option whose value belongs in the controller's file.

        Raises:
            InputError: It has a value, and the controller stands in a file.
        """
        if self.in_file and value not in (None, False):
            raise InputError(option, value, f"nothing beside --controller {self.controller}", "write it into the file")

    def _named_law(self) -> Law:
        from whiptool.impedance import constant_preset, oiac_preset

        if self.controller not in LAWS:
            raise InputError("--controller", self.controller, ", ".join(LAWS) + ", or a .toml file")
        if self.controller == "oiac":
            return oiac_preset(self.usual_preset if self.preset is None else self.preset)
        return constant_preset(self._constant)

    @property
    def _constant(self) -> str:
        """The preset of the constant law: as given, or that of the model's arm, or the paper's."""
        from whiptool.impedance import CONSTANT_PRESETS

        model = getattr(self, "model", "")  # of commands that have one
        return self.preset or (model if model in CONSTANT_PRESETS else "nah2020")

    def law_label(self) -> str:
        """The law in words, for people."""
        if self.in_file:
            return f"the controller of {Path(self.controller).name}"
        if self.controller == "constant":
            return "constant impedance" + (f" {self._constant}" if self._constant != "nah2020" else "")
        return f"OIAC {self.usual_preset if self.preset is None else self.preset}"


@dataclass(frozen=True, kw_only=True)
class ControllerOptions(LawOptions):
    """The law, and what a real motor adds."""

    feedforward: bool = False
    """Add the torque that the bare arm needs to follow the reference."""
    torque_limit: float | None = None
    """Largest joint torque [N m]."""

    def build_controller(self) -> Controller:
        """The controller that the options describe, or that of the file."""
        controller = super().build_controller()
        self.refuse_beside_file("--feedforward", self.feedforward)
        self.refuse_beside_file("--torque-limit", self.torque_limit)
        if self.in_file:
            return controller
        return replace(controller, feedforward=self.feedforward, torque_limit=self.torque_limit)

    def controller_label(self) -> str:
        """The controller in words, for people."""
        return self.law_label() + (" with feedforward" if self.feedforward else "")


@dataclass(frozen=True, kw_only=True)
class SimulatedControllerOptions(ControllerOptions):
    """The controller of a simulated arm; a rig's holds its torque for a cycle in any case."""

    control_period: float | None = None
    """Hold the torque for this long [s], as a rig does."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number

        super().check()
        if self.control_period is not None:
            number("--control-period", self.control_period, low=0, high=LONGEST_PERIOD, strict=True)

    def build_controller(self) -> Controller:
        """The controller that the options describe, or that of the file."""
        controller = super().build_controller()
        self.refuse_beside_file("--control-period", self.control_period)
        return controller if self.in_file else replace(controller, control_period=self.control_period)


@dataclass(frozen=True, kw_only=True)
class StepOptions(Options):
    """How finely the compiled simulator steps."""

    timestep: float | None = None
    """Integration step [s]; default: 0.00025, less for stiff whips."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.dynamics.stepping import LARGEST_STEP, SMALLEST_STEP
        from whiptool.models.parameters import number

        super().check()
        if self.timestep is not None:
            number("--timestep", self.timestep, low=SMALLEST_STEP, high=LARGEST_STEP)

    def step_for(self, model: Model) -> float:
        """The compiled simulator's step [s]."""
        from whiptool.dynamics.modes import steady_timestep
        from whiptool.rollout.compiled import TIMESTEP

        return steady_timestep(model, TIMESTEP) if self.timestep is None else self.timestep

    def warn_if_coarse(self, model: Model, controller: Controller, target: tuple[float, ...], t_stay: float) -> None:
        """Say so on stderr where the step that was asked for lets random strikes miss otherwise than a finer one."""
        import numpy as np

        from whiptool.models.strike import default_bounds
        from whiptool.rollout.refinement import share_too_coarse

        if self.timestep is None:
            return
        share, finer = share_too_coarse(
            model,
            controller,
            default_bounds(model.arm),
            timestep=self.timestep,
            t_stay=t_stay,
            target=np.array(target),
        )
        if share > MANY_COARSE:
            said = f"{share:.0%} of random strikes miss by other distances at {1e3 * finer:.3g} ms"
            print(f"whiptool: --timestep {self.timestep:g} is too coarse: {said}", file=sys.stderr)

    def build_compiled(self, model: Model, controller: Controller) -> CompiledRollout:
        """Return the compiled simulator of a model and controller."""
        from whiptool.rollout.compiled import CompiledRollout

        return CompiledRollout(model, controller, timestep=self.step_for(model))


@dataclass(frozen=True, kw_only=True)
class SimulatorOptions(StepOptions):
    """Which simulator, and how finely it steps."""

    simulator: str = "compiled"
    """compiled (CasADi) or reference (MuJoCo)."""
    timestep: float | None = None
    """Integration step [s]; default: 0.00025 compiled, less for stiff whips; at most 0.0001 reference."""
    integrator: str | None = None
    """Of the reference: RK4, Euler, implicit or implicitfast; default: RK4 unless the whip is too stiff for it."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        if self.simulator not in ("compiled", "reference"):
            raise InputError("--simulator", self.simulator, "compiled, reference")
        if self.integrator is None:
            return
        if self.simulator != "reference":
            raise InputError("--integrator", self.integrator, "nothing, unless --simulator reference is given")
        from whiptool.rollout.reference import check_integrator

        check_integrator(self.integrator)

    def build_rollout(self, model: Model, controller: Controller) -> Rollout:
        """The simulator that `--simulator` names."""
        if self.simulator == "compiled":
            return self.build_compiled(model, controller)
        from whiptool.rollout.reference import ReferenceRollout

        return ReferenceRollout(model, controller, timestep=self.timestep, integrator=self.integrator)


def whole(name: str, value: int, *, low: int = 1, high: int = MANY) -> int:
    """A whole number of a range.

    Raises:
        InputError: It is out of the range.
    """
    if not low <= value <= high:
        raise InputError(name, value, f"a whole number from {low} to {high}")
    return value


def check_training(episodes: int, trials: int, random_episodes: int, hindsight: int) -> None:
    """Refuse lengths of a training (Algorithm 1) in which nothing is learned, or that no machine holds.

    Raises:
        InputError: One is out of range.
    """
    whole("--episodes", episodes)
    whole("--trials", trials, low=2, high=MANY_TARGETS)
    whole("--hindsight", hindsight, low=0, high=1000)
    if not 0 <= random_episodes < episodes:
        allowed = (
            f"a whole number from 0 to {episodes - 1}, fewer than --episodes {episodes}: random episodes come first, "
        )
        allowed += "and nothing is learned in them"
        fix = f"give --random-episodes {episodes // 5}; it is 50 unless given"
        raise InputError("--random-episodes", random_episodes, allowed, fix)


def refuse_idle(options: Any, idle: Mapping[str, str], usual: Any = None) -> None:
    """Refuse options that would change nothing, lest they are taken for ones that did.

    Args:
        options: As parsed.
        idle: Names of fields that say nothing here, and what is allowed instead of them.
        usual: The same options where none is given; default: the class's defaults.

    Raises:
        InputError: One of them is not at its default.
    """
    defaults = {f.name: f.default if usual is None else getattr(usual, f.name) for f in fields(options)}
    for name, allowed in idle.items():
        if getattr(options, name) != defaults[name]:
            raise InputError("--" + name.replace("_", "-"), getattr(options, name), allowed)
