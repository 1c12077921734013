"""Build a map of strikes, and strike from it: `python -m whiptool.map build`, `python -m whiptool.map strike`."""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from tyro.conf import Positional

from whiptool.commands import cli
from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.limit_options import LimitOptions
from whiptool.commands.options.option_group import (
    MANY_TARGETS,
    Condition,
    Conditions,
    OutputOptions,
    ResumableOptions,
    SeedOptions,
    flag,
    whole,
)
from whiptool.commands.options.region_options import RegionOptions
from whiptool.commands.options.simulator_options import StepOptions
from whiptool.commands.options.target_options import GoalOptions, ModelOptions
from whiptool.commands.options.trajectory_options import TrajectoryOptions
from whiptool.commands.pictures import StrikePictures
from whiptool.errors import InputError
from whiptool.extras import optional

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.models.strike import Strike
    from whiptool.strike_map import StrikeMap

WORDS = {"build": "build the map of a region of goals", "strike": "look up the strike for a goal in a map"}


@dataclass(frozen=True, kw_only=True)
class BuildOptions(
    ResumableOptions,
    SeedOptions,
    LimitOptions,
    StepOptions,
    SimulatedControllerOptions,
    ModelOptions,
    RegionOptions,
):
    """Build a map of strikes: the strike for any goal of a region, without a search.

    Without --zone-radius, --sector and --region the region is most of what the model can reach: of a robot a shell
    around its base, above the floor, with arrival angles of the full turn.
    """

    first: ClassVar[tuple[str, ...]] = (
        "random_strikes",
        "rounds",
    )
    in_space: ClassVar[bool] = True

    random_strikes: int = 8192
    """Number of random strikes. Their passages through the region are the first answers of the map."""
    room: int = 2
    """Number of answers in each cell of the region at first (a cell is two hit radii and two cones wide); each round of
    practice adds one."""
    rounds: int = 4
    """Number of rounds of practice. In each round the goals that the map misses are refined and added to it."""
    goals: int = 1000
    """Number of random goals in each round."""
    gate_strikes: int = 20_000
    """Number of candidate strikes on which the ranking network is trained; 0: no network."""
    tests: int = 300
    """Number of random goals on which the finished map is tested."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        for name in ("random_strikes", "room", "goals", "tests"):
            whole(flag(name), getattr(self, name), high=MANY_TARGETS)
        for name in ("rounds", "gate_strikes"):
            whole(flag(name), getattr(self, name), low=0, high=MANY_TARGETS)

    def needs(self) -> tuple[str, ...]:
        """Return the modules of extras that the command imports with these options."""
        return ("torch",) if self.gate_strikes else ()


@dataclass(frozen=True, kw_only=True)
class StrikeOptions(OutputOptions, TrajectoryOptions, GoalOptions):
    """Strike at a goal from a map; without --hit-radius at the map's."""

    of_this_call: ClassVar[tuple[str, ...]] = ("video",)
    only_with: ClassVar[Conditions] = {"t_stay": Condition("only without a map, which has its own", lambda o: False)}
    first: ClassVar[tuple[str, ...]] = (
        "run",
        "refine",
        "video",
    )

    run: Positional[Path]
    """Run folder of `whiptool map build`, or a preset whose map comes with the package: lemon2024, panda, ur5e."""
    refine: bool = True
    """Refine the strike of the map by rollouts. Without refinement the first guess is the answer."""
    video: bool = True
    """Render the strike as a video."""


_BUILD = (
    "Build a map, which returns a strike for any goal of a region without a search. "
    "Example: python -m whiptool.map build --zone-radius 0.3 --hit-radius 0.01"
)
_STRIKE = "Look up a strike in a map. Example: python -m whiptool.map strike lemon2024 --target 1.2 0.1"


def main(args: Sequence[str] | None = None) -> int:
    """The command line; the exit status is 0, 1 for a failure, 2 for bad input, 130 when interrupted."""
    words = list(sys.argv[1:] if args is None else args)

    def command() -> int:
        if words[:1] in (["-h"], ["--help"]):
            print("usage: whiptool map build|strike [options]\n")
            print("\n".join(f"  {word:8s} {what}" for word, what in WORDS.items()))
            return 0
        if not words or words[0] not in WORDS:
            raise InputError("map", " ".join(words[:1]), ", ".join(WORDS), "such as `whiptool map build --help`")
        return _build(words[1:]) if words[0] == "build" else _strike(words[1:])

    return cli.run(command)


