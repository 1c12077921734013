"""Identify an unknown whip, strike by strike: `python -m whiptool.adapt --target X Y --port twin --camera twin`.

`python -m whiptool.adapt next` continues the run of a user's robot by one strike.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from whiptool.adaptation.adapter import NoPlan
from whiptool.adaptation.ports import AwaitsRecording, RobotPort, truth_of
from whiptool.commands import cli, run_folders
from whiptool.commands.cli import tell_when_interrupted
from whiptool.commands.options.option_group import OptionGroup, renaming
from whiptool.commands.options.rig_options import (
    ADDRESS,
    ROBOT,
    AdaptOptions,
    ask_to_release,
    confirmed_by,
    hardware_rig,
    loop_options,
    virtual_film,
    watch_port,
)
from whiptool.errors import InputError
from whiptool.progress import note
from whiptool.whole_files import write_whole

if TYPE_CHECKING:
    from whiptool.adaptation.loop import Adaptation
    from whiptool.adaptation.prior import Belief
    from whiptool.adaptation.steps import Step
    from whiptool.models import Model
    from whiptool.models.strike import Strike
    from whiptool.recording.strike_recording import StrikeRecording
    from whiptool.rig.robots.robot_rig import RobotRig
    from whiptool.rig.stops import Interlock

REPORT = "report.html"
AWAITS = 3  # exit status
_ABOUT = (
    "Identify an unknown whip, strike by strike, until its tip hits the target. "
    "Example: python -m whiptool.adapt --target 1.2 0.1 --port twin --camera points --family strange --seed 3"
)


_NEXT = (
    "Read the recording of a strike, and print the next strike, in a run begun with `whiptool adapt --port robot`. "
    "Example: python -m whiptool.adapt next --run runs/adapt recorded.csv; with cameras in space: "
    "python -m whiptool.adapt next --run runs/adapt left.mp4 right.mp4 --cameras cameras.toml"
)
NEXT = "next"


SLOW = 0.9  # [s], shortest movement within a motor's limits
UNFELT = 0.01  # part of a motor's line that is left for the drag and dry friction that a check leaves out


def prepare(options: AdaptOptions, folder: Path | None = None) -> Adaptation:
    """Return the run that the options describe: it strikes, identifies the whip and plans again until the tip hits.

    Args:
        options: Options of the command; `out`, `resume` and `json` are ignored.
        folder: Run folder; None: nothing is kept.

    Raises:
        InputError: An option is out of range.
    """
    from whiptool.adaptation.adapter import Options
    from whiptool.adaptation.loop import Adaptation
    from whiptool.limits.all_limits import default_limits
    from whiptool.limits.arm_limits import limits_preset
    from whiptool.models.strike import StrikeBounds, default_bounds
    from whiptool.recording.readers import read_recording
    from whiptool.rig.stops import Interlock

    tip = _without_motors(options)
    stock = options.build_stock()
    model = options.build_model() if stock is None else stock.owned(options.build_model())
    target = options.build_target(model)
    controller = _controller(options, model)
    target.check_reach(model)
    motor = options.limits or (None if tip else "xm430")
    motors = () if motor is None else (limits_preset(motor),)
    usual = default_bounds(model.arm)
    slow = StrikeBounds((*usual.lower[:-1], SLOW), usual.upper)
    loop = Options(
        max_strikes=options.max_strikes,
        starts=options.starts,
        seed=options.seed,
        t_stay=options.t_stay,
        limits=(*motors, *default_limits(model, prescribed=True)),
        bounds=slow if motors else usual,
        check=None if tip else lambda strike, believed: _refusal(options, model, controller, strike, believed),
        still=options.still,
        wiggle=options.wiggle,
        **_efforts(model, limited=bool(motors)),
    )
    known = [read_recording(path).for_model(model) for path in options.known]
    prior = prior_of(options)
    interlock = Interlock()
    port = _port(options, model, controller, stock, interlock)
    _check_known(known, prior.plant.controller)
    return Adaptation(prior, port, target, loop, folder, recordings=known, interlock=interlock)


def prior_of(options: AdaptOptions) -> Belief:
    """Return the belief before the first strike of a run that the options describe.

    Raises:
        InputError: An option is out of range.
    """
    from whiptool.adaptation.prior import read_belief
    from whiptool.rig.emulator.motor import HARDWARE, Motor

    stock = options.build_stock()
    model = options.build_model() if stock is None else stock.owned(options.build_model())
    drive = None if _without_motors(options) else HARDWARE if options.friction else Motor()
    controller = _controller(options, model)
    return read_belief(options.prior, model, controller, whip=options.whip, motor=drive, stock=stock)


def _without_motors(options: AdaptOptions) -> bool:
    """Whether no motors of ours move the arm."""
    return (options.port == "twin" and options.camera == "tip") or options.own_controller


def _efforts(model: Model, *, limited: bool) -> dict[str, Any]:
    """How hard strikes are looked for: harder within the motors' limits, hardest where they are aimed in space."""
    from whiptool.adaptation.planner import FIRST, FIRST_IN_SPACE, NEXT, NEXT_IN_SPACE, RETRIES_IN_SPACE

    if model.dimension == 3:
        return {"first": FIRST_IN_SPACE, "later": NEXT_IN_SPACE, "retries": RETRIES_IN_SPACE}
    if limited:
        return {"first": replace(FIRST, pool=1024), "later": replace(NEXT, pool=512)}
    return {"first": FIRST, "later": NEXT}


