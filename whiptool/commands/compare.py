"""Compare methods over many targets and seeds (Fig. 6): `python -m whiptool.compare --methods directl ga sac`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from whiptool.commands import cli, run_folders
from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import (
    MANY_TARGETS,
    Condition,
    Conditions,
    Count,
    Ranges,
    ResumableOptions,
    unless,
)
from whiptool.commands.options.search_options import (
    Methods,
    Observation,
    TrainingOptions,
    learned_with,
    spell_methods,
)
from whiptool.commands.options.strike_options import StepOptions
from whiptool.commands.options.target_options import ZoneGoalOptions, ZoneOptions
from whiptool.errors import InputError
from whiptool.runs import CITATIONS
from whiptool.whole_files import write_whole
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.comparison.plan import Comparison
    from whiptool.comparison.series import Series
    from whiptool.runs import RunFolder

QUICK: dict[str, Any] = {
    "targets": 12,
    "seeds": 1,
    "max_trials": 40,
    "tighter": (0.03,),
    "episodes": 10,
    "trials": 40,
    "random_episodes": 4,
    "further_episodes": None,
    "further_methods": ("directl", "sac"),
}

LEARNING = ("observation", "episodes", "trials", "random_episodes", "hindsight")
_LEARNED = Condition("only with a learner among --methods", lambda o: bool(learned_with(o.methods)))


@dataclass(frozen=True, kw_only=True)
class ComparisonOptions(
    ResumableOptions,
    TrainingOptions,
    StepOptions,
    SimulatedControllerOptions,
    ModelOptions,
    ZoneOptions,
):
    """Options that `compare` and `reproduce` share; --target is the centre of the zone of targets."""

    may_be_empty: ClassVar[tuple[str, ...]] = ("tighter",)
    changeable: ClassVar[tuple[str, ...]] = ("workers", "cluster")
    heading: ClassVar[str] = "comparison"
    only_with: ClassVar[Conditions] = {"workers": unless("cluster", why=", which has its own")}
    ranges: ClassVar[Ranges] = {
        "targets": Count(high=MANY_TARGETS),
        "target_seed": Count(0),
        "seeds": Count(high=10_000),
        "max_trials": Count(high=MANY_TARGETS),
        "further_episodes": Count(),
        "workers": Count(),
    }
    first: ClassVar[tuple[str, ...]] = (
        "targets",
        "seeds",
        "workers",
        "quick",
    )

    targets: int = 300
    """Number of random targets, the same for all methods."""
    target_seed: int = 0
    """Seed from which the targets are drawn (default: 0)."""
    seeds: int = 3
    """Number of random seeds: 0, 1, ..."""
    max_trials: int = 600
    """Largest number of trials at each target."""
    tighter: tuple[float, ...] = (0.03, 0.01)
    """Also evaluate these smaller hit radii [m]; learners are trained with --hit-radius."""
    further_episodes: int | None = None
    """Training episodes for observations other than tip (default: --episodes)."""
    workers: int | None = None
    """Number of processes (default: one per core, at most 8). The results do not depend on it."""
    cluster: str | None = None
    """Run on a Ray cluster: its address, or auto for the cluster that this machine belongs to."""
    quick: bool = False
    """Run a small version in a minute or two. It has few targets, one seed and a short training, unless the options are
    given."""

    def check(self) -> None:
        super().check()
        widest = self.hit_radius
        for radius in self.tighter:
            if not 0 < radius < widest or self.tighter.count(radius) > 1:
                allowed = f"different hit radii between 0 and --hit-radius, {widest:g} m"
                raise InputError("--tighter", radius, allowed)

    def needs(self) -> tuple[str, ...]:
        return () if self.cluster is None else ("ray",)

    def usual(self, name: str) -> object:
        """Return the default of an option; with `--quick` some are smaller."""
        return QUICK[name] if self.quick and name in QUICK else super().usual(name)

    def processes(self) -> int:
        """Number of worker processes: as given, but at most one per core, or 2 on one core; default: one per core, at
        most 8.
        """
        cores = os.cpu_count() or 1
        if self.workers is not None and self.workers > max(2, cores):
            print(f"whiptool: --workers {self.workers}: {max(2, cores)} are used, one per core", file=sys.stderr)
            return max(2, cores)
        return min(cores, 8) if self.workers is None else self.workers

    def comparison(self, methods: Sequence[str], observations: Sequence[str]) -> Comparison:
        """Return the comparison that the options describe.

        Raises:
            InputError: An option is out of range.
        """
        from whiptool.comparison.plan import Comparison
        from whiptool.comparison.target_scene import TargetScene
        from whiptool.rl.settings import TrainingPlan

        model, controller = self.build_model(), self.build_controller()
        scene = TargetScene(
            model=model,
            controller=controller,
            zone=self.build_zone(model),
            arrival=self.build_arrival(),
            targets=self.targets,
            target_seed=self.target_seed,
            radii=(self.hit_radius, *self.tighter),
            cap=self.max_trials,
            t_stay=self.t_stay,
            tolerance=self.tolerance,
            timestep=self.timestep,
        )
        return Comparison(
            scene=scene,
            methods=tuple(methods),
            observations=tuple(observations),
            seeds=self.seeds,
            plan=TrainingPlan(self.episodes, self.trials, self.random_episodes, self.hindsight),
            further_episodes=self.further_episodes,
        )


@dataclass(frozen=True, kw_only=True)
class CompareOptions(ComparisonOptions, ZoneGoalOptions):
    """Options of `compare`: trials until the first hit of many random targets, method by method (Fig. 6)."""

    first: ClassVar[tuple[str, ...]] = ("methods", "observation", "zone")
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(LEARNING, _LEARNED),
        "further_episodes": (
            _LEARNED,
            Condition("only with an observation other than tip", lambda o: set(o.observation) != {"tip"}),
        ),
        **dict.fromkeys(ZoneOptions.of_disc, unless("zone", "fast")),
    }

    methods: Methods = ("directl", "ga", "cmaes", "gradient", "sac", "td3", "ddpg", "ppo")
    """Search methods. They are those of whiptool optimize; random is always added. sac, td3, ddpg and ppo are trained
    once per seed."""
    observation: tuple[Observation, ...] = ("goal",)
    """Observation of the learners: the tip, tip minus target (relative), or tip and target (goal). They are trained
    separately for each observation."""
    zone: Literal["disc", "fast"] = "disc"
    """Zone of targets: disc around --target, or fast, where the tip of random strikes moves at 3 m/s or more."""

    def __post_init__(self) -> None:
        spell_methods(self, "methods")

    def check(self) -> None:
        from whiptool.optimizers import find_method

        super().check()
        for method in self.methods:
            find_method(method)

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), *learned_with(self.methods))


_EXAMPLE = (
    "Compare how many trials each method needs until its first hit of each of many random targets, as in Fig. 6 of "
    "Wang et al. 2024. "
    "Example: python -m whiptool.compare --quick --methods directl sac"
)


def _work(options: CompareOptions) -> int:
    comparison = options.comparison(options.methods, options.observation)
    with open_folder("compare", options, comparison) as folder:
        return _compare(options, comparison, folder)


def _compare(options: CompareOptions, comparison: Comparison, folder: RunFolder) -> int:
    """Work on what is not done yet, write everything, tell people or programs."""
    start = time.monotonic()
    from whiptool.comparison.series import collect, difficulty_sentence
    from whiptool.comparison.target_scene import fast_region, words
    from whiptool.comparison.units import Store

    scene = comparison.scene
    target = options.build_target(scene.model).position
    options.warn_if_coarse(scene.model, scene.controller, target, scene.t_stay)
    store = Store(folder.path, workers=options.processes(), cluster=options.cluster)
    if options.zone == "fast":
        region = fast_region(comparison.scene, store, quick=options.quick)
        comparison = replace(comparison, scene=replace(comparison.scene, zone=region))
    units, hard = comparison.units(), comparison.difficulty(quick=options.quick)
    results = store.results([hard, *units], desc="compare")
    series, task = collect(units, results), results[hard.key]
    summary = {
        "rows": [one.row() for one in series],
        "task": task,
        "targets": comparison.scene.targets,
        "arrival": comparison.scene.arrival.table(),
        "cap": comparison.scene.cap,
        "worker_deaths": store.deaths,
        "wall_time": time.monotonic() - start,
    }
    folder.write_result(summary)
    rule = comparison.scene.arrival
    asked = "" if rule.only_points else f", {rule}"
    targets = f"{counted(comparison.scene.targets, 'target')}: {words(comparison.scene.zone)}"
    about = f"{targets}{asked}. {difficulty_sentence(task)}"
    text = save(folder.path, series, about)
    files = f"run folder {folder.path} (table.csv, table.md, bars.png, ecdf.png, {CITATIONS})"
    options.tell(summary, f"{text}\n{files}")
    return 0


def open_folder(command: str, options: ComparisonOptions, comparison: Comparison) -> RunFolder:
    """Return the run folder of a command: a new folder, or that of the run to resume.

    Raises:
        InputError: The folder cannot be made, or holds a run with another configuration; or no strike can begin.
    """
    from whiptool.limits.all_limits import AllLimits, default_limits

    scene = comparison.scene
    space = scene.controller.strike_space(scene.model.arm)
    limits = AllLimits(
        default_limits(scene.model, prescribed=scene.controller.prescribed), by_joints=space.kind == "joint"
    )
    limits.narrowed(space.bounds)  # as every unit does, which names no options
    return run_folders.open_folder(
        options, command, run_folders.configuration(options, command, scene.model, scene.controller)
    )


def save(folder: Path, series: Sequence[Series], about: str) -> str:
    """Write tables and plots into a folder, and return the tables as Markdown under the heading `about`."""
    import whiptool.comparison.series as tables
    from whiptool.comparison.trial_plots import save_comparison

    parts = [about, tables.as_markdown(tables.main_table(series)), tables.CONVENTION_NOTE]
    if len({one.hit_radius for one in series}) > 1:
        parts.append(tables.as_markdown(tables.radius_table(series)))
    if any(one.learned for one in series):
        parts.append(tables.as_markdown(tables.convention_table(series)))
    text = "\n\n".join(parts) + "\n"
    write_whole(folder / "table.csv", tables.as_csv(series))
    write_whole(folder / "table.md", text)
    save_comparison(folder, series)
    return text


main = cli.command(CompareOptions, "compare", _EXAMPLE, _work, quick=QUICK)
