"""Find a strike that hits a target: `python -m whiptool.optimize --method directl`."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import arg

from whiptool.commands import cli
from whiptool.commands.limits_told import limit_lines, limits_table, refuse_unheld, with_cure
from whiptool.commands.options.criteria_options import CriteriaOptions
from whiptool.commands.options.limit_options import LimitOptions
from whiptool.commands.options.option_group import Conditions, ResumableOptions, SeedOptions, unless
from whiptool.commands.options.search_options import (
    METHODS,
    WITH_DERIVATIVES,
    SearchOptions,
    learned_with,
    spell_methods,
)
from whiptool.commands.options.simulator_options import SimulatorOptions
from whiptool.commands.options.space_options import SpaceOptions
from whiptool.commands.options.target_options import GoalOptions, ModelOptions
from whiptool.commands.options.trajectory_options import TrajectoryOptions
from whiptool.commands.pictures import StrikePictures, drawing_process
from whiptool.errors import InputError
from whiptool.progress import Progress, note
from whiptool.references import CITATIONS
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.models.joint_trajectory import JointTrajectory


@dataclass(frozen=True, kw_only=True)
class OptimizeOptions(
    ResumableOptions,
    TrajectoryOptions,
    CriteriaOptions,
    SeedOptions,
    SearchOptions,
    LimitOptions,
    SimulatorOptions,
    SpaceOptions,
    ModelOptions,
    GoalOptions,
):
    """Find a strike with which the tip of the whip hits a target."""

    changeable: ClassVar[tuple[str, ...]] = ("video",)
    first: ClassVar[tuple[str, ...]] = (
        "method",
        "video",
    )
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        "method": unless("pareto", why=", which has its own search method"),
        "pareto": unless("simulator", "reference", why=", which has no derivatives"),
    }

    method: Annotated[str | None, arg(metavar=METHODS)] = None
    """Search method; default: directl, in space gradient. nlopt:NAME is any of NLopt's global algorithms, such as
    nlopt:GN_CRS2_LM."""
    max_time: float | None = None
    """Start no trial after this many seconds. A resumed run with this limit may end differently from an uninterrupted
    one."""
    stop_at_hit: bool = True
    """End at the first hit, or after the batch that contains it; otherwise continue to reduce the miss. A search that
    minimises another criterion always continues."""
    video: bool = True
    """Render the strike as a video."""

    def __post_init__(self) -> None:
        if self.method is not None:
            spell_methods(self, "method")

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number
        from whiptool.optimizers import find_method

        super().check()
        if self.method is not None:
            find_method(self.method)
        if self.method in WITH_DERIVATIVES and self.simulator == "reference":
            raise InputError("--method", self.method, "one without derivatives, with --simulator reference")
        if self.max_time is not None:
            number("--max-time", self.max_time, low=0, strict=True)

    def needs(self) -> tuple[str, ...]:
        """Return the modules of extras that the command imports with these options."""
        return learned_with([self.method] if self.method else [])


_EXAMPLE = "Find a strike that hits a target. Example: python -m whiptool.optimize --method directl --target 1.2 0.1"


def main(args: Sequence[str] | None = None) -> int:
    """The command line; the exit status is 0, 2 for bad input, 130 when interrupted."""
    return cli.run(lambda: _main(args))


def _main(args: Sequence[str] | None) -> int:
    options = cli.parse_resumable(OptimizeOptions, command="optimize", description=_EXAMPLE, args=args)
    with cli.options_named(options):
        run = _Run(options)
        with run.folder:
            return run.report(run.search())


_REFUSALS_SHOWN = 30  # strikes that are all refused, after which a search reports it
_NOT_REPLAYED = {"miss_distance": None, "difference": None, "angle": None, "speed": None}


class _Run:
    """One search: everything is checked before anything is written."""

    def __init__(self, options: OptimizeOptions) -> None:
        self.options = options
        self.model, self.controller = options.build_model(), options.build_controller()
        options.check_posture(self.model)
        self.target = options.build_target(self.model)
        self.target.check_reach(self.model)
        self.controller.check_fits(self.model.arm)
        self.drawing = drawing_process() if options.video else None  # it imports meanwhile
        from whiptool.objective import Objective
        from whiptool.optimizers import usual_method
        from whiptool.optimizers.trial_log import TRIALS, TrialLog
        from whiptool.runs import code_version

        self.rollout = options.build_rollout(self.model, self.controller)
        self.given = options.build_limits(self.model, self.controller)
        bounds = options.build_bounds(self.model, self.rollout.space)
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
        refuse_unheld(self.model, self.controller, self.objective.limits, self.objective.bounds)
        self.version = code_version()
        box = {name: list(values) for name, values in asdict(bounds).items()}
        config = cli.configuration(options, "optimize", self.model, self.controller, bounds=box)
        self.method = "pareto" if options.pareto is not None else options.method or usual_method(self.rollout)
        if self.method == "map":
            from whiptool.optimizers.map_search import map_for

            map_for(self.objective)
        self.folder = cli.open_folder(options, self.method.replace(":", "-"), config)
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
        """Search with a progress bar, every new trial written as it happens."""
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

            objective.record(self.recorded, on_trial)
            return run_search(objective, run, self.method, seed=self.options.seed)

    def _all_refused(self) -> str:
        """Say why every strike so far was refused: what the one that was closest to the limits is beyond."""
        from whiptool.objective import UNREACHABLE, why_lost

        objective, said = self.objective, None
        assert objective.best is not None
        if objective.best.outcome.refused != UNREACHABLE:
            strike = self.rollout.space.strike(objective.best.strike)
            trajectory = self.rollout.trajectory(strike, t_stay=self.options.t_stay)
            said = with_cure(objective.limits.explain(trajectory, self.model.arm.joints, strike))
        why = ", ".join(f"{name} ({count})" for name, count in why_lost(objective.trials).items())
        closest = "" if said is None else f"; the least of them: {said}"
        motors = "other --limits, or " if objective.best.outcome.refused == "motor" else ""
        cure = f"give {motors}other --lower and --upper"
        return f"all of the first {len(objective.trials)} strikes were refused: {why}{closest}; {cure}"

    def report(self, result) -> int:
        """Print the result, replay it on the reference, then draw; JSON is printed after the replay."""
        from whiptool.optimizers import Status

        status = 130 if result.status is Status.INTERRUPTED else 0
        if result.strike is None:
            print("whiptool: ended before the first trial", file=sys.stderr)
            return status or 1
        self.folder.write_result(self._summary(result, reference=_NOT_REPLAYED))  # whatever happens below
        trajectory = self.rollout.trajectory(result.strike, t_stay=self.options.t_stay)
        table = limits_table(self.objective.limits, trajectory, result.strike, self.model.arm.joints)
        table |= self._refusals(result) if table else {}
        if not self.options.json:
            print(self._text(result, self._summary(result, reference=_NOT_REPLAYED) | table), flush=True)
        label, beyond = self.options.controller_label(), table.get("beyond")
        with StrikePictures(
            self.folder.path,
            trajectory,
            self.model,
            self.target,
            label,
            video=self.options.video,
            beyond=beyond,
            process=self.drawing,
        ) as pictures:
            replayed = self._replay(result)
            summary = self._summary(result, reference=replayed)
            summary["warning"] = self._refine(result, trajectory)
            summary |= table
            self.folder.write_result(summary)
            said = json.dumps(summary, allow_nan=False) if self.options.json else _in_mujoco(replayed, result.outcome)
            print(said, flush=True)
            files = pictures.draw()
            from whiptool.viz.plots import save_convergence

            label = f"{self.model.name}, {label}, {result.method}"
            save_convergence(self.folder.path, result.trace, self.target, label=label)
            files += self._save_front(result, label)
        if not self.options.json:
            print(f"  run folder     {self.folder.path} ({', '.join([*files, CITATIONS])})")
        self.options.refuse_beyond(summary.get("beyond"))
        path = self.rollout.space.path(result.strike.vector)
        commanded = self.options.build_trajectory(self.model, path, self.options.t_stay, self.given)
        export_trajectory(self.options, commanded, self.controller)
        return status

    def _save_front(self, result, label: str) -> list[str]:
        """Write the Pareto front as JSON, CSV and figure, if one was asked for; return what that is, for people."""
        if self.options.pareto is None:
            return []
        import numpy as np

        from whiptool.models.strike import strike_names
        from whiptool.viz.plots_front import save_front
        from whiptool.whole_files import write_whole

        front, names, folder = self._front(result), strike_names(self.model.arm), self.folder.path
        write_whole(folder / "front.json", json.dumps(front.table(names), indent=2, allow_nan=False) + "\n")
        write_whole(folder / "front.csv", front.csv(names))
        if front.trials:
            tried = np.array([trial.outcome.values for trial in result.trace if trial.outcome.hit])
            labels = [f"{x.words} [{x.unit}]" for x in front.criteria]
            save_front(folder, front.values, tried, labels=labels, title=label)
        return [f"front of {counted(len(front.trials), 'hit')}"]

    def _front(self, result):
        """Return the Pareto front of what was tried."""
        from whiptool.optimizers.front import ParetoFront

        first, second = self.objective.criteria
        return ParetoFront.of((first, second), result.trace)

    def _refusals(self, result) -> dict:
        """How many strikes were refused, and how many by each of the limits, for JSON."""
        by = Counter(trial.outcome.refused for trial in result.trace if trial.outcome.refused is not None)
        return {"n_refused": by.total(), "refused": dict(by)}

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

    def _replay(self, result) -> dict:
        """The winning strike on the reference rollout; one line on stderr if that does not confirm it."""
        import numpy as np

        from whiptool.rollout.reference import AGREEMENT, replay

        if result.outcome.lost:
            return _NOT_REPLAYED
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
        if seen.miss_distance is None or seen.velocity is None:
            return _NOT_REPLAYED
        goals, velocity = self.target.goals, seen.velocity[None]
        return {
            "miss_distance": seen.miss_distance,
            "difference": seen.miss_distance - expected,
            "angle": None if goals.directions is None else float(goals.angle(velocity)[0]),
            "speed": None if goals.only_points else float(goals.arrival_speed(velocity)[0]),
        }

    def _refine(self, result, trajectory) -> str | None:
        """What the integration of the winning strike may have got wrong; printed on stderr, too."""
        import numpy as np

        from whiptool.rollout.refinement import refine

        if result.outcome.lost:
            return None
        target = np.array(self.target.position)
        warning = refine(self.rollout, result.strike, trajectory, t_stay=self.options.t_stay, target=target)
        if warning is not None:
            print(f"whiptool: {warning}", file=sys.stderr)
        return warning

    def _summary(self, result, *, reference: dict) -> dict:
        from whiptool.impedance.files import controller_to_table

        outcome = result.outcome
        return {
            "method": result.method,
            "status": result.status.value,
            "message": result.message,
            "target": list(self.target.position),
            "hit_radius": self.target.hit_radius,
            "space": self.rollout.space.kind,
            "strike": dict(zip(self.rollout.space.names, map(float, result.strike.vector), strict=True)),
            "miss_distance": outcome.known_miss,
            "hit": outcome.hit,
            "missed_by": missed_by(outcome, self.target),
            "hit_time": outcome.hit_time,
            "tip_speed": outcome.tip_speed if math.isfinite(outcome.tip_speed) and not outcome.diverged else None,
            "arrival": arrival_table(outcome, self.target),
            "judged": self._judged(result),
            "n_trials": result.n_trials,
            "n_diverged": result.n_diverged,
            "wall_time": result.wall_time,
            "reference": reference,
            "warning": None,
            "controller": controller_to_table(self.controller),
            "model": self.model.name,
            "seed": self.options.seed,
            "version": self.version,
        }

    def _text(self, result, summary: dict) -> str:
        from whiptool.objective import why_lost

        bounds = self.objective.bounds
        refused = result.outcome.refused is not None
        batch = result.status.value == "hit" and result.first_hit != result.n_trials
        first = f" (number {result.first_hit} was the first hit; whole batches are evaluated)" if batch else ""
        lines = [
            f"{result.method}: {result.message}, after {counted(result.n_trials, 'trial')}{first} in "
            f"{result.wall_time:.2f} s ({result.n_diverged} diverged)",
            *strike_lines(summary["strike"], self.model.arm, zip(bounds.lower, bounds.upper, strict=True)),
            *(
                [f"  outcome        refused, like all other strikes; the best: {with_cure(summary['beyond'])}"]
                if refused
                else outcome_lines(result.outcome, self.target, self.model.arm)
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
        return "\n".join(lines)


def closest(best) -> str:
    """Return for a progress bar what the best strike so far came to."""
    miss = best.known_miss
    return f"closest {miss:.4f} m" if miss is not None else f"all {best.status} so far"


def finite(value: float | None) -> float | None:
    """Return a number as JSON has it: None where it is not finite."""
    return value if value is not None and math.isfinite(value) else None


def strike_lines(strike: dict[str, float], arm, bounds=None) -> list[str]:
    """A strike of an arm for people, with the bounds in which it was searched if given."""
    from whiptool.models.strike import sliding_names

    slides = sliding_names(arm)
    lines = []
    limits = list(bounds) if bounds is not None else [None] * len(strike)
    width = max(14, *map(len, strike))
    for (name, value), limit in zip(strike.items(), limits, strict=True):
        text = _number_text(name, value, slides)
        within = "" if limit is None else f"   within {limit[0]:+.4f} .. {limit[1]:+.4f}"
        lines.append(f"  {name:{width}s} {text:27s}{within}")
    return lines


def _number_text(name: str, value: float, slides: Sequence[str]) -> str:
    """One of a strike's numbers for people: angles, or lengths where a joint slides or the hand is."""
    if name == "D":
        return f"{value:.4f} s"
    return f"{value:+.4f} m" if name[0] in "xyz" or name in slides else cli.degrees(value)


