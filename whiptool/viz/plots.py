"""Figures of a strike over time and of a search, drawn with matplotlib's objects.

Every `plot_...` function draws into given axes and returns them, so that figures can be composed;
`matplotlib.rc_context(STYLE)` gives them the style of the saved figures. Without axes, the functions for a strike make
a new figure with pyplot in that style.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whiptool.errors import expect
from whiptool.goals.target import Target, as_target
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.viz.drawn_posture import planned_end
from whiptool.viz.plots_strike import draw_strike
from whiptool.viz.style import (
    COLORS,
    CYCLE,
    JOINT_COLORS,
    STYLE,
    joint_units,
    legend_above,
    length_text,
    save_figure,
    verbatim,
)

_TIME_SIZE, _TWO_TIMES_SIZE = (7.6, 4.0), (7.6, 6.4)  # [in]


def _new_axes(size: tuple[float, float]) -> Axes:
    """Axes of a new figure of this size [in]."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained").subplots()


def _new_pair() -> np.ndarray:
    """Two axes of a new figure over one time, (2,)."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=_TWO_TIMES_SIZE, layout="constrained").subplots(2, sharex=True)


def _joints(trajectory: Trajectory, model: Model | None) -> tuple[Sequence[str], Sequence[str]]:
    """Names of the arm's joints, and of those that slide; without a model they have numbers, and all of them turn."""
    if model is None:
        return [f"joint{i + 1}" for i in range(trajectory.tau.shape[1])], ()
    expect(Model, model=model)
    return model.arm.joints, model.arm.slides


def plot_tracking(trajectory: Trajectory, model: Model | None = None, *, axes: np.ndarray | None = None) -> np.ndarray:
    """Draw positions [deg] and velocities [deg/s] of the arm's joints and their references.

    Prismatic joints are drawn in mm and mm/s.

    Args:
        trajectory: Trajectory of the strike.
        model: Model with which it was simulated, for the joints' names and kinds; None: joints are numbered and taken
            as revolute.
        axes: Axes to draw into, (2,); None: axes of a new figure.

    Returns:
        The axes.
    """
    expect(Trajectory, trajectory=trajectory)
    joint_names, slides = _joints(trajectory, model)
    if axes is None:
        with matplotlib.rc_context(STYLE):
            return plot_tracking(trajectory, model, axes=_new_pair())
    pairs = ((trajectory.q, trajectory.q_d, "position", ""), (trajectory.v, trajectory.v_d, "velocity", "/s"))
    for ax, (actual, desired, quantity, per) in zip(axes, pairs, strict=True):
        for i, name in enumerate(joint_names):
            scale, unit = (1e3, f"mm{per}") if name in slides else (180 / np.pi, f"deg{per}")
            error = round(scale * float(np.abs(desired[:, i] - actual[:, i]).max()), 9)  # no rounding errors
            ax.plot(
                trajectory.t,
                scale * actual[:, i],
                color=JOINT_COLORS[i % len(JOINT_COLORS)],
                linewidth=3,
                alpha=0.75,
                label=f"{name}, error up to {error:.3g} {unit}",
            )
            ax.plot(
                trajectory.t,
                scale * desired[:, i],
                color=COLORS["black"],
                linestyle=(0, (4, 2.5)),
                linewidth=1.1,
                label="desired" if i == len(joint_names) - 1 else "",
            )
        ax.set_ylabel(f"{quantity} [{joint_units(f'deg{per}', f'mm{per}', joint_names, slides)}]")
        _time_axis(ax, trajectory)
        legend_above(ax, ncols=3 if len(joint_names) < 4 else 2)
    return axes


