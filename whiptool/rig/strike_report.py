"""The report of one strike on a rig: path of the tip, servos, and timing of the cycles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch
from matplotlib.ticker import MaxNLocator

from whiptool.goals.target import Target
from whiptool.limits.arm_limits import XM430, MotorLimits
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import Model
from whiptool.rig.cyclelog import Cycles, Flag, Phase
from whiptool.rig.struck import Struck
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE, legend_above, save_figure
from whiptool.words import counted

_PHASES = {
    Phase.APPROACH: COLORS["sky"],
    Phase.SETTLE: COLORS["green"],
    Phase.STRIKE: COLORS["orange"],
    Phase.RETURN: COLORS["pink"],
}
_SEEN: dict[str, Any] = {"color": COLORS["blue"], "markersize": 3.5, "markeredgewidth": 0}
_MEASURED: dict[str, Any] = {"color": COLORS["blue"], "linewidth": 2.6, "alpha": 0.75, "label": "measured"}
_WANTED: dict[str, Any] = {"color": COLORS["black"], "linewidth": 1.1, "linestyle": (0, (4, 2.5))}
_OF_JOINTS = (COLORS["blue"], COLORS["vermilion"], COLORS["pink"], COLORS["orange"], COLORS["sky"], COLORS["black"])
# drawn at the height of their cycle: what, marker, colour
_MARKS = {
    Flag.MISSED: ("no sample", "v", COLORS["vermilion"]),
    Flag.OVERRUN: ("ended late", "o", COLORS["blue"]),
    Flag.SATURATED: ("cut to the current limit", "s", COLORS["black"]),
    Flag.FAULT: ("fault", "X", COLORS["vermilion"]),
}


def sections(
    struck: Struck, model: Model, target: Target, pictures: dict[str, Figure], *, limits: MotorLimits = XM430
) -> list[Section]:
    """Return the report's sections, for `whiptool.viz.report.to_html`.

    Args:
        struck: Result of the strike, which may be partial after a fault.
        model: Model, for the names of the arm's joints.
        target: Position and hit radius.
        pictures: Figures from `draw`.
        limits: Limits of the motors.
    """
    result: list[Table | Text | Picture] = [_result(struck, target)]
    if "strike" in pictures:
        result.append(Picture(pictures["strike"], _tip_caption(struck)))
    found = [Section("Result", result)]
    if "joints" in pictures:
        caption = "Joint angles of the robot during the strike, and the torques or motor currents if it reports them."
        found.append(Section("Joints", [Picture(pictures["joints"], caption)]))
    if "servos" in pictures:
        caption = (
            f"Joint angles and currents during the strike. Shaded: the currents that the {limits.name} can carry at "
            "the measured speed, from its stall current down to none at its no-load speed. Right: the same in the "
            "plane of speed and torque, with the motor's line."
        )
        table = _servo_table(struck.run.cycles, model, limits)
        found.append(Section("Servos", [table, Picture(pictures["servos"], caption)]))
    caption = "Time from one sample to the next over the whole run; what was wrong with a cycle is marked."
    found.append(Section("Control cycles", [_cycle_table(struck.run.cycles), Picture(pictures["cycles"], caption)]))
    return found


def save_pictures(folder: str | Path, pictures: dict[str, Figure]) -> list[Path]:
    """Write the figures of `draw` as PNG files into a folder; return the files."""
    return [save_figure(figure, Path(folder) / f"{name}.png") for name, figure in pictures.items()]


def draw(struck: Struck, model: Model, target: Target, *, limits: MotorLimits = XM430) -> dict[str, Figure]:
    """Return the figures `strike`, `servos` or, of a robot without them, `joints`, and `cycles` by name, as far as the
    run has data for them.

    A run that ended before its strike only has `cycles`. The arguments are those of `sections`.
    """
    cycles = struck.run.cycles
    during = cycles.during(Phase.STRIKE)
    pictures = {}
    with matplotlib.rc_context(STYLE):
        if struck.recording is not None:
            pictures["strike"] = Figure((12.5, 6.4), layout="constrained")
            path, distance = pictures["strike"].subplots(1, 2, width_ratios=(1.25, 1.0))
            plot_tip(path, struck, model, target)
            plot_distance_seen(distance, struck, target)
        a, servos = model.arm.n, bool(np.isfinite(during.goal_current).any())
        if len(during) > 1 and not servos:
            known = np.isfinite(during.tau).any() or np.isfinite(during.current).any()
            plots = (plot_angle, plot_effort) if known else (plot_angle,)
            pictures["joints"] = Figure((5.5 * len(plots), 1.2 + 2.4 * a), layout="constrained")
            axes = pictures["joints"].subplots(a, len(plots), squeeze=False)
            for i, name in enumerate(model.arm.names):
                for ax, plot in zip(axes[i], plots, strict=True):
                    plot(ax, during, i, name)
        if len(during) > 1 and servos:
            pictures["servos"] = Figure((13.0, 1.2 + 2.8 * a), layout="constrained")
            grid = pictures["servos"].add_gridspec(a, 3)
            for i, name in enumerate(model.arm.joints):
                plot_angle(pictures["servos"].add_subplot(grid[i, 0]), during, i, name)
                plot_current(pictures["servos"].add_subplot(grid[i, 1]), during, i, name, limits)
            plot_motor_line(pictures["servos"].add_subplot(grid[:, 2]), during, model.arm.joints, limits)
        pictures["cycles"] = Figure((11.0, 3.6), layout="constrained")
        plot_cycles(pictures["cycles"].subplots(), cycles)
    return pictures


def plot_tip(ax: Axes, struck: Struck, model: Model, target: Target) -> Axes:
    """Draw the measured path of the tip (on a simulated rig also the true path), the target, and the arm at the closest
    approach.

    Raises:
        AssertionError: The strike has no recording.
    """
    recording = struck.recording
    assert recording is not None
    where = _from_the_side(np.array(target.position))
    ax.add_patch(Circle(tuple(where), target.hit_radius, facecolor=COLORS["orange"], alpha=0.35, edgecolor="none"))
    ax.add_patch(Circle(tuple(where), target.hit_radius, fill=False, edgecolor=COLORS["orange"], linewidth=1.6))
    ax.plot([], [], "o", color="#F8E1B0", markeredgecolor=COLORS["orange"], markersize=9, label=_radius(target))
    if struck.truth is not None:
        ax.plot(*_from_the_side(struck.truth.tip).T, color="0.45", linewidth=1.2, label="true path of the tip (twin)")
    judged = struck.judged(target)
    nearest = None if judged is None else judged.nearest
    instants, names = [0.0], ["at the start"]
    if nearest is not None:
        instants, names = [0.0, nearest.time], ["at the start", f"at {nearest.time:.3f} s"]
    if "tip" in recording.markers:
        t, points = struck.tip_seen()
        ax.plot(*_from_the_side(points).T, "o", **_SEEN, label=f"tip in {counted(len(t), 'frame')}")
    for instant, name, shade in zip(instants, names, ("0.6", COLORS["black"]), strict=False):
        arm = _from_the_side(_arm_points(struck, model, instant))
        ax.plot(*arm.T, "o-", color=shade, linewidth=3, markerfacecolor="white", label=f"arm {name}")
    if nearest is not None:
        ax.plot(
            *_from_the_side(np.array(nearest.place)),
            "o",
            color=COLORS["vermilion"],
            markersize=7,
            zorder=5,
            label="closest approach",
        )
    up = "y, up [m]" if model.dimension == 2 else "z, up [m]"
    ax.set(aspect="equal", xlabel="x, forward [m]", ylabel=up, title="path of the tip, from the side")
    ax.margins(0.06)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    legend_above(ax, ncols=3)
    return ax


def plot_distance_seen(ax: Axes, struck: Struck, target: Target) -> Axes:
    """Draw the measured distance of tip and target [cm] over time, and on a simulated rig the true distance."""
    recording = struck.recording
    assert recording is not None
    where = np.array(target.position)
    edge = 100 * target.hit_radius
    ax.axhspan(0, edge, color=COLORS["orange"], alpha=0.25, linewidth=0)
    ax.axhline(edge, color=COLORS["orange"], linestyle="--", linewidth=1.5, label=f"hit radius {edge:g} cm")
    if struck.truth is not None:
        true = 100 * struck.truth.distance(where)
        ax.plot(struck.truth.t, true, color="0.45", linewidth=1.2, label="true distance (twin)")
    title = "the tip was not seen"
    if "tip" in recording.markers:
        t, points = struck.tip_seen()
        ax.plot(t, 100 * np.linalg.norm(points - where, axis=1), "o", **_SEEN, label="as seen")
    judged, unseen = struck.judged(target), struck.unseen(target)
    if unseen is not None:
        ax.axvspan(*unseen, color="0.9", zorder=0, label="not seen")
    if judged is not None and judged.nearest is not None:
        ax.errorbar(
            [judged.nearest.time], [100 * judged.miss], yerr=[100 * judged.error], fmt="D", color=COLORS["vermilion"],
            markersize=6, capsize=4, zorder=5, label="estimate, with standard error",
        )  # fmt: skip
        title = f"estimated miss {judged}; hit probability {judged.probability:.0%}"
    ax.set(xlabel="time since the strike began [s]", ylabel="distance tip to target [cm]", title=title)
    ax.set_ylim(bottom=0)
    legend_above(ax, ncols=2)
    return ax


def plot_angle(ax: Axes, during: Cycles, joint: int, name: str) -> Axes:
    """Draw a joint's measured and desired angle [deg] over the strike."""
    t = during.t - during.t[0]
    error = np.rad2deg(_largest(during.q_d[:, joint] - during.q[:, joint]))
    ax.plot(t, np.rad2deg(during.q[:, joint]), **_MEASURED)
    ax.plot(t, np.rad2deg(during.q_d[:, joint]), **_WANTED, label="desired")
    ax.set(xlabel="time since the strike began [s]", ylabel="angle [deg]", title=f"{name}: error up to {error:.1f} deg")
    legend_above(ax, ncols=2)
    return ax


