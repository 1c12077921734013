"""Options of the simulator and its integration steps."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from whiptool.commands.options.option_group import Conditions, Names, OptionGroup, unless, when

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.models.parameters import Model
    from whiptool.rollout.compiled import CompiledRollout
    from whiptool.rollout.interface import Rollout

Simulator = Literal["compiled", "reference"]
MANY_COARSE = 0.1  # share of random strikes that a step may get wrong by more than 0.3 mm before it is said


@dataclass(frozen=True, kw_only=True)
class StepOptions(OptionGroup):
    """Options for the accuracy of the compiled simulator."""

    heading: ClassVar[str] = "simulation"
    first: ClassVar[tuple[str, ...]] = ("tolerance",)
    only_with: ClassVar[Conditions] = {"tolerance": unless("timestep")}

    tolerance: float | None = None
    """Largest integration error of the miss distance [m] (default: 1e-4). The integration steps are chosen
    accordingly."""
    timestep: float | None = None
    """Use equal integration steps of this length [s], without an estimate of their error. Default: steps that
    --tolerance needs."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
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
