"""A strike as a slow-motion H.264 film, rendered by MuJoCo, or drawn by matplotlib where there is no OpenGL."""

from __future__ import annotations

import importlib
import itertools
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
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
from whiptool.viz.plots import COLORS
from whiptool.whole_files import replacing

logger = logging.getLogger("whiptool")

# Colours of the trail from a tip at rest to its fastest, of the grid, and of the target once hit (Okabe-Ito)
_SLOW, _FAST, _GRID, _HIT = (0.62, 0.66, 0.72), (0.84, 0.37, 0.0), (0.70, 0.73, 0.77), (0.0, 0.62, 0.45)
_FLOOR_GRID = (0.85, 0.87, 0.90)
_TEXT = (0.15, 0.16, 0.18)
_MAX_SEGMENTS = 800


@dataclass(frozen=True)
class _Film:
    """What is to be seen in F frames, whoever draws it."""

    q: np.ndarray  # joint positions [rad], (F, n)
    trail: np.ndarray  # the tip's path in short segments, their ends [m], (S, 2, d)
    trail_rgb: np.ndarray  # (S, 3)
    shown: np.ndarray  # how many segments each frame shows, (F,)
    hit: np.ndarray  # whether the target has been hit, (F,)
    readings: dict[str, list[str]]  # numbers to show in each frame, under their names
    note: str
    grid: float  # distance of the grid's lines [m]
    size: tuple[int, int]  # width and height [pixels]

    @property
    def type_size(self) -> float:
        """Height [pixels] that type and lines go by."""
        return min(self.size[1], 0.8 * self.size[0])

    def text(self, frame: int) -> Iterator[tuple[float, float, str]]:
        """Words and where they start, as shares of width and height from the lower left."""
        yield 0.02, 0.03, self.note
        for row, (name, values) in enumerate(self.readings.items()):
            y = 0.94 - row * max(0.05 * self.type_size, 17) / self.size[1]
            yield 0.02, y, name
            yield 0.02 + max(0.21 * self.type_size, 85) / self.size[0], y, values[frame]


def render_video(
    path: str | Path,
    trajectory: Trajectory,
    model: Model,
    target: np.ndarray,
    hit_radius: float,
    *,
    fps: float = 25.0,
    speed: float = 0.25,
    size: tuple[int, int] = (960, 540),
    progress: Callable[[int, int], None] | None = None,
) -> str:
    """Write a film of a strike, seen from the side, or in space from the front right and above.

    The trail is the tip's path so far, the redder the faster; the target turns green once it has been hit.

    Args:
        path: MP4 file to write; missing folders are made.
        trajectory, model: The strike, and the model that it was rolled out with.
        target, hit_radius: Position (2,) or (3,) [m], and how near [m] the tip must come to hit.
        fps, speed: Frames per second of the film, and its speed: 1 is real time, 0.25 four times slower.
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
    film = _film(trajectory, model, np.asarray(target, float), hit_radius, fps, speed, size)
    try:
        used, frames = "mujoco", _mujoco_frames(film, model, target, hit_radius)
        frames = itertools.chain([next(frames)], frames)  # the first frame shows whether OpenGL works
    except Exception as error:  # drivers and MuJoCo fail in many ways
        logger.warning("no OpenGL (%s: %s): the video is drawn by matplotlib", type(error).__name__, error)
        used, frames = "matplotlib", _matplotlib_frames(film, model, target, hit_radius)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as unfinished:
        _encode(unfinished, film, frames, fps, progress)
    return used


def _encode(
    path: Path,
    film: _Film,
    frames: Iterator[np.ndarray],
    fps: float,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Write frames as a film.

    Raises:
        OSError: It cannot be written.
    """
    writer = imageio_ffmpeg.write_frames(
        path,
        film.size,
        fps=fps,  # type: ignore[arg-type]
        codec="libx264",
        quality=7,
        macro_block_size=1,
        ffmpeg_log_level="error",
        output_params=["-preset", "veryfast", "-movflags", "+faststart"],
    )
    writer.send(None)
    try:
        for i, frame in enumerate(frames):
            writer.send(frame)
            if progress is not None:
                progress(i + 1, len(film.q))
    except OSError:
        raise OSError("ffmpeg ended before the last frame; the disk may be full") from None
    finally:
        writer.close()
    try:
        written, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError:  # no film at all
        written = 0
    if written != len(film.q):
        raise OSError(f"ffmpeg wrote {written} of {len(film.q)} frames; the disk may be full")


