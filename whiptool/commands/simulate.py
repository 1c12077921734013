"""Play one strike, or export the model: `python -m whiptool.simulate --strike q_si q_ei q_sf q_ef D`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

import numpy as np
import tyro

from whiptool.commands import cli, run_folders
from whiptool.commands.options.controller_options import SpaceOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import (
    Condition,
    Conditions,
    OptionGroup,
    OutputOptions,
    check_place,
    unless,
)
from whiptool.commands.options.strike_options import LimitOptions, SimulatorOptions, TrajectoryOptions
from whiptool.commands.options.target_options import GoalOptions
from whiptool.commands.pictures import StrikeRun, tell_strike
from whiptool.commands.run_folders import folder_of, is_policy
from whiptool.commands.strike_lines import limit_lines, limits_table, outcome_lines, outcome_table, strike_lines
from whiptool.errors import NOTHING, InputError
from whiptool.whole_files import write_whole

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.models.hand_space import StrikeSpace

T = TypeVar("T", bound=OptionGroup)
# commands whose runs hold a strike, and that go on
PLAYED, RESUMED = ("optimize", "simulate", "map strike"), ("optimize", "train")


_NO_POLICY = Condition("only without a policy", lambda o: not o.of_policy())
_PLAYS = Condition("only with --strike", lambda o: o.plays() or o.export is None)
_OF_SIMULATIONS = [f.name for of in (LimitOptions, SimulatorOptions, SpaceOptions) for f in fields(of)] + ["t_stay"]
_OF_STRIKES = [f.name for of in (OutputOptions, TrajectoryOptions, GoalOptions) for f in fields(of)] + ["video"]


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(
    OutputOptions,
    TrajectoryOptions,
    LimitOptions,
    SimulatorOptions,
    SpaceOptions,
    ModelOptions,
    GoalOptions,
):
    """Options of `simulate`, which plays one strike and saves its trajectory, figures and video."""

    of_this_call: ClassVar[tuple[str, ...]] = ("run", "trajectory", "export", "video")
    first: ClassVar[tuple[str, ...]] = ("run", "strike", "export", "video")
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **{name: (_PLAYS,) for name in _OF_STRIKES if name != "target"},  # the target is in the model's file, too
        **dict.fromkeys(_OF_SIMULATIONS, (_PLAYS, unless("trajectory"))),
        "strike": (_NO_POLICY,),
        "space": (_NO_POLICY, _PLAYS, unless("trajectory")),
        "trajectory": (_NO_POLICY, unless("strike")),
    }

    run: tyro.conf.Positional[Annotated[Path | None, tyro.conf.arg(metavar="[RUN]")]] = None
    """Run folder of optimize or simulate, whose strike is played again. It can also be a folder of train, or a policy
    file in it, whose policy strikes at --target. Options that are not given are those of the run."""
    strike: tuple[float, ...] | None = None
    """Joint angles [rad], or coordinates of the hand with --space: all at the start, all at the end, then the duration
    [s]. For two joints these are q_si q_ei q_sf q_ef D (shoulder, elbow). With --space hand they are x_i y_i x_f y_f D,
    in space x_i y_i z_i x_f y_f z_f D [m]. With --space pose each position is followed by the rotation from the home
    posture [rad]: turn_i, in space the rotation vector turn_x_i turn_y_i turn_z_i."""
    trajectory: Path | None = None
    """Play the joint trajectory in this CSV file instead of --strike, with position servos in MuJoCo. The file is such
    as --export-trajectory writes."""
    export: Path | None = None
    """File for the model as MJCF, which MuJoCo's viewer opens."""
    video: bool = True
    """Render the strike as a video."""

    def check(self) -> None:
        from whiptool.models.strike import Strike

        super().check()
        if self.export is not None:
            check_place("--export", self.export)
        if self.of_policy():
            return
        if self.strike is not None:
            Strike.from_vector(self.strike)
        elif self.trajectory is None and self.export is None:
            rule = "joint angles at start and end [rad], duration [s]; or a run, --trajectory or --export FILE.xml"
            raise InputError("--strike", NOTHING, rule)

    def plays(self) -> bool:
        """Whether a strike is played, and not the model exported alone."""
        return self.strike is not None or self.trajectory is not None or self.of_policy()

    def of_policy(self) -> bool:
        """Whether the strike is that of a policy."""
        return self.run is not None and is_policy(self.run)