def torques_known(arm) -> bool:
    """Whether an arm's torques are known: the inertia of all that moves is known."""
    return not arm.weightless


def _joint_lines(outcome, arm) -> list[str]:
    """The lines that tell people how fast joints were, and with how much torque or force."""
    width, lines = max(14, *map(len, arm.joints)), []
    for joint, speed, torque in zip(arm.joints, outcome.max_joint_speed, outcome.max_torque, strict=True):
        fast, strong, what = ("m/s", "N", "force") if joint in arm.slides else ("rad/s", "N m", "torque")
        said = f"{torque:.1f} {strong}" if torques_known(arm) else f"{what} not known"
        lines.append(f"  {joint:{width}s} at most {speed:.1f} {fast}, {said}")
    return lines


def missed_by(outcome, target) -> dict[str, float | None] | None:
    """By how much a strike misses point [m], direction [rad] and speed [m/s], for JSON; of what it keeps None.

    None where it hits, or where there is no closest approach.
    """
    if outcome.hit or outcome.lost:
        return None
    missed = target.missed_by(outcome.miss_distance, outcome.tip_velocity)
    return {"point": None, "direction": None, "speed": None} | missed


def outcome_lines(outcome, target, arm) -> list[str]:
    """Return the lines that tell people the outcome of a strike of an arm."""
    from whiptool.goals.target import missed_words

    if outcome.diverged:
        cure = "move less far or in more time, or take a smaller --timestep"
        return [f"  outcome        the simulation diverged: the joint speeds grew without bound; {cure}"]
    where = ", ".join(f"{x:.3f}" for x in target.position)
    said = "hit" if outcome.hit else "missed"
    if not outcome.hit and outcome.arrival is not None:
        said = f"missed {missed_words(target.missed_by(outcome.miss_distance, outcome.tip_velocity))}"
    return [
        f"  target         ({where}) m, {said}: closest {outcome.miss_distance:.4f} m at {outcome.time:.3f} s, "
        f"hit radius {target.hit_radius:.3f} m",
        f"  tip speed      {outcome.tip_speed:.1f} m/s",
        *_arrival_lines(outcome, target),
        *_joint_lines(outcome, arm),
    ]


