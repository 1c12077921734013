"""Show a run: `python -m whiptool.view RUN`."""

from __future__ import annotations

import os
import sys
import time
import warnings
import webbrowser
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import tyro

from whiptool.commands import cli, run_folders
from whiptool.commands.options.controller_options import ControllerOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import Conditions, JsonOptions, OptionGroup, check_place, unless
from whiptool.commands.options.target_options import GoalOptions
from whiptool.commands.pictures import MAP, PAGE, TRAJECTORY, VIDEO, StrikeRun
from whiptool.errors import InputError
from whiptool.given_files import check_kinds
from whiptool.progress import note

T = TypeVar("T", bound=OptionGroup)
REPORT = "report.html"
RESUMED = ("optimize", "train", "compare", "reproduce", "adapt", "identify", "rig learn")  # commands with --resume
FPS = 60.0  # frames a second in the viewer
SPACE = 32  # GLFW's code of the key


@dataclass(frozen=True, kw_only=True)
class ViewOptions(JsonOptions):
    """Options of `view`, which shows a run."""

    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]]
    """Run folder, or policy file of train. For optimize or simulate the strike of the run is shown, for train a strike
    of its policy; for identify, adapt, reproduce or rig strike the report is opened. With --mcap it can also be a
    recording."""
    mcap: Path | None = None
    """Write the strike of the run, or a recording of markers and joints, to this MCAP file, which Foxglove and Rerun
    show and ROS 2 plays; nothing is opened."""
    page: bool = False
    """Write the interactive page again and open it in the browser, instead of MuJoCo's viewer."""
    only_with: ClassVar[Conditions] = {"page": unless("mcap")}

    def check(self) -> None:
        super().check()
        if self.mcap is not None:
            check_place("--mcap", self.mcap, ending=".mcap")

    def needs(self) -> tuple[str, ...]:
        from whiptool.recording.readers import needed_for

        return () if self.mcap is None else ("mcap", "rosbags", *needed_for([self.run]))


@dataclass(frozen=True, kw_only=True)
class _Controlled(ControllerOptions, ModelOptions):
    """A controller, which may be that of the model's arm."""

    in_space: ClassVar[bool] = True


_ABOUT = (
    "Show a run: play its strike in MuJoCo's viewer, in a loop (space pauses), or open its report. Without a display "
    "the paths of video and page are printed. Example: python -m whiptool.view runs/directl-20260102-030405"
)


def _work(options: ViewOptions) -> int:
    if options.mcap is not None:
        _write_mcap(options.run, options.mcap)
        options.tell({"run": str(options.run), "mcap": str(options.mcap)}, f"wrote {options.mcap}")
        return 0
    run_folders.check_matplotlib()
    shown = _look(options)
    where = {"viewer": "shown in MuJoCo's viewer", "browser": "opened in the browser", None: "no window opens here"}
    files = [f"  {name:14s} {shown[name]}" for name in ("report", "page", "video") if shown[name]]
    options.tell(shown, "\n".join([f"{shown['run']}: {where[shown['shown']]}", *files]))
    return 0


main = cli.command(ViewOptions, "view", _ABOUT, _work)


def _write_mcap(run: Path, path: Path) -> None:
    """Write the strike of a run, or a recording, as MCAP."""
    from whiptool.recording.mcap_file import write_recorded_mcap, write_strike_mcap
    from whiptool.recording.readers import read_recording

    try:
        if (run / TRAJECTORY).is_file():
            strike = read_strike(run)
            write_strike_mcap(path, strike.model, strike.trajectory)
        else:
            write_recorded_mcap(path, read_recording(run))
    except OSError as error:
        raise InputError("--mcap", str(path), "a file that can be written", f"reason: {error.strerror}") from None


