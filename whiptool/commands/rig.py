"""Strike with a rig: `python -m whiptool.rig strike --strike ... --port twin --camera twin`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tyro.conf import arg

from whiptool.commands import cli, run_folders
from whiptool.commands.cli import INTERRUPTED, tell_when_interrupted, with_state
from whiptool.commands.options.live_options import LiveOptions
from whiptool.commands.options.model_options import ModelName
from whiptool.commands.options.option_group import Conditions, ResumableOptions, when
from whiptool.commands.options.rig_options import ArmOptions, ask_to_release, hardware_rig, loop_options
from whiptool.commands.options.search_options import (
    WITH_DERIVATIVES,
    WITHOUT_DERIVATIVES,
    SearchOptions,
    learned_with,
    spell_methods,
)
from whiptool.commands.options.target_options import LONGEST_STAY
from whiptool.errors import InputError
from whiptool.progress import note
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.models.parameters import Model
    from whiptool.models.strike import Strike, StrikeBounds
    from whiptool.objective import Objective, Outcome
    from whiptool.optimizers import Result
    from whiptool.rig.session import Rig
    from whiptool.rig.stops import Interlock, StrikeInterrupted, StrikeStopped
    from whiptool.rig.struck import Struck
    from whiptool.runs import RunFolder

REPORT = "report.html"
TWIN_CAMERAS = ("twin", "d435-color", "d435-infrared", "points", "none")


@dataclass(frozen=True, kw_only=True)
class RigOptions(ArmOptions):
    """Options of `rig strike` and `rig learn`: the arm and whip, the port and the camera."""

    only_with: ClassVar[Conditions] = {"true_model": when("port", "twin")}

    cap: bool = False
    """Reduce stiffness and damping to values that are stable at the rate of the control loop, instead of refusing an
    unstable controller."""
    true_model: ModelName | None = None
    """Model of the simulated twin, if it differs from that of the controller; default: --model."""

    def check(self) -> None:
        super().check()
        if self.port != "twin":
            _check_camera(self.camera, self.camera_named)
        elif self.camera not in TWIN_CAMERAS:
            raise InputError("--camera", self.camera, ", ".join(TWIN_CAMERAS) + " with --port twin")


@dataclass(frozen=True, kw_only=True)
class RigStrikeOptions(LiveOptions, RigOptions):
    """Options of `rig strike`, which makes one strike on a rig."""

    first: ClassVar[tuple[str, ...]] = ("strike",)
    only_with: ClassVar[Conditions] = {"seed": when("port", "twin")}

    strike: tuple[float, ...]
    """All joint angles at the start, then all at the end [rad], and the duration [s]: q_si q_ei (shoulder and elbow at
    the start), q_sf q_ef (at the end) and D."""

    def check(self) -> None:
        from whiptool.models.numbers import number
        from whiptool.models.strike import Strike

        super().check()
        strike = Strike.from_vector(self.strike)
        number("--strike: D", strike.D, low=0, high=LONGEST_STAY)
        for angle in (*strike.q_i, *strike.q_f):
            number("--strike: angle", angle, low=-2 * math.pi, high=2 * math.pi)


@dataclass(frozen=True, kw_only=True)
class LearnOptions(ResumableOptions, SearchOptions, RigOptions):
    """Options of `rig learn`, which searches for a hit on the rig itself, strike by strike."""

    first: ClassVar[tuple[str, ...]] = ("method",)

    method: Annotated[str, WITHOUT_DERIVATIVES] = "cmaes"
    """Search method. It is any method of whiptool optimize that needs no derivatives."""
    max_trials: int = 20
    """Largest number of strikes."""
    camera: Annotated[str, arg(metavar="{twin,d435-color,d435-infrared,points,realsense}|FILE.db3")] = "twin"
    """Camera, by --port:

    - twin: twin or d435-infrared (both render infrared images), d435-color (renders colour images) or points (positions
      of the tip with the errors of tracked images)
    - servos: realsense or FILE.db3 (a RealSense recording)"""

    def __post_init__(self) -> None:
        spell_methods(self, "method")

    def check(self) -> None:
        from whiptool.optimizers import find_method

        super().check()
        find_method(self.method)
        if self.method in WITH_DERIVATIVES:
            raise InputError("--method", self.method, "a method that needs no derivatives, because a rig has none")
        if self.camera == "none":
            raise InputError(
                "--camera", self.camera, "a camera that sees the tip, because a search needs the miss distance"
            )

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), *learned_with([self.method]))


_STRIKE = (
    "Make one strike with a rig or its simulated twin, and save the recording. "
    "Example: python -m whiptool.rig strike --strike -1.57 0 0.857 2.334 1.5 --target 1.2 0.1 --port twin"
)
_LEARN = (
    "Search for a hit by strikes of the rig itself. Example: python -m whiptool.rig learn --port twin --camera points"
)


def _make_rig(options: RigOptions, model, controller, interlock: Interlock):
    """The rig that the options describe; everything is checked before anything moves."""
    from whiptool.models.files import load_model
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.emulator.physics import TwinTruth
    from whiptool.rig.loop_options import default_caps
    from whiptool.rig.session import TwinRig

    loop = loop_options(options)
    if options.cap:
        loop = replace(loop, caps=default_caps(model, period=1 / options.rate, delay=options.latency))
    if options.port != "twin":
        return hardware_rig(options, model, controller, loop, interlock)
    truth = TwinTruth(
        load_model(options.true_model) if options.true_model is not None else model,
        HARDWARE if options.friction else Motor(),
        command_delay=options.latency / 2,
        sample_delay=options.latency / 2,
        seed=options.seed,
    )
    camera = "d435-infrared" if options.camera == "twin" else options.camera
    target = options.build_target().position
    return TwinRig(
        model,
        controller,
        truth=truth,
        camera=camera,
        target=target,
        options=loop,
        interlock=interlock,
    )


def _check_camera(name: str, said: str) -> None:
    """Refuse what is not a real camera; messages name it as `said`."""
    if name.endswith(".db3") and not Path(name).is_file():
        raise InputError("--camera", name, "a RealSense recording; there is no such file")
    if name not in ("none", "realsense") and not name.endswith(".db3"):
        raise InputError("--camera", said, "realsense, a .db3 recording, none", "the twin's cameras need --port twin")


def _strike(options: RigStrikeOptions) -> int:
    """Strike, write everything, tell people or programs."""
    from whiptool.models.hand_space import numbers_of
    from whiptool.models.strike import JointSpace
    from whiptool.rig.stops import STOPPED, Interlock

    model, controller = options.build_model(), options.build_controller()
    space, target = JointSpace(model.arm), options.build_target()
    if len(options.strike) != space.width:
        raise InputError("--strike", options.strike, numbers_of(space))
    strike = space.strike(options.strike)
    target.check_reach(model)
    interlock = Interlock()
    tell_when_interrupted(lambda: interlock.torque)
    rig = _make_rig(options, model, controller, interlock)
    ask_to_release(interlock, options.port)
    config = run_folders.configuration(options, "rig strike")
    with run_folders.new_folder(options, "rig", config) as folder, options.shown(folder.path):
        interlock.watch(folder.path / STOPPED)
        return strike_and_tell(options, rig, strike, model, target, folder)


def strike_and_tell(options: Any, rig: Rig, strike: Strike, model: Model, target: Target, folder: RunFolder) -> int:
    """Make a strike, write everything into the run folder, print the result, and return the exit status.

    Args:
        options: Options of the command, for the format of the result and the facts of the report.
        rig: The rig, which is not armed or connected yet.
        strike, model, target: The strike, and what it is judged by.
        folder: Run folder.

    Raises:
        StrikeStopped, StrikeInterrupted: After the partial result was written.
    """
    from whiptool.rig.session import CYCLES, RECORDING
    from whiptool.rig.stops import StrikeInterrupted, StrikeStopped

    stopped: StrikeStopped | StrikeInterrupted | None = None
    try:
        struck = rig.strike(strike, folder=folder.path)
    except (StrikeStopped, StrikeInterrupted) as error:
        struck, stopped = error.struck, error
    summary = _summary(struck, target) | {"report": None}
    if isinstance(stopped, StrikeInterrupted):
        summary["fault"] = stopped.reason
    if stopped is not None:
        stopped.add_note(f"kept in {folder.path}")
    try:
        folder.write_result(summary)  # before anything is drawn: no picture that fails can lose it
        _report(folder.path, struck, model, target, options, rig.port)
    except KeyboardInterrupt as interruption:
        folder.write_result(summary)
        if options.json:
            options.tell(summary, "")
        raise stopped or interruption from None  # a fault is raised, also if its report was not waited for
    summary["report"] = str(folder.path / REPORT)
    folder.write_result(summary)
    kept = ", ".join([CYCLES, RECORDING if struck.recording else "no recording", REPORT])
    seen = f"  run folder     {folder.path} ({kept}); look at it: whiptool view {folder.path}"
    if stopped is None or options.json:
        options.tell(summary, "\n".join([*_lines(struck, summary, target, options.camera), seen]))
    if stopped is not None:
        raise stopped
    return 0


def _report(folder: Path, struck: Struck, model: Model, target: Target, options: Any, port: str) -> None:
    """Write the report and its pictures."""
    from whiptool.rig.strike_report import draw, save_pictures, sections
    from whiptool.runs import code_version
    from whiptool.viz.report import to_html
    from whiptool.whole_files import write_whole

    pictures = draw(struck, model, target)
    save_pictures(folder, pictures)
    robot = struck.run.overruns is None
    facts = {
        "strike": " ".join(f"{x:.4g}" for x in options.strike),
        "robot" if robot else "rig": f"{port}, camera {options.camera}",
        "arm and whip": model.name,
        "controller": options.controller_label(),
        "cycles per second": f"{struck.run.cycles.about['rate']:g}",
        "version": code_version(),
    }
    title = "A strike of the robot" if robot else "A strike on the rig"
    html = to_html(title, str(folder), facts, sections(struck, model, target, pictures))
    write_whole(folder / REPORT, html)


def _summary(struck, target) -> dict[str, Any]:
    import numpy as np

    judged = struck.judged(target)
    nearest = None if judged is None else judged.nearest
    true = None if struck.truth is None else float(struck.truth.approach(np.array(target.position)).distance[0])
    return {
        "miss_distance": None if judged is None else judged.miss,
        "miss_error": None if judged is None else judged.error,
        "hit_probability": None if judged is None else judged.probability,
        "hit": None if judged is None else judged.hit,
        "hit_time": None if nearest is None else nearest.time,
        "tip_speed": None if nearest is None else nearest.speed,
        "unseen": struck.unseen(target),
        "true_miss_distance": true,
        "fault": None if struck.run.fault is None else str(struck.run.fault),
        "torque_off": struck.run.torque_off,
        "cycles": len(struck.run.cycles),
        "missed": struck.run.missed,
        "overruns": struck.run.overruns,
        "longest_gap": struck.run.cycles.longest_gap,
    }


def _lines(struck, summary: dict, target, camera: str) -> list[str]:
    where = ", ".join(f"{x:.3f}" for x in target.position)
    if summary["miss_distance"] is None:
        why = "no camera" if camera == "none" else "the camera did not see the tip"
        lines = [f"made the strike at the target ({where}) m; {why}"]
    else:
        how = "measured" if summary["unseen"] is None else "interpolated"
        lines = [
            f"{struck.judged(target).verdict}, ({where}) m: {how} miss distance "
            f"{summary['miss_distance']:.4f} ± {summary['miss_error']:.4f} m at {summary['hit_time']:.3f} s, "
            f"{summary['tip_speed']:.1f} m/s; hit probability {summary['hit_probability']:.0%}"
        ]
        if summary["unseen"] is not None:
            lines.append(
                "  not seen       from {:.3f} to {:.3f} s, around the closest approach".format(*summary["unseen"])
            )
    if summary["true_miss_distance"] is not None:
        lines.append(f"  true miss      {summary['true_miss_distance']:.4f} m (known to the twin only)")
    lines.append(f"  cycles         {_cycles_words(summary)}")
    return lines


def _cycles_words(summary: dict) -> str:
    cycles, missed, late = (summary[name] for name in ("cycles", "missed", "overruns"))
    if late is None:  # a robot's own controller keeps its cycles
        gap = 1e3 * summary["longest_gap"]
        return f"{cycles} states of the robot, {missed} more are missing by its clock, longest gap {gap:.1f} ms"
    return f"{cycles}, {missed} missed, {late} too long"


def _learn(options: LearnOptions) -> int:
    """Search on the rig, and say what came of it."""
    from whiptool.commands.options.search_options import refuse_unheld
    from whiptool.limits.all_limits import AllLimits
    from whiptool.limits.arm_limits import XM430
    from whiptool.rig.stops import STOPPED, Interlock

    model, controller = options.build_model(), options.build_controller()
    bounds = options.build_bounds(model)
    options.build_target().check_reach(model)
    refuse_unheld(model, controller, AllLimits(XM430.keeping_free(loop_options(options).margin)), bounds)
    interlock = Interlock()
    tell_when_interrupted(lambda: interlock.torque)
    rig = _make_rig(options, model, controller, interlock)

    def make(number: int) -> Rig:
        """The rig of a strike's number: a twin's noise depends on it, so that a resumed run sees the same noise."""
        if options.port != "twin":
            return rig
        return _make_rig(replace(options, seed=1000 * options.seed + number), model, controller, interlock)

    config = run_folders.configuration(options, "rig learn")
    ask_to_release(interlock, options.port, options.resume)
    with run_folders.open_folder(options, "rig-" + options.method, config) as folder:
        interlock.watch(folder.path / STOPPED)
        return _search(options, make, model, bounds, folder, interlock)


def _search(
    options: LearnOptions,
    make: Callable[[int], Rig],
    model: Model,
    bounds: StrikeBounds,
    folder: RunFolder,
    interlock: Interlock,
) -> int:
    """Strike until it hits, every strike written as it happens; tell people or programs."""
    from whiptool.objective import Objective
    from whiptool.optimizers import Status, search
    from whiptool.optimizers.trial_log import TRIALS, TrialLog
    from whiptool.rig.session import RigRollout
    from whiptool.rig.stops import StrikeStopped

    log = TrialLog(folder.path / TRIALS, model.arm, measured=True)
    recorded = log.read()
    rollout = RigRollout(make, model, folder=folder.path, done=len(recorded))
    objective = Objective(
        rollout,
        options.build_target(),
        t_stay=options.t_stay,
        bounds=bounds,
        max_trials=options.max_trials,
        stop_at_hit=True,
    )

    def on_trial(trial) -> None:
        if trial.number > len(recorded):
            log.append(trial)
        refused = rollout.refused.get(trial.number)
        said = f" was refused: {refused}" if refused else f": {_measured(trial.outcome)}"
        note(f"strike {trial.number}{said}")

    objective.record(recorded, on_trial)
    try:
        result = search(objective, options.method, seed=options.seed)
    except StrikeStopped as stopped:
        summary = _learned(objective, options.method, "stopped") | {
            "fault": str(stopped),
            "torque_off": interlock.torque_off,
        }
        folder.write_result(summary)
        if options.json:
            options.tell(summary, "")
        stopped.add_note(f"kept in {folder.path}: {counted(len(objective.trials), 'strike')}")
        raise
    summary = _learned(objective, options.method, result.status.value)
    lines = _learned_lines(result, objective, folder.path)
    if result.status is Status.INTERRUPTED:
        summary["torque_off"] = interlock.torque_off
        lines[0] = with_state(lines[0])
    folder.write_result(summary)
    options.tell(summary, "\n".join(lines))
    return INTERRUPTED if result.status is Status.INTERRUPTED else 0


def _learned(objective: Objective, method: str, status: str) -> dict[str, Any]:
    """What a search on the rig came to; what was not carried out is not in it."""
    best = objective.best
    if best is not None and best.outcome.lost:  # none of them was seen
        best = None
    return {
        "method": method,
        "status": status,
        "fault": None,
        "n_trials": len(objective.trials),
        "n_refused": objective.n_refused,
        "n_unseen": objective.n_unseen,
        "miss_distance": None if best is None else best.outcome.miss_distance,
        "miss_error": None if best is None else best.outcome.miss_error,
        "hit": None if best is None else best.outcome.hit,
        "strike": None if best is None else dict(zip(objective.space.names, map(float, best.strike), strict=True)),
    }


def _measured(outcome: Outcome) -> str:
    """What the camera saw of a strike's miss."""
    if outcome.lost:
        return "refused" if outcome.refused is not None else "the tip was not seen"
    said = "hit claimed" if outcome.hit else "no hit claimed"
    error = "" if outcome.miss_error is None else f" ± {outcome.miss_error:.4f}"
    return f"{said}, {outcome.miss_distance:.4f}{error} m"


def _learned_lines(result: Result, objective: Objective, folder: Path) -> list[str]:
    """What a search on the rig came to."""
    strikes = f"{counted(result.n_trials, 'strike')}, {objective.n_refused} refused, {objective.n_unseen} not seen"
    lines = [f"{result.method}: {result.message}; {strikes}"]
    if result.outcome is not None and not result.outcome.lost and result.strike is not None:
        strike = " ".join(f"{x:.4f}" for x in result.strike.vector)
        lines += [f"  miss distance  {_measured(result.outcome)}", f"  strike         {strike}"]
    return [*lines, f"  run folder     {folder}"]


main = cli.subcommands(
    "rig",
    {
        "strike": (_STRIKE, cli.command(RigStrikeOptions, "rig strike", _STRIKE, _strike)),
        "learn": (_LEARN, cli.command(LearnOptions, "rig learn", _LEARN, _learn)),
    },
    note="\n\nKeep a switch that cuts the servos' power within reach; these commands do not replace it.",
)
