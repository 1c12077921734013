"""The style of all figures: colours, fonts, legends, axes, targets and their required directions, and saving."""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from matplotlib.ticker import Locator, MaxNLocator, MultipleLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from whiptool.goals.target import Target
from whiptool.whole_files import replacing

# Okabe and Ito's colour-blind safe palette
COLORS = {
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "green": "#009E73",
    "pink": "#CC79A7",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "black": "#222222",
    "yellow": "#F0E442",
    "brown": "#8A6D3B",  # ours
}
CYCLE = list(COLORS.values())[:7]  # yellow lines are hard to see on white
JOINT_COLORS = [*CYCLE[:6], COLORS["brown"]]  # none is the black of what is desired
_MOST_TICKS = 40
_LONGEST_LABEL = 48  # [characters] of a line in a legend
_HEAD_CHARACTERS = 9.0  # of a bold heading in an inch
_PNG: dict[str, Any] = {"pil_kwargs": {"compress_level": 2}}  # as the usual 6, in half the time
STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "savefig.dpi": 200,
    "savefig.bbox": "tight",
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.labelsize": 11,
    "xtick.labelsize": 10,
    "ytick.labelsize": 10,
    "legend.fontsize": 10,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.8,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "axes.titlelocation": "left",
    "axes.prop_cycle": cycler(color=CYCLE),
}
# viridis without its yellow end, which fades into white
TIME = LinearSegmentedColormap.from_list("time", matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, 128)))
SPEED = TIME.reversed()  # what is fast is dark


def legend_above(
    ax: Axes, *, ncols: int = 3, handles: Sequence[Artist] | None = None, width: float | None = None
) -> None:
    """Put a legend between title and axes, with the given handles or all labelled artists.

    It has fewer columns than `ncols` if these would be wider than the axes, and long labels are wrapped.

    Args:
        ax: Axes to which the legend belongs.
        ncols: Largest number of columns.
        handles: Artists of the legend; None: all labelled ones.
        width: Available width [in]; None: that of the axes.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    if width is None:  # a layout engine that comes later only widens axes, unless a colour bar is at their side
        width = ax.get_position().width * figure.get_figwidth()
    shown = ax.get_legend_handles_labels()[0] if handles is None else handles
    if not shown:
        return
    labels = [str(one.get_label()) for one in shown]
    tries = [(columns, _LONGEST_LABEL) for columns in range(min(ncols, max(len(labels), 1)), 0, -1)]
    for columns, longest in [*tries, *((1, shorter) for shorter in (36, 28, 20))]:
        legend = ax.legend(
            handles=shown,
            labels=[textwrap.fill(label, longest) for label in labels],
            loc="lower left",
            bbox_to_anchor=(0, 1),
            ncols=columns,
            borderaxespad=0.3,
            columnspacing=1.4,
            handlelength=1.8,
        )
        if legend.get_window_extent().width <= figure.dpi * width:
            break
    texts = legend.get_texts()
    rows = -(-len(texts) // columns) + sum(text.get_text().count("\n") for text in texts)
    ax.set_title(ax.get_title(loc="left"), loc="left", pad=8 + 1.6 * rows * float(texts[0].get_fontsize()))


def head(figure: Figure, text: str) -> None:
    """Write a bold heading above all axes of a figure, on as many lines as its width takes."""
    longest = int(_HEAD_CHARACTERS * figure.get_figwidth())
    wrapped = "\n".join(textwrap.wrap(text, longest))
    figure.suptitle(verbatim(wrapped), fontsize=12, fontweight="bold", x=0.02, ha="left")


def ticks(step: float, extent: float) -> Locator:
    """Return ticks at multiples of a step [m], or about ten ticks if the extent [m] is much larger."""
    return MultipleLocator(step) if extent <= _MOST_TICKS * step else MaxNLocator(10)


def verbatim(text: str) -> str:
    """Escape dollar signs in a text, so that matplotlib does not read formulas in it."""
    return text.replace("$", r"\$")


def save_figure(figure: Figure, path: Path | str) -> Path:
    """Write a figure to a file, whose folder is created if missing; return the file."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as unfinished, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # of names in letters that the font lacks: boxes stand for them
        figure.savefig(unfinished, **_PNG if path.suffix == ".png" else {})
    return path


