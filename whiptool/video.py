"""A strike as a slow-motion H.264 film, rendered by MuJoCo, or drawn by matplotlib where there is no OpenGL."""

from __future__ import annotations

import importlib
import itertools
import logging
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from whiptool.errors import InputError
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory, joint_points

logger = logging.getLogger("whiptool")

# Trail colours from a tip at rest to its fastest, grid, and the target once hit (Okabe-Ito)
_SLOW, _FAST, _GRID, _HIT = (0.62, 0.66, 0.72), (0.84, 0.37, 0.0), (0.70, 0.73, 0.77), (0.0, 0.62, 0.45)
_TEXT = (0.15, 0.16, 0.18)
_MAX_SEGMENTS = 800


@dataclass(frozen=True)
class _Film:
    """What is to be seen in F frames, whoever draws it.

    Args:
        q: Joint positions [rad], (F, n).
        trail: The tip's path at equal distances [m], (S + 1, 2).
        trail_rgb: Colour of each of its segments, by the tip's speed there, (S, 3).
        shown: How many segments each frame shows, (F,).
        hit: Whether the target has been hit, (F,).
        readings: Numbers to show in each frame, under their names, as text.
        note: One more line.
        grid: Distance of the grid's lines [m].
    """

    q: np.ndarray
    trail: np.ndarray
    trail_rgb: np.ndarray
    shown: np.ndarray
    hit: np.ndarray
    readings: dict[str, list[str]]
    note: str
    grid: float

    def text(self, frame: int) -> Iterator[tuple[float, float, str]]:
        """Words and where they start, as shares of width and height from the lower left."""
        yield 0.02, 0.03, self.note
        for row, (name, values) in enumerate(self.readings.items()):
            y = 0.94 - 0.05 * row
            yield 0.02, y, name
            yield 0.13, y, values[frame]


