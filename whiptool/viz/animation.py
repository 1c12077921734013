"""A strike as a matplotlib animation, which a notebook shows as a film."""

from __future__ import annotations

from typing import Any

import imageio_ffmpeg
import matplotlib
import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from whiptool.errors import InputError
from whiptool.models.parameters import Model
from whiptool.rollout.trajectory import Trajectory, joint_points
from whiptool.viz.plots import COLORS, STYLE

FPS = 25.0


class StrikeAnimation(FuncAnimation):
    """An animation that a notebook shows as HTML5 video, made by the ffmpeg that comes with imageio-ffmpeg."""

    def to_html(self) -> str:
        """Return the film as an HTML element with embedded H.264 video."""
        with matplotlib.rc_context(
            {
                "animation.ffmpeg_path": imageio_ffmpeg.get_ffmpeg_exe(),
                "animation.writer": "ffmpeg",
                "animation.codec": "h264",
                "savefig.bbox": None,  # frames of one size,
                "savefig.dpi": "figure",  # the one that was asked for
            }
        ):
            return self.to_html5_video(embed_limit=20)

    def __repr__(self) -> str:
        return "StrikeAnimation"

    def _repr_html_(self) -> str:
        return self.to_html()


def animate(
    trajectory: Trajectory,
    model: Model,
    target: np.ndarray | tuple[float, ...],
    hit_radius: float,
    *,
    speed: float = 0.25,
    width: float = 5.6,
    dpi: float = 90,
) -> StrikeAnimation:
    """A strike in slow motion: arm, whip, the tip's path so far, the target, which turns green once it is hit.

    As the last expression of a notebook's cell it shows as a film; `.save("strike.gif")` writes a file.

    Args:
        trajectory, model: The strike, and the model that it was rolled out with.
        target, hit_radius: Position (2,) [m], and how near [m] the tip must come to hit.
        speed: 1 is real time, 0.25 four times slower.
        width, dpi: Of the frames [inches], [pixels per inch].

    Raises:
        InputError: speed, width or dpi is not a positive number.
    """
    for name, value in (("speed", speed), ("width", width), ("dpi", dpi)):
        if not 0 < value < np.inf:
            raise InputError(name, value, "a finite number > 0")
    t, n, target = trajectory.t, model.arm.n, np.asarray(target, float)
    times = np.append(np.arange(t[0], t[-1], speed / FPS), t[-1])  # (F,)

    def at(x: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, t, column) for column in x.T], axis=1)

    points, tip_velocity = joint_points(model, at(trajectory.q)), at(trajectory.tip_velocity)
    path = at(trajectory.tip)  # (F, 2)
    near = trajectory.approach(target)
    hit = bool(near.distance[0] <= hit_radius)
    every = np.concatenate([points.reshape(-1, 2), trajectory.tip, target + hit_radius * np.array([[-1, -1], [1, 1]])])
    low, high = every.min(axis=0) - 0.08, every.max(axis=0) + 0.08
    height = width * (high[1] - low[1]) / (high[0] - low[0]) + 0.6
    size = [(2 * round(x * dpi / 2) + 0.01) / dpi for x in (width, height)]  # H.264 wants even numbers of pixels

    with matplotlib.rc_context(STYLE):
        figure = Figure((size[0], size[1]), dpi=dpi, layout="constrained")
        ax = figure.subplots()
        ax.set(aspect="equal", xlabel="x, forward [m]", ylabel="y, up [m]")
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        zone = ax.add_patch(Circle((target[0], target[1]), hit_radius, color=COLORS["orange"], alpha=0.5, linewidth=0))
        (trail,) = ax.plot([], [], color=COLORS["vermilion"], linewidth=1)
        (whip,) = ax.plot([], [], color=COLORS["black"], linewidth=2.2, solid_joinstyle="round")
        (arm,) = ax.plot([], [], "o-", color=COLORS["blue"], linewidth=5, markersize=7, markerfacecolor="white")
        (tip,) = ax.plot([], [], "o", color=COLORS["vermilion"], markersize=6)
        title = ax.set_title(" ", fontsize=11)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, not in every frame

        def draw(frame: Any) -> tuple[Artist, ...]:
            p, now = points[frame], times[frame]
            arm.set_data(*p[: n + 1].T)
            whip.set_data(*p[n:].T)
            tip.set_data(*p[-1:].T)
            trail.set_data(*path[: frame + 1].T)
            zone.set_color(COLORS["green"] if hit and now >= near.time[0] else COLORS["orange"])
            title.set_text(f"{now:.2f} s, tip at {np.hypot(*tip_velocity[frame]):.1f} m/s ({speed:g} x real time)")
            return arm, whip, tip, trail, zone, title

        return StrikeAnimation(figure, draw, frames=len(times), init_func=lambda: (), interval=1e3 / FPS, blit=False)