def length_text(meters: float) -> str:
    """Return a length as text in metres, the unit of the axes: to a millimetre, or a shorter one in two digits, though
    no finer than 0.01 mm."""
    if not 1e-5 < meters < 0.0995:
        return f"{meters:.3f} m"
    return f"{meters:.{min(1 - math.floor(math.log10(meters)), 5)}f} m"


def joint_units(turning: str, sliding: str, joint_names: Sequence[str], slides: Sequence[str]) -> str:
    """Return the units for an axis of all joints: `turning` for revolute joints, `sliding` for the prismatic joints
    `slides`, or both.
    """
    if not slides:
        return turning
    return f"{turning}, {sliding}" if len(slides) < len(joint_names) else sliding


AXES = {2: ("x, forward [m]", "y, up [m]"), 3: ("x, forward [m]", "y, left [m]", "z, up [m]")}


AZIMUTH, ELEVATION = -55.0, 20.0  # from where a strike is seen in perspective, as matplotlib counts them [deg]


def plot_ball(ax: Axes3D, target: Target) -> Line3DCollection:
    """Draw the ball of the hit radius around a target."""
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, 17), np.linspace(0, np.pi, 9))
    unit = np.stack([np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)])
    ball = np.array(target.position)[:, None, None] + target.hit_radius * unit
    return ax.plot_wireframe(*ball, color=COLORS["orange"], linewidth=0.5, alpha=0.55, zorder=2)


def set_up_perspective(ax: Axes3D, low: np.ndarray, high: np.ndarray, *, zoom: float = 1.12) -> None:
    """Show a box between two corners (3,) [m] in perspective with equal scales; `zoom` is matplotlib's."""
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_proj_type("persp", focal_length=0.8)
    ax.view_init(elev=ELEVATION, azim=AZIMUTH)
    ax.set_box_aspect(tuple(high - low), zoom=zoom)
    ax.set(**dict(zip(("xlabel", "ylabel", "zlabel"), AXES[3], strict=True)))
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_pane_color((0.97, 0.97, 0.98, 1.0))  # pyrefly: ignore[missing-attribute]  # typed as in the plane


LOOK: dict[str, Any] = {"color": COLORS["green"], "linewidth": 1.8}
_LENGTH = 0.2  # of the target's distance from the base
_SHORTEST = 0.1  # share of its length below which an arrow points at the beholder, and is not drawn


def arrow(target: Target) -> tuple[np.ndarray, np.ndarray]:
    """Return start and end, (d,) each [m], of the arrow that shows a target's required direction; the end is at the
    target.
    """
    end = np.array(target.position)
    return end - _LENGTH * float(np.linalg.norm(end)) * np.array(target.direction), end


def asked_of(target: Target) -> str:
    """Return a description of the required direction, for a legend."""
    return f"direction asked for, to {math.degrees(target.cone):g} degrees"


def draw_direction(ax: Axes, target: Target, shown: Sequence[int] = (0, 1)) -> None:
    """Draw the arrow of a target with a required direction into axes in the plane.

    Args:
        ax: Axes to draw into.
        target: The target.
        shown: Indices of the two coordinates that the axes show.
    """
    if target.direction is None:
        return
    start, end = arrow(target)
    look = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 13, **LOOK}
    if np.linalg.norm((end - start)[list(shown)]) > _SHORTEST * np.linalg.norm(end - start):
        at = (tuple(x[list(shown)]) for x in (end, start))
        ax.annotate("", *at, arrowprops=look, annotation_clip=False, zorder=7)


def draw_direction_in_space(ax: Axes3D, target: Target) -> None:
    """Draw the arrow of a target with a required direction into axes in perspective."""
    if target.direction is not None:
        start, end = arrow(target)
        ax.quiver(*start, *(end - start), arrow_length_ratio=0.25, zorder=7, **LOOK)