def arrival_table(outcome, target) -> dict | None:
    """How the tip arrived, and what the target asks, for JSON [rad, m/s]; None: it asks for a point only."""
    if target.goals.only_points:
        return None
    return {
        "angle": None if outcome.arrival is None else outcome.arrival.angle,
        "speed": None if outcome.arrival is None else outcome.arrival.speed,
        "direction": None if target.direction is None else list(target.direction),
        "sight": None if target.sight is None else list(target.sight),
        "cone": None if target.direction is None else target.cone,
        "least_speed": target.speed,
    }


def _arrival_lines(outcome, target) -> list[str]:
    """The line that tells people how the tip arrived, if the target asks for more than a point."""
    came = outcome.arrival
    if came is None:
        return []
    said = []
    if came.angle is not None:
        said.append(f"{math.degrees(came.angle):.2f} degrees (at most {math.degrees(target.cone):g})")
    if target.speed is not None or came.angle is not None:
        along = "along it" if came.angle is not None else "fast"
        least = "" if target.speed is None else f" (at least {target.speed:g})"
        said.append(f"{came.speed:.1f} m/s {along}{least}")
    lead = "from its direction " if came.angle is not None else ""
    return [f"  arrival        {lead}{', '.join(said)}"]


def _in_mujoco(reference: dict, outcome) -> str:
    """The line that tells people how the strike did in MuJoCo."""
    if reference["miss_distance"] is None:
        said = "not computed for such a strike" if outcome.lost else "not confirmed: no result in MuJoCo"
        return f"  reference      {said}"
    difference = f"a difference of {1e3 * reference['difference']:+.3f} mm{_arrival_in_mujoco(reference)}"
    return f"  reference      {reference['miss_distance']:.4f} m in MuJoCo, {difference}"


def _arrival_in_mujoco(reference: dict) -> str:
    """How the tip arrived in MuJoCo, for people, behind its miss distance."""
    said = [] if reference["angle"] is None else [f"{math.degrees(reference['angle']):.2f} degrees"]
    said += [] if reference["speed"] is None else [f"{reference['speed']:.1f} m/s"]
    return f"; arrives at {', '.join(said)}" if said else ""


def export_trajectory(options: TrajectoryOptions, commanded: JointTrajectory | None, controller: Controller) -> None:
    """Write a strike for a robot, if the options ask for it, and say what kind of robot makes the same strike of it.

    Raises:
        InputError: The file cannot be written.
    """
    if commanded is None:
        return
    files = options.write_trajectory(commanded)
    follows = "" if controller.prescribed else "; these are references: the robot needs the same impedance controller"
    note(f"wrote {' and '.join(map(str, files))}{follows}")