def plot_effort(ax: Axes, during: Cycles, joint: int, name: str) -> Axes:
    """Draw a joint's measured torque [N m] over the strike, or its motor's current [A] if no torque was measured."""
    torque = bool(np.isfinite(during.tau).any())
    values, unit = (during.tau, "N m") if torque else (during.current, "A")
    ax.plot(during.t - during.t[0], values[:, joint], **_MEASURED)
    what = f"torque [{unit}]" if torque else f"motor current [{unit}]"
    title = f"{name}: up to {_largest(values[:, joint]):.1f} {unit}"
    ax.set(xlabel="time since the strike began [s]", ylabel=what, title=title)
    return ax


def plot_current(ax: Axes, during: Cycles, joint: int, name: str, limits: MotorLimits) -> Axes:
    """Draw a joint's commanded and measured current [A] over the strike, and the limits of its motor."""
    t, v = during.t - during.t[0], during.v[:, joint]
    most = np.maximum(limits.available(v, np.ones(len(v))), 0.0) / limits.torque_constant
    least = -np.maximum(limits.available(v, -np.ones(len(v))), 0.0) / limits.torque_constant
    ax.fill_between(t, least, most, color=COLORS["green"], alpha=0.2, linewidth=0, label=f"{limits.name}")
    ax.plot(t, during.current[:, joint], **_MEASURED)
    ax.plot(t, during.goal_current[:, joint], **_WANTED, label="commanded")
    title = f"{name}: {_usage(during, joint, limits):.0%} of the line"
    ax.set(xlabel="time since the strike began [s]", ylabel="current [A]", title=title)
    legend_above(ax, ncols=2)
    return ax


