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
from command_line import called
from films import film
from human_data import write_made_up
from page_commands import DOCS, Command, name_of, parts_of
from pendulum_swing import pendulum, swing
from swings import Whip

from whiptool.impedance import Controller
from whiptool.impedance.controller import controller_to_table
from whiptool.models import ArmLink, Model, preset, write_model
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.kinematics import joint_points
from whiptool.models.strike import Strike, default_bounds
from whiptool.models.trajectory import Trajectory
from whiptool.recording.camera import camera_preset, write_cameras
from whiptool.recording.readers import write_csv
from whiptool.rollout import CompiledRollout
from whiptool.rollout.servo_replay import replay_trajectory

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
    for make in MADE.get(name_of(page), ()):
        make(folder)


def provide_for(command: Command, folder: Path) -> None:
    """Write into a folder what a command is told of: recordings, which take seconds, and RUN, the newest run."""
    for words, make in RECORDED.get(name_of(command.page), {}).items():
        if words in command.line:
            make(folder)
    link, runs = folder / "RUN", sorted((folder / "runs").glob("*"), key=lambda run: run.stat().st_mtime)
    if runs:
        link.unlink(missing_ok=True)
        link.symlink_to(runs[-1])


def people(folder: Path) -> None:
    """Made-up throws of people, as `FOLDER`."""
    write_made_up(folder / "FOLDER")


def tracks(folder: Path, names: Sequence[str] = ("strike1", "strike2", "strike3")) -> None:
    """Tracked strikes of the paper's arm and whip: tip and handle, with what was commanded, without a log of joints."""
    for name, strike in zip(names, STRIKES, strict=False):
        recording = film(MODEL, np.array(strike), np.random.default_rng(0), markers=("tip", "handle"), sigma=2e-3)
        controller = controller_to_table(Controller())
        told = dataclasses.replace(recording, controller=controller, joints_t=None, joints_q=None)
        write_csv(told, folder / f"{name}.csv")


def in_a_hand(folder: Path) -> None:
    """Three tracked strikes."""
    tracks(folder, ["hand1", "hand2", "hand3"])


def strike_films(
    folder: Path, names: Sequence[str] = ("strike1", "strike2", "strike3"), *, camera: str = "d435-infrared"
) -> None:
    """Films of strikes by the virtual camera, with their sidecars."""
    rollout = CompiledRollout(MODEL, Controller())
    for seed, (name, vector) in enumerate(zip(names, STRIKES[1:], strict=False)):
        strike = Strike.from_vector(np.array(vector))
        said = {"strike": strike, "target": np.array(TARGET), "t_stay": 0.3}
        seen = rollout.trajectory(strike, t_stay=0.3)
        seen_by = camera_preset(camera).replace(fps=60)
        side = _filmed(folder / f"{name}.mkv", seen_by, MODEL, seen, seed, start=-0.02, **said)
        _say(side, controller=controller_to_table(Controller()))


def coloured_films(folder: Path) -> None:
    """Films of three strikes in colour."""
    strike_films(folder, camera="d435-color")


def swings(folder: Path, *, clamp: float | None = None) -> None:
    """Films of three swings of the paper's whip, in a clamp [rad] or on a hinge; metres count from its upper end."""
    whip, t = Whip(MODEL, clamped=clamp is not None, direction=clamp or 0.0), np.arange(0, 1.6, 2e-3)
    camera, hand = camera_preset("d435-infrared").replace(fps=60), MODEL.arm.length
    from_hand = np.array([[1, 0, 0], [0, 1, hand], [0, 0, 1.0]]) @ camera.homography
    arm, none = np.zeros((len(t), MODEL.arm.n)), np.zeros((len(t), MODEL.arm.n, MODEL.arm.n))
    for i, pull in enumerate(((2.0, 0.5), (-1.5, 0.9), (1.2, 0.6))):  # [N] at the tip, before it is released
        theta = whip.released(whip.held_aside(pull), t)
        q = np.hstack([arm, np.diff(theta, axis=1, prepend=0.0)])
        tip = joint_points(MODEL, q)[:, -1]
        speeds = np.gradient(q, t, axis=0), np.gradient(tip, t, axis=0)
        path = Trajectory(t, q, speeds[0], arm, arm, arm, none, none, tip, speeds[1])
        _filmed(folder / f"swing{i + 1}.mkv", camera, MODEL, path, i, homography=from_hand)


