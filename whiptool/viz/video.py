"""A strike as a slow-motion H.264 film, rendered by MuJoCo, or drawn by matplotlib without OpenGL."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.target import Target, as_target
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.mujoco_model import build_spec, set_posture
from whiptool.viz.animation import animate, write_film
from whiptool.viz.film import AIM, GRID, HIT, MAX_SEGMENTS, TEXT, Film, film_of, film_place, side_view
from whiptool.viz.opengl import add_ball, add_bar, add_path, add_rod, draws_in_software, gl_context
from whiptool.whole_files import replacing

logger = logging.getLogger("whiptool")
_DPI = 90.0  # of films that matplotlib draws
_RING = 28  # rods of the ring around a target that was hit


def render_video(
    path: str | Path,
    trajectory: Trajectory,
    model: Model,
    target: Target | Sequence[float],
    *,
    fps: float = 25.0,
    speed: float = 0.25,
    size: tuple[int, int] = (960, 540),
    beyond: bool = False,
) -> str:
    """Write a film of a strike, seen from the side, or in space from the front right and above.

    The tip's path so far is drawn with colours from slow to fast (red). When the target is hit, it turns green, the
    broken ring around it becomes whole, and the text says so.

    Args:
        path: MP4 file to write; missing folders are created.
        trajectory, model: Trajectory of the strike, and the model with which it was simulated.
        target: Target of the strike, or its position (2,) or (3,) [m].
        fps, speed: Frames per second of the film, and its speed: 1 is real time, 0.25 four times slower.
        size: Width and height [pixels], both even; a film drawn by matplotlib has a height that fits the strike.
        beyond: Whether the strike exceeds its limits; it is then not shown as a hit.

    Returns:
        `"mujoco"` or `"matplotlib"`, by which the frames were drawn.

    Raises:
        InputError: fps or speed is not positive, a size is odd, or the target has a wrong number of coordinates.
        OSError: The file cannot be written.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not 0 < value < np.inf:
            raise InputError(name, value, "a finite number > 0")
    if any(x < 16 or x % 2 for x in size):
        raise InputError("size", size, "an even width and height of 16 pixels or more")
    goal = as_target(target)
    film = film_of(trajectory, model, goal, fps=fps, speed=speed, size=size, beyond=beyond)
    count, shown = len(film.q), film.size
    try:
        used, frames = "mujoco", _mujoco_frames(film, goal)
        frames = itertools.chain([next(frames)], frames)  # the first frame shows whether OpenGL works
    except Exception as error:  # drivers and MuJoCo fail in many ways
        logger.warning("no OpenGL (%s: %s): the video is drawn by matplotlib", type(error).__name__, error)
        drawn = animate(trajectory, model, goal, speed=speed, fps=fps, width=size[0] / _DPI, dpi=_DPI, beyond=beyond)
        used, frames, count, shown = "matplotlib", drawn.frames(), drawn.count, drawn.size
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as unfinished:
        write_film(unfinished, frames, count=count, size=shown, fps=fps)
    return used