def _film(
    trajectory: Trajectory,
    model: Model,
    target: np.ndarray,
    hit_radius: float,
    fps: float,
    speed: float,
    size: tuple[int, int],
) -> _Film:
    t, tip = trajectory.t, trajectory.tip
    at = np.minimum(t[0] + np.arange(int(np.ceil((t[-1] - t[0]) / speed * fps)) + 1) * speed / fps, t[-1])  # (F,)
    near = trajectory.approach(target)
    tip_speed, distance = np.linalg.norm(trajectory.tip_velocity, axis=1), trajectory.distance(target)
    closest = np.interp(at, t, np.minimum.accumulate(distance))
    closest[at >= near.time[0]] = min(near.distance[0], distance.min())  # between two instants, nearer than at either

    path = np.r_[0, np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1))]  # (T,)
    segments = int(np.clip(path[-1] / (0.016 * model.reach), 1, _MAX_SEGMENTS))
    along = np.linspace(0, path[-1], segments + 1)
    trail = np.stack([np.interp(along, path, x) for x in tip.T], axis=1)  # (S + 1, d)
    share = np.interp((along[1:] + along[:-1]) / 2, path, tip_speed) / max(tip_speed.max(), 1e-9)
    grid = min((0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0), key=lambda spacing: abs(spacing - model.reach / 3))
    return _Film(
        q=np.stack([np.interp(at, t, x) for x in trajectory.q.T], axis=1),
        trail=np.stack([trail[:-1], trail[1:]], axis=1),
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
        size=(int(size[0]), int(size[1])),
    )


def _gl_context(width: int, height: int):
    """An off-screen OpenGL context, chosen by MUJOCO_GL, or EGL where there is no display.

    MuJoCo itself reads that variable only once, when it is imported, and without it insists on a display.
    """
    backend = os.environ.get("MUJOCO_GL", "").strip().lower()
    if backend in ("disable", "disabled", "off", "false", "0"):
        raise RuntimeError(f"MUJOCO_GL={backend}")
    if not backend and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        backend = "egl"
    module = f"mujoco.{backend}" if backend in ("egl", "osmesa", "glfw", "cgl") else "mujoco.gl_context"
    return importlib.import_module(module).GLContext(width, height)


