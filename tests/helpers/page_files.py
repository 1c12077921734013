"""What the documentation's pages take from their readers: recordings, robots, whips and people's throws, by name."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import robot_lab
import tomli_w
from films import film
from human_data import write_made_up
from page_commands import Command, parts_of
from pendulum_swing import swing

from whiptool.identification.pendulum import Pendulum
from whiptool.impedance import Controller
from whiptool.impedance.files import controller_to_table
from whiptool.models import ArmLink, Model, preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.recording.readers import write_csv
from whiptool.rollout import CompiledRollout
from whiptool.rollout.trajectory import Trajectory

MODEL, TARGET = preset("lemon2024"), (1.2, 0.1)
STRIKES = (
    (-1.36, 0.47, 1.73, 1.41, 0.95),
    (-1.2, 0.9, 1.2, 0.3, 0.9),
    (-0.9, 0.3, 1.5, 1.2, 1.1),
    (-1.4, 1.2, 1.0, 0.6, 0.8),
)
FILE_OF_ITS_OWN = re.compile(r"# (\S+\.toml)")


def provide(page: Path, folder: Path) -> None:
    """Write into a folder what a page's commands need and do not make, but for recordings."""
    for language, body in parts_of(page):
        named = FILE_OF_ITS_OWN.match(body)
        if language == "toml" and named:
            (folder / named[1]).write_text(body, encoding="utf-8")
    for make in MADE.get(page.stem, ()):
        make(folder)


def provide_for(command: Command, folder: Path) -> None:
    """Write into a folder what a command is told of: recordings, which take seconds, and RUN, the newest run."""
    for word, make in RECORDED.get(command.page.stem, {}).items():
        if word in command.words and not (folder / word).exists():
            make(folder)
    link, runs = folder / "RUN", sorted((folder / "runs").glob("*"), key=lambda run: run.stat().st_mtime)
    if runs:
        link.unlink(missing_ok=True)
        link.symlink_to(runs[-1])


def people(folder: Path) -> None:
    """Made-up throws of people, as `FOLDER`."""
    write_made_up(folder / "FOLDER")


def tracks(folder: Path, names: Sequence[str] = ("strike1", "strike2", "strike3")) -> None:
    """Tracked strikes of the paper's arm and whip: tip and handle, with what was commanded."""
    for name, strike in zip(names, STRIKES, strict=False):
        recording = film(MODEL, np.array(strike), np.random.default_rng(0), markers=("tip", "handle"), sigma=2e-3)
        told = dataclasses.replace(recording, controller=controller_to_table(Controller()))
        write_csv(told, folder / f"{name}.csv")


def strike_films(folder: Path, names: Sequence[str] = ("strike1", "strike2", "strike3")) -> None:
    """Films of strikes by the virtual camera, with their sidecars."""
    rollout = CompiledRollout(MODEL, Controller())
    for seed, (name, vector) in enumerate(zip(names, STRIKES[1:], strict=False)):
        strike = Strike.from_vector(np.array(vector))
        said = {"strike": strike, "target": np.array(TARGET), "t_stay": 0.3}
        _filmed(folder / f"{name}.mkv", MODEL, rollout.trajectory(strike, t_stay=0.3), seed, **said)
        side = folder / f"{name}.toml"
        table = tomllib.loads(side.read_text(encoding="utf-8")) | {"controller": controller_to_table(Controller())}
        side.write_text(tomli_w.dumps(table), encoding="utf-8")


def _filmed(path: Path, model: Model, trajectory: Trajectory, seed: int, **said: Any) -> None:
    """Film a trajectory with the virtual camera; 60 frames a second are enough."""
    from whiptool.vision.camera_model import camera_preset
    from whiptool.vision.film_files import write_video
    from whiptool.vision.render import VirtualCamera
    from whiptool.vision.source import frames_of

    camera = camera_preset("d435-infrared").replace(fps=60)
    virtual = VirtualCamera(
        camera, model, trajectory, np.random.default_rng(seed), target=np.array(TARGET), start=-0.02
    )
    virtual.open()
    write_video(path, frames_of(virtual), synthetic=True, **said)


def prior(folder: Path) -> None:
    """What somebody knows of his whip beforehand."""
    (folder / "mine.toml").write_text('"profile.length" = {value = 0.9, error = 0.02}\n', encoding="utf-8")


def of_strikes(folder: Path) -> None:
    """One strike tracked, two filmed."""
    tracks(folder, ["strike1"])
    strike_films(folder, ["strike2", "strike3"])


def robots_strikes(folder: Path) -> None:
    """What a lab recorded of three strikes of a UR5e: markers, and the robot's own log."""
    arm = preset("ur5e")
    for i in (1, 2, 3):
        bounds = default_bounds(arm.arm)
        vector = np.mean(bounds.box, axis=0) + 0.05 * i * np.ptp(bounds.box, axis=0)
        strike = Strike.from_vector(np.append(vector[:-1], 1.0))
        trajectory = robot_lab.exported(strike, arm, folder / f"told{i}.csv")
        robot_lab.run(arm, trajectory, folder, f"strike{i}", seed=i)
        trajectory.unlink()


def pendulums_swings(folder: Path) -> None:
    """Twelve swings of a double pendulum, by its encoders, and a guess of its links."""
    rng, links = np.random.default_rng(0), (ArmLink(0.2, 0.2), ArmLink(0.1, 0.2))
    double = Pendulum(links, (1e-3, 1e-3), 0.2, (1e-3, 1e-3), 9.81)
    swings = [swing(double, np.array([rng.uniform(-1.0, 1.0, 2), np.zeros(2)]), rng) for _ in range(12)]
    np.savez(folder / "double.npz", t=swings[0].t, angle=np.array([one.angles for one in swings]))
    guess = tomli_w.dumps({"links": [{"mass": m, "length": 0.2, "dry_friction": 1e-3} for m in (0.2, 0.1)]})
    (folder / "links.toml").write_text(guess, encoding="utf-8")


Make: TypeAlias = Callable[[Path], object]
MADE: dict[str, tuple[Make, ...]] = {
    "README": (people,),
    "commands": (people,),
    "how-to": (prior,),
    "human": (people,),
    "results": (people,),
}
# What is made when a command first asks for a file of this name
RECORDED: dict[str, dict[str, Make]] = {
    "README": {"strike2.mkv": of_strikes},
    "commands": {"strike2.mkv": of_strikes, "double.npz": pendulums_swings},
    "how-to": {"strike1.csv": robots_strikes, "double.npz": pendulums_swings},
}