def _check_known(recordings, controller) -> None:
    """Earlier strikes are learned from as if this controller had struck them."""
    from whiptool.identification.inputs import check_controllers

    try:
        check_controllers(recordings, controller)
    except InputError as error:
        fix = "give the --model and --controller that it was struck with"
        raise InputError(f"--known {error.name}", error.given, error.allowed, fix) from None


def _controller(options: AdaptOptions, model):
    """The controller; a rig's holds the torque for a cycle, and compensates the weights that it is given."""
    controller = options.build_controller()
    if options.camera == "tip" or options.own_controller:
        return controller
    return replace(controller, control_period=1 / options.rate).reckoning_with(model)


def _refusal(options: AdaptOptions, model, controller, strike, believed) -> str | None:
    """Return why the control loop would refuse a strike, None if it would not.

    The rehearsal leaves out drag and dry friction of the whip, which an arm hardly feels and which take small steps.
    """
    from whiptool.rig.rehearsal import rehearse

    smooth = replace(believed, whip=replace(believed.whip, drag=0.0, dry_friction=0.0))
    loop = loop_options(options)
    kept_free = replace(loop, margin=loop.margin + UNFELT)
    return rehearse(model, controller, strike, kept_free, believed=smooth).refused


def _port(options: AdaptOptions, model, controller, stock, interlock: Interlock):
    """The port: a twin at the tip, a twin of the whole rig, or the rig."""
    from whiptool.adaptation.ports import RigPort, RobotPort, TipPort
    from whiptool.adaptation.twins import draw_twin
    from whiptool.rig.emulator.motor import HARDWARE, Motor
    from whiptool.rig.session import TwinRig

    goal = options.build_target(model)
    target = goal.position
    if options.port == ROBOT:
        options.check_posture(model)
        return RobotPort(model, goal, execution=options.build_execution(), t_stay=options.t_stay)
    if ADDRESS in options.port:
        return _port_of_robot(options, model, stock, interlock)
    if options.port != "twin":
        rig = hardware_rig(options, model, controller, loop_options(options), interlock)
        return RigPort(lambda number: rig, target)
    twin = draw_twin(options.family, options.seed, model, controller, stock)
    if options.camera == "tip":
        return TipPort(twin, target, t_stay=options.t_stay)
    camera = "d435-infrared" if options.camera == "twin" else options.camera
    loop = loop_options(options)

    def make(number: int) -> TwinRig:
        seed = 1000 * options.seed + number
        return TwinRig(
            model,
            twin.controller,
            truth=replace(truth_of(twin, HARDWARE if options.friction else Motor()), seed=seed),
            camera=camera,
            target=target,
            options=loop,
            at_once=True,
            interlock=interlock,
        )

    return RigPort(make, target)


