"""A strike as a matplotlib animation, which a notebook shows as a film, and films written by ffmpeg."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import imageio_ffmpeg
import matplotlib
import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.axes3d import Axes3D

from whiptool.errors import InputError
from whiptool.goals.target import Target, as_target
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.viz.drawn_posture import arm_and_whip, at_times, box_around
from whiptool.viz.style import COLORS, STYLE, plot_ball, set_up_perspective

FPS = 25.0


class StrikeAnimation(FuncAnimation):
    """An animation that a notebook shows as HTML5 video, made by the ffmpeg that comes with imageio-ffmpeg.

    Args:
        figure: Figure that is drawn.
        moving: Artists that move, in drawing order.
        count: Number of frames.
        show: Called with each frame's number; sets the artists to that frame.
        fps: Frames per second.
    """

    def __init__(
        self, figure: Figure, moving: Sequence[Artist], count: int, show: Callable[[int], None], fps: float
    ) -> None:
        super().__init__(figure, show, frames=count, init_func=lambda: (), interval=1e3 / fps, blit=False)
        self.figure, self.moving, self.count, self.show, self.fps = figure, moving, count, show, fps

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a frame [pixels]."""
        width, height = self.figure.bbox.size
        return int(width), int(height)

    def frames(self) -> Iterator[np.ndarray]:
        """Yield the frames (height, width, 3) of uint8; only moving artists are redrawn for each frame."""
        self._draw_was_started = True  # or matplotlib warns of an animation that was never drawn
        canvas = FigureCanvasAgg(self.figure)
        for artist in self.moving:
            artist.set_animated(True)
        canvas.draw()
        background = canvas.copy_from_bbox(self.figure.bbox)
        for i in range(self.count):
            self.show(i)
            canvas.restore_region(background)
            for artist in self.moving:
                self.figure.draw_artist(artist)
            yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])

    def to_html(self) -> str:
        """Return the film as an HTML element with embedded H.264 video."""
        width, height = self.size
        with TemporaryDirectory() as folder:
            film = Path(folder) / "film.mp4"
            write_film(film, self.frames(), count=self.count, size=self.size, fps=self.fps)
            data = base64.b64encode(film.read_bytes()).decode()
        source = f'<source type="video/mp4" src="data:video/mp4;base64,{data}">'
        return f'<video width="{width}" height="{height}" controls autoplay loop>{source}</video>'

    def __repr__(self) -> str:
        return "StrikeAnimation"

    def _repr_html_(self) -> str:
        return self.to_html()


def animate(
    trajectory: Trajectory,
    model: Model,
    target: Target | Sequence[float] | np.ndarray,
    *,
    speed: float = 0.25,
    fps: float = FPS,
    width: float = 5.6,
    dpi: float = 90,
    beyond: bool = False,
) -> StrikeAnimation:
    """Animate a strike in slow motion: arm, whip, path of the tip, and the target.

    When the target is hit, it turns green, its cross becomes a ring, and the title says so. A strike in space is seen
    in perspective.

    A notebook shows the result as a film; `.save("strike.gif")` writes a file.

    Args:
        trajectory, model: Trajectory of the strike, and the model with which it was simulated.
        target: Target of the strike, or its position (2,), in space (3,) [m].
        speed: Speed of the film: 1 is real time, 0.25 four times slower.
        fps: Frames per second.
        width, dpi: Width [inches] and resolution [pixels per inch] of the frames.
        beyond: Whether the strike exceeds its limits; it is then not shown as a hit.

    Raises:
        InputError: A number is not positive, or the target has a wrong number of coordinates.
    """
    for name, value in (("speed", speed), ("fps", fps), ("width", width), ("dpi", dpi)):
        if not 0 < value < np.inf:
            raise InputError(name, value, "a finite number > 0")
    goal = as_target(target)
    goal.check_fits(model)
    t = trajectory.t
    times = np.append(np.arange(t[0], t[-1], speed / fps), t[-1])  # (F,)
    q, tip_velocity = (at_times(times, t, x) for x in (trajectory.q, trajectory.tip_velocity))
    path_times = times if model.dimension == 2 else np.union1d(times, t)
    path = at_times(path_times, t, trajectory.tip)
    arms, whips = arm_and_whip(model, q)
    hit_time = None if beyond else goal.hit_time(trajectory.approach(goal))
    every = np.concatenate([arms.reshape(-1, model.dimension), whips.reshape(-1, model.dimension), trajectory.tip])

    with matplotlib.rc_context(STYLE):
        figure, ax, zone = (_in_space if model.dimension == 3 else _in_plane)(every, goal, width, dpi)
        trail, whip, arm, tip = _lines(ax, model)
        mark = _mark(ax, goal)
        title = ax.set_title(" ", fontsize=11) if model.dimension == 2 else figure.text(0.02, 0.95, " ", fontsize=11)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, not in every frame

        def show(frame: int) -> None:
            now = times[frame]
            for line, places in ((arm, arms[frame]), (whip, whips[frame]), (tip, whips[frame, -1:])):
                _put(line, places)
            _put(trail, path[path_times <= now])
            struck = hit_time is not None and now >= hit_time
            zone.set_color(COLORS["green"] if struck else COLORS["orange"])
            mark.set(marker="o" if struck else "+", color=COLORS["green"] if struck else COLORS["orange"])
            fast = np.linalg.norm(tip_velocity[frame])
            title.set_text(f"{now:.2f} s, tip at {fast:.1f} m/s ({speed:g} x real time){', hit' if struck else ''}")

        return StrikeAnimation(figure, (zone, mark, trail, whip, arm, tip, title), len(times), show, fps)