def _mujoco_frames(film: Film, target: Target) -> Iterator[np.ndarray]:
    """Yield the frames of a film (height, width, 3) uint8, rendered by MuJoCo."""
    (width, height), model, reach = film.size, film.model, film.model.reach
    spec = build_spec(model, target=np.array(target.position), target_radius=target.hit_radius)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 14, 8  # enough at this size
    mj = spec.compile()
    flat = model.dimension == 2
    seen_from = mj.cam("side" if flat else "view")
    if flat:
        middle, seen_from.fovy[:] = side_view(film, target)  # the height of what it sees [m]
        seen_from.pos[:] += middle
    else:
        seen_from.pos[:] = film_place(mj, film, target)
        mj.geom("floor").pos[2] = film.places(target)[:, 2].min()
    data = mujoco.MjData(mj)
    context = gl_context(width, height)
    context.make_current()
    mj.vis.quality.offsamples = 0 if draws_in_software() else 4  # of each pixel; in software they take most of the time
    gl = mujoco.MjrContext(mj, 50 * int(np.clip(round(film.type_size / 180), 1, 6)))
    try:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        scene = mujoco.MjvScene(mj, maxgeom=MAX_SEGMENTS + 1000)
        # each costs time; in the plane the board covers the sky
        for flag in ("SHADOW", "REFLECTION", "HAZE", *(("SKYBOX",) if flat else ())):
            scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False
        option, rect, camera = mujoco.MjvOption(), mujoco.MjrRect(0, 0, width, height), mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, seen_from.id
        pixels, ring = np.empty((height, width, 3), np.uint8), None
        for i, q in enumerate(film.q):
            context.make_current()
            if film.hit[i]:
                for material in ("target", "target_zone", "target_zone_clear"):
                    mj.mat(material).rgba[:3] = HIT
            set_posture(mj, data, q)
            mujoco.mjv_updateScene(mj, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            if ring is None:  # bars are added once: updating the scene rewrites the model's own geoms only
                if flat:
                    _add_grid(scene, film, seen_from.pos, float(seen_from.fovy[0]))
                else:
                    _add_floor_grid(scene, film.grid, reach, float(mj.geom("floor").pos[2]))
                ring = _add_ring(scene, mj.cam_mat0[seen_from.id].reshape(3, 3), target, reach)
                if film.thing is not None:
                    add_ball(scene, 0.025 * reach, AIM)
                add_path(scene, film.trail, film.trail_rgb, reach)
            scene.ngeom = ring.stop + int(film.shown[i])
            if film.thing is not None:
                scene.geoms[ring.stop].pos[:] = film.thing[i]
                scene.ngeom += 1
            for k, geom in enumerate(scene.geoms[ring]):
                geom.rgba[:] = (*(HIT if film.hit[i] else AIM), 1.0 if film.hit[i] or k % 4 < 2 else 0.0)
            mujoco.mjr_render(rect, scene, gl)
            for x, y, word in film.text(i):
                mujoco.mjr_text(mujoco.mjtFont.mjFONT_NORMAL, word, gl, x, y, *TEXT)
            mujoco.mjr_readPixels(pixels, None, rect, gl)
            yield np.ascontiguousarray(pixels[::-1])
    finally:
        context.make_current()
        gl.free()
        context.free()


def _add_grid(scene: mujoco.MjvScene, film: Film, middle: np.ndarray, tall: float) -> None:
    """Add lines on the board behind a strike in the plane, as far as a camera in the middle (3,) [m] of a view of this
    height [m] shows them."""
    (width, height), spacing, reach = film.size, film.grid, film.model.reach
    half = tall / 2 * np.array([width / height, 1.0])
    low, high = middle[[0, 2]] - half, middle[[0, 2]] + half
    for axis in (0, 1):
        for k in range(int(np.ceil(low[axis] / spacing)), int(np.floor(high[axis] / spacing)) + 1):
            ends = np.array([low, high])
            ends[:, axis] = k * spacing
            add_bar(scene, ends, 0.058 * reach, (0.004 if k else 0.008) * reach, GRID)


def _add_floor_grid(scene: mujoco.MjvScene, spacing: float, reach: float, floor: float) -> None:
    """Add lines on the floor below a strike in space, at a height [m]."""
    far = (lines := int(2 * reach / spacing)) * spacing
    for k in range(-lines, lines + 1):
        ends = np.array([[-far, k * spacing, floor], [far, k * spacing, floor]])
        for line in (ends, ends[:, [1, 0, 2]]):
            add_rod(scene, line, (0.002 if k else 0.004) * reach, GRID)


def _add_ring(scene: mujoco.MjvScene, axes: np.ndarray, target: Target, reach: float) -> slice:
    """Add a ring around a target that faces a camera with these axes, in columns (3, 3); return its place among the
    scene's objects."""
    first = scene.ngeom
    place = np.array(target.position if len(target.position) == 3 else (target.position[0], 0.0, target.position[1]))
    radius, around = max(1.5 * target.hit_radius, 0.045 * reach), np.linspace(0, 2 * np.pi, _RING + 1)
    points = place + radius * (np.cos(around)[:, None] * axes[:, 0] + np.sin(around)[:, None] * axes[:, 1])
    for ends in np.stack([points[:-1], points[1:]], axis=1):
        add_rod(scene, ends, 0.006 * reach, HIT)
    return slice(first, scene.ngeom)