_EXAMPLE = (
    "Simulate one strike, or export the model. Example: python -m whiptool.simulate --strike -1.2 0.9 1.2 0.3 0.7; "
    "python -m whiptool.simulate runs/directl-20260102-030405"
)


def played_again(run_folder: Path) -> SimulateOptions:
    """Return the options that play the best strike of a run again, or strikes of a policy.

    Raises:
        InputError: The folder is not a run of optimize, simulate or train, or has no strike.
    """
    return _of_policy(folder_of(run_folder)) if is_policy(run_folder) else strike_of(run_folder, SimulateOptions)


def strike_of(run_folder: Path, kind: type[T]) -> T:
    """Return the options of another command that has the best strike of a run.

    Args:
        run_folder: Run folder of a command that finds or plays a strike.
        kind: Class of the options, with a field `strike`; it takes over the options of the run that it has.

    Raises:
        InputError: The folder is not such a run, or has no strike.
    """
    from whiptool.given_files import read_json
    from whiptool.runs import RESULT, read_config

    config = read_config(run_folder)
    command, kept = config.get("command"), config.get("options")
    if command not in (*PLAYED, "train") or not isinstance(kept, dict):
        rule = f"a run of {', '.join(PLAYED)} or train"
        raise InputError("RUN", str(run_folder), rule, f"it is of `whiptool {command}`" if command else "")
    result = read_json(run_folder / RESULT) if (run_folder / RESULT).is_file() else {}
    strike = result.get("strike")
    if not isinstance(strike, dict):
        fix = f"go on with `whiptool {command} --resume {run_folder}`" if command in RESUMED else ""
        raise InputError("RUN", str(run_folder), "a run that ended with a strike", fix)
    if command == "map strike":
        of = Path(kept["run"])  # a map, or the name of one of the package
        kept = {**(read_config(of)["options"] if of.exists() else {"model": of.name}), **kept}
    return _shared({**kept, "strike": list(strike.values())}, run_folder, kind)


def check_width(options: Any, space: StrikeSpace) -> None:
    """Refuse a strike that has other coordinates than the model's, by the name of the option or run that gave it."""
    from whiptool.models.hand_space import numbers_of

    if len(options.strike) == space.width:
        return
    if options.run is None or options.strike != strike_of(options.run, type(options)).strike:
        raise InputError("--strike", options.strike, numbers_of(space))
    rule = f"a run whose strike has {numbers_of(space)}, for {options.model}"
    raise InputError("RUN", str(options.run), rule, f"its strike has {len(options.strike)}: give --model of its arm")


def _shared(kept: dict[str, Any], run_folder: Path, kind: type[T]) -> T:
    """Return the options of another command's run as far as they are options of `kind`, too."""
    mine = {f.name for f in fields(kind)} - kind.named("of_this_call")
    table = {name: value for name, value in kept.items() if name in mine}
    return run_folders.stored_options(kind, table, run_folder)


def _of_policy(run_folder: Path) -> SimulateOptions:
    """Return the options of strikes of a policy: those of its training.

    A range of arrival angles is left out, and so is the cone without a single angle or a direction.
    """
    from whiptool.runs import config_of

    kept = dict(config_of(run_folder, "train")["options"])
    angles, cone = kept.pop("arrival_angle", ()), kept.pop("cone", None)
    if len(angles) == 1:
        kept["arrival_angle"] = angles[0]
    if cone is not None and (len(angles) == 1 or "direction" in kept):
        kept["cone"] = cone
    return _shared(kept, run_folder, SimulateOptions)