def render_video(
    path: str | Path, trajectory: Trajectory, model: Model, target: np.ndarray, hit_radius: float, *,
    fps: float = 30.0, speed: float = 0.25, size: tuple[int, int] = (960, 540),
    progress: Callable[[int, int], None] | None = None,
) -> str:  # fmt: skip
    """Write a film of a strike, seen from the side.

    The trail is the tip's path so far, the redder the faster; the target turns green once it has been hit.

    Args:
        path: MP4 file to write; missing folders are made.
        trajectory: The strike.
        model: The model that it was rolled out with.
        target: Position (2,) [m].
        hit_radius: The tip hits within this distance [m].
        fps: Frames per second of the film.
        speed: Of the film; 1 is real time, 0.25 four times slower.
        size: Width and height [pixels], both even.
        progress: Called as `progress(frames done, frames in all)` after each frame.

    Returns:
        `"mujoco"` or `"matplotlib"`: what drew the frames.

    Raises:
        InputError: fps or speed is not positive, or a size is odd.
        OSError: The file cannot be written.
    """
    for name, value in (("fps", fps), ("speed", speed)):
        if not 0 < value < np.inf:
            raise InputError(name, value, "a finite number > 0")
    if any(x < 16 or x % 2 for x in size):
        raise InputError("size", size, "an even width and height of 16 pixels or more")
    film = _film(trajectory, model, np.asarray(target, float), hit_radius, fps, speed)
    try:
        used, frames = "mujoco", _mujoco_frames(film, model, target, hit_radius, size)
        frames = itertools.chain([next(frames)], frames)  # the first frame shows whether OpenGL works
    except Exception as error:  # drivers and MuJoCo fail in many ways
        logger.warning("no OpenGL (%s: %s): the video is drawn by matplotlib", type(error).__name__, error)
        used, frames = "matplotlib", _matplotlib_frames(film, model, target, hit_radius, size)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = imageio_ffmpeg.write_frames(
        path, tuple(map(int, size)), fps=fps, codec="libx264", quality=7, macro_block_size=1, ffmpeg_log_level="error",
        output_params=["-preset", "veryfast", "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    try:
        for i, frame in enumerate(frames):
            writer.send(frame)
            if progress is not None:
                progress(i + 1, len(film.q))
    finally:
        writer.close()
    return used


def _film(trajectory: Trajectory, model: Model, target: np.ndarray, hit_radius: float, fps: float,
          speed: float) -> _Film:  # fmt: skip
    t, tip, reach = trajectory.t, trajectory.tip, model.reach
    at = np.minimum(t[0] + np.arange(int(np.ceil((t[-1] - t[0]) / speed * fps)) + 1) * speed / fps, t[-1])  # (F,)
    near = trajectory.approach(target)
    tip_speed, distance = np.hypot(*trajectory.tip_velocity.T), trajectory.distance(target)
    closest = np.interp(at, t, np.minimum.accumulate(distance))
    closest[at >= near.time[0]] = min(near.distance[0], distance.min())  # between two instants, nearer than at either

    path = np.r_[0, np.cumsum(np.hypot(*np.diff(tip, axis=0).T))]  # (T,)
    segments = int(np.clip(path[-1] / (0.012 * reach), 1, _MAX_SEGMENTS))
    along = np.linspace(0, path[-1], segments + 1)
    trail = np.stack([np.interp(along, path, x) for x in tip.T], axis=1)
    share = np.interp((along[1:] + along[:-1]) / 2, path, tip_speed) / max(tip_speed.max(), 1e-9)
    spacing = np.array([0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])
    grid = float(spacing[np.abs(spacing - reach / 3).argmin()])
    return _Film(
        q=np.stack([np.interp(at, t, x) for x in trajectory.q.T], axis=1),
        trail=trail,
        trail_rgb=np.array(_SLOW) + share[:, None] * (np.array(_FAST) - np.array(_SLOW)),
        shown=np.searchsorted(along, np.interp(at, t, path), side="right") - 1,
        hit=closest <= hit_radius,
        readings={
            "time": [f"{x:.3f} s" for x in at],
            "tip speed": [f"{x:.1f} m/s" for x in np.interp(at, t, tip_speed)],
            "distance": [f"{x:.3f} m" for x in np.interp(at, t, distance)],
            "closest": [f"{x:.3f} m" for x in closest],
        },
        note=f"{speed:g} x real time, grid {grid:g} m",
        grid=grid,
    )


def _gl_context(width: int, height: int):
    """An off-screen OpenGL context.

    MuJoCo reads MUJOCO_GL when it is imported, and without it takes GLFW, which needs a display. By now MuJoCo has
    long been imported, so its choice is made again here.
    """
    backend = os.environ.get("MUJOCO_GL", "").strip().lower()
    headless = sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if not backend and headless:
        backend = "egl"
    module = f"mujoco.{backend}" if backend in ("egl", "osmesa", "glfw", "cgl") else "mujoco.gl_context"
    return importlib.import_module(module).GLContext(width, height)


def _mujoco_frames(film: _Film, model: Model, target: np.ndarray, hit_radius: float,
                   size: tuple[int, int]) -> Iterator[np.ndarray]:  # fmt: skip
    """Frames (height, width, 3) of uint8."""
    import mujoco

    from whiptool.models.mujoco_model import build_spec, set_posture

    width, height = size
    spec = build_spec(model, target=target, target_radius=hit_radius)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 4
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 14, 8  # enough at this size
    mj = spec.compile()
    if width < height:  # a camera's angle is that of the height
        mj.cam("side").fovy[:] = np.rad2deg(2 * np.arctan(np.tan(np.deg2rad(mj.cam("side").fovy) / 2) * height / width))
    data = mujoco.MjData(mj)
    context = _gl_context(width, height)
    context.make_current()
    gl = mujoco.MjrContext(mj, 100 if height < 700 else 150)
    try:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        scene = mujoco.MjvScene(mj, maxgeom=_MAX_SEGMENTS + 1000)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "HAZE"):  # each costs time; the board covers the sky
            scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False
        option, rect = mujoco.MjvOption(), mujoco.MjrRect(0, 0, width, height)
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, mj.cam("side").id
        pixels = np.empty((height, width, 3), np.uint8)
        first_trail = None
        for i, q in enumerate(film.q):
            context.make_current()
            if film.hit[i]:
                mj.mat("target").rgba[:3] = mj.mat("target_zone").rgba[:3] = _HIT
            set_posture(mj, data, q)
            mujoco.mjv_updateScene(mj, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            if first_trail is None:  # once: updating rewrites the model's own geoms only
                _add_grid(scene, film.grid, model.reach, mj.geom("board").pos[1])
                first_trail = scene.ngeom
                _add_trail(scene, film, model.reach)
            scene.ngeom = first_trail + int(film.shown[i])
            mujoco.mjr_render(rect, scene, gl)
            for x, y, text in film.text(i):
                mujoco.mjr_text(mujoco.mjtFont.mjFONT_NORMAL, text, gl, x, y, *_TEXT)
            mujoco.mjr_readPixels(pixels, None, rect, gl)
            yield np.ascontiguousarray(pixels[::-1])
    finally:
        context.make_current()
        gl.free()
        context.free()


def _add_grid(scene, spacing: float, reach: float, board: float) -> None:
    """Lines on the board, through the shoulder and at whole multiples of `spacing` from it."""
    import mujoco

    half, y = 2.5 * reach, board - 0.002 * reach
    for k in range(-int(half / spacing), int(half / spacing) + 1):
        thickness = (0.0045 if k == 0 else 0.0024) * reach
        for size, pos in (((thickness, thickness, half), (k * spacing, y, 0)),
                          ((half, thickness, thickness), (0, y, k * spacing))):  # fmt: skip
            mujoco.mjv_initGeom(scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_BOX, np.array(size), np.array(pos),
                                np.eye(3).ravel(), np.array([*_GRID, 1], np.float32))  # fmt: skip
            scene.ngeom += 1


def _add_trail(scene, film: _Film, reach: float) -> None:
    """The tip's whole path, in the order in which it is to appear, between board and whip."""
    import mujoco

    points = np.insert(film.trail, 1, 0.03 * reach, axis=1)  # (S + 1, 3)
    for start, end, rgb in zip(points[:-1], points[1:], film.trail_rgb, strict=True):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.zeros(9),
                            np.array([*rgb, 1], np.float32))  # fmt: skip
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.004 * reach, start, end)
        scene.ngeom += 1