def _lines(ax: Axes, model: Model) -> tuple[Any, Any, Any, Any]:
    """The path of the tip, the whip, the arm and the tip, without places so far."""
    (trail,) = ax.plot([], [], *_nothing(model), color=COLORS["vermilion"], linewidth=1)
    (whip,) = ax.plot([], [], *_nothing(model), color=COLORS["black"], linewidth=2.2, solid_joinstyle="round")
    (arm,) = ax.plot(
        [], [], *_nothing(model), "o-", color=COLORS["blue"], linewidth=5, markersize=7, markerfacecolor="white"
    )
    (tip,) = ax.plot([], [], *_nothing(model), "o", color=COLORS["vermilion"], markersize=6)
    return trail, whip, arm, tip


def _mark(ax: Axes, target: Target) -> Any:
    """The mark of a target, which is seen however small its hit radius is: a cross, and a ring once it is hit."""
    look = {"color": COLORS["orange"], "markersize": 20, "markerfacecolor": "none", "markeredgewidth": 1.8}
    (mark,) = ax.plot(*([x] for x in target.position), "+", **look)
    return mark


def _nothing(model: Model) -> list[list[float]]:
    """What a line of a model in space is given more than one in the plane: its z."""
    return [[]] if model.dimension == 3 else []


def _put(line: Any, places: np.ndarray) -> None:
    """Move a line to places (..., 2) or (..., 3)."""
    (line.set_data_3d if places.shape[-1] == 3 else line.set_data)(*places.T)


def _in_plane(every: np.ndarray, target: Target, width: float, dpi: float) -> tuple[Figure, Axes, Any]:
    """Figure and axes that hold all places (..., 2), and the target in them."""
    low, high = box_around(every, target)
    beside, above = 0.72, 0.86  # [in], of ticks, labels and title
    figure = _figure(width, (width - beside) * (high[1] - low[1]) / (high[0] - low[0]) + above, dpi)
    ax = figure.subplots()
    ax.set(aspect="equal", xlabel="x, forward [m]", ylabel="y, up [m]")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    x, y = target.position
    zone = Circle((x, y), target.hit_radius, color=COLORS["orange"], alpha=0.5, linewidth=0)
    return figure, ax, ax.add_patch(zone)


def _in_space(every: np.ndarray, target: Target, width: float, dpi: float) -> tuple[Figure, Axes, Any]:
    """Figure and axes in perspective that hold all places (..., 3), and the target in them."""
    figure = _figure(width, 0.88 * width, dpi)
    figure.set_layout_engine("none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 0.93), projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    low, high = box_around(every, target)
    set_up_perspective(ax, low, high, zoom=1.0)
    ax.locator_params(nbins=5)
    zone = plot_ball(ax, target)
    _fill(figure, ax, high - low)
    return figure, ax, zone


def _axes_of(ax: Axes3D) -> tuple[Any, Any, Any]:
    return ax.xaxis, ax.yaxis, ax.zaxis


def _fill(figure: Figure, ax: Axes3D, sides: np.ndarray) -> None:
    """Zoom and move axes in perspective, of a box with these sides (3,), so that they and their labels fill a figure
    below its title."""
    width, height = figure.bbox.size
    room, margin = np.array([width, 0.93 * height]), 0.02 * width
    for zoom in (1.0, None):
        figure.draw_without_rendering()
        walls = [axis.pane.get_window_extent() for axis in _axes_of(ax)]
        drawn = Bbox.union([*walls, *(axis.get_tightbbox() for axis in _axes_of(ax))])
        if zoom is not None:  # words keep their size, and so a little room stays
            ax.set_box_aspect(tuple(sides), zoom=zoom * float(((room - 2 * margin) / drawn.size).min()))
    x, y = (room - (drawn.p0 + drawn.p1)) / 2 / (width, height)
    ax.set_position((x, y, 1.0, 0.93))


def _figure(width: float, height: float, dpi: float) -> Figure:
    size = [(2 * round(x * dpi / 2) + 0.01) / dpi for x in (width, height)]  # H.264 wants even numbers of pixels
    return Figure((size[0], size[1]), dpi=dpi, layout="constrained")


def write_film(
    path: Path,
    frames: Iterable[np.ndarray],
    *,
    count: int,
    size: tuple[int, int],
    fps: float,
) -> None:
    """Write frames (height, width, 3) of uint8 as an H.264 film.

    Args:
        path: MP4 file to write.
        frames, count: Frames of the film, and their number.
        size: Width and height [pixels], both even.
        fps: Frames per second.

    Raises:
        OSError: The file cannot be written.
    """
    writer = imageio_ffmpeg.write_frames(
        path,
        size,
        fps=fps,
        codec="libx264",
        quality=7,
        macro_block_size=1,
        ffmpeg_log_level="error",
        output_params=["-preset", "veryfast", "-movflags", "+faststart"],
    )
    writer.send(None)
    try:
        for frame in frames:
            writer.send(frame)
    except OSError:
        raise OSError("ffmpeg ended before the last frame; the disk may be full") from None
    finally:
        writer.close()
    try:
        written, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError:  # no film at all
        written = 0
    if written != count:
        raise OSError(f"ffmpeg wrote {written} of {count} frames; the disk may be full")