def clamped_swings(folder: Path) -> None:
    """The same of a whip in a clamp that points down, but for half a degree."""
    swings(folder, clamp=0.01)


def _filmed(
    path: Path, camera: Any, model: Model, trajectory: Trajectory, seed: int, *, start: float = 0.0, **said: Any
) -> Path:
    """Film a trajectory with a virtual camera, and return the film's sidecar."""
    from whiptool.vision.film_files import write_video
    from whiptool.vision.render import VirtualCamera
    from whiptool.vision.source import frames_of

    virtual = VirtualCamera(camera, model, trajectory, np.random.default_rng(seed), said.get("target"), start=start)
    virtual.open()
    return write_video(path, frames_of(virtual), synthetic=True, **said)


def _say(side: Path, **more: Any) -> None:
    """Add to what a sidecar says; a recording of a camera in space leaves it to the command where the cameras stand."""
    table = tomllib.loads(side.read_text(encoding="utf-8")) | more
    side.write_text(tomli_w.dumps({key: x for key, x in table.items() if key != "cameras"}), encoding="utf-8")


def own_whip(folder: Path) -> None:
    """The model that another page writes."""
    provide(DOCS / "how-to" / "whips.md", folder)


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


def a_take(folder: Path) -> None:
    """A take of a motion-capture system."""
    import lab_files

    lab_files.c3d(folder / "take1.c3d", lab_files.swing())


def two_cameras(folder: Path) -> dict[str, Any]:
    """The file of two cameras, and a guess of a robot's whip; returns the cameras by name."""
    import space_films as lab

    small = {"camera_matrix": np.array([[322.0, 0, 318], [0, 324.0, 178], [0, 0, 1]]), "distortion": ()}
    small |= {"width": 640, "height": 360, "fps": 60.0}
    cameras = {x.name: dataclasses.replace(x, **small) for x in (lab.LEFT, lab.RIGHT)}
    write_cameras(folder / "cameras.toml", cameras)
    guess = dataclasses.replace(lab.ROBOT, whip=dataclasses.replace(lab.WHIP, k=0.07, b=0.006))
    write_model(guess, folder / "my-robot.toml")
    return cameras


def tables_of_pixels(folder: Path) -> None:
    """Where two cameras saw the tip in three strikes of a robot."""
    import space_films as lab

    two_cameras(folder)
    write_cameras(folder / "cameras.toml", {"left": lab.LEFT, "right": lab.RIGHT})
    strikes = (*lab.STRIKES, dataclasses.replace(lab.STRIKES[0], D=0.5))
    for i, strike in enumerate(strikes, start=1):
        for seen in lab.filmed_by_two(lab.ROBOT, strike, i):
            _say(write_csv(seen, folder / f"strike{i}-{seen.camera}.csv")[1])


def films_in_space(folder: Path) -> None:
    """What two cameras filmed of a strike of a robot that is known but for its whip."""
    import space_films as lab

    strike = lab.STRIKES[0]
    told = JointTrajectory.of_strike(strike, lab.ROBOT.arm.joints, rest=0.1, t_stay=0.15)
    film_in_space(folder, lab.ROBOT, told)


def film_in_space(folder: Path, model: Model, told: JointTrajectory) -> None:
    """Write `left.mkv` and `right.mkv` of a robot's trajectory, and the robot's log; all count from its beginning."""

    path, clocks = replay_trajectory(model, told), {"start": told.strike_begins, "joints_start": told.strike_begins}
    every = slice(None, None, 80)
    rows = np.column_stack([path.t, path.q[:, : model.arm.n]])[every]
    robot_lab.write(folder / "robot-joints.txt", ["t", *model.arm.joints], rows)
    for seed, (name, camera) in enumerate(two_cameras(folder).items()):
        side = _filmed(folder / f"{name}.mkv", camera, model, path, seed, start=0.01, in_space=True)
        _say(side, camera=name, joints="robot-joints.txt", **clocks)


