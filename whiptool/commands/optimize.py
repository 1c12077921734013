"""Find a strike that hits a target: `python -m whiptool.optimize --method directl`."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from whiptool.commands import cli, run_folders
from whiptool.commands.options.controller_options import SpaceOptions
from whiptool.commands.options.live_options import LiveOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import Conditions, Interval, Ranges, ResumableOptions, SeedOptions, unless
from whiptool.commands.options.search_options import (
    METHODS,
    WITH_DERIVATIVES,
    CriteriaOptions,
    SearchOptions,
    learned_with,
    refuse_unheld,
    spell_methods,
)
from whiptool.commands.options.strike_options import LimitOptions, TrajectoryOptions
from whiptool.commands.options.target_options import GoalOptions
from whiptool.commands.options.throw_options import ThrowOptions
from whiptool.commands.pictures import PictureProcess, StrikeRun, tell_strike
from whiptool.commands.strike_lines import (
    finite,
    limit_lines,
    limits_table,
    outcome_lines,
    outcome_table,
    strike_lines,
    with_cure,
)
from whiptool.errors import InputError
from whiptool.progress import Progress, note
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.throws.rollout import ThrowRollout


@dataclass(frozen=True, kw_only=True)
class OptimizeOptions(
    ResumableOptions,
    LiveOptions,
    TrajectoryOptions,
    CriteriaOptions,
    SeedOptions,
    SearchOptions,
    LimitOptions,
    ThrowOptions,
    SpaceOptions,
    ModelOptions,
    GoalOptions,
):
    """Options of `optimize`, which finds a strike with which the tip of the whip hits a target, or a throw into a
    box."""

    changeable: ClassVar[tuple[str, ...]] = ("video",)
    first: ClassVar[tuple[str, ...]] = ("method",)
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        "method": unless("pareto", why=", which has its own search method"),
        "pareto": unless("simulator", "reference", why=", which has no derivatives"),
    }

    ranges: ClassVar[Ranges] = {"max_time": Interval(0, strict=True)}

    method: Annotated[str, METHODS] | None = None
    """Search method (default: directl, or gradient for an arm in space). nlopt:NAME is any of NLopt's global
    algorithms, such as nlopt:GN_CRS2_LM."""
    max_time: float | None = None
    """Start no trial after this time [s]. A resumed run with this limit may end differently from an uninterrupted one.
    Default: no limit."""
    stop_at_hit: bool = True
    """End at the first hit, or after the batch that contains it; otherwise continue to reduce the miss distance. A
    search that minimises another criterion always continues."""
    video: bool = True
    """Render the strike as a video."""

    def __post_init__(self) -> None:
        if self.method is not None:
            spell_methods(self, "method")

    def check(self) -> None:
        from whiptool.optimizers import find_method

        super().check()
        if self.method is not None:
            find_method(self.method)
        if self.method == "map" and self.throw:
            raise InputError("--method", self.method, "any other method, because maps are of strikes and not of throws")
        if self.method in WITH_DERIVATIVES and self.simulator == "reference":
            raise InputError(
                "--method", self.method, "a method without derivatives, which --simulator reference does not compute"
            )

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), *learned_with([self.method] if self.method else []))


_EXAMPLE = "Find a strike that hits a target. Example: python -m whiptool.optimize --target 1.2 0.1"


_MUCH_DRAG = 5.0  # [1/m] per mass of a thing, a balloon's
_REFUSALS_SHOWN = 30  # strikes that are all refused, after which a search reports it
_NOT_REPLAYED = {"miss_distance": None, "difference": None, "angle": None, "speed": None}


class SearchRun:
    """One run of `optimize`: its options are checked before a file is written."""

    def __init__(self, options: OptimizeOptions) -> None:
        self.options = options
        self.model, self.controller = options.build_model(), options.build_controller()
        options.check_posture(self.model)
        self.target = options.build_target(self.model)
        self.target.check_reach(self.model)
        self.controller.check_fits(self.model.arm)
        self.drawing = PictureProcess() if options.video else None  # it imports meanwhile
        from whiptool.objective import Objective
        from whiptool.optimizers import usual_method
        from whiptool.optimizers.trial_log import TRIALS, TrialLog
        from whiptool.runs import code_version

        self.rollout = options.build_rollout(self.model, self.controller)
        self.given = options.build_limits(self.model, self.controller)
        bounds = options.build_bounds(self.model, self.rollout.space)
        if options.throw:
            self._throws.check_release(bounds.upper[-1], options.t_stay)
            if (braked := self._throws.thing.drag_per_mass) > _MUCH_DRAG:
                said = f"with a drag per mass of {braked:.3g} 1/m a flight is simulated in many steps"
                note(f"{said}: the search takes five to ten times as long")
        self.objective = Objective(
            self.rollout,
            self.target,
            t_stay=options.t_stay,
            bounds=bounds,
            max_trials=options.max_trials,
            max_time=options.max_time,
            stop_at_hit=options.stop_at_hit and not options.judged,
            limits=self.given,
            criteria=options.build_criteria(bounds),
        )
        if self.rollout.space.kind == "joint":
            lighter = {"easier": f"give {self._easier}"} if self._easier else {}
            refuse_unheld(self.rollout.model, self.controller, self.objective.limits, self.objective.bounds, **lighter)
        self.version = code_version()
        box = {name: list(values) for name, values in asdict(bounds).items()}
        config = run_folders.configuration(options, "optimize", self.model, self.controller, bounds=box)
        self.method = "pareto" if options.pareto is not None else options.method or usual_method(self.rollout)
        if self.method == "map":
            from whiptool.optimizers.gradient_search import map_for

            map_for(self.objective)
        self.folder = run_folders.open_folder(options, self.method.replace(":", "-"), config)
        arriving = not self.objective.goals.only_points
        names = [criterion.name for criterion in self.objective.criteria]
        self.log = TrialLog(
            self.folder.path / TRIALS,
            self.model.arm,
            names=self.rollout.space.names,
            arriving=arriving,
            limited=bool(self.objective.limits) or self.rollout.space.kind != "joint",
            criteria=names,
        )
        self.recorded = self.log.read() if options.resume else []

    def search(self):
        """Run the search with a progress bar and return its result; every trial is written immediately."""
        from whiptool.optimizers import find_method, run_search

        if self.options.pareto is None:
            run = find_method(self.method)
        else:
            from whiptool.optimizers.pareto_search import pareto_search as run
        objective, known = self.objective, len(self.recorded)
        with Progress(
            total=self.options.max_trials,
            unit=" trials",
            file=sys.stderr,
            desc=self.method,
            dynamic_ncols=True,
            leave=False,
        ) as bar:

            def on_trial(trial) -> None:
                if trial.number > known:
                    self.log.append(trial)
                assert objective.best is not None
                bar.set_postfix_str(closest(objective.best.outcome), refresh=False)
                bar.update()

                if trial.number == _REFUSALS_SHOWN > known and objective.n_refused == trial.number:
                    bar.write(f"whiptool: {self._all_refused()}", file=sys.stderr)

            bar.set_postfix_str("the first are simulated")
            objective.record(self.recorded, on_trial)
            return run_search(objective, run, self.method, seed=self.options.seed)

    @property
    def _easier(self) -> str:
        """What of the options that are given asks more of joints and motors, as a cure; empty: nothing."""
        own = ["a lighter thing (--thing-mass)"] * self.options.throw
        return ", or ".join(own + ["a smaller --keep-free"] * bool(self.options.keep_free))

    def _all_refused(self) -> str:
        """Say why every strike so far was refused: what the one that was closest to the limits is beyond, of those that
        were refused for the most frequent reason.
        """
        from whiptool.limits.all_limits import AllLimits
        from whiptool.objective import UNREACHABLE, why_lost

        objective, said = self.objective, None
        reason = Counter(trial.outcome.refused for trial in objective.trials).most_common(1)[0][0]
        alike = [trial for trial in objective.trials if trial.outcome.refused == reason]
        if reason != UNREACHABLE:
            strike = self.rollout.space.strike(min(alike, key=lambda trial: trial.outcome.cost).strike)
            trajectory = self.rollout.trajectory(strike, t_stay=self.options.t_stay)
            of_reason = AllLimits([each for each in objective.limits.members if each.judges == reason])
            found = of_reason.worst(trajectory, self.model.arm.joints, strike)
            said = None if found is None else with_cure(str(found), found.overlap)
        reasons = Counter(why_lost(objective.trials)).most_common()
        why = ", ".join(f"{name} ({count})" for name, count in reasons)
        of = "these" if len(reasons) == 1 else "the first"
        closest = "" if said is None else f"; the least of {of}: {said}"
        own = [self._easier] if self._easier and reason in ("joint", "motor") else []
        cure = "give " + ", or ".join([*own, *["other --limits"] * (reason == "motor"), "other --lower and --upper"])
        return f"all of the first {len(objective.trials)} strikes were refused: {why}{closest}; {cure}"

    def report(self, result) -> int:
        """Print the result, replay the strike in MuJoCo, then draw; return the exit status. JSON is printed after the
        replay.
        """
        from whiptool.optimizers import Status

        status = 130 if result.status is Status.INTERRUPTED else 0
        if result.strike is None:
            print("whiptool: ended before the first trial", file=sys.stderr)
            return status or 1
        options = self.options
        trajectory = self.rollout.trajectory(result.strike, t_stay=options.t_stay)
        table = limits_table(self.objective.limits, trajectory, result.strike, self.model.arm)
        if table:
            by = Counter(trial.outcome.refused for trial in result.trace if trial.outcome.refused is not None)
            table |= {"n_refused": by.total(), "refused": dict(by)}
        summary = self._summary(result) | table
        label, beyond = options.controller_label(), table.get("beyond")

        def later() -> tuple[dict, str]:
            replayed, said = self._replay(result)
            warning = self._refine(result, trajectory)
            return {"reference": replayed, "warning": warning}, _in_mujoco(replayed, said)

        tell_strike(
            options,
            self.folder,
            StrikeRun(trajectory, self.model, self._seen_target(result), label, beyond),
            summary,
            self._lines(result, summary),
            later=later,
            further=lambda: self._further(result, label),
            process=self.drawing,
        )
        options.refuse_beyond(beyond)
        path = self.rollout.space.path(result.strike.vector)
        commanded = options.build_trajectory(self.model, path, options.t_stay, self.given)
        options.write_trajectory(commanded, self.controller)
        return status

    def _further(self, result, label: str) -> list[str]:
        """Draw how the search converged, and its front if there is one; return what that is, for people."""
        from whiptool.viz.plots_search import save_convergence

        label = f"{self.model.name}, {label}, {result.method}"
        save_convergence(self.folder.path, result.trace, self.target, label=label)
        return [] if self.options.pareto is None else [self._save_front(result, label)]

    def _save_front(self, result, label: str) -> str:
        """Write the Pareto front as JSON, CSV and figure; return what that is, for people."""
        import numpy as np

        from whiptool.models.strike import strike_names
        from whiptool.optimizers.pareto_search import ParetoFront
        from whiptool.viz.plots_search import save_front
        from whiptool.whole_files import write_whole

        first, second = self.objective.criteria
        front, names, folder = (
            ParetoFront.of((first, second), result.trace),
            strike_names(self.model.arm),
            self.folder.path,
        )
        write_whole(folder / "front.json", json.dumps(front.table(names), indent=2, allow_nan=False) + "\n")
        write_whole(folder / "front.csv", front.csv(names))
        if front.trials:
            tried = np.array([trial.outcome.values for trial in result.trace if trial.outcome.hit])
            labels = [f"{x.words} [{x.unit}]" for x in front.criteria]
            save_front(folder, front.values, tried, labels=labels, title=label)
        return f"front of {counted(len(front.trials), 'hit')}"

    def _judged(self, result) -> list[dict] | None:
        """What the best strike is judged by, for JSON; None: by the miss alone."""
        criteria, values = self.objective.criteria, result.outcome.values
        if not criteria:
            return None
        known = dict(zip((x.name for x in criteria), values, strict=False))
        return [
            {"name": x.name, "unit": x.unit, "maximised": x.largest, "value": finite(known.get(x.name))}
            for x in criteria
        ]

    def _replay(self, result) -> tuple[dict, str]:
        """The winning strike on the reference rollout, and what to say where that has no result; one line on stderr if
        it does not confirm the strike.
        """
        import numpy as np

        from whiptool.rollout.reference import AGREEMENT, replay

        if result.outcome.lost:
            return _NOT_REPLAYED, "not computed for such a strike"
        if self.options.throw:
            return self._replay_throw(result)
        expected = result.outcome.miss_distance
        target = np.array(self.target.position)
        seen = replay(self.model, self.controller, result.strike, target, t_stay=self.options.t_stay, expected=expected)
        if not seen.confirmed:
            what = "diverges" if seen.miss_distance is None else f"misses by {seen.miss_distance:.4f} m"
            print(
                f"whiptool: not confirmed: the strike {what} in MuJoCo at {1e3 * seen.timestep:.2g} ms, more than "
                f"{1e3 * AGREEMENT:g} mm from {expected:.4f} m; try a smaller --tolerance",
                file=sys.stderr,
            )
        nothing = "not confirmed: no result in MuJoCo"
        if seen.miss_distance is None or seen.velocity is None:
            return _NOT_REPLAYED, nothing
        goals, velocity = self.target.goals, seen.velocity[None]
        return {
            "miss_distance": seen.miss_distance,
            "difference": seen.miss_distance - expected,
            "angle": None if goals.directions is None else float(goals.angle(velocity)[0]),
            "speed": None if goals.only_points else float(goals.arrival_speed(velocity)[0]),
        }, nothing

    @property
    def _throws(self) -> ThrowRollout:
        from whiptool.throws.rollout import ThrowRollout

        assert isinstance(self.rollout, ThrowRollout)
        return self.rollout

    def _seen_target(self, result) -> Target:
        """The target as pictures show it: a box that moves is shown where the thing lands."""
        if not self.options.throw or result.outcome.lost:
            return self.target
        return self._throws.box.at(result.outcome.time)

    def _replay_throw(self, result) -> tuple[dict, str]:
        """The winning throw in MuJoCo, as of `_replay`."""
        from whiptool.commands.throw_lines import NEVER_DOWN, replay_doubt, replay_table
        from whiptool.throws.mujoco_throw import AGREEMENT, replay_throw

        if not self._throws.landing(result.strike, t_stay=self.options.t_stay)[0]:
            return _NOT_REPLAYED, "not computed for such a throw"
        seen = replay_throw(self._throws, result.strike, t_stay=self.options.t_stay)
        doubt = replay_doubt(seen, AGREEMENT)
        if doubt is not None:
            print(f"whiptool: not confirmed: {doubt}", file=sys.stderr)
        said = f"{NEVER_DOWN} in MuJoCo, either" if doubt is None else f"not confirmed: {doubt}"
        return replay_table(seen, self._throws), said

    def _refine(self, result, trajectory) -> str | None:
        """Why the result of the winning strike may not be trusted; printed on stderr, too."""
        import numpy as np

        from whiptool.rollout.refinement import doubts

        if result.outcome.lost:
            return None
        target = np.array(self.target.position)
        warning = doubts(self.rollout, result.strike, trajectory, t_stay=self.options.t_stay, target=target)
        if warning is not None:
            print(f"whiptool: {warning}", file=sys.stderr)
        return warning

    def _summary(self, result) -> dict:
        from whiptool.commands.throw_lines import never_landed
        from whiptool.impedance.controller import controller_to_table

        outcome, thrown = result.outcome, self._thrown(result)
        found = outcome_table(outcome, self.target)
        if thrown is not None:
            found |= never_landed(thrown, found)
        return {
            "method": result.method,
            "status": result.status.value,
            "message": result.message,
            "space": self.rollout.space.kind,
            "strike": dict(zip(self.rollout.space.names, map(float, result.strike.vector), strict=True)),
            **found,
            "throw": thrown,
            "judged": self._judged(result),
            "n_trials": result.n_trials,
            "n_diverged": result.n_diverged,
            "wall_time": result.wall_time,
            "reference": _NOT_REPLAYED,
            "warning": None,
            "controller": controller_to_table(self.controller),
            "model": self.model.name,
            "seed": self.options.seed,
            "version": self.version,
        }

    def _thrown(self, result) -> dict | None:
        """Release and landing, for JSON; None for a strike."""
        from whiptool.commands.throw_lines import throw_table

        if not self.options.throw:
            return None
        return throw_table(self._throws, result.strike, result.outcome, self.options.t_stay)

    def _outcome_lines(self, result, summary: dict) -> list[str]:
        """Lines on the outcome of the best strike or throw."""
        from whiptool.commands.throw_lines import throw_lines

        lines = outcome_lines(result.outcome, self.target, self.model.arm)
        return throw_lines(summary["throw"], result.outcome, self._throws, lines) if self.options.throw else lines

    def _lines(self, result, summary: dict) -> list[str]:
        from whiptool.objective import why_lost

        bounds = self.objective.bounds
        refused = result.outcome.refused is not None
        batch = result.status.value == "hit" and result.first_hit != result.n_trials
        said = with_cure(summary.get("beyond"), summary.get("overlap", False))
        first = f" (number {result.first_hit} was the first hit; whole batches are evaluated)" if batch else ""
        lines = [
            f"{result.method}: {result.message}, after {counted(result.n_trials, 'trial')}{first} in "
            f"{result.wall_time:.2f} s ({result.n_diverged} diverged)",
            *strike_lines(summary["strike"], self.model.arm, zip(bounds.lower, bounds.upper, strict=True)),
            *(
                [f"  outcome        refused, like all other strikes; the best: {said}"]
                if refused
                else self._outcome_lines(result, summary)
            ),
        ]
        for judged in summary["judged"] or ():
            if judged["value"] is not None:
                lines.append(f"  {judged['name']:14s} {judged['value']:.6g} {judged['unit']}")
        lines += limit_lines(self.objective.limits, {**summary, "beyond": None} if refused else summary)
        if self.objective.n_refused:
            refusals = [one for one in result.trace if one.outcome.refused is not None]
            by = ", ".join(f"{n} {why}" for why, n in why_lost(refusals).items())
            lines.append(f"  refused        {counted(len(refusals), 'strike')}: {by}")
        lines.append(f"  model          {self.model.name}, {self.options.controller_label()}, {self.options.simulator}")
        return lines


def closest(best) -> str:
    """Return a progress bar's text on the best strike so far: its miss distance, or its status."""
    miss = best.known_miss
    return f"closest {miss:.4f} m" if miss is not None else f"all {best.status} so far"


def _in_mujoco(reference: dict, nothing: str) -> str:
    """The line that tells people how the strike did in MuJoCo, or what is said where it has no difference."""
    if reference["difference"] is None:
        return f"  reference      {nothing}"
    arrival = [] if reference["angle"] is None else [f"{math.degrees(reference['angle']):.2f} degrees"]
    arrival += [] if reference["speed"] is None else [f"{reference['speed']:.1f} m/s"]
    said = f"{reference['miss_distance']:.4f} m in MuJoCo, a difference of {1e3 * reference['difference']:+.3f} mm"
    return f"  reference      {said}{'; arrives at ' * bool(arrival)}{', '.join(arrival)}"


def _work(options: OptimizeOptions) -> int:
    run = SearchRun(options)
    with run.folder, options.shown(run.folder.path):
        return run.report(run.search())


main = cli.command(OptimizeOptions, "optimize", _EXAMPLE, _work)  # 130 when interrupted
