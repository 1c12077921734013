"""Picture of what was understood of files: paths of markers, coordinates over time, and logs, one row for each file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whiptool.recording.readers import VideoSource
from whiptool.recording.readers.joint_log import JointLog, Logs
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.recording.understood import Understood
from whiptool.viz.style import CYCLE, STYLE, legend_above, save_figure, verbatim

_ROW = (16.0, 4.6)  # [in]
_LISTED = 8  # names in a legend

Panel = Callable[[Axes], None]


def draw(files: Sequence[Understood], path: Path | str) -> Path:
    """Write a PNG picture of files as they were understood, a row of panels for each (of four panels two rows), and
    return its path."""
    width, height = _ROW
    panels = [_panels(one) for one in files]
    grids = [(2, 2) if len(x) == 4 else (1, len(x)) for x in panels]
    lines = [rows for rows, _ in grids]
    with matplotlib.rc_context(STYLE):
        figure = Figure((width, height * sum(lines)), layout="constrained")
        parts = figure.subfigures(len(files), 1, squeeze=False, height_ratios=lines)[:, 0]
        for one, part, drawn, grid in zip(files, parts, panels, grids, strict=True):
            part.suptitle(verbatim(one.path), x=0.01, ha="left", fontsize=12, fontweight="bold")
            for panel, ax in zip(drawn, part.subplots(*grid, squeeze=False).flat, strict=True):
                panel(ax)
        return save_figure(figure, path)


def _panels(one: Understood) -> list[Panel]:
    """What is drawn of a file: as many panels as it has something for."""
    found, logs = one.found, one.logs or Logs()
    if isinstance(found, StrikeRecording):
        up = _up(found)
        sides = [(0, up), (0, 3 - up)][: found.points.shape[2] - 1]
        panels = [partial(_paths, recording=found, seen=side) for side in sides]
        panels = [*panels, *([partial(_steps, t=found.t, what="samples")] if found.angular else [])]
        panels.append(partial(_over_time, recording=found))
    elif isinstance(found, VideoSource):
        panels = [partial(_first_image, film=found), partial(_steps, t=found.times, what="images")]
    else:
        logs, first = found, found.joints or found.hand
        panels = [partial(_steps, t=np.zeros(0) if first is None else first.t, what="samples")]
        if found.hand is not None:
            panels += [partial(_hand_path, hand=found.hand, seen=side) for side in ((0, 2), (0, 1))]
    if logs.joints is not None:
        panels.append(partial(_joints, log=logs.joints))
    elif logs.hand is not None:
        panels.append(partial(_hand, hand=logs.hand))
    return panels


def _up(recording: StrikeRecording) -> int:
    """Number of the coordinate that points up."""
    return 1 if recording.points.shape[2] == 2 or recording.up == "y" else 2


def _unit(recording: StrikeRecording) -> str:
    return "pixels" if recording.view is not None else "rad" if recording.angular else "m"


def _names(recording: StrikeRecording) -> tuple[str, ...]:
    """Names of the coordinates."""
    if recording.view is not None:
        return "u", "v"
    return ("angle",) if recording.angular else ("x", "y", "z")[: recording.points.shape[2]]


def _paths(ax: Axes, recording: StrikeRecording, seen: tuple[int, int]) -> None:
    """Draw the markers' paths, two coordinates of them: from the side, or from above."""
    names, unit, (x, y) = _names(recording), _unit(recording), seen
    for m, name in enumerate(recording.markers):
        points, color = recording.points[:, m], CYCLE[m % len(CYCLE)]
        ax.plot(points[:, x], points[:, y], ".-", ms=3, lw=0.8, color=color, label=verbatim(name) * (m < _LISTED))
        first = points[recording.seen[:, m]][:1]
        ax.plot(first[:, x], first[:, y], "o", ms=7, mfc="none", color=color)
    side = "" if recording.points.shape[2] == 2 else " from the side" if y == _up(recording) else " from above"
    ax.set(xlabel=f"{names[x]} [{unit}]", ylabel=f"{names[y]} [{unit}]", title=f"paths{side} (o: first)")
    ax.set_aspect("equal", adjustable="datalim")
    if recording.view is not None or (side == " from above" and y == 2):
        ax.invert_yaxis()  # pixels count downward, and of axes whose y is up the third one points to the right
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


def _joints(ax: Axes, log: JointLog) -> None:
    """Draw the measured joints over time."""
    names = log.names or [f"joint {i + 1}" for i in range(log.q.shape[1])]
    for i, name in enumerate(names):
        ax.plot(log.t, log.q[:, i], color=CYCLE[i % len(CYCLE)], label=verbatim(name) * (i < _LISTED), lw=1.3)
    ax.set(xlabel="t [s]", ylabel=f"joints [{log.unit or 'rad'}]", title="measured joints")
    legend_above(ax)


def _hand(ax: Axes, hand: JointLog) -> None:
    """Draw the hand's place over time."""
    for i, name in enumerate("xyz"):
        ax.plot(hand.t, hand.q[:, i], color=CYCLE[i], label=f"hand {name}", lw=1.3)
    ax.set(xlabel="t [s]", ylabel="hand [m]", title="measured hand")
    legend_above(ax)


def _hand_path(ax: Axes, hand: JointLog, seen: tuple[int, int]) -> None:
    """Draw the hand's path from the side or from above."""
    x, y = seen
    ax.plot(hand.q[:, x], hand.q[:, y], ".-", ms=3, lw=0.8)
    ax.plot(*hand.q[0, [x, y]], "o", ms=7, mfc="none", color=CYCLE[0])
    title = f"path of the hand from {'the side' if y == 2 else 'above'} (o: first)"
    ax.set(xlabel=f"{'xyz'[x]} [m]", ylabel=f"{'xyz'[y]} [m]", title=title)
    ax.set_aspect("equal", adjustable="datalim")


def _steps(ax: Axes, t: np.ndarray, what: str) -> None:
    """Draw the steps between times t (T,) [s]."""
    ax.plot(t[1:], 1e3 * np.diff(t), ".", ms=3)
    ax.set(xlabel="t [s]", ylabel=f"step between {what} [ms]", title="clock")
    ax.set_ylim(0, 1.2e3 * float(np.diff(t).max(initial=1e-3)))


def _first_image(ax: Axes, film: VideoSource) -> None:
    """Show the first image of a film."""
    image = next(iter(film.frames()))
    ax.imshow(image[..., ::-1] if image.ndim == 3 else image, cmap="gray")
    ax.set(xlabel="u [pixels]", ylabel="v [pixels]", title="first image")
    ax.grid(visible=False)
