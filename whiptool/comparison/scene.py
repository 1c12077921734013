"""What is struck with and at: the same for all methods that are compared."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from whiptool.goals.arrival_rule import ArrivalRule, sample_goals
from whiptool.goals.goals import Goals
from whiptool.goals.zone import Disc, Zone, check_fits
from whiptool.impedance import Controller
from whiptool.models import Model
from whiptool.models.strike import T_STAY
from whiptool.rollout import CompiledRollout


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is struck with and at: the same for all methods.

    Args:
        model, controller: Whip, arm, and law.
        zone: Zone of the targets.
        arrival: How the tip has to arrive there.
        targets: Number of targets.
        target_seed: They are drawn with it.
        radii: Hit radii [m]; with the first one learners are trained.
        cap: Trials at most at each target.
        t_stay: Time after the movement during which the tip is followed [s].
        tolerance, timestep: Tolerance and timestep of the compiled rollout.

    Raises:
        InputError: Zone or hit radius do not fit the model.
    """

    model: Model
    controller: Controller
    zone: Zone = field(default_factory=Disc)
    arrival: ArrivalRule = field(default_factory=ArrivalRule)
    targets: int = 300
    target_seed: int = 0
    radii: tuple[float, ...] = (0.06, 0.03, 0.01)
    cap: int = 600
    t_stay: float = T_STAY
    tolerance: float | None = None
    timestep: float | None = None

    def __post_init__(self) -> None:
        for radius in self.radii:
            check_fits(self.zone, self.model, radius)

    def points(self) -> np.ndarray:
        """Where the targets are, (targets, d) [m]."""
        return self.goals().positions

    def goals(self) -> Goals:
        """The targets, at the widest hit radius, with how the tip has to arrive."""
        rng = np.random.default_rng(self.target_seed)
        return sample_goals(self.zone, self.arrival, self.radii[0], self.targets, rng)

    def rollout(self, threads: int | None = None) -> CompiledRollout:
        """Return the simulator that all methods share."""
        accuracy = {"tolerance": self.tolerance, "timestep": self.timestep}
        return CompiledRollout(self.model, self.controller, **accuracy, threads=threads)