def _mujoco_frames(film: _Film, model: Model, target: np.ndarray, hit_radius: float) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) of uint8."""
    (width, height), reach = film.size, model.reach
    spec = build_spec(model, target=target, target_radius=hit_radius)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 4
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 14, 8  # enough at this size
    mj = spec.compile()
    flat = model.dimension == 2
    seen_from = mj.cam("side" if flat else "view")
    seen_from.fovy *= max(1.0, height / width)  # the height of what it sees
    data = mujoco.MjData(mj)
    context = _gl_context(width, height)
    context.make_current()
    gl = mujoco.MjrContext(mj, 50 * int(np.clip(round(film.type_size / 180), 1, 6)))
    try:
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        scene = mujoco.MjvScene(mj, maxgeom=_MAX_SEGMENTS + 1000)
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
                        _add_bar(scene, ends, 0.03 * reach, 0.01 * reach, rgb)
                    else:
                        _add_rod(scene, ends, 0.004 * reach, rgb)
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
    """Lines on the board behind a strike in the plane."""
    for k in range(-(lines := int(2.5 * reach / spacing)), lines + 1):
        ends = np.array([[-2.5 * reach, k * spacing], [2.5 * reach, k * spacing]])
        thickness = (0.004 if k else 0.008) * reach
        _add_bar(scene, ends, 0.058 * reach, thickness, _GRID)
        _add_bar(scene, ends[:, ::-1], 0.058 * reach, thickness, _GRID)


def _add_floor_grid(scene: mujoco.MjvScene, spacing: float, reach: float) -> None:
    """Lines on the floor below a strike in space."""
    far = (lines := int(2 * reach / spacing)) * spacing
    for k in range(-lines, lines + 1):
        ends = np.array([[-far, k * spacing, -FLOOR * reach], [far, k * spacing, -FLOOR * reach]])
        for line in (ends, ends[:, [1, 0, 2]]):
            _add_rod(scene, line, (0.002 if k else 0.004) * reach, _FLOOR_GRID)


def _add_rod(scene: mujoco.MjvScene, ends: np.ndarray, radius: float, rgb: Sequence[float]) -> None:
    """A round rod between two ends (2, 3) in space."""
    geom = scene.geoms[scene.ngeom]
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), np.array([*rgb, 1], np.float32))
    mujoco.mjv_connector(geom, kind, radius, ends[0], ends[1])
    scene.ngeom += 1


def _add_bar(scene: mujoco.MjvScene, ends: np.ndarray, y: float, thickness: float, rgb: Sequence[float]) -> None:
    """A flat bar between two ends (2, 2), y behind the strike plane: far cheaper to render than a capsule."""
    along = ends[1] - ends[0]
    length = np.hypot(*along)
    dx, dz = along / length if length else (1.0, 0.0)
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_BOX,
        np.array([length + thickness, 2e-4, thickness]) / 2,
        np.insert(ends.mean(axis=0), 1, y),
        np.array([dx, 0, -dz, 0, 1, 0, dz, 0, dx]),
        np.array([*rgb, 1], np.float32),
    )
    geom.specular = 0
    scene.ngeom += 1


def _matplotlib_frames(film: _Film, model: Model, target: np.ndarray, hit_radius: float) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) of uint8; only what moves is drawn anew."""
    size, dpi = np.array(film.size), film.type_size / 5.4
    figure = Figure(figsize=((size[0] + 0.01) / dpi, (size[1] + 0.01) / dpi), dpi=dpi)  # matplotlib truncates to pixels
    canvas = FigureCanvasAgg(figure)
    half = 1.07 * model.reach * size / size.min()  # (2,)
    ax = figure.add_axes((0, 0, 1, 1), xlim=(-half[0], half[0]), ylim=(-half[1], half[1]))
    ax.set_axis_off()
    for k in range(-int(max(half) / film.grid), int(max(half) / film.grid) + 1):
        for line in (ax.axhline, ax.axvline):
            line(k * film.grid, color=_GRID, linewidth=0.8 if k else 1.8, zorder=0)
    seen = [0, 1] if model.dimension == 2 else [0, 2]  # in space from the side
    zone = Circle(tuple(target[seen]), hit_radius, color=COLORS["orange"], alpha=0.5)
    trail = LineCollection([], linewidths=2.5, capstyle="round")
    whip = Line2D([], [], color="0.15", linewidth=3, solid_capstyle="round", solid_joinstyle="round")
    arm = Line2D(
        [], [], color=COLORS["blue"], linewidth=8, marker="o", markersize=10, markerfacecolor="0.35", markeredgewidth=0
    )
    tip = Line2D([], [], color=COLORS["vermilion"], marker="o", markersize=9, markeredgewidth=0)
    words = [figure.text(x, y, word, color=_TEXT, fontsize=11) for x, y, word in film.text(0)]
    moving = [ax.add_patch(zone), ax.add_collection(trail, autolim=False), *map(ax.add_line, (whip, arm, tip)), *words]
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background, n = canvas.copy_from_bbox(figure.bbox), model.arm.n
    trails = film.trail[..., seen]
    for i, p in enumerate(joint_points(model, film.q)[..., seen]):
        arm.set_data(*p[: n + 1].T)
        whip.set_data(*p[n:].T)
        tip.set_data(*p[-1:].T)
        trail.set(segments=trails[: film.shown[i]], colors=film.trail_rgb[: film.shown[i]])
        if film.hit[i]:
            zone.set_color(_HIT)
        for artist, (*_, word) in zip(words, film.text(i), strict=True):
            artist.set_text(word)
        canvas.restore_region(background)
        for artist in moving:
            figure.draw_artist(artist)
        yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