def plot_motor_line(ax: Axes, during: Cycles, joints: Sequence[str], limits: MotorLimits) -> Axes:
    """Draw the speed and torque of every cycle of the strike, and the motor's speed-torque line."""
    w, stall = limits.no_load_speed, limits.stall_torque
    ax.fill(
        [-w, 0, w, w, 0, -w], [stall, stall, 0, -stall, -stall, 0], color=COLORS["green"], alpha=0.2, linewidth=0,
        label=f"{limits.name}",
    )  # fmt: skip
    ax.plot([-w, 0, w, w], [stall, stall, 0, -stall], color=COLORS["green"], linewidth=1.5)
    ax.plot([w, 0, -w, -w], [-stall, -stall, 0, stall], color=COLORS["green"], linewidth=1.5)
    for i, name in enumerate(joints):
        torque = limits.torque_constant * during.current[:, i]
        color = _OF_JOINTS[i % len(_OF_JOINTS)]
        ax.plot(during.v[:, i], torque, ".", color=color, markersize=3, alpha=0.6, label=name)
    ax.set(xlabel="joint speed [rad/s]", ylabel="torque from measured current [N m]", title="speed and torque")
    legend_above(ax, ncols=2)
    return ax


def plot_cycles(ax: Axes, cycles: Cycles) -> Axes:
    """Draw the time between samples [ms] over the run, with its phases and the faults of cycles."""
    between = 1e3 * np.diff(cycles.stamp, prepend=np.nan)
    ax.plot(cycles.t, between, ".", color="0.35", markersize=2, rasterized=len(cycles) > 5000)
    for phase, color in _PHASES.items():
        of_phase = cycles.t[cycles.phase == phase]
        if len(of_phase):
            ax.axvspan(of_phase[0], of_phase[-1], color=color, alpha=0.18, linewidth=0)
    usual = float(np.nanmedian(between)) if np.isfinite(between).any() else 1.0
    at = np.where(np.isfinite(between), between, usual)
    handles = [Patch(color=color, alpha=0.3, label=phase.name.lower()) for phase, color in _PHASES.items()]
    for flag, (what, marker, color) in _MARKS.items():
        marked = (cycles.flags & flag) > 0
        if marked.any():
            label = f"{what}: {marked.sum()}"
            handles += ax.plot(cycles.t[marked], at[marked], marker, color=color, markersize=5, label=label)
    title = f"{len(cycles)} control cycles"
    ax.set(xlabel="time since the first cycle [s]", ylabel="between samples [ms]", title=title)
    ax.set_ylim(0, max(2 * usual, 1.1 * float(np.nanmax(at, initial=0.0))))
    legend_above(ax, ncols=len(handles), handles=handles)
    return ax


