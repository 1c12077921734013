"""A strike as one self-contained interactive HTML file: arm and whip over time, linked to plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from whiptool.goals.target import Target, as_target, missed_words
from whiptool.models.kinematics import arm_frames, joint_points
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.viz.drawn_posture import planned_end
from whiptool.viz.report import filled
from whiptool.viz.style import COLORS, joint_units

RATE = 500.0  # [Hz], at which a strike is shown
MOST = 120_000  # numbers in a page; a longer strike is shown at a lower rate


def strike_page(
    model: Model,
    trajectory: Trajectory,
    target: Target | Sequence[float] | np.ndarray,
    *,
    label: str = "",
    beyond: str | None = None,
) -> str:
    """Return an interactive HTML page: the strike at the instant of a slider, and speed, angles and torques over time.

    Args:
        model, trajectory: Trajectory of the strike, and the model with which it was simulated.
        target: Target of the strike, or its position (2,) or (3,) [m].
        label: Description of the controller.
        beyond: Description of the limit that the strike exceeds, which is then not shown as a hit; None: it keeps all.
    """
    goal = as_target(target)
    data = strike_data(model, trajectory, goal)
    if beyond is not None:
        data["hit_time"] = None
    period = 1e3 * float(np.median(np.diff(data["t"]))) if len(data["t"]) > 1 else 0.0
    return filled(
        "strike.html",
        title=f"Strike of {model.name}",
        subtitle=_subtitle(trajectory, goal, label, beyond),
        period=f"{period:.2g}",
        colors=COLORS,
        data=data,
    )


def strike_data(model: Model, trajectory: Trajectory, goal: Target) -> dict[str, Any]:
    """Return the data of the page: samples of the trajectory, and the closest approach.

    Numbers are rounded to six digits; values that are not finite become None.
    """
    near, a, whole, target = trajectory.approach(goal), model.arm.n, trajectory, np.array(goal.position)
    parts = {
        **_in_space(model, whole),
        "q": whole.q[:, : a if model.dimension == 3 else None],
        "q_d": whole.q_d,
        "tip": whole.tip,
        "tip_velocity": whole.tip_velocity,
        "tau": whole.tau,
        "K": _gains(whole.K),
        "B": _gains(whole.B),
    }
    most = MOST // sum(x.shape[1] for x in parts.values())
    step = max(1 / RATE, float(whole.t[-1] - whole.t[0]) / most)
    kept = np.unique(np.r_[np.searchsorted(whole.t, np.arange(whole.t[0], whole.t[-1], step)), len(whole.t) - 1])
    t, shown = whole.t[kept], {name: x[kept] for name, x in parts.items()}
    seen = bool(np.isfinite(near.distance[0]))
    if seen and near.time[0] not in t:
        at = int(np.searchsorted(t, near.time[0]))
        t = np.insert(t, at, near.time[0])
        for name, x in parts.items():
            row = [np.interp(near.time[0], whole.t, column) for column in x.T]
            shown[name] = np.insert(shown[name], at, row, axis=0)
    letters, hit_time = [name[0] for name in model.arm.joints], goal.hit_time(near)
    return {
        "t": _plain(t, digits=8),
        **{name: [_plain(column) for column in x.T] for name, x in shown.items() if name != "tip_velocity"},
        "speed": _plain(np.linalg.norm(shown["tip_velocity"], axis=1)),
        "distance": _plain(np.linalg.norm(shown["tip"] - target, axis=1)),
        "lengths": []
        if model.dimension == 3
        else [*map(float, (*model.arm.per_link("length"), *model.whip.per_node("l")))],
        "arm": a,
        "joints": list(model.arm.joints),
        "slides": [joint in model.arm.slides for joint in model.arm.joints],
        "units": _units(model),
        "marks": letters if len(set(letters)) == a else [str(i + 1) for i in range(a)],
        "target": [float(x) for x in target],
        "hit_radius": goal.hit_radius,
        "hit_time": hit_time if hit_time is None else _plain(near.time, digits=8)[0],
        "near": {
            "time": _plain(near.time, digits=8)[0],
            "distance": _plain(near.distance)[0],
            "tip": _plain(near.tip[0]),
        }
        if seen
        else None,
        "D": planned_end(whole),
    }


def _units(model: Model) -> dict[str, str]:
    """Units of the plots of all joints."""
    pairs = {"q": ("deg", "mm"), "tau": ("N m", "N"), "K": ("N m/rad", "N/m"), "B": ("N m s/rad", "N s/m")}
    return {name: joint_units(*pair, model.arm.joints, model.arm.slides) for name, pair in pairs.items()}


def _gains(gain: np.ndarray) -> np.ndarray:
    """All entries of a gain (T, a, a), row by row; of more than three joints those on the diagonal."""
    few = gain.shape[1] <= 3
    return gain.reshape(len(gain), -1) if few else np.diagonal(gain, axis1=1, axis2=2)


def _in_space(model: Model, trajectory: Trajectory) -> dict[str, np.ndarray]:
    """Where the joints, the hand and the nodes are, and where the arm is to be: coordinates one after the other."""
    if model.dimension == 2:
        return {}  # the page works that out from the angles
    frames = arm_frames(model.arm.in_space(), trajectory.q_d)
    points = {"points": joint_points(model, trajectory.q), "desired": np.stack([f.origin for f in frames], axis=1)}
    return {name: x.reshape(len(trajectory.t), -1) for name, x in points.items()}


def _plain(values: np.ndarray, digits: int = 6) -> list[float | None]:
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in values]


def _subtitle(trajectory: Trajectory, goal: Target, label: str, beyond: str | None) -> str:
    near = trajectory.approach(goal)
    distance = float(near.distance[0])
    where = ", ".join(f"{x:.3f}" for x in goal.position)
    place = f"target at ({where}) m, hit radius {goal.hit_radius:g} m"
    words = [f"{_verdict(goal, near)} the {place}"]
    if trajectory.diverged:
        words = [f"The simulation diverged at {trajectory.t[-1]:.4f} s; target at ({where}) m"]
    elif beyond is not None:
        words = [
            f"Beyond its limits, and so no hit: {beyond}",
            f"target at ({where}) m, hit radius {goal.hit_radius:g} m",
        ]
    if np.isfinite(distance):
        words.append(f"closest {distance:.4f} m at {near.time[0]:.3f} s with {near.speed[0]:.1f} m/s")
        words += _arrival(goal, near)
    return "; ".join([*words, label] if label else words) + "."


def _verdict(goal: Target, near: Approach) -> str:
    """Whether the strike hits, and which of several things that are asked for it misses, and by how much."""
    if goal.hit_time(near) is not None:
        return "Hits"
    if goal.goals.only_points:
        return "Misses"
    return f"Misses {missed_words(goal.missed_by(near.distance[0], near.velocity[0]))}:"


def _arrival(goal: Target, near: Approach) -> list[str]:
    """Arrival of the tip, and the required one."""
    said, speed = [], f"{goal.goals.arrival_speed(near.velocity)[0]:.1f} m/s"
    if goal.direction is not None:
        angle = math.degrees(goal.goals.angle(near.velocity)[0])
        said.append(f"{angle:.1f} degrees from the direction asked for (at most {math.degrees(goal.cone):g})")
    if goal.speed is not None:
        said.append(f"{speed} {'along it' if said else 'fast'} (at least {goal.speed:g})")
    return said
