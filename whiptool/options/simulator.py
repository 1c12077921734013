"""Options of the simulator: which one, and how finely it steps."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from whiptool.errors import InputError
from whiptool.options.base import OptionGroup

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.models.parameters import Model
    from whiptool.rollout.compiled import CompiledRollout
    from whiptool.rollout.interface import Rollout

Simulator = Literal["compiled", "reference"]
Integrator = Literal["RK4", "Euler", "implicit", "implicitfast"]  # those of `whiptool.rollout.reference`
MANY_COARSE = 0.1  # share of random strikes that a step may get wrong by more than 0.3 mm before it is said


@dataclass(frozen=True, kw_only=True)
class StepOptions(OptionGroup):
    """How finely the compiled simulator steps."""

    heading: ClassVar[str] = "simulation"
    first: ClassVar[tuple[str, ...]] = ("timestep",)

    timestep: float | None = None
    """Integration step [s]; default: 0.00025, less for stiff whips."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.dynamics.stepping import LARGEST_STEP, SMALLEST_STEP
        from whiptool.models.parameters import number

        super().check()
        if self.timestep is not None:
            number("--timestep", self.timestep, low=SMALLEST_STEP, high=LARGEST_STEP)

    def step_for(self, model: Model, controller: Controller) -> float:
        """The compiled simulator's step [s]."""
        from whiptool.dynamics.modes import steady_timestep
        from whiptool.rollout.compiled import TIMESTEP

        if self.timestep is not None:
            return self.timestep
        return steady_timestep(model, TIMESTEP, prescribed=controller.prescribed)

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

        return CompiledRollout(model, controller, timestep=self.step_for(model, controller))


@dataclass(frozen=True, kw_only=True)
class SimulatorOptions(StepOptions):
    """Which simulator, and how finely it steps."""

    simulator: Simulator = "compiled"
    """CasADi's or MuJoCo's."""
    timestep: float | None = None
    """Integration step [s]; default: 0.00025 compiled, less for stiff whips; at most 0.0001 reference."""
    integrator: Integrator | None = None
    """Of the reference; default: RK4 unless the whip is too stiff for it."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        if self.integrator is not None and self.simulator != "reference":
            raise InputError("--integrator", self.integrator, "nothing, unless --simulator reference is given")

    def build_rollout(self, model: Model, controller: Controller) -> Rollout:
        """The simulator that `--simulator` names."""
        if self.simulator == "compiled":
            return self.build_compiled(model, controller)
        from whiptool.rollout.reference import ReferenceRollout

        return ReferenceRollout(model, controller, timestep=self.timestep, integrator=self.integrator)
