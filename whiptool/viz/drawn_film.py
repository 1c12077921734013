"""The frames of a film as matplotlib draws them, where there is no OpenGL."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from whiptool.goals.target import Target
from whiptool.models.kinematics import joint_points
from whiptool.rollout.mujoco_model import build_spec
from whiptool.rollout.mujoco_scene import FLOOR
from whiptool.viz.film import GRID, HIT, TEXT, Film, film_camera
from whiptool.viz.frames import drawn_frames
from whiptool.viz.posture import arm_and_whip
from whiptool.viz.style import COLORS


def drawn_film(film: Film, target: Target) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) of uint8."""
    size, dpi = np.array(film.size), film.type_size / 5.4
    figure = Figure(figsize=((size[0] + 0.01) / dpi, (size[1] + 0.01) / dpi), dpi=dpi)  # matplotlib truncates to pixels
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    flat = film.model.dimension == 2
    points, trails, place, radius = (_flat if flat else _perspective)(ax, film, target)
    zone = Circle(place, radius, color=COLORS["orange"], alpha=0.5)
    trail = LineCollection([], linewidths=2.5, capstyle="round")
    whip = Line2D([], [], color="0.15", linewidth=3, solid_capstyle="round", solid_joinstyle="round")
    arm = Line2D(
        [], [], color=COLORS["blue"], linewidth=8, marker="o", markersize=10, markerfacecolor="0.35", markeredgewidth=0
    )
    tip = Line2D([], [], color=COLORS["vermilion"], marker="o", markersize=9, markeredgewidth=0)
    words = [figure.text(x, y, word, color=TEXT, fontsize=11) for x, y, word in film.text(0)]
    moving = [ax.add_patch(zone), ax.add_collection(trail, autolim=False), *map(ax.add_line, (whip, arm, tip)), *words]
    hand = film.model.arm.n if flat else film.model.arm.n + 1  # in space the base comes first

    def show(i: int) -> None:
        arm.set_data(*points[i][: hand + 1].T)
        whip.set_data(*points[i][hand:].T)
        tip.set_data(*points[i][-1:].T)
        trail.set(segments=trails[: film.shown[i]], colors=film.trail_rgb[: film.shown[i]])
        if film.hit[i]:
            zone.set_color(HIT)
        for artist, (*_, word) in zip(words, film.text(i), strict=True):
            artist.set_text(word)

    return drawn_frames(figure, moving, len(points), show)


_Drawn: TypeAlias = tuple[
    np.ndarray, np.ndarray, tuple[float, float], float
]  # points, trail, target's place and radius


def _flat(ax: Axes, film: Film, target: Target) -> _Drawn:
    """Set up axes that show the plane, with a grid, and return what is drawn into them."""
    size = np.array(film.size)
    half = 1.07 * film.model.reach * size / size.min()  # (2,)
    ax.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]))
    for k in range(-int(max(half) / film.grid), int(max(half) / film.grid) + 1):
        for line in (ax.axhline, ax.axvline):
            line(k * film.grid, color=GRID, linewidth=0.8 if k else 1.8, zorder=0)
    x, y = target.position
    return joint_points(film.model, film.q), film.trail, (x, y), target.hit_radius


def _perspective(ax: Axes, film: Film, target: Target) -> _Drawn:
    """Set up axes that show space as the camera of MuJoCo's film does, with a floor; return what is drawn into them.

    Their unit is half the picture's height.
    """
    camera = film_camera(build_spec(film.model).compile(), film, target)
    aspect, reach = film.size[0] / film.size[1], film.model.reach
    ax.set(xlim=(-aspect, aspect), ylim=(-1, 1))
    far = (lines := int(2 * reach / film.grid)) * film.grid
    along = np.linspace(-far, far, 201)
    for k in range(-lines, lines + 1):
        line = np.stack([along, np.full_like(along, k * film.grid), np.full_like(along, -FLOOR * reach)], axis=1)
        for way in (line, line[:, [1, 0, 2]]):
            ax.plot(*camera.seen(way)[:, :2].T, color=GRID, linewidth=1.0 if k else 2.0, zorder=0)
    arm, whip = arm_and_whip(film.model, film.q)
    points = np.concatenate([arm, whip[:, 1:]], axis=1)
    x, y, size = camera.seen(np.array(target.position))
    return camera.seen(points)[..., :2], camera.seen(film.trail)[..., :2], (x, y), target.hit_radius * size
