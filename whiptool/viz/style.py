"""The style of all figures: colours, type, legends, and saving."""

from __future__ import annotations

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


def legend_above(ax: Axes, *, ncols: int = 3, handles: Sequence[Artist] | None = None) -> None:
    """Put a legend between title and axes, with the given handles or all labelled artists."""
    legend = ax.legend(
        handles=ax.get_legend_handles_labels()[0] if handles is None else handles,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=ncols,
        borderaxespad=0.3,
        columnspacing=1.4,
        handlelength=1.8,
    )
    rows = -(-len(legend.get_texts()) // ncols)
    ax.set_title(ax.get_title(loc="left"), loc="left", pad=8 + 1.6 * rows * float(legend.get_texts()[0].get_fontsize()))


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
    """Return a length [m] as text, in mm or m."""
    return f"{1e3 * meters:.2g} mm" if meters < 0.0995 else f"{meters:.3f} m"
