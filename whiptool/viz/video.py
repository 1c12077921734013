"""A strike as a slow-motion H.264 film, rendered by MuJoCo, or drawn by matplotlib where there is no OpenGL."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from whiptool.errors import InputError
from whiptool.models.parameters import Model
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.mujoco_model import build_spec, set_posture
from whiptool.rollout.mujoco_scene import FLOOR
from whiptool.rollout.trajectory import Trajectory, joint_points
from whiptool.target import Target, as_target
from whiptool.viz.camera import Camera
from whiptool.viz.film import MAX_SEGMENTS, Film, film_of
from whiptool.viz.frames import drawn_frames, write_film
from whiptool.viz.opengl import add_bar, add_rod, gl_context
from whiptool.viz.posture import arm_and_whip
from whiptool.viz.style import COLORS
from whiptool.whole_files import replacing

logger = logging.getLogger("whiptool")

_GRID, _HIT, _TEXT = (0.70, 0.73, 0.77), (0.0, 0.62, 0.45), (0.15, 0.16, 0.18)  # colours; the target's once hit


def render_video(
    path: str | Path,
    trajectory: Trajectory,
    model: Model,
    target: Target | Sequence[float],
    *,
    fps: float = 25.0,
    speed: float = 0.25,
    size: tuple[int, int] = (960, 540),
    progress: Callable[[int, int], None] | None = None,
    beyond: bool = False,
) -> str:
    """Write a film of a strike, seen from the side, or in space from the front right and above.

    The trail is the tip's path so far, the redder the faster; the target turns green once it has been hit.

    Args:
        path: MP4 file to write; missing folders are made.
        trajectory, model: The strike, and the model that it was rolled out with.
        target: What was to be hit, or its position (2,) or (3,) [m].
        fps, speed: Frames per second of the film, and its speed: 1 is real time, 0.25 four times slower.
        size: Width and height [pixels], both even.
        progress: Called as `progress(frames done, frames in all)` after each frame.
        beyond: The strike is beyond its limits: it is shown as no hit.

    Returns:
        `"mujoco"` or `"matplotlib"`: what drew the frames.

    Raises:
        InputError: fps or speed is not positive, a size is odd, or the target has other coordinates than the model.
        OSError: The file cannot be written.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not 0 < value < np.inf:
            raise InputError(name, value, "a finite number > 0")
    if any(x < 16 or x % 2 for x in size):
        raise InputError("size", size, "an even width and height of 16 pixels or more")
    goal = as_target(target)
    film = film_of(trajectory, model, goal, fps=fps, speed=speed, size=size, beyond=beyond)
    try:
        used, frames = "mujoco", _mujoco_frames(film, goal)
        frames = itertools.chain([next(frames)], frames)  # the first frame shows whether OpenGL works
    except Exception as error:  # drivers and MuJoCo fail in many ways
        logger.warning("no OpenGL (%s: %s): the video is drawn by matplotlib", type(error).__name__, error)
        used, frames = "matplotlib", _matplotlib_frames(film, goal)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as unfinished:
        write_film(unfinished, frames, count=len(film.q), size=film.size, fps=fps, progress=progress)
    return used


