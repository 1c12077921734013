"""Runs that are followed while they go on: what the folder of a long command shows."""

from __future__ import annotations

import logging
import os
import sys
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from whiptool.commands import run_folders
from whiptool.errors import InputError
from whiptool.progress import note

_NICE = 5  # lower priority of the process that shows a run

if TYPE_CHECKING:
    from viser import ClientHandle

    from whiptool.commands.options.model_options import ModelOptions
    from whiptool.following.followed import Followed
    from whiptool.following.page import RunPage
    from whiptool.following.watcher import Watcher
    from whiptool.live_page.server import PageServer


def followed(folder: Path) -> Followed:
    """Return the run of optimize, train, adapt, map build or rig strike that a folder holds, to follow it.

    Raises:
        InputError: The folder holds no such run, or its configuration is damaged.
    """
    from whiptool.runs import read_config

    command = read_config(folder).get("command")
    if command not in _FOLLOWED:
        commands = "optimize, train, adapt, map build or rig strike"
        raise InputError("run folder", str(folder), f"the folder of {commands}", f"this one is of {command}")
    run, options = _FOLLOWED[command](folder)
    try:
        run.looks = options.find_looks()
    except InputError as error:
        note(f"whiptool: the robot is drawn without its meshes: {error}")
    return run


def serve_child(folder: str, port: int, fd: int) -> None:
    """Show a run folder until the process that started this one with `--live` closes its end of a socket, or dies."""
    sys.stdout = sys.stderr  # what the command prints there stays its own
    parent = Connection(fd)
    server, _ = _serve(lambda: followed(Path(folder)), port=port)
    print(f"whiptool: the page of the run answers at {server.address}", file=sys.stderr, flush=True)
    os.nice(_NICE)  # the run comes first where cores are few
    with suppress(EOFError, OSError):
        parent.recv()
    os._exit(0)  # nothing is to be saved


def watch(folder: Path, *, host: str, port: int, browser: bool) -> int:
    """Show a run folder on a page until Ctrl-C; return the exit status.

    Raises:
        InputError: As for `followed`, or the host cannot be served on.
    """
    run = followed(folder)
    server, watcher = _serve(lambda: run, host=host, port=port)
    try:
        serve_until_stopped(server, f"{folder} is shown", "the page", port=port, browser=browser)
    finally:
        watcher.close()
    return 0


def serve_until_stopped(server: PageServer, shown: str, name: str, *, port: int, browser: bool) -> None:
    """Print where a page is served, and serve it until Ctrl-C.

    Args:
        server: The server, which is closed at the end.
        shown: What is served, before its address.
        name: Name of what is closed.
        port: Port that was asked for.
        browser: Whether the page is opened in a browser.
    """
    try:
        say_address(shown, server, port)
        if browser:
            webbrowser.open(server.address)
        threading.Event().wait()
    except KeyboardInterrupt:
        print(f"{name} is closed", flush=True)
    finally:
        server.close()


def say_address(what: str, server: PageServer, port: int) -> None:
    """Print where a page is served, and what a reader of the address needs to know about it."""
    print(f"{what} at {server.address}", flush=True)
    if port not in (0, server.port):
        print(f"port {port} is in use", flush=True)
    if server.everywhere:
        print("on other machines write the name of this machine in place of localhost", flush=True)
    print("Ctrl-C ends it", flush=True)


def _serve(opened: Callable[[], Followed], **where: Any) -> tuple[PageServer, Watcher]:
    """Serve pages of a run that a function returns."""
    from whiptool.live_page.server import PageServer

    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # browsers that go away are no errors
    watcher: list[Watcher] = []

    def page(client: ClientHandle) -> RunPage:
        from whiptool.following.page import RunPage

        return RunPage(client, watcher[0])

    server = PageServer(page, **where)
    from whiptool.following.watcher import Watcher

    watcher.append(Watcher(opened))
    return server, watcher[0]


def write_progress(folder: Path, path: Path) -> None:
    """Write what a run shows now as MCAP, see `whiptool.recording.mcap_file.write_progress_mcap`.

    Raises:
        InputError: As for `followed`, or the file cannot be written.
    """
    from whiptool.recording.mcap_file import write_progress_mcap

    run = followed(folder)
    view = run.look()
    assert view is not None  # the first look shows the run as it is
    curves = {f"{chart.full_title} {curve.name}": (curve.x, curve.y) for chart in view.charts for curve in chart.curves}
    motion = None if view.chosen is None else run.motion(view.chosen)
    strike = None if motion is None else (motion.model, motion.trajectory, motion.target.position)
    try:
        write_progress_mcap(path, curves, view.points, strike)
    except OSError as error:
        raise InputError("--mcap", str(path), "a file that can be written", f"reason: {error.strerror}") from None


Run: TypeAlias = "tuple[Followed, ModelOptions]"


def _search(folder: Path) -> Run:
    from whiptool.commands.optimize import OptimizeOptions
    from whiptool.following.search import FollowedSearch

    options = run_folders.options_of_run(OptimizeOptions, folder, command="optimize")
    model, heading = options.find_model(), _heading("optimize", "pareto" if options.pareto else options.method, folder)
    rollout, target = options.build_rollout(model, options.build_controller()), options.build_target(model)
    run = FollowedSearch(folder, heading, rollout, target, t_stay=options.t_stay, budget=options.max_trials)
    return run, options


def _training(folder: Path) -> Run:
    from whiptool.commands.train import TrainOptions
    from whiptool.following.training import FollowedTraining

    options = run_folders.options_of_run(TrainOptions, folder, command="train")
    return FollowedTraining(folder, _heading("train", options.method, folder), episodes=options.episodes), options


def _adaptation(folder: Path) -> Run:
    from whiptool.commands.adapt import prior_of
    from whiptool.commands.options.rig_options import AdaptOptions
    from whiptool.following.adaptation import FollowedAdaptation

    options = run_folders.options_of_run(AdaptOptions, folder, command="adapt")
    prior, heading = prior_of(options), _heading("adapt", options.port, folder)
    target, budget = options.build_target(prior.plant.model), options.max_strikes
    return FollowedAdaptation(folder, heading, prior, target, t_stay=options.t_stay, budget=budget), options


def _map(folder: Path) -> Run:
    from whiptool.commands.map import BuildOptions
    from whiptool.following.map_building import FollowedMap
    from whiptool.runs import config_of
    from whiptool.strike_map.building import building_of

    options = run_folders.options_of_run(BuildOptions, folder, command="map")
    building = building_of(config_of(folder, "map"))
    return FollowedMap(folder, _heading("map build", None, folder), building), options


def _rig_strike(folder: Path) -> Run:
    from whiptool.commands.rig import RigStrikeOptions
    from whiptool.following.rig_strike import FollowedStrike
    from whiptool.models.strike import Strike
    from whiptool.rollout.compiled import CompiledRollout

    options = run_folders.options_of_run(RigStrikeOptions, folder, command="rig strike")
    model, strike = options.find_model(), Strike.from_vector(options.strike)
    twin, heading = CompiledRollout(model, options.build_controller()), _heading("rig strike", options.port, folder)
    return FollowedStrike(folder, heading, twin, strike, options.build_target(model), t_stay=options.t_stay), options


_FOLLOWED: dict[Any, Any] = {
    "rig strike": _rig_strike,
    "optimize": _search,
    "train": _training,
    "adapt": _adaptation,
    "map": _map,
}


def _heading(command: str, how: str | None, folder: Path) -> str:
    """Which run it is, in words."""
    return f"{command}{f', {how}' if how else ''}: {folder.name}"