def _result(struck: Struck, target: Target) -> Table | Text:
    """What came of the strike."""
    run = struck.run
    if run.fault is not None:
        return Text(f"The strike ended in a fault: {run.fault}; {run.torque}.")
    rows = [["", ""], ["target", ", ".join(f"{x:.3f}" for x in target.position) + f" m, {_radius(target)}"]]
    judged, unseen = struck.judged(target), struck.unseen(target)
    if judged is None or judged.nearest is None:
        rows.append(["the tip", "was not seen"])
    else:
        rows += [
            ["verdict", f"{judged.verdict}; hit probability {judged.probability:.0%}"],
            ["miss distance", str(judged)],
            ["closest approach", f"at {judged.nearest.time:.3f} s, {judged.nearest.speed:.1f} m/s"],
        ]
    if unseen is not None:
        rows.append(["the tip was not seen", f"from {unseen[0]:.3f} to {unseen[1]:.3f} s, around the closest approach"])
    if struck.truth is not None:
        true = struck.truth.approach(np.array(target.position))
        rows.append(["true miss (known to the twin only)", f"{100 * true.distance[0]:.2f} cm at {true.time[0]:.3f} s"])
    return Table(rows)


def _tip_caption(struck: Struck) -> str:
    seen = struck.recording is not None and "tip" in struck.recording.markers
    what = "Path of the tip, and its distance from the target" if seen else "The arm, and the target"
    return f"{what}. The arm's angles are those of its encoders."


def _servo_table(cycles: Cycles, model: Model, limits: MotorLimits) -> Table:
    during = cycles.during(Phase.STRIKE)
    rows = [["joint", "speed up to [rad/s]", "current up to [A]", "of the motor's line", "error up to [deg]",
             "cut to the limit", "warmest [°C]", "lowest voltage [V]"]]  # fmt: skip
    cut = int(((during.flags & Flag.SATURATED) > 0).sum())
    for i, name in enumerate(model.arm.joints):
        error = np.rad2deg(_largest(during.q_d[:, i] - during.q[:, i]))
        rows.append(
            [
                name,
                f"{_largest(during.v[:, i]):.2f}",
                f"{_largest(during.current[:, i]):.2f}",
                f"{_usage(during, i, limits):.0%}",
                f"{error:.1f}",
                f"{cut} of {len(during)} cycles",
                f"{_largest(during.temperature[:, i]):.0f}",
                f"{-_largest_signed(-during.voltage[:, i]):.1f}",
            ]
        )
    return Table(rows, "During the strike.")


def _cycle_table(cycles: Cycles) -> Table:
    robot = "period" in cycles.about
    own = [] if robot else ["ended late", "latest start [ms]"]
    rows = [["phase", "cycles", "no sample", "longest gap [ms]", *own]]
    for phase in Phase:
        part = cycles.during(phase)
        if len(part):
            late = int(((part.flags & Flag.OVERRUN) > 0).sum()), 1e3 * max(0.0, _largest_signed(part.late))
            lost, gap = int(cycles.lost[cycles.phase == phase].sum()), f"{1e3 * part.longest_gap:.2f}"
            own = [] if robot else [str(late[0]), f"{late[1]:.2f}"]
            rows.append([phase.name.lower(), str(len(part)), str(lost), gap, *own])
    return Table(rows, "No sample: states that are missing by the clock of the robot's controller." if robot else "")


def _arm_points(struck: Struck, model: Model, instant: float) -> np.ndarray:
    """First joint to hand as the encoders have them at an instant [s]: (a + 1, d) [m]."""
    recording, a = struck.recording, model.arm.n
    assert recording is not None
    assert recording.joints_t is not None
    assert recording.joints_q is not None
    q = np.zeros((1, model.coordinates))
    for i in range(a):
        q[0, i] = np.interp(instant, recording.joints_t, recording.joints_q[:, i])
    return joint_points(model, q)[0, : a + 1]


def _from_the_side(places: np.ndarray) -> np.ndarray:
    """Positions (..., d) as seen from the side: forward and up, (..., 2)."""
    return places[..., [0, -1]]


def _usage(during: Cycles, joint: int, limits: MotorLimits) -> float:
    """Largest part of the motor's line that a joint used."""
    return _largest(limits.usage(during.v[:, joint], limits.torque_constant * during.current[:, joint]))


def _largest(values: np.ndarray) -> float:
    """Largest magnitude of what was measured; not a number: nothing was."""
    return _largest_signed(np.abs(values))


def _largest_signed(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if len(finite) else float("nan")


def _radius(target: Target) -> str:
    return f"hit radius {target.hit_radius:g} m"
