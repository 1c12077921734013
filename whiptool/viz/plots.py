"""Figures of a strike over time and of a search, drawn with matplotlib's objects.

Every `plot_...` function draws into given axes and returns them, so that figures can be composed;
`matplotlib.rc_context(STYLE)` gives them the style of the saved figures. Without axes, the functions for a strike make
a new figure with pyplot in that style.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
    head,
    joint_units,
    legend_above,
    length_text,
    save_figure,
)

_TIME_SIZE, _TWO_TIMES_SIZE = (7.6, 4.0), (7.6, 6.4)  # [in]
_EXACT = 1e-9  # [deg or mm, or the same a second], below which errors are rounding errors


def _new_axes(size: tuple[float, float]) -> Axes:
    """Axes of a new figure of this size [in]."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained").subplots()


def _new_pair(size: tuple[float, float]) -> np.ndarray:
    """Two axes of a new figure of this size [in] over one time, (2,)."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained").subplots(2, sharex=True)


def _tracking_size(joints: int) -> tuple[float, float]:
    """Size of a figure of tracking errors [in], with room for a legend of many joints."""
    return _TWO_TIMES_SIZE if joints < 4 else (10.0, 6.8)


def _joints(trajectory: Trajectory, model: Model | None) -> tuple[Sequence[str], Sequence[str]]:
    """Names of the arm's joints, and of those that slide; without a model they have numbers, and all of them turn."""
    if model is None:
        return [f"joint{i + 1}" for i in range(trajectory.tau.shape[1])], ()
    expect(Model, model=model)
    return model.arm.joints, model.arm.slides


def plot_tracking(trajectory: Trajectory, model: Model | None = None, *, axes: np.ndarray | None = None) -> np.ndarray:
    """Draw the errors of positions [deg] and velocities [deg/s] of the arm's joints: actual minus desired, over time.

    The legend has the root mean square and the largest of each error. Where the joints follow their references exactly,
    as under position control, the positions and velocities themselves are drawn. Prismatic joints are drawn in mm and
    mm/s.

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
            return plot_tracking(trajectory, model, axes=_new_pair(_tracking_size(len(joint_names))))
    a = len(joint_names)
    units = ["mm" if name in slides else "deg" for name in joint_names]
    scale = np.array([1e3 if unit == "mm" else 180 / np.pi for unit in units])
    q, v = scale * trajectory.q[:, :a], scale * trajectory.v[:, :a]
    errors = (q - scale * trajectory.q_d, v - scale * trajectory.v_d)
    exact = bool(np.nanmax(np.abs(errors)) < _EXACT)
    for ax, actual, error, quantity, per in zip(
        axes, (q, v), errors, ("position", "velocity"), ("", "/s"), strict=True
    ):
        for i, name in enumerate(joint_names):
            drawn, label = (actual, name) if exact else (error, f"{name}: {_size(error[:, i])} {units[i]}{per}")
            width = (
                1.5 + 0.5 * (len(joint_names) - 1 - i) if exact else 1.8
            )  # joints that move alike show behind others
            ax.plot(trajectory.t, drawn[:, i], color=JOINT_COLORS[i % len(JOINT_COLORS)], linewidth=width, label=label)
        what = quantity if exact else f"{quantity} error"
        ax.set_ylabel(f"{what} [{joint_units(f'deg{per}', f'mm{per}', joint_names, slides)}]")
        _time_axis(ax, trajectory)
        if exact and quantity == "position":
            ax.set_title("the joints follow their references exactly", loc="left")
        legend_above(ax, ncols=4 if exact else 2)
    return axes


def _size(error: np.ndarray) -> str:
    """Root mean square and largest magnitude of errors (T,), in words."""
    return f"RMS {np.sqrt(np.mean(error**2)):.3g}, largest {np.abs(error).max():.3g}"


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


def plot_tip_speed(
    trajectory: Trajectory, target: Target | Sequence[float] | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw the speed of the tip [m/s] over time, and mark its maximum.

    Args:
        trajectory: Trajectory of the strike.
        target: Target of the strike, or (x, y), in space (x, y, z) [m], whose closest approach is marked, too; None:
            no mark.
        ax: Axes to draw into; None: axes of a new figure.

    Returns:
        The axes.
    """
    expect(Trajectory, trajectory=trajectory)
    expect(Axes, type(None), ax=ax)
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_tip_speed(trajectory, target, ax=_new_axes(_TIME_SIZE))
    t, speed = trajectory.t, trajectory.tip_speed
    fastest = int(speed.argmax())
    label = f"largest {speed[fastest]:.3g} m/s at {t[fastest]:.3f} s"
    ax.plot(t, speed, color=COLORS["blue"])
    ax.plot(t[fastest], speed[fastest], "^", color=COLORS["black"], markersize=7, zorder=3, label=label)
    if target is not None:
        near = trajectory.approach(as_target(target))
        label = f"closest approach, {near.speed[0]:.3g} m/s at {near.time[0]:.3f} s"
        ax.plot(near.time, near.speed, "o", color=COLORS["vermilion"], markersize=7, zorder=4, label=label)
    ax.set_ylabel("speed of the tip [m/s]")
    _time_axis(ax, trajectory)
    ax.set_ylim(bottom=0)
    legend_above(ax)
    return ax