def plot_torque(trajectory: Trajectory, model: Model | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the torques of the arm's joints [N m] over time, or forces [N] of prismatic joints.

    Args:
        trajectory: Trajectory of the strike.
        model: Model with which it was simulated, for the joints' names and kinds; None: joints are numbered and taken
            as revolute.
        ax: Axes to draw into; None: axes of a new figure.

    Returns:
        The axes.
    """
    expect(Trajectory, trajectory=trajectory)
    joint_names, slides = _joints(trajectory, model)
    expect(Axes, type(None), ax=ax)
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_torque(trajectory, model, ax=_new_axes(_TIME_SIZE))
    largest = np.abs(trajectory.tau).max(axis=0)
    for i, name in enumerate(joint_names):
        label = f"{name}, up to {largest[i]:.3g} {'N' if name in slides else 'N m'}"
        ax.plot(trajectory.t, trajectory.tau[:, i], color=JOINT_COLORS[i % len(JOINT_COLORS)], label=label)
    ax.set_ylabel(f"torque [{joint_units('N m', 'N', joint_names, slides)}]")
    _time_axis(ax, trajectory)
    legend_above(ax)
    return ax


def plot_tip_speed(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw the speed of the tip [m/s] over time, and mark its maximum.

    Args:
        trajectory: Trajectory of the strike.
        ax: Axes to draw into; None: axes of a new figure.

    Returns:
        The axes.
    """
    expect(Trajectory, trajectory=trajectory)
    expect(Axes, type(None), ax=ax)
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_tip_speed(trajectory, ax=_new_axes(_TIME_SIZE))
    t, speed = trajectory.t, trajectory.tip_speed
    fastest = int(speed.argmax())
    label = f"largest {speed[fastest]:.3g} m/s at {t[fastest]:.3f} s"
    ax.plot(t, speed, color=COLORS["blue"])
    ax.plot(t[fastest], speed[fastest], "o", color=COLORS["vermilion"], markersize=7, zorder=3, label=label)
    ax.set_ylabel("speed of the tip [m/s]")
    _time_axis(ax, trajectory)
    ax.set_ylim(bottom=0)
    legend_above(ax)
    return ax


def plot_gains(trajectory: Trajectory, model: Model | None = None, *, axes: np.ndarray | None = None) -> np.ndarray:
    """Draw the entries of the controller's stiffness and damping over time (Fig. 10c, d).

    Diagonal entries of prismatic joints are in N/m and N s/m. For more than three joints, off-diagonal entries are thin
    lines with one common label.

    Args:
        trajectory: Trajectory of the strike.
        model: Model with which it was simulated, for the joints' names and kinds; None: joints are numbered and taken
            as revolute.
        axes: Axes to draw into, (2,); None: axes of a new figure.

    Returns:
        The axes.
    """
    expect(Trajectory, trajectory=trajectory)
    joint_names, slides = _joints(trajectory, model)
    if axes is None:
        with matplotlib.rc_context(STYLE):
            return plot_gains(trajectory, model, axes=_new_pair())
    letters = [name[0] for name in joint_names]
    marks = letters if len(set(letters)) == len(letters) else [str(i + 1) for i in range(len(letters))]
    a, few = len(marks), len(marks) <= 3
    stiffness = joint_units("N m/rad", "N/m", joint_names, slides)
    damping = joint_units("N m s/rad", "N s/m", joint_names, slides)
    for ax, gain, name, unit in ((axes[0], trajectory.K, "K", stiffness), (axes[1], trajectory.B, "B", damping)):
        for k, (i, j) in enumerate(np.ndindex(a, a)):
            color, label = CYCLE[k % len(CYCLE)], f"${name}_{{{marks[i]}{marks[j]}}}$"
            style = {"linestyle": "-" if i == j else (4 * (i > j), (4, 4))}  # equal ones show in turn
            if not few:
                color = JOINT_COLORS[i % len(JOINT_COLORS)] if i == j else "0.6"
                style = {} if i == j else {"linewidth": 0.8, "zorder": 1.5}
                label = label if i == j else ""
            ax.plot(trajectory.t, gain[:, i, j], color=color, label=label, **style)
        if not few:
            ax.plot([], [], color="0.6", linewidth=0.8, label="coupling")
        largest = np.abs(gain).max(axis=(1, 2))
        peak, usual = largest.max(), np.median(largest)
        if usual < peak / 10:  # gains of rank one rise and fall with the error by orders of magnitude
            ax.set_yscale("symlog", linthresh=10 ** np.floor(np.log10(max(usual, peak / 1e3))))
        ax.set_ylabel(f"{'stiffness' if name == 'K' else 'damping'} {name} [{unit}]")
        _time_axis(ax, trajectory)
        legend_above(ax, ncols=max(a * a, 4) if few else a + 1)
    return axes


def plot_distance(trajectory: Trajectory, target: Target | Sequence[float], *, ax: Axes | None = None) -> Axes:
    """Draw the distance of the tip from the target over time (Fig. 10b), with the closest approach.

    Args:
        trajectory: Trajectory of the strike.
        target: Target of the strike, or (x, y), in space (x, y, z) [m].
        ax: Axes to draw into; None: axes of a new figure.

    Returns:
        The axes.
    """
    expect(Trajectory, trajectory=trajectory)
    expect(Axes, type(None), ax=ax)
    goal = as_target(target)
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_distance(trajectory, goal, ax=_new_axes(_TIME_SIZE))
    place, hit_radius = np.array(goal.position), goal.hit_radius
    near = trajectory.approach(place)
    ax.plot(trajectory.t, trajectory.distance(place), color=COLORS["blue"])
    ax.axhspan(0, hit_radius, color=COLORS["orange"], alpha=0.25, linewidth=0)
    ax.axhline(hit_radius, color=COLORS["orange"], linestyle="--", linewidth=1.5, label=f"hit radius {hit_radius:g} m")
    if np.isfinite(near.distance[0]):
        ax.plot(
            near.time,
            near.distance,
            "o",
            color=COLORS["vermilion"],
            markersize=7,
            zorder=3,
            clip_on=False,
            label=f"closest approach {length_text(near.distance[0])} at {near.time[0]:.3f} s",
        )
    ax.set_ylabel("distance tip to target [m]")
    _time_axis(ax, trajectory)
    ax.set_ylim(bottom=0)
    figure = ax.get_figure(root=True)
    assert figure is not None
    width = ax.get_position().width * figure.get_figwidth()  # [inch]
    legend_above(ax, ncols=2 if width > 5 else 1)
    return ax


def save_strike_figures(
    folder: str | Path, trajectory: Trajectory, model: Model, target: Target, controller_label: str
) -> list[Path]:
    """Write `strike.png`, `distance.png`, `tracking.png`, `torque.png` and, if there are gains, `gains.png`.

    Args:
        folder: Folder to write to, created if missing.
        trajectory: Trajectory of the strike.
        model: Model with which it was simulated.
        target: Target of the strike.
        controller_label: Name of the controller in the figures.

    Returns:
        The files.
    """
    with matplotlib.rc_context(STYLE):
        sizes = {"distance": _TIME_SIZE, "tracking": _TWO_TIMES_SIZE, "torque": _TIME_SIZE}
        sizes |= {"gains": _TWO_TIMES_SIZE} if trajectory.K.any() or trajectory.B.any() else {}
        figures = {name: Figure(size, layout="constrained") for name, size in sizes.items()}
        figures["strike"] = Figure()
        draw_strike(figures["strike"], trajectory, model, target)
        plot_distance(trajectory, target, ax=figures["distance"].subplots())
        plot_tracking(trajectory, model, axes=figures["tracking"].subplots(2, sharex=True))
        plot_torque(trajectory, model, ax=figures["torque"].subplots())
        if "gains" in figures:
            plot_gains(trajectory, model, axes=figures["gains"].subplots(2, sharex=True))
        title = verbatim(f"{model.name}, {controller_label}")
        for figure in figures.values():
            figure.suptitle(title, fontsize=12, fontweight="bold", x=0.02, ha="left")
        return [save_figure(figure, Path(folder) / f"{name}.png") for name, figure in figures.items()]


def _time_axis(ax: Axes, trajectory: Trajectory) -> None:
    """Label time, and mark D, the end of the planned movement."""
    ax.margins(y=0.12)  # room for the mark
    ax.set_xlim(trajectory.t[0], max(trajectory.t[-1], trajectory.t[0] + 1e-3))
    D = planned_end(trajectory)
    if D is not None:
        ax.axvline(D, color="0.55", linewidth=1, linestyle=":", zorder=1)
        ax.annotate(
            "D",
            (D, 1),
            xycoords=ax.get_xaxis_transform(),
            xytext=(3, -3),
            textcoords="offset points",
            va="top",
            color="0.35",
        )
    spec = ax.get_subplotspec()
    if spec is None or spec.is_last_row():
        ax.set_xlabel("time [s]")