def _check_same(options: SimulateOptions, model) -> None:
    """Refuse a model or controller that is other than in the run, though its options are the run's.

    Raises:
        InputError: A file that they name, or what a preset says, has changed since.
    """
    from whiptool.impedance.controller import controller_to_table
    from whiptool.models.files import model_to_table
    from whiptool.runs import CONFIG, read_config

    assert options.run is not None
    begun, config = played_again(options.run), read_config(folder_of(options.run))
    now = {"model": model_to_table(model), "controller": controller_to_table(options.build_controller())}
    for part, group in (("model", ModelOptions), ("controller", SpaceOptions)):
        as_begun = all(getattr(options, f.name) == getattr(begun, f.name) for f in fields(group))
        if as_begun and not (part in config and run_folders.reads_as(part, config[part], now[part])):
            kept = folder_of(options.run) / CONFIG
            fix = f"the {part} differs from when the run was made: give --{part} {kept}"
            raise InputError("RUN", str(options.run), f"a run of the same {part}", fix)


def _strike(options: SimulateOptions, model):
    """Return the strike that is asked for; None: none is."""
    if options.of_policy():
        from whiptool.rl.trained import load_policy

        assert options.run is not None
        return load_policy(options.run).strike(options.build_target(model))
    if options.strike is None:
        return None

    space = options.build_controller().strike_space(model.arm)
    check_width(options, space)
    space.check_turns("--strike", options.strike)
    return space.strike(options.strike)


def _export(options: SimulateOptions, model) -> None:
    from whiptool.rollout.mujoco_model import export_xml

    assert options.export is not None
    target = options.build_target(model)
    target.check_fits(model)
    xml, missing = export_xml(model, target=np.array(target.position))
    try:
        write_whole(options.export, xml)
    except OSError as error:
        raise InputError(
            "--export", str(options.export), "a file that can be written", f"reason: {error.strerror}"
        ) from None
    print(f"wrote {options.export}; it does not hold {'; '.join(missing)}", file=sys.stderr)


def _play(options: SimulateOptions, model, strike) -> int:
    """Play a strike, write and tell what it did; return the exit status."""
    from whiptool.limits.all_limits import AllLimits

    controller, target = options.build_controller(), options.build_target(model)
    target.check_fits(model)
    options.check_posture(model)
    space, given = controller.strike_space(model.arm), options.build_limits(model, controller)
    path = space.path(strike.vector)
    commanded = options.build_trajectory(model, path, options.t_stay, given)  # refused before anything is written
    rollout = options.build_rollout(model, controller)
    trajectory = rollout.trajectory(strike, t_stay=options.t_stay)
    limits = AllLimits(given, by_joints=space.kind == "joint")
    used = limits_table(limits, trajectory, strike, model.arm)
    options.refuse_beyond(used.get("beyond"))
    outcome, label = _judged(rollout, trajectory, target), options.controller_label()
    named = dict(zip(space.names, map(float, strike.vector), strict=True))
    summary = {
        "space": space.kind,
        "strike": named,
        **outcome_table(outcome, target),
        **_motion(outcome, model.arm),
        **used,
        **_accuracy(options, rollout, strike, trajectory, target),
    }
    lines = [f"one strike: {model.name}, {label}, {rollout.engine} {rollout.accuracy}", *strike_lines(named, model.arm)]
    lines += [*outcome_lines(outcome, target, model.arm), *limit_lines(limits, used)]
    _write(options, StrikeRun(trajectory, model, target, label, used.get("beyond")), controller, summary, lines)
    options.write_trajectory(commanded, controller)
    return int(outcome.diverged)