def _build(args: Sequence[str]) -> int:
    options = cli.parse_resumable(BuildOptions, command="map", description=_BUILD, args=args, prog="whiptool map build")
    with cli.options_named(options):
        from whiptool.strike_map.building import built
        from whiptool.strike_map.map_runs import building_of

        if options.gate_strikes:
            optional("torch", "whiptool map").set_num_threads(1)  # the same result on any number of cores

        config = cli.configuration(options, "map", options.build_model(), options.build_controller())
        building = building_of(config)
        with cli.open_folder(options, "map", config) as folder:
            start = time.monotonic()
            strike_map = built(building, folder.path)
            summary = _tested(options, strike_map, time.monotonic() - start)
            folder.write_result(summary)
            print(json.dumps(summary, allow_nan=False) if options.json else _text(summary, folder.path))
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


def _strike(args: Sequence[str]) -> int:
    options = cli.parse(StrikeOptions, prog="whiptool map strike", description=_STRIKE, args=args)
    with cli.options_named(options, run_folder="run folder"):
        from whiptool.strike_map.map_runs import load_map

        cli.check_out(options)
        strike_map = load_map(options.run)
        model = strike_map.striker.rollout.model
        options.check_posture(model)
        if "--hit-radius" not in cli.given_flags(args):
            options = replace(options, hit_radius=strike_map.region.hit_radius)
        target = options.build_target(model)
        with warnings.catch_warnings(action="ignore"):  # what it misses or is beyond is printed
            strike = strike_map.strike(target, refined=options.refine)
        _report(options, strike_map, target, strike)
    return 0


def _report(options: StrikeOptions, strike_map: StrikeMap, target: Target, strike: Strike) -> None:
    """Play the strike and print the result, replay it in MuJoCo, then draw; JSON is printed after the replay."""
    from whiptool.commands.limits_told import with_cure
    from whiptool.commands.optimize import (
        arrival_table,
        export_trajectory,
        missed_by,
        outcome_lines,
        strike_lines,
    )
    from whiptool.models.strike import named_strike
    from whiptool.objective import Objective
    from whiptool.rollout.reference import replay
    from whiptool.runs import code_version

    striker = strike_map.striker
    rollout, model = striker.rollout, striker.rollout.model
    trajectory = rollout.trajectory(strike, t_stay=striker.t_stay)
    limits = striker.limits.members
    beyond = striker.limits.explain(trajectory, model.arm.joints, strike)
    options.refuse_beyond(beyond)
    commanded = options.build_trajectory(model, strike, striker.t_stay, limits)  # refused before anything is written
    objective = Objective(rollout, target, t_stay=striker.t_stay, bounds=striker.bounds, limits=limits)
    outcome = objective.judge(trajectory, strike)
    lines = [f"one strike from the map of {model.name}", *strike_lines(named_strike(strike, model.arm), model.arm)]
    refused = [f"  outcome        refused, as it is beyond the limits: {with_cure(beyond)}"]
    lines += refused if outcome.refused is not None else outcome_lines(outcome, target, model.arm)
    if not options.json:
        print("\n".join(lines), flush=True)
    place, expected = np.array(target.position), outcome.miss_distance
    config = cli.configuration(options, "map strike", model, rollout.controller)
    if not options.run.exists():  # a map of the package, whose name is not a path
        config["options"]["run"] = options.run.name
    with (
        cli.new_folder(options, "map-strike", config) as folder,
        StrikePictures(
            folder.path, trajectory, model, target, "strike map", video=options.video, beyond=beyond
        ) as pictures,
    ):
        seen = replay(model, rollout.controller, strike, place, t_stay=striker.t_stay, expected=expected)
        summary = {
            "strike": named_strike(strike, model.arm),
            "target": list(target.position),
            "hit_radius": target.hit_radius,
            "refined": options.refine,
            "miss_distance": outcome.known_miss,
            "hit": outcome.hit,
            "missed_by": missed_by(outcome, target),
            "beyond": beyond,
            "hit_time": outcome.hit_time,
            "tip_speed": None if outcome.diverged else outcome.tip_speed,
            "arrival": arrival_table(outcome, target),
            "reference": {"miss_distance": seen.miss_distance},
            "model": model.name,
            "version": code_version(),
        }
        folder.write_result(summary)
        said = "no result in MuJoCo" if seen.miss_distance is None else f"{seen.miss_distance:.4f} m in MuJoCo"
        print(json.dumps(summary, allow_nan=False) if options.json else f"  reference      {said}", flush=True)
        files = pictures.draw()
    if not options.json:
        print(f"  run folder     {folder.path} ({', '.join(files)})")
    export_trajectory(options, commanded, rollout.controller)