def _matplotlib_frames(film: _Film, model: Model, target: np.ndarray, hit_radius: float,
                       size: tuple[int, int]) -> Iterator[np.ndarray]:  # fmt: skip
    """Frames (height, width, 3) of uint8; only what moves is drawn anew."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle

    from whiptool.plots import COLORS

    (width, height), reach = size, model.reach
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    half = 1.07 * reach * np.array(size) / min(size)  # (2,)
    ax = figure.add_axes((0, 0, 1, 1), xlim=(-half[0], half[0]), ylim=(-half[1], half[1]))
    ax.set_axis_off()
    for k in range(-int(max(half) / film.grid), int(max(half) / film.grid) + 1):
        for line in (ax.axhline, ax.axvline):
            line(k * film.grid, color=_GRID, linewidth=1.8 if k == 0 else 0.8, zorder=0)
    points, n = joint_points(model, film.q), model.arm.n
    zone = Circle((target[0], target[1]), hit_radius, color=COLORS["orange"], alpha=0.5)
    trail = LineCollection([], linewidths=2.5)
    arm, whip, tip = (
        Line2D([], [], color=COLORS["blue"], linewidth=8, marker="o", markersize=10, markerfacecolor="0.35",
               markeredgewidth=0, solid_capstyle="round"),
        Line2D([], [], color="0.15", linewidth=3, solid_capstyle="round", solid_joinstyle="round"),
        Line2D([], [], color=COLORS["vermilion"], marker="o", markersize=9, markeredgewidth=0),
    )  # fmt: skip
    words = [figure.text(x, y, word, color=_TEXT, fontsize=11) for x, y, word in film.text(0)]
    moving = [ax.add_patch(zone), ax.add_collection(trail, autolim=False), *map(ax.add_line, (whip, arm, tip)), *words]
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    segments = np.stack([film.trail[:-1], film.trail[1:]], axis=1)  # (S, 2, 2)
    for i, p in enumerate(points):
        arm.set_data(*p[: n + 1].T)
        whip.set_data(*p[n:].T)
        tip.set_data(*p[-1:].T)
        trail.set(segments=segments[: film.shown[i]], colors=film.trail_rgb[: film.shown[i]])
        if film.hit[i]:
            zone.set_color(_HIT)
        for artist, (*_, word) in zip(words, film.text(i), strict=True):
            artist.set_text(word)
        canvas.restore_region(background)
        for artist in moving:
            figure.draw_artist(artist)
        yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