def next_recorded(folder: Path) -> None:
    """What a lab recorded of the strike that is asked for."""
    robot_lab.run(preset("ur5e"), asked_for(folder), folder, "recorded")


def first_in_lab(folder: Path) -> None:
    """The same in a folder of the lab's own."""
    (folder / "lab").mkdir()
    robot_lab.run(preset("ur5e"), asked_for(folder), folder / "lab", "strike0")


def next_filmed(folder: Path) -> None:
    """What two cameras filmed of the strike that is asked for."""
    film_in_space(folder, preset("ur5e"), JointTrajectory.load_csv(asked_for(folder)))


def asked_for(folder: Path) -> Path:
    """The trajectory of the strike that the page's run with a robot asks for."""
    return max(path for run in ("run", "robot") for path in folder.glob(f"{run}/strike-*/trajectory.csv"))


def a_killed_search(folder: Path) -> None:
    """The page's search with DIRECT-L as one that was killed before it wrote its result, on another day."""
    runs = folder / "runs"
    if not list(runs.glob("directl-*")):
        called("optimize", "--method", "directl", "--target", "1.2", "0.1", cwd=folder)
    killed = min(runs.glob("directl-*")).rename(runs / "directl-20260102-030405")
    (killed / "result.json").unlink()


def a_run(folder: Path) -> None:
    """A simulated strike, in the folder of runs."""
    called("simulate", "--strike", *map(str, STRIKES[0]), "--no-video", cwd=folder)


def pendulums_swings(folder: Path) -> None:
    """Twelve swings of a double pendulum, by its encoders, and a guess of its links."""
    rng, links = np.random.default_rng(0), (ArmLink(0.2, 0.2), ArmLink(0.1, 0.2))
    double = pendulum(links, (1e-3, 1e-3), 0.2, (1e-3, 1e-3), 9.81)
    swings = [swing(double, np.array([rng.uniform(-1.0, 1.0, 2), np.zeros(2)]), rng) for _ in range(12)]
    np.savez(folder / "double.npz", t=swings[0].t, angle=np.array([one.points[..., 0] for one in swings]))
    guess = tomli_w.dumps({"links": [{"mass": m, "length": 0.2, "dry_friction": 1e-3} for m in (0.2, 0.1)]})
    (folder / "links.toml").write_text(guess, encoding="utf-8")


Make: TypeAlias = Callable[[Path], object]
MADE: dict[str, tuple[Make, ...]] = {
    "commands.md": (people,),
    "how-to/identify.md": (own_whip,),
    "how-to/unknown-whips.md": (prior,),
    "human.md": (people,),
    "results.md": (people,),
}
# What is made before a command that holds these words
RECORDED: dict[str, dict[str, Make]] = {
    "commands.md": {
        "--resume runs/directl-": a_killed_search,
        "strike2.mkv": of_strikes,
        "recording show strike1.csv": of_strikes,
        "identify left.mkv": films_in_space,
        "*.csv": in_a_hand,
        "swing*.mkv": swings,
        "double.npz": pendulums_swings,
        "next --run robot recorded.csv": next_recorded,
        "next --run robot left.mkv": next_filmed,
    },
    "file-formats.md": {"recording show strike1.csv": robots_strikes, "take1.c3d": a_take},
    "how-to/cameras.md": {"strike1-left.csv": tables_of_pixels},
    "how-to/identify.md": {
        "identify strike1.mkv": coloured_films,
        "--drive passive --free": swings,
        "--drive passive --clamp": clamped_swings,
        "double.npz": pendulums_swings,
    },
    "how-to/robot-trajectories.md": {
        "view RUN": a_run,
        "identify strike1.csv": robots_strikes,
        "lab/strike0.csv": first_in_lab,
        "next --run run left.mkv": next_filmed,
    },
}
