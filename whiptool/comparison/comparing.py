"""Methods compared in memory: without a run folder, for a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from whiptool.comparison.plan import Comparison
from whiptool.comparison.scene import Scene
from whiptool.comparison.series import Series, collect
from whiptool.comparison.store import Store
from whiptool.errors import expect, refuse_call
from whiptool.goals.target import HIT_RADIUS
from whiptool.goals.zone import Zone, usual_disc
from whiptool.models.numbers import texts, whole
from whiptool.rollout.compiled import CompiledRollout


def compare(
    rollout: CompiledRollout,
    methods: Sequence[str] = ("directl", "cmaes", "gradient"),
    *,
    zone: Zone | None = None,
    targets: int = 12,
    target_seed: int = 0,
    hit_radius: float = HIT_RADIUS,
    max_trials: int = 600,
    seeds: int = 1,
    observations: Sequence[str] = ("goal",),
    **training: Any,
) -> list[Series]:
    """Compare methods by the trials that they need until they hit random targets of a zone (Fig. 6).

    `random` is always added. Learners are trained first, for as long as `training` says.

    Args:
        rollout: Simulator of the model and controller.
        methods: Methods of `METHODS`. Capital letters, hyphens and underscores make no difference.
        zone: Zone of the targets; None: the paper's disc, in space a ball around the default target.
        targets: Number of targets, the same for all methods.
        target_seed: Seed of the targets.
        hit_radius: Hit radius [m].
        max_trials: Largest number of trials at each target.
        seeds: Number of random seeds of each method.
        observations: Observations of the learners.
        training: `episodes`, `trials`, `random_episodes`, `hindsight`, see `Comparison`.

    Returns:
        One series for each method, and for a learner one for each way of using its policy.

    Raises:
        InputError: There is no such method, or a number is out of range.
    """
    expect(CompiledRollout, rollout=rollout)
    scene = Scene(
        model=rollout.model,
        controller=rollout.controller,
        zone=zone or usual_disc(rollout.model),
        targets=whole("targets", targets),
        target_seed=target_seed,
        radii=(hit_radius,),
        cap=whole("max_trials", max_trials),
        tolerance=rollout.tolerance,
        timestep=rollout.timestep if rollout.tolerance is None else None,
    )
    methods, observations = texts("methods", methods), texts("observations", observations)
    plan: dict[str, Any] = {"scene": scene, "methods": methods, "observations": observations, "seeds": seeds} | training
    refuse_call("compare", Comparison, **plan)
    comparison = Comparison(**plan)
    with TemporaryDirectory() as folder:
        units = comparison.units()
        return collect(units, Store(Path(folder)).results(units, desc="compare"))