def _mujoco_frames(film: Film, target: Target) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) of uint8."""
    (width, height), model, reach = film.size, film.model, film.model.reach
    spec = build_spec(model, target=np.array(target.position), target_radius=target.hit_radius)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 4
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 14, 8  # enough at this size
    mj = spec.compile()
    flat = model.dimension == 2
    seen_from = mj.cam("side" if flat else "view")
    if flat:
        seen_from.fovy *= max(1.0, height / width)  # the height of what it sees
    else:
        seen_from.pos[:] = _camera(mj, film, target).place
    data = mujoco.MjData(mj)
    context = gl_context(width, height)
    context.make_current()
    gl = mujoco.MjrContext(mj, 50 * int(np.clip(round(film.type_size / 180), 1, 6)))
    try:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        scene = mujoco.MjvScene(mj, maxgeom=MAX_SEGMENTS + 1000)
        # each costs time; in the plane the board covers the sky
        for flag in ("SHADOW", "REFLECTION", "HAZE", *(("SKYBOX",) if flat else ())):
            scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False
        option, rect, camera = mujoco.MjvOption(), mujoco.MjrRect(0, 0, width, height), mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, seen_from.id
        pixels, first_bar = np.empty((height, width, 3), np.uint8), None
        for i, q in enumerate(film.q):
            context.make_current()
            if film.hit[i]:
                for material in ("target", "target_zone", "target_zone_clear"):
                    mj.mat(material).rgba[:3] = _HIT
            set_posture(mj, data, q)
            mujoco.mjv_updateScene(mj, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            if first_bar is None:  # bars are added once: updating the scene rewrites the model's own geoms only
                if flat:
                    _add_grid(scene, film.grid, reach)
                else:
                    _add_floor_grid(scene, film.grid, reach)
                first_bar = scene.ngeom
                for ends, rgb in zip(film.trail, film.trail_rgb, strict=True):
                    if flat:
                        add_bar(scene, ends, 0.03 * reach, 0.01 * reach, rgb)
                    else:
                        add_rod(scene, ends, 0.004 * reach, rgb)
            scene.ngeom = first_bar + int(film.shown[i])
            mujoco.mjr_render(rect, scene, gl)
            for x, y, word in film.text(i):
                mujoco.mjr_text(mujoco.mjtFont.mjFONT_NORMAL, word, gl, x, y, *_TEXT)
            mujoco.mjr_readPixels(pixels, None, rect, gl)
            yield np.ascontiguousarray(pixels[::-1])
    finally:
        context.make_current()
        gl.free()
        context.free()


def _add_grid(scene: mujoco.MjvScene, spacing: float, reach: float) -> None:
    """Add lines on the board behind a strike in the plane."""
    for k in range(-(lines := int(2.5 * reach / spacing)), lines + 1):
        ends = np.array([[-2.5 * reach, k * spacing], [2.5 * reach, k * spacing]])
        thickness = (0.004 if k else 0.008) * reach
        add_bar(scene, ends, 0.058 * reach, thickness, _GRID)
        add_bar(scene, ends[:, ::-1], 0.058 * reach, thickness, _GRID)


def _add_floor_grid(scene: mujoco.MjvScene, spacing: float, reach: float) -> None:
    """Add lines on the floor below a strike in space."""
    far = (lines := int(2 * reach / spacing)) * spacing
    for k in range(-lines, lines + 1):
        ends = np.array([[-far, k * spacing, -FLOOR * reach], [far, k * spacing, -FLOOR * reach]])
        for line in (ends, ends[:, [1, 0, 2]]):
            add_rod(scene, line, (0.002 if k else 0.004) * reach, _GRID)


def _camera(mj: mujoco.MjModel, film: Film, target: Target) -> Camera:
    """Return the camera that films a strike in space."""
    return Camera.of(mj, "view").fitted(film.box(target), film.size[0] / film.size[1])


def _matplotlib_frames(film: Film, target: Target) -> Iterator[np.ndarray]:
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
    words = [figure.text(x, y, word, color=_TEXT, fontsize=11) for x, y, word in film.text(0)]
    moving = [ax.add_patch(zone), ax.add_collection(trail, autolim=False), *map(ax.add_line, (whip, arm, tip)), *words]
    hand = film.model.arm.n if flat else film.model.arm.n + 1  # in space the base comes first

    def show(i: int) -> None:
        arm.set_data(*points[i][: hand + 1].T)
        whip.set_data(*points[i][hand:].T)
        tip.set_data(*points[i][-1:].T)
        trail.set(segments=trails[: film.shown[i]], colors=film.trail_rgb[: film.shown[i]])
        if film.hit[i]:
            zone.set_color(_HIT)
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
            line(k * film.grid, color=_GRID, linewidth=0.8 if k else 1.8, zorder=0)
    x, y = target.position
    return joint_points(film.model, film.q), film.trail, (x, y), target.hit_radius


def _perspective(ax: Axes, film: Film, target: Target) -> _Drawn:
    """Set up axes that show space as the camera of MuJoCo's film does, with a floor; return what is drawn into them.

    Their unit is half the picture's height.
    """
    camera = _camera(build_spec(film.model).compile(), film, target)
    aspect, reach = film.size[0] / film.size[1], film.model.reach
    ax.set(xlim=(-aspect, aspect), ylim=(-1, 1))
    far = (lines := int(2 * reach / film.grid)) * film.grid
    along = np.linspace(-far, far, 201)
    for k in range(-lines, lines + 1):
        line = np.stack([along, np.full_like(along, k * film.grid), np.full_like(along, -FLOOR * reach)], axis=1)
        for way in (line, line[:, [1, 0, 2]]):
            ax.plot(*camera.seen(way)[:, :2].T, color=_GRID, linewidth=1.0 if k else 2.0, zorder=0)
    arm, whip = arm_and_whip(film.model, film.q)
    points = np.concatenate([arm, whip[:, 1:]], axis=1)
    x, y, size = camera.seen(np.array(target.position))
    return camera.seen(points)[..., :2], camera.seen(film.trail)[..., :2], (x, y), target.hit_radius * size
