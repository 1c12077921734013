"""A lab that never saw whiptool's code: a robot runs an exported trajectory, cameras see markers, files are written."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.interpolate import BPoly
from scipy.signal import lsim

from whiptool.models import Model
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.rollout.servo_replay import replay_trajectory

LAG = 0.02  # [s] of the robot's own control, a first-order one, behind what it is told
RATE, FPS = 125.0, 240.0  # [1/s] of the joint log, of the cameras
ENCODER, MARKER = 2e-5, 5e-4  # [rad], [m] standard errors
UPTIME = 37.25  # [s] that the robot's clock showed when the trajectory began; the cameras count from the strike


def lagging(told: JointTrajectory, lag: float = LAG) -> JointTrajectory:
    """Return what the robot's joints are sent to: the trajectory behind a first-order lag."""
    fine = np.linspace(0, told.t[-1], 20 * (len(told.t) - 1) + 1)
    wanted = BPoly.from_derivatives(told.t, np.stack([told.q, told.v, told.a], axis=1))(fine)
    q = np.stack([x[0] + lsim(([1.0], [lag, 1.0]), x - x[0], fine)[1] for x in wanted.T], axis=1)[::20]
    v = (told.q - q) / lag
    return JointTrajectory(told.joints, told.t, q, v, (told.v - v) / lag)


def run(model: Model, trajectory: Path, folder: Path, name: str, *, seed: int = 0, t_stay: float = 0.15) -> Path:
    """Let MuJoCo's servos run an exported trajectory; write what a lab records of it, and return the markers' file."""
    rng, told = np.random.default_rng(seed), JointTrajectory.load_csv(trajectory)
    path, begins = replay_trajectory(model, lagging(told)), told.strike_begins
    at = np.arange(0.0, path.t[-1], 1 / RATE)
    joints = np.stack([np.interp(at, path.t, q) for q in path.q[:, : model.arm.n].T], axis=1)
    joints += ENCODER * rng.standard_normal(joints.shape)
    order = rng.permutation(model.arm.n)  # a robot's log need not have the arm's order
    names = [model.arm.joints[i] for i in order]
    speeds = np.gradient(joints, at, axis=0)
    header = ["time", *(f"{kind}_{joint}" for kind in ("position", "velocity") for joint in names)]
    write(folder / f"{name}.joints.csv", header, np.column_stack([at + UPTIME, joints[:, order], speeds[:, order]]))
    frames = np.arange(-0.05, path.t[-1] - begins, 1 / FPS)
    tip = np.stack([np.interp(frames + begins, path.t, x) for x in path.tip.T], axis=1)
    tip += MARKER * rng.standard_normal(tip.shape)
    tip[rng.random(len(tip)) < 0.1] = np.nan
    write(folder / f"{name}.csv", ["t", "tip_x", "tip_y", "tip_z"], np.column_stack([frames, tip]))
    side = f'joints = "{name}.joints.csv"\njoints_start = {UPTIME + begins}\nsigma = {MARKER}\nt_stay = {t_stay}\n'
    (folder / f"{name}.toml").write_text(side)
    return folder / f"{name}.csv"


def write(path: Path, header: list[str], rows: np.ndarray) -> None:
    """Write numbers under their names; what is missing is empty."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([["" if np.isnan(x) else repr(float(x)) for x in row] for row in rows])


def exported(strike: Strike, model: Model, path: Path, *, rest: float = 0.1, t_stay: float = 0.15) -> Path:
    """Write a strike's trajectory as the commands do, and return its file."""
    JointTrajectory.of_strike(strike, model.arm.joints, rest=rest, t_stay=t_stay).save_csv(path)
    return path
