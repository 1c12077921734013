"""The required direction of the tip at a target, as an arrow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.axes3d import Axes3D

from whiptool.goals.target import Target
from whiptool.viz.style import COLORS

LOOK: dict[str, Any] = {"color": COLORS["green"], "linewidth": 1.8}
_LENGTH = 0.2  # of the target's distance from the base
_SHORTEST = 0.1  # share of its length below which an arrow points at the beholder, and is not drawn


def arrow(target: Target) -> tuple[np.ndarray, np.ndarray]:
    """Return start and end of the arrow, (d,) each [m]; the end is at the target."""
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
