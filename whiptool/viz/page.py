"""A strike as one interactive HTML file that needs nothing else: the arm and whip at an instant, linked to plots."""

from __future__ import annotations

from typing import Any

import numpy as np

from whiptool.models.parameters import Model
from whiptool.rollout.trajectory import Approach, Trajectory
from whiptool.viz.plots import COLORS, planned_end
from whiptool.viz.templating import filled

RATE = 500.0  # [Hz], at which a strike is shown
MOST = 120_000  # numbers in a page; a longer strike is shown at a lower rate


def strike_page(model: Model, trajectory: Trajectory, target: np.ndarray, hit_radius: float, *, label: str = "") -> str:
    """Return the page: the strike at an instant that a slider chooses, and its speed, angles and torques over time.

    Args:
        model, trajectory: The strike, and the model that it was rolled out with.
        target, hit_radius: Position (2,) [m], and how near [m] the tip must come to hit.
        label: The controller, in words.
    """
    target = np.asarray(target, float)
    data = strike_data(model, trajectory, target, hit_radius)
    period = 1e3 * float(np.median(np.diff(data["t"]))) if len(data["t"]) > 1 else 0.0
    return filled(
        "strike.html",
        title=f"Strike of {model.name}",
        subtitle=_subtitle(trajectory, trajectory.approach(target), target, hit_radius, label),
        period=f"{period:.2g}",
        colors=COLORS,
        data=data,
    )


def strike_data(model: Model, trajectory: Trajectory, target: np.ndarray, hit_radius: float) -> dict[str, Any]:
    """What the page draws, as plain data: instants of the trajectory, and the closest approach between two of them.

    Numbers have six digits, and are None where they are not finite; rows of a matrix follow one another.
    """
    near, a, whole = trajectory.approach(target), model.arm.n, trajectory
    parts = {
        "q": whole.q,
        "q_d": whole.q_d,
        "tip": whole.tip,
        "tip_velocity": whole.tip_velocity,
        "tau": whole.tau,
        "K": whole.K.reshape(len(whole.t), -1),
        "B": whole.B.reshape(len(whole.t), -1),
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
    letters = [name[0] for name in model.arm.joints]
    return {
        "t": _plain(t, digits=8),
        **{name: [_plain(column) for column in x.T] for name, x in shown.items() if name != "tip_velocity"},
        "speed": _plain(np.hypot(*shown["tip_velocity"].T)),
        "distance": _plain(np.hypot(*(shown["tip"] - target).T)),
        "lengths": [float(x) for x in (*model.arm.per_link("length"), *model.whip.per_node("l"))],
        "arm": a,
        "joints": list(model.arm.joints),
        "marks": letters if len(set(letters)) == a else [str(i + 1) for i in range(a)],
        "target": [float(x) for x in target],
        "hit_radius": float(hit_radius),
        "near": {
            "time": _plain(near.time, digits=8)[0],
            "distance": _plain(near.distance)[0],
            "tip": _plain(near.tip[0]),
        }
        if seen
        else None,
        "D": planned_end(whole),
    }


def _plain(values: np.ndarray, digits: int = 6) -> list[float | None]:
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in values]


def _subtitle(trajectory: Trajectory, near: Approach, target: np.ndarray, hit_radius: float, label: str) -> str:
    distance = float(near.distance[0])
    said = "Hits" if distance <= hit_radius else "Misses"
    where = ", ".join(f"{x:.3f}" for x in target)
    words = [f"{said} the target at ({where}) m, hit radius {hit_radius:g} m"]
    if trajectory.diverged:
        words = [f"The simulation diverged at {trajectory.t[-1]:.4f} s; target at ({where}) m"]
    if np.isfinite(distance):
        words.append(f"closest {distance:.4f} m at {near.time[0]:.3f} s with {near.speed[0]:.1f} m/s")
    return "; ".join([*words, label] if label else words) + "."
