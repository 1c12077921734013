"""Build a strike map, and look up strikes in it: `python -m whiptool.map build`, `python -m whiptool.map strike`."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from tyro.conf import Positional, arg

from whiptool.commands import cli, run_folders
from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.live_options import LiveOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import (
    MANY_TARGETS,
    Condition,
    Conditions,
    Count,
    OutputOptions,
    Ranges,
    ResumableOptions,
    SeedOptions,
)
from whiptool.commands.options.strike_options import LimitOptions, StepOptions, TrajectoryOptions
from whiptool.commands.options.target_options import GoalOptions, RegionOptions
from whiptool.commands.pictures import MAP, StrikeRun, tell_strike
from whiptool.commands.strike_lines import (
    limit_lines,
    limits_table,
    outcome_lines,
    outcome_table,
    strike_lines,
    with_cure,
)
from whiptool.extras import optional

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.models.strike import Strike
    from whiptool.objective import Outcome
    from whiptool.strike_map.strike_map import StrikeMap
    from whiptool.strike_map.striker import Striker


@dataclass(frozen=True, kw_only=True)
class BuildOptions(
    ResumableOptions,
    LiveOptions,
    SeedOptions,
    LimitOptions,
    StepOptions,
    SimulatedControllerOptions,
    ModelOptions,
    RegionOptions,
):
    """Options of `map build`, which builds a map: the strike for any goal of a region, without a search.

    Without --zone-radius, --sector and --region the region is most of what the model can reach: for a robot a shell
    around its base, above the floor, with all arrival angles.
    """

    first: ClassVar[tuple[str, ...]] = (
        "random_strikes",
        "rounds",
    )
    in_space: ClassVar[bool] = True

    ranges: ClassVar[Ranges] = {
        **dict.fromkeys(("random_strikes", "room", "goals", "tests"), Count(high=MANY_TARGETS)),
        **dict.fromkeys(("rounds", "gate_strikes"), Count(0, MANY_TARGETS)),
    }

    random_strikes: int = 8192
    """Number of random strikes with which the map begins. Its first entries are the points of the region that they
    pass."""
    room: int = 2
    """Largest number of strikes that are stored in each cell of the region at first; every round adds one. A cell is
    two hit radii and two cones wide."""
    rounds: int = 4
    """Number of rounds in which missed goals are added. In each round the map is asked for random goals; strikes for
    those that it misses are refined and added to it."""
    goals: int = 1000
    """Number of random goals in each round."""
    gate_strikes: int = 20_000
    """Number of candidate strikes on which the ranking network is trained; 0: no network."""
    tests: int = 300
    """Number of random goals on which the finished map is tested."""

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), *(("torch",) if self.gate_strikes else ()))


@dataclass(frozen=True, kw_only=True)
class MapStrikeOptions(OutputOptions, TrajectoryOptions, GoalOptions):
    """Options of `map strike`, which looks up a strike in a map; the default of --hit-radius is that of the map."""

    of_this_call: ClassVar[tuple[str, ...]] = ("video",)
    only_with: ClassVar[Conditions] = {"t_stay": Condition("only without a map, which has its own", lambda o: False)}
    first: ClassVar[tuple[str, ...]] = (
        "run",
        "refine",
        "video",
    )

    run: Positional[Annotated[Path, arg(metavar="MAP")]]
    """Run folder of map build, or a model: lemon2024, panda or ur5e. The maps of these models come with the package."""
    refine: bool = True
    """Refine the strike of the map by rollouts. Without refinement the first strike that the map returns is taken."""
    video: bool = True
    """Render the strike as a video."""


_BUILD = (
    "Build a map, which then returns a strike for any goal of a region without a search. The default region is most of "
    "the reach of the model. "
    "Example: python -m whiptool.map build --zone-radius 0.3 --hit-radius 0.01"
)
_STRIKE = "Look up the strike for a goal in a map. Example: python -m whiptool.map strike lemon2024 --target 1.2 0.1"


def _build(options: BuildOptions) -> int:
    from whiptool.strike_map.building import building_of, built

    if options.gate_strikes:
        optional("torch", "whiptool map").set_num_threads(1)  # the same result on any number of cores
    config = run_folders.configuration(options, "map", options.build_model(), options.build_controller())
    building = building_of(config)
    with run_folders.open_folder(options, "map", config) as folder, options.shown(folder.path):
        start = time.monotonic()
        strike_map = built(building, folder.path)
        summary = _tested(options, strike_map, time.monotonic() - start)
        folder.write_result(summary)
        options.tell(summary, _text(summary, folder.path))
    return 0


def _tested(options: BuildOptions, strike_map: StrikeMap, seconds: float) -> dict[str, Any]:
    """Strike at goals that the map has not seen."""
    from whiptool.runs import code_version

    goals = strike_map.region.draw(options.tests, np.random.default_rng([options.seed, 2**31]))
    first = strike_map.striker.strike(strike_map.kept(goals), goals)
    start = time.monotonic()
    refined = strike_map.refined(goals)
    each = (time.monotonic() - start) / options.tests
    return {
        "model": strike_map.striker.rollout.model.name,
        "answers": len(strike_map.answers),
        "tests": options.tests,
        "hit_radius": options.hit_radius,
        "arrival": strike_map.region.rule.table(),
        "one_shot": float(first.hit.mean()),
        "refined": float(refined.struck.hit.mean()),
        "median_miss": float(np.median(refined.struck.distance)),
        "rollouts_per_goal": refined.rollouts / options.tests,
        "derivatives_per_goal": refined.derivatives / options.tests,
        "seconds_per_goal": each,
        "wall_time": seconds,
        "seed": options.seed,
        "version": code_version(),
    }


def _text(summary: dict[str, Any], path: Path) -> str:
    return "\n".join(
        [
            f"map: {summary['answers']} answers for {summary['model']} in {summary['wall_time']:.1f} s",
            f"  one shot       {summary['one_shot']:.1%} of {summary['tests']} goals are hit, without refinement",
            f"  refined        {summary['refined']:.1%}, median miss {1e3 * summary['median_miss']:.3f} mm; "
            f"{summary['rollouts_per_goal']:.1f} rollouts, {summary['derivatives_per_goal']:.2f} times derivatives and "
            f"{summary['seconds_per_goal']:.3f} s a goal",
            f"  run folder     {path} (answers, gate)",
        ]
    )


def _usual(run: Path) -> MapStrikeOptions:
    """Return the options of strikes from a map: they hit within its radius unless another is given."""
    from whiptool.runs import read_config

    kept = read_config(run).get("options", {}) if run.exists() else {}
    return MapStrikeOptions(run=run, **{name: kept[name] for name in ("hit_radius",) if name in kept})


def _strike(options: MapStrikeOptions) -> int:
    """Play a strike of the map and print the result, replay it in MuJoCo, then draw."""
    from whiptool.models.strike import named_strike
    from whiptool.objective import Objective
    from whiptool.runs import code_version
    from whiptool.strike_map.building import load_map

    run_folders.check_out(options)
    strike_map = load_map(options.run)
    striker = strike_map.striker
    rollout, model, limits = striker.rollout, striker.rollout.model, striker.limits.members
    options.check_posture(model)
    target = options.build_target(model)
    with warnings.catch_warnings(action="ignore"):  # what it misses or is beyond is printed
        strike = strike_map.strike(target, refined=options.refine)
    trajectory = rollout.trajectory(strike, t_stay=striker.t_stay)
    table: dict[str, Any] = {"beyond": None, **limits_table(striker.limits, trajectory, strike, model.arm)}
    beyond = table["beyond"]
    options.refuse_beyond(beyond)
    commanded = options.build_trajectory(model, strike, striker.t_stay, limits)  # refused before anything is written
    objective = Objective(rollout, target, t_stay=striker.t_stay, bounds=striker.bounds, limits=limits)
    outcome, named = objective.judge(trajectory, strike), named_strike(strike, model.arm)
    bounds = zip(striker.bounds.lower, striker.bounds.upper, strict=True)
    lines = [f"one strike from the map of {model.name}", *strike_lines(named, model.arm, bounds)]
    said = with_cure(beyond, table.get("overlap", False))
    refused = [f"  outcome        refused, as it is beyond the limits: {said}"]
    lines += refused if outcome.refused is not None else outcome_lines(outcome, target, model.arm)
    lines += limit_lines(striker.limits, {**table, "beyond": None} if outcome.refused is not None else table)
    summary = {"strike": named, **outcome_table(outcome, target), "refined": options.refine, **table}
    summary |= {"model": model.name, "version": code_version()}
    config = run_folders.configuration(options, "map strike", model, rollout.controller)
    if not options.run.exists():  # a map of the package, whose name is not a path
        config["options"]["run"] = options.run.name
    with run_folders.new_folder(options, "map-strike", config) as folder:
        tell_strike(
            options,
            folder,
            StrikeRun(trajectory, model, target, MAP, beyond),
            summary,
            lines,
            later=lambda: _replayed(striker, strike, target, outcome),
        )
    options.write_trajectory(commanded, rollout.controller)
    return 0


def _replayed(striker: Striker, strike: Strike, target: Target, outcome: Outcome) -> tuple[dict, str]:
    """Return how a strike does in MuJoCo, for the result and for people."""
    from whiptool.rollout.reference import replay

    rollout, place = striker.rollout, np.array(target.position)
    expected = {"t_stay": striker.t_stay, "expected": outcome.miss_distance}
    miss = replay(rollout.model, rollout.controller, strike, place, **expected).miss_distance
    said = "no result in MuJoCo" if miss is None else f"{miss:.4f} m in MuJoCo"
    return {"reference": {"miss_distance": miss}}, f"  reference      {said}"


main = cli.subcommands(
    "map",
    {
        "build": (
            "build the map of a region of goals",
            cli.command(BuildOptions, "map", _BUILD, _build, prog="whiptool map build"),
        ),
        "strike": (
            "look up the strike for a goal in a map",
            cli.command(
                MapStrikeOptions, "map strike", _STRIKE, _strike, of_run=_usual, named={"run_folder": "run folder"}
            ),
        ),
    },
)