def _port_of_robot(options: AdaptOptions, model: Model, stock, interlock: Interlock):
    """The port of a robot with a driver: its whip is simulated, or filmed by the user's cameras."""
    from whiptool.adaptation.ports import RigPort, RobotPort
    from whiptool.adaptation.twins import draw_twin
    from whiptool.impedance import Controller, PositionControl
    from whiptool.limits.all_limits import default_limits
    from whiptool.rig.loop_options import LoopOptions
    from whiptool.rig.robots.addresses import robot_at
    from whiptool.rig.robots.robot_rig import RobotRig

    goal = options.build_target(model)
    limits = default_limits(model, prescribed=True)
    shared: dict[str, Any] = {
        "port": options.port,
        "confirm": confirmed_by(yes=options.yes, limits=limits),
        "limits": limits,
        "target": goal.position,
        "options": LoopOptions(t_stay=options.t_stay, settle=options.settle),
        "interlock": interlock,
    }
    watch_port(interlock, options.port)
    robot = robot_at(options.port, model)
    if options.camera == "none":
        return RobotPort(model, goal, t_stay=options.t_stay, rig=RobotRig(model, robot, **shared))
    twin = draw_twin(options.family, options.seed, model, Controller(PositionControl()), stock)

    def make(number: int) -> RobotRig:
        seed = [options.seed, number]
        film = virtual_film(options.camera, twin.model, seed, goal.position, twin.clock_offset)
        return RobotRig(model, robot, film=film, **shared)

    return RigPort(make, goal.position)


@dataclass(frozen=True, kw_only=True)
class NextOptions(OptionGroup):
    """Options of `whiptool adapt next`, which reads a recording and prints the next strike."""

    recordings: Positional[tuple[Path, ...]] = ()
    """Recording of the strike that was printed last, with its sidecar file. For cameras in space, give one film or one
    table of pixels per camera, two or more. Without a recording the strike is printed again."""
    run: Path
    """Run folder that `whiptool adapt --port robot` made."""
    cameras: Path | None = None
    """TOML file with the calibration of the cameras in space; default: the file that each sidecar file names."""
    posture: tuple[float, ...] | None = None
    """Present posture of the robot [rad], from which the next trajectory begins. Default: the start of the strike."""
    json: bool = False
    """Print one JSON object."""

    def needs(self) -> tuple[str, ...]:
        from whiptool.recording.readers import needed_for

        return needed_for(self.recordings)


def _next(options: NextOptions) -> int:
    begun = run_folders.options_of_run(AdaptOptions, options.run, command="adapt")
    if begun.port != ROBOT and begun.camera != "none":
        raise InputError("--run", str(options.run), f"a run that began with --port {ROBOT} or --camera none")
    if options.cameras is not None and len(options.recordings) < 2:
        raise InputError("--cameras", str(options.cameras), "only with the recordings of two cameras or more")
    return _adapt(
        replace(begun, resume=options.run, out=None, json=options.json, posture=options.posture), told=options
    )


def _adapt(options: AdaptOptions, told: NextOptions | None = None) -> int:
    """Go on to the next strike that has not been recorded, or to the end.

    Args:
        options: Options of the run.
        told: Recordings of the robot's last requested strike.
    """
    adaptation = prepare(options)
    tell_when_interrupted(lambda: _torque(adaptation))
    ask_to_release(adaptation.interlock, options.port, options.resume)
    config = run_folders.configuration(options, "adapt")
    with run_folders.open_folder(options, "adapt", config) as folder, options.shown(folder.path):
        adaptation.folder = folder.path
        for recording in adaptation.recordings:
            print(f"known: {recording.source}: {'; '.join(recording.remarks) or 'no remarks'}", file=sys.stderr)
        steps: list[Step] = []
        if told is not None and told.recordings:
            adapter, port = adaptation.adapter(), adaptation.port
            assert isinstance(port, RobotPort)
            adapter.tell(_recorded(port, adapter.asked, told), must_teach=True)
        try:
            skip = "say where the base stands with --mount, or skip this measurement with --no-still"
            with renaming({"posture": "--posture"}), renaming({"still": "--still"}, fix=skip):
                adaptation.run(lambda step: _tell(steps, step, adaptation.prior))
        except AwaitsRecording as waits:
            return _ask(waits, folder.path, options)
        except NoPlan as none:
            note(str(none))
        summary = _summary(steps)
        folder.write_result(summary)
        options.tell(summary, _conclusion(summary, folder.path))
        note("drawing ...")
        write_whole(folder.path / REPORT, _page(adaptation, steps, options))
        return 0 if summary["hit"] else 1


def _torque(adaptation: Adaptation) -> str:
    """What became of the motors; empty: none were armed, as where the arm is simulated."""
    interlock = adaptation.interlock
    return "" if interlock.torque_off is None else interlock.torque


def _recorded(port: RobotPort, strike: Strike, told: NextOptions) -> StrikeRecording:
    """Return what a strike was recorded in: places, or what cameras saw."""
    if len(told.recordings) == 1:
        return port.read(told.recordings[0], strike)
    return port.read_cameras(told.recordings, strike, told.cameras)


