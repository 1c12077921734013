"""Open the studio, a page on which a target is dragged and the strike follows: `python -m whiptool.studio`."""

from __future__ import annotations

import logging
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import Positional, arg

from whiptool.commands import cli
from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import Count, OptionGroup, Ranges, check_place
from whiptool.commands.options.target_options import GoalOptions
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.live_page.saved import Saved
    from whiptool.models.parameters import Model


@dataclass(frozen=True, kw_only=True)
class PageOptions(OptionGroup):
    """Options for the page's address."""

    heading: ClassVar[str] = "page"
    first: ClassVar[tuple[str, ...]] = ("host", "port", "browser")
    ranges: ClassVar[Ranges] = {"port": Count(0, 65535)}

    host: str = "127.0.0.1"
    """Address to serve on. With the default only this machine can open the page; with another one, such as 0.0.0.0,
    other machines can, if they have the token in the address that is printed."""
    port: int = 8080
    """Port to serve on, or the next free one."""
    browser: bool = False
    """Open the page in the browser."""


@dataclass(frozen=True, kw_only=True)
class StudioOptions(PageOptions, SimulatedControllerOptions, ModelOptions, GoalOptions):
    """Options of `studio`, which opens a page to play with strikes, or to watch a run."""

    in_space: ClassVar[bool] = True

    run: Positional[Annotated[Path | None, arg(metavar="[RUN]")]] = None
    """Run folder of optimize, train, adapt, map build or rig strike, which is shown, also while the run goes on."""
    mcap: Path | None = None
    """With a run folder, write what the page would show to this MCAP file for Foxglove, Rerun and ROS 2, and open no
    page. A trial, episode, strike or part lasts a second there; the strike that is shown follows."""

    def check(self) -> None:
        super().check()
        if self.run is not None:
            own = {f.name for f in fields(PageOptions)} | {"run", "mcap"}
            self.refuse_given("only without a run folder", *(f.name for f in fields(self) if f.name not in own))
        elif self.mcap is not None:
            raise InputError("--mcap", str(self.mcap), "only with a run folder", "such as whiptool studio RUN")
        if self.mcap is not None:
            check_place("--mcap", self.mcap, ending=".mcap")

    def needs(self) -> tuple[str, ...]:
        return ("viser",) if self.mcap is None else ("mcap", "rosbags")


_ABOUT = (
    "Open a page on this machine: drag the target, change whip, controller and strike, and see what the strike does. "
    "Example: python -m whiptool.studio --model ur5e"
)


def _loader(model: Model, controller: Controller, first: str):
    """Return a function that returns model and controller for a name: those given for the first, or a preset."""

    def load(name: str) -> tuple[Model, Controller | None]:
        from whiptool.models.files import load_model

        return (model, controller) if name == first else (load_model(name), None)

    return load


def saved_settings(options: StudioOptions, model: Model) -> Saved | None:
    """Return what the file of `--model` names in addition to a model, if the studio saved it, and say so; options that
    are given come first.

    Raises:
        InputError: The file was saved by the studio and has been damaged.
    """
    from whiptool.live_page.saved import read_saved

    found = read_saved(options.model, model) if options.model.endswith(".toml") else None
    if found is None:
        return None
    taken = ["controller", "target", "strike"]
    if any(options.given(f.name) for f in fields(SimulatedControllerOptions)):
        found = replace(found, controller=options.build_controller())
        taken.remove("controller")
    if any(options.given(f.name) for f in fields(GoalOptions)):
        found = replace(found, target=options.build_target(model), strike=(), t_stay=options.t_stay)
        taken = taken[:-2]
    print(f"taken from {options.model}: {', '.join(['model', *taken])}", flush=True)
    return found


def _first(options: StudioOptions) -> str:
    """Return the name of the model of the options, which is its preset's if nothing of it is changed."""
    changed = [f.name for f in fields(ModelOptions) if f.name != "model" and options.given(f.name)]
    model = options.find_model()
    return f"{model.name}, changed" if changed else options.model if options.model.endswith(_FILES) else model.name


_FILES = (".toml", ".urdf", ".xml", ".mjcf")


def _work(options: StudioOptions) -> int:
    if options.run is not None:
        from whiptool.commands.following import watch, write_progress

        if options.mcap is not None:
            write_progress(options.run, options.mcap)
            print(f"wrote {options.mcap}", flush=True)
            return 0
        return watch(options.run, host=options.host, port=options.port, browser=options.browser)
    return _open(options)


def _open(options: StudioOptions) -> int:
    """Serve the studio until Ctrl-C; return the exit status."""
    from whiptool.commands.following import serve_until_stopped
    from whiptool.live_page.page import Choices
    from whiptool.live_page.saved import Saved
    from whiptool.live_page.server import Studio
    from whiptool.models.presets import presets

    model = options.build_model()
    saved = saved_settings(options, model)
    if saved is None:
        saved = Saved(options.build_controller(), options.build_target(model), (), options.t_stay)
    saved.target.check_fits(model)
    saved.controller.check_fits(model.arm)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # browsers that go away are no errors
    first = _first(options)
    names = [first, *(name for name in presets() if name != first)]
    load = _loader(model, saved.controller, first)
    choices = Choices(load, tuple(names), saved.target, saved.t_stay, options.find_looks(), saved.strike)
    studio = Studio(choices, host=options.host, port=options.port)
    serve_until_stopped(studio, "the studio is", "the studio", port=options.port, browser=options.browser)
    return 0


main = cli.command(StudioOptions, "studio", _ABOUT, _work)