def _look(options: ViewOptions) -> dict[str, Any]:
    """Show the run; what was shown where, and the files that hold it."""
    from whiptool.commands.run_folders import folder_of, is_policy

    folder = options.run
    if is_policy(folder):
        strike = policy_strike(folder)
        at = ", ".join(f"{x:.3g}" for x in strike.target.position)
        print(f"whiptool: the policy's first strike at ({at}) m, one of its held-out goals", file=sys.stderr)
        return _look_at_strike(options, folder_of(folder), strike, anew=True)
    if not folder.is_dir():
        raise InputError("RUN", str(folder), "the folder of a run", "" if folder.exists() else "it does not exist")
    if not (folder / TRAJECTORY).is_file():
        if not (folder / REPORT).is_file():
            raise _nothing_to_see(folder)
        return _shown(folder) | {"report": str(folder / REPORT), "shown": _open(folder / REPORT)}
    return _look_at_strike(options, folder, read_strike(folder))


def _shown(folder: Path) -> dict[str, Any]:
    """What is shown of a run before anything is."""
    return {"run": str(folder), "shown": None, "report": None, "page": None, "video": None}


def policy_strike(policy: Path) -> StrikeRun:
    """Return the strike that a policy makes first at the first of its training's held-out goals."""
    from whiptool.commands.run_folders import folder_of
    from whiptool.rl.trained import held_out_strike
    from whiptool.runs import config_of

    kept = config_of(folder_of(policy), "train")["options"]
    loaded, target, strike = held_out_strike(policy)
    task, model = loaded.task, loaded.task.rollout.model
    trajectory = task.rollout.trajectory(strike, t_stay=task.t_stay)
    beyond = task.limits.explain(trajectory, model.arm.joints, strike)
    label = f"{_part(_Controlled, kept).controller_label()}, first strike of a policy trained with {kept['method']}"
    return StrikeRun(trajectory, model, target, label, beyond)


def _look_at_strike(options: ViewOptions, folder: Path, strike: StrikeRun, *, anew: bool = False) -> dict[str, Any]:
    """Show a strike; its files are written where they are missing, or again."""
    shown = _shown(folder)
    if strike.beyond is not None:
        print(f"whiptool: the strike is beyond its limits: {strike.beyond}", file=sys.stderr)
    if has_display() and not options.page and play(strike):
        return shown | {"shown": "viewer"}
    if anew or options.page or not (folder / PAGE).is_file():
        note("drawing ...")
        strike.write_page(folder)
    shown["page"] = str(folder / PAGE)
    if options.page:
        return shown | {"shown": _open(folder / PAGE)}
    if anew or not (folder / VIDEO).is_file():
        note("drawing ...")
        strike.write_video(folder)
    return shown | {"video": str(folder / VIDEO)}


def _nothing_to_see(folder: Path) -> InputError:
    from whiptool.given_files import read_toml
    from whiptool.runs import CONFIG, RESULT

    command = read_toml(folder / CONFIG).get("command") if (folder / CONFIG).is_file() else None
    if command in RESUMED and not (folder / RESULT).is_file():
        go_on = f"it is not finished: go on with `whiptool {command} --resume {folder}`"
        return InputError("RUN", str(folder), "a run that has ended", go_on)
    return InputError(
        "RUN",
        str(folder),
        f"a folder with {TRAJECTORY}, as optimize and simulate write it at their end, or {REPORT}, as identify, "
        "adapt, reproduce and rig strike do",
        f"this one is of `whiptool {command}`" if command else f"it has no {CONFIG}",
    )


def read_strike(folder: Path) -> StrikeRun:
    """Return the strike of a run folder of optimize or simulate.

    Raises:
        InputError: A file is missing or damaged, or the files do not belong together.
    """
    from whiptool.given_files import read_toml
    from whiptool.models.files import model_from_table
    from whiptool.models.trajectory import Trajectory
    from whiptool.runs import CONFIG

    config = read_toml(folder / CONFIG)
    try:
        if not isinstance(config.get("options", {}), dict):
            raise InputError("options", config["options"], "a table")
        model = model_from_table(config.get("model", {}))
        table = config.get("options", {})
        struck = _part(GoalOptions, table)
        of_map = config.get("command") == "map strike"
        label = MAP if of_map else _part(_Controlled, table).controller_label()
        target = struck.build_target(model)
    except InputError as error:
        raise error.within(f"{folder / CONFIG}: ") from None
    trajectory = Trajectory.load(folder / TRAJECTORY)
    if trajectory.q.shape[1:] != (model.coordinates,):
        given = f"{trajectory.q.shape[1]} coordinates"
        raise InputError(str(folder / TRAJECTORY), given, f"the model's {model.coordinates}")
    return StrikeRun(trajectory, model, target, label, _beyond(folder))