def _motion(outcome, arm) -> dict[str, Any]:
    """Return for JSON how arm and tip moved."""
    torque = None if arm.weightless else dict(zip(arm.joints, outcome.max_torque, strict=True))
    speed = dict(zip(arm.joints, outcome.max_joint_speed, strict=True))
    moved = {"time": outcome.time, "max_joint_speed": speed, "max_torque": torque}
    return moved | {"diverged": outcome.diverged}


def _accuracy(options: SimulateOptions, rollout, strike, trajectory, target) -> dict[str, Any]:
    """Return for JSON how a strike was simulated, and why its result may not be trusted; say the latter."""
    from whiptool.rollout.refinement import doubts

    warning = doubts(rollout, strike, trajectory, t_stay=options.t_stay, target=np.array(target.position))
    if warning is not None:
        print(f"whiptool: {warning}", file=sys.stderr)
    return {
        "simulator": options.simulator,
        "engine": rollout.engine,
        "timestep": rollout.timestep if rollout.tolerance is None else None,
        "tolerance": rollout.tolerance,
        "warning": warning,
    }


def _judged(rollout, trajectory, target):
    """Return the outcome of a trajectory of arm and whip."""
    from whiptool.models.strike import StrikeBounds
    from whiptool.objective import Objective

    n = rollout.space.width - 1
    anywhere = StrikeBounds((-1.0,) * n + (0.1,), (1.0,) * (n + 1))  # what is there already needs no box
    return Objective(rollout, target, bounds=anywhere, check_reach=False, limits=None).judge(trajectory)


def _follow(options: SimulateOptions, model) -> int:
    """Have servos follow a joint trajectory, say what the tip did from the strike's beginning on; return the exit
    status."""
    from whiptool.impedance import Controller
    from whiptool.impedance.laws import PositionControl
    from whiptool.models.joint_trajectory import JointTrajectory
    from whiptool.rollout.reference import ReferenceRollout
    from whiptool.rollout.servo_replay import replay_trajectory

    assert options.trajectory is not None
    target, commanded = options.build_target(model), JointTrajectory.load_csv(options.trajectory)
    target.check_fits(model)
    whole = replay_trajectory(model, commanded)
    strike = whole.since(commanded.strike_begins)
    outcome = _judged(ReferenceRollout(model, Controller(PositionControl())), strike, target)
    error, label = float(np.abs(strike.q[:, : model.arm.n] - strike.q_d).max()), "position servos"
    summary = {**outcome_table(outcome, target), "time": outcome.time, "tracking_error": error}
    summary |= {"diverged": outcome.diverged}
    unit = "rad or m" if model.arm.slides else "rad"
    lines = [f"a joint trajectory: {model.name}, {label}, MuJoCo", *outcome_lines(outcome, target, model.arm)]
    lines.append(f"  servos         at most {error:.2g} {unit} from the trajectory")
    _write(options, StrikeRun(strike, model, target, label), None, summary, lines)
    return int(outcome.diverged)


def _write(
    options: SimulateOptions, strike: StrikeRun, controller: Controller | None, summary: dict, lines: list[str]
) -> None:
    """Make the run folder, and write, tell and draw the strike."""
    from whiptool.impedance.controller import controller_to_table
    from whiptool.runs import code_version

    if controller is not None:
        summary["controller"] = controller_to_table(controller)
    summary |= {"model": strike.model.name, "version": code_version()}
    with run_folders.new_folder(
        options, "simulate", run_folders.configuration(options, "simulate", strike.model, controller)
    ) as folder:
        tell_strike(options, folder, strike, summary, lines)


def _work(options: SimulateOptions) -> int:
    run_folders.check_out(options)
    model = options.build_model()
    if options.run is not None:
        _check_same(options, model)
    strike = _strike(options, model)
    if options.export is not None:
        _export(options, model)
    if strike is not None:
        return _play(options, model, strike)
    return 0 if options.trajectory is None else _follow(options, model)


main = cli.command(SimulateOptions, "simulate", _EXAMPLE, _work, of_run=played_again)  # 1 where the simulation diverged