def plot_gains(trajectory: Trajectory, model: Model | None = None, *, axes: np.ndarray | None = None) -> np.ndarray:
    """Draw the entries of the controller's stiffness and damping over time (Fig. 10c, d), or constant ones as matrices.

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
        from matplotlib import pyplot

        with matplotlib.rc_context(STYLE):
            figure = pyplot.figure(figsize=_gains_size(trajectory, joint_names), layout="constrained")
            return plot_gains(trajectory, model, axes=_gains_axes(figure, trajectory))
    stiffness = joint_units("N m/rad", "N/m", joint_names, slides)
    damping = joint_units("N m s/rad", "N s/m", joint_names, slides)
    draw = _plot_matrix if _constant(trajectory) else _plot_entries
    for ax, name, unit in ((axes[0], "K", stiffness), (axes[1], "B", damping)):
        draw(ax, trajectory, name, f"{'stiffness' if name == 'K' else 'damping'} {name} [{unit}]", joint_names)
    return axes


def _constant(trajectory: Trajectory) -> bool:
    """Whether the gains stay as they are over the whole strike."""
    return all(bool(np.allclose(gain, gain[:1], rtol=1e-9, atol=0)) for gain in (trajectory.K, trajectory.B))


def _gains_size(trajectory: Trajectory, joint_names: Sequence[str]) -> tuple[float, float]:
    """Size of a figure of the gains [in], with room for the names of the joints next to matrices."""
    if not _constant(trajectory):
        return _TWO_TIMES_SIZE
    name, count = 0.09 * max(len(name) for name in joint_names), len(joint_names)
    below = name if count > 3 else 0.2  # where names are turned
    return 2 * (0.6 + name + max(0.72 * count, 2.4)), 1.4 + below + max(0.5 * count, 1.8)


def _gains_axes(figure: Figure, trajectory: Trajectory) -> np.ndarray:
    """Two axes for the gains, (2,): next to each other where they are matrices, else over one time."""
    return figure.subplots(1, 2) if _constant(trajectory) else figure.subplots(2, sharex=True)


def _plot_matrix(ax: Axes, trajectory: Trajectory, name: str, label: str, joint_names: Sequence[str]) -> None:
    """Draw a constant gain as a matrix with its numbers."""
    gain, count = (trajectory.K if name == "K" else trajectory.B)[0], len(joint_names)
    ax.imshow(np.abs(gain), cmap="Blues", vmin=0, vmax=2 * max(float(np.abs(gain).max()), 1e-12), aspect="auto")
    for (i, j), value in np.ndenumerate(gain):
        look = {"ha": "center", "va": "center", "color": "black" if value else "0.6", "fontsize": 10}
        ax.text(j, i, f"{value:.4g}" if value else "0", **look)
    turned: dict[str, Any] = {} if count <= 3 else {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}
    ax.set_xticks(range(count), joint_names, **turned)
    ax.set_yticks(range(count), joint_names)
    ax.set(xlabel="error of", ylabel="torque on")
    ax.set_title(f"{label}, constant", loc="left")
    ax.grid(visible=False)


def _plot_entries(ax: Axes, trajectory: Trajectory, name: str, label: str, joint_names: Sequence[str]) -> None:
    """Draw the entries of a gain over time."""
    gain = trajectory.K if name == "K" else trajectory.B
    letters = [joint[0] for joint in joint_names]
    marks = letters if len(set(letters)) == len(letters) else [str(i + 1) for i in range(len(letters))]
    a, few = len(marks), len(marks) <= 3
    for k, (i, j) in enumerate(np.ndindex(a, a)):
        color, entry = CYCLE[k % len(CYCLE)], f"${name}_{{{marks[i]}{marks[j]}}}$"
        style: dict[str, Any] = {"linestyle": "-" if i == j else (4 * (i > j), (4, 4))}  # equal ones show in turn
        if not few:
            color = JOINT_COLORS[i % len(JOINT_COLORS)] if i == j else "0.6"
            style = {} if i == j else {"linewidth": 0.8, "zorder": 1.5}
            entry = f"{entry}, {joint_names[i]}" if i == j else ""
        ax.plot(trajectory.t, gain[:, i, j], color=color, label=entry, **style)
    if not few:
        ax.plot([], [], color="0.6", linewidth=0.8, label="coupling")
    largest = np.abs(gain).max(axis=(1, 2))
    peak, usual = largest.max(), np.median(largest)
    if usual < peak / 10:  # gains of rank one rise and fall with the error by orders of magnitude
        ax.set_yscale("symlog", linthresh=10 ** np.floor(np.log10(max(usual, peak / 1e3))))
    ax.set_ylabel(label)
    _time_axis(ax, trajectory)
    legend_above(ax, ncols=4)


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
            label=f"{trajectory.MEETING} {length_text(near.distance[0])} at {near.time[0]:.3f} s",
        )
    ax.set_ylabel(f"distance {trajectory.FOLLOWED} to target [m]")
    _time_axis(ax, trajectory)
    ax.set_ylim(bottom=0)
    legend_above(ax)
    return ax


def save_strike_figures(
    folder: str | Path, trajectory: Trajectory, model: Model, target: Target, controller_label: str
) -> list[Path]:
    """Write `strike.png`, `distance.png`, `speed.png`, `tracking.png`, `torque.png` and, if there are gains,
    `gains.png`.

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
        sizes = dict.fromkeys(("distance", "speed", "torque"), _TIME_SIZE)
        sizes["tracking"] = _tracking_size(model.arm.n)
        sizes |= (
            {"gains": _gains_size(trajectory, model.arm.joints)} if trajectory.K.any() or trajectory.B.any() else {}
        )
        figures = {name: Figure(size, layout="constrained") for name, size in sizes.items()}
        figures["strike"] = Figure()
        draw_strike(figures["strike"], trajectory, model, target)
        plot_distance(trajectory, target, ax=figures["distance"].subplots())
        plot_tip_speed(trajectory, target, ax=figures["speed"].subplots())
        plot_tracking(trajectory, model, axes=figures["tracking"].subplots(2, sharex=True))
        plot_torque(trajectory, model, ax=figures["torque"].subplots())
        if "gains" in figures:
            plot_gains(trajectory, model, axes=_gains_axes(figures["gains"], trajectory))
        for figure in figures.values():
            head(figure, f"{model.name}, {controller_label}")
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