def _ask(waits: AwaitsRecording, folder: Path, options: AdaptOptions) -> int:
    """Print which strike the user's robot has to make next, and how to continue the run."""
    strike = waits.strike.vector.tolist()
    if options.json:
        told = {"awaits": str(waits.recording), "trajectory": str(waits.trajectory)}
        print(json.dumps({**told, "number": waits.number, "strike": strike}))
        return AWAITS
    if options.posture is None and options.port == ROBOT:
        note(
            "the trajectory begins at the strike's start, where the robot has to stand; --posture says where it stands"
        )
    which = f"strike {waits.number}" if waits.number else "a look at the whip, before the first strike"
    print(f"{which}: {' '.join(f'{x:.6g}' for x in strike)}")
    print(
        f"{waits} (and recorded.toml next to it); then: python -m whiptool.adapt --resume {folder}; "
        f"or, wherever it was put: python -m whiptool.adapt {NEXT} --run {folder} RECORDING "
        "(of cameras in space one file each, and --cameras FILE)"
    )
    return AWAITS


def _tell(steps: list[Step], step: Step, prior: Belief) -> None:
    """What came of a strike, as it comes."""
    from whiptool.adaptation.run_report import lines

    before = next((s.learned.belief for s in reversed(steps) if s.learned), None)
    note("\n".join(lines(step, prior, before)))
    steps.append(step)


def _page(adaptation: Adaptation, steps: list[Step], options: AdaptOptions) -> str:
    """Return the report as one HTML page."""
    from whiptool.adaptation.run_report import sections
    from whiptool.runs import code_version
    from whiptool.viz.report import to_html

    place = ", ".join(f"{x:g}" for x in adaptation.target.position)
    facts = {
        "code": f"whiptool {code_version()}",
        "believed": f"{options.model}, {options.controller_label()}; prior: {options.prior or options.whip}"
        + (f", {options.material}" if options.material else ""),
        "struck with": f"twin, family {options.family}, seed {options.seed}"
        if options.port == "twin"
        else f"{options.port}, whip of family {options.family}, seed {options.seed}"
        if ADDRESS in options.port and options.camera != "none"
        else options.port,
        "camera": options.camera,
        "target": f"({place}) m, hit radius {adaptation.target.hit_radius:g} m",
    }
    subtitle = "How the posterior of the whip changed with each strike."
    return to_html("An unknown whip", subtitle, facts, sections(steps, adaptation.prior, adaptation.target))


def _summary(steps) -> dict[str, Any]:
    strikes = [step for step in steps if step.number]
    misses = [None if step.judged is None else step.judged.miss for step in strikes]
    return {
        "hit": bool(strikes and strikes[-1].hit),
        "strikes": len(strikes),
        "miss_distance": [m if s.outcome.true_miss is None else s.outcome.true_miss for m, s in zip(misses, strikes)],
        "judged_miss": misses,
        "judged_error": [None if s.judged is None else s.judged.error for s in strikes],
        "hit_probability": [None if s.judged is None else s.judged.probability for s in strikes],
        "stated_probability": [s.plan.probability for s in strikes],
        "refused_strikes": [s.outcome.refused for s in strikes],
        "refused": strikes[-1].learned.refused if strikes and strikes[-1].learned else {},
        "values": strikes[-1].learned.belief.values() if strikes and strikes[-1].learned else {},
    }


def _conclusion(summary: dict[str, Any], folder: Path) -> str:
    from whiptool.adaptation.steps import percent

    rows = zip(summary["judged_miss"], summary["judged_error"], summary["hit_probability"], strict=True)
    judged = ["unknown" if m is None else f"{100 * m:.2f} ± {100 * e:.2f} ({percent(p)})" for m, e, p in rows]
    if not judged:
        return f"no strike was made; run folder {folder}"
    said = "hit claimed at" if summary["hit"] else "no hit claimed up to"
    misses = f"estimated misses [cm] with standard error and hit probability: {', '.join(judged)}"
    return f"{said} strike {summary['strikes']}; {misses}; run folder {folder}"


_begun = cli.command(AdaptOptions, "adapt", _ABOUT, _adapt, named={"robot": "--port"})
_continued = cli.command(NextOptions, f"adapt {NEXT}", _NEXT, _next, named={"run_folder": "--run"})


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 0 after a hit, 1 without a hit or after a fault, 2 for bad input, 3 if
    the user's own robot has to make the next strike, 130 after a signal.
    """
    words = list(sys.argv[1:] if args is None else args)
    return _continued(words[1:]) if words[:1] == [NEXT] else _begun(words)
