"""Picture of what was understood of files: paths of markers, coordinates over time, and logs, one row for each file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whiptool.recording.readers import VideoSource
from whiptool.recording.readers.joint_log import Logs
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.recording.understood import Understood
from whiptool.viz.style import CYCLE, STYLE, legend_above, save_figure, verbatim

_SIZE = (16.0, 4.6)  # [in] of a row
_LISTED = 8  # names in a legend


def draw(files: Sequence[Understood], path: Path | str) -> Path:
    """Write a picture of files, one row of three panels for each, and return its path.

    Args:
        files: The files as they were understood.
        path: PNG file to write.

    Raises:
        OSError: The file cannot be written.
    """
    width, height = _SIZE
    with matplotlib.rc_context(STYLE):
        figure = Figure((width, height * len(files)), layout="constrained")
        for one, row in zip(files, figure.subfigures(len(files), 1, squeeze=False)[:, 0], strict=True):
            row.suptitle(verbatim(one.path), x=0.01, ha="left", fontsize=12, fontweight="bold")
            left, middle, right = row.subplots(1, 3)
            if isinstance(one.found, StrikeRecording):
                _paths(left, one.found)
                _over_time(middle, one.found)
                _logs(right, one.logs or Logs())
            elif isinstance(one.found, VideoSource):
                _first_image(left, one.found)
                _steps(middle, one.found.times, "images")
                _logs(right, Logs())
            else:
                _hand_path(left, one.found)
                first = one.found.joints or one.found.hand
                _steps(middle, np.zeros(0) if first is None else first.t, "samples")
                _logs(right, one.found)
        return save_figure(figure, path)


def _unit(recording: StrikeRecording) -> str:
    return "pixels" if recording.view is not None else "rad" if recording.angular else "m"


def _names(recording: StrikeRecording) -> tuple[str, ...]:
    """Names of the coordinates."""
    if recording.view is not None:
        return "u", "v"
    return ("angle",) if recording.angular else ("x", "y", "z")[: recording.points.shape[2]]


def _paths(ax: Axes, recording: StrikeRecording) -> None:
    """Draw the markers' paths from the side."""
    names, unit, d = _names(recording), _unit(recording), recording.points.shape[2]
    if d == 1:  # angles have no path
        _steps(ax, recording.t, "samples")
        return
    up = 1 if d == 2 else {"y": 1}.get(recording.up, 2)
    for m, name in enumerate(recording.markers):
        points, color = recording.points[:, m], CYCLE[m % len(CYCLE)]
        ax.plot(points[:, 0], points[:, up], ".-", ms=3, lw=0.8, color=color, label=verbatim(name) * (m < _LISTED))
        first = points[recording.seen[:, m]][:1]
        ax.plot(first[:, 0], first[:, up], "o", ms=7, mfc="none", color=color)
    if recording.view is not None:
        ax.invert_yaxis()
    ax.set(xlabel=f"{names[0]} [{unit}]", ylabel=f"{names[up]} [{unit}]", aspect="equal", title="paths (o: first)")
    ax.set_adjustable("datalim")
    legend_above(ax)


def _over_time(ax: Axes, recording: StrikeRecording) -> None:
    """Draw the coordinates of the marker nearest to the tip, and of the hand's, over time; gaps are shaded."""
    names = _names(recording)
    shown = [x for x in ("tip", "handle") if x in recording.markers] or list(recording.markers[:2])
    for i, marker in enumerate(shown):
        m = recording.markers.index(marker)
        for j, name in enumerate(names):
            look = {"ls": "-" if i == 0 else "--", "color": CYCLE[j], "lw": 1.3}
            ax.plot(recording.t, recording.points[:, m, j], label=verbatim(f"{marker} {name}"), **look)
    first = recording.markers.index(shown[0])
    unseen = ~recording.seen[:, first]
    if unseen.any():
        low, high = ax.get_ylim()
        ax.fill_between(recording.t, low, high, where=unseen, color="0.85", step="mid", label=f"no {shown[0]}")
    ax.set(xlabel="t [s]", ylabel=f"{', '.join(names)} [{_unit(recording)}]", title="coordinates")
    legend_above(ax)


def _logs(ax: Axes, logs: Logs) -> None:
    """Draw the joints, or the hand's place where no joints were logged, over time."""
    if logs.joints is not None:
        log = logs.joints
        names = log.names or [f"joint {i + 1}" for i in range(log.q.shape[1])]
        for i, name in enumerate(names):
            ax.plot(log.t, log.q[:, i], color=CYCLE[i % len(CYCLE)], label=verbatim(name) * (i < _LISTED), lw=1.3)
        ax.set(xlabel="t [s]", ylabel=f"joints [{log.unit or 'rad'}]", title="measured joints")
        legend_above(ax)
    elif logs.hand is not None:
        for i, name in enumerate("xyz"):
            ax.plot(logs.hand.t, logs.hand.q[:, i], color=CYCLE[i], label=f"hand {name}", lw=1.3)
        ax.set(xlabel="t [s]", ylabel="hand [m]", title="measured hand")
        legend_above(ax)
    else:
        ax.set_axis_off()
        ax.text(0.5, 0.5, "no log of joints or hand", ha="center", va="center", color="0.5")


def _hand_path(ax: Axes, logs: Logs) -> None:
    """Draw the hand's path from the side."""
    if logs.hand is None:
        ax.set_axis_off()
        ax.text(0.5, 0.5, "no tracks", ha="center", va="center", color="0.5")
        return
    ax.plot(logs.hand.q[:, 0], logs.hand.q[:, 2], lw=1.3)
    ax.set(xlabel="x [m]", ylabel="z [m]", aspect="equal", title="path of the hand")


def _steps(ax: Axes, t: np.ndarray, what: str) -> None:
    """Draw the steps between times t (T,) [s]."""
    ax.plot(t[1:], 1e3 * np.diff(t), ".", ms=3)
    ax.set(xlabel="t [s]", ylabel=f"step between {what} [ms]", title="clock")
    ax.set_ylim(bottom=0)


def _first_image(ax: Axes, film: VideoSource) -> None:
    """Show the first image of a film."""
    image = next(iter(film.frames()))
    ax.imshow(image[..., ::-1] if image.ndim == 3 else image, cmap="gray")
    ax.set(xlabel="u [pixels]", ylabel="v [pixels]", title="first image")
    ax.grid(visible=False)