def _beyond(folder: Path) -> str | None:
    """Which limit the strike of a run is beyond, as its result says; None: none that it knows."""
    from whiptool.given_files import read_json
    from whiptool.runs import RESULT

    said = read_json(folder / RESULT).get("beyond") if (folder / RESULT).is_file() else None
    return said if isinstance(said, str) else None


def _part(group: type[T], table: dict[str, Any]) -> T:
    """A group of the options that a folder holds."""
    given = {f.name: table[f.name] for f in fields(group) if f.name in table}
    given = {name: tuple(x) if isinstance(x, list) else x for name, x in given.items()}
    check_kinds(group, given, "options.")
    return group(**given)


def has_display() -> bool:
    """Whether this machine appears to have a display: always on macOS and Windows, else if the environment variable
    DISPLAY or WAYLAND_DISPLAY is set.
    """
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _open(page: Path) -> str | None:
    """Open a page in the browser where there is a display."""
    return "browser" if has_display() and webbrowser.open(page.resolve().as_uri()) else None


def play(strike: StrikeRun) -> bool:
    """Play a strike in MuJoCo's viewer at real speed, repeatedly, until its window is closed.

    Returns:
        False if no window opens.
    """
    if not window_opens():
        return False
    import mujoco.viewer
    import numpy as np

    from whiptool.rollout.mujoco_model import build_spec, set_posture
    from whiptool.viz.film import film_of
    from whiptool.viz.opengl import add_path

    target, radius = np.array(strike.target.position), strike.target.hit_radius
    beyond = strike.beyond is not None
    film = film_of(strike.trajectory, strike.model, strike.target, fps=FPS, speed=1.0, beyond=beyond)
    mj = build_spec(film.model, target=target, target_radius=radius).compile()
    data, paused = mujoco.MjData(mj), False

    def on_key(key: int) -> None:
        nonlocal paused
        paused ^= key == SPACE

    try:
        viewer = mujoco.viewer.launch_passive(mj, data, key_callback=on_key, show_left_ui=False, show_right_ui=False)
    except RuntimeError as error:  # on macOS, without mjpython
        print(f"whiptool: no viewer: {error}", file=sys.stderr)
        return False
    with viewer:
        if strike.model.dimension == 2:  # in space the view can be turned
            viewer.cam.type, viewer.cam.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, mj.cam("side").id
        scene = viewer.user_scn
        assert scene is not None
        t, before = 0.0, time.monotonic()
        while viewer.is_running():
            now = time.monotonic()
            t = t if paused else (t + now - before) % (len(film.q) / FPS)
            before, frame = now, int(t * FPS)
            with viewer.lock():
                set_posture(mj, data, film.q[frame])
                data.time = frame / FPS
                scene.ngeom = 0
                shown = film.shown[frame]
                add_path(scene, film.trail[:shown], film.trail_rgb[:shown], strike.model.reach)
            viewer.sync()
            time.sleep(max(0.0, now + 1 / FPS - time.monotonic()))
    return True


def window_opens() -> bool:
    """Whether an OpenGL window can be opened; otherwise MuJoCo's viewer would wait for it forever."""
    try:
        import glfw
    except ImportError:
        return False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what GLFW says where it fails
        if not glfw.init():
            return False
        glfw.window_hint(glfw.VISIBLE, False)
        window = glfw.create_window(64, 64, "whiptool", None, None)
        if window:
            glfw.destroy_window(window)
        glfw.terminate()
    return bool(window)
