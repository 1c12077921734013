"""Content of a film of a strike, frame by frame, for any renderer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from whiptool.goals.target import Target
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.mujoco_import import mujoco
from whiptool.viz.drawn_posture import as_mujoco_shows, at_times

MAX_SEGMENTS = 800  # of the tip's path
GRID, HIT, TEXT = (0.70, 0.73, 0.77), (0.0, 0.62, 0.45), (0.15, 0.16, 0.18)  # colours; the target's once hit
_SLOW, _FAST = (0.62, 0.66, 0.72), (0.84, 0.37, 0.0)  # colours of the path where the tip rests and is fastest


@dataclass(frozen=True)
class Film:
    """Content of the F frames of a film of a strike, independent of the renderer.

    Args:
        model: Model as MuJoCo shows it: a whip of rods is converted to universal joints.
        q: Positions of the model's n joints [rad or m], (F, n).
        trail: Ends of the S short segments of the tip's path [m], (S, 2, d).
        trail_rgb: Colours of the segments, (S, 3).
        shown: Number of segments that each frame shows, (F,).
        hit: Whether the target has been hit, from the closest approach on, (F,).
        readings: Texts to show in each frame, by their titles; F texts each.
        note: Text in every frame.
        grid: Distance of the grid's lines [m].
        size: Width and height [pixels].
    """

    model: Model
    q: np.ndarray
    trail: np.ndarray
    trail_rgb: np.ndarray
    shown: np.ndarray
    hit: np.ndarray
    readings: dict[str, list[str]]
    note: str
    grid: float
    size: tuple[int, int]

    def box(self, target: Target) -> np.ndarray:
        """Return the corners of a box that contains base, arm and whip in all frames, and the target [m], (8, 3)."""
        points, place = joint_points(self.model, self.q).reshape(-1, 3), np.array(target.position)
        radius = target.hit_radius
        every = np.concatenate([points, self.trail.reshape(-1, 3), [place - radius, place + radius, np.zeros(3)]])
        ends = np.array([np.nanmin(every, axis=0), np.nanmax(every, axis=0)])  # (2, 3)
        return np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)

    @property
    def type_size(self) -> float:
        """Reference height for font sizes and line widths [pixels]."""
        return min(self.size[1], 0.8 * self.size[0])

    def text(self, frame: int) -> Iterator[tuple[float, float, str]]:
        """Yield the texts of a frame with their positions, as fractions of width and height from the lower left."""
        yield 0.02, 0.03, self.note
        for row, (name, values) in enumerate(self.readings.items()):
            y = 0.94 - row * max(0.05 * self.type_size, 17) / self.size[1]
            yield 0.02, y, name
            yield 0.02 + max(0.21 * self.type_size, 85) / self.size[0], y, values[frame]


def film_of(
    trajectory: Trajectory,
    model: Model,
    target: Target,
    *,
    fps: float,
    speed: float,
    size: tuple[int, int] = (960, 540),
    beyond: bool = False,
) -> Film:
    """Return the content of a film of a strike.

    Args:
        trajectory, model: Trajectory of the strike, and the model with which it was simulated.
        target: Target of the strike.
        fps, speed: Frames per second of the film, and its speed: 1 is real time, 0.25 four times slower.
        size: Width and height [pixels].
        beyond: Whether the strike exceeds its limits; it is then not shown as a hit.

    Raises:
        InputError: The target has a wrong number of coordinates.
    """
    target.check_fits(model)
    place = np.array(target.position)
    t, tip = trajectory.t, trajectory.tip
    at = np.minimum(t[0] + np.arange(int(np.ceil((t[-1] - t[0]) / speed * fps)) + 1) * speed / fps, t[-1])  # (F,)
    near = trajectory.approach(place)
    hit_time = None if beyond else target.hit_time(near)
    tip_speed, distance = trajectory.tip_speed, trajectory.distance(place)
    closest = np.interp(at, t, np.minimum.accumulate(distance))
    closest[at >= near.time[0]] = min(near.distance[0], distance.min())  # between two instants, nearer than at either

    path = np.r_[0, np.cumsum(np.linalg.norm(np.diff(tip, axis=0), axis=1))]  # (T,)
    segments = int(np.clip(path[-1] / (0.016 * model.reach), 1, MAX_SEGMENTS))
    along = np.linspace(0, path[-1], segments + 1)
    trail = np.stack([np.interp(along, path, x) for x in tip.T], axis=1)  # (S + 1, d)
    share = np.interp((along[1:] + along[:-1]) / 2, path, tip_speed) / max(tip_speed.max(), 1e-9)
    grid = min((0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0), key=lambda spacing: abs(spacing - model.reach / 3))
    shown, q = as_mujoco_shows(model, at_times(at, t, trajectory.q))
    return Film(
        model=shown,
        q=q,
        trail=np.stack([trail[:-1], trail[1:]], axis=1),
        trail_rgb=np.array(_SLOW) + share[:, None] * (np.array(_FAST) - np.array(_SLOW)),
        shown=np.searchsorted(along, np.interp(at, t, path), side="right") - 1,
        hit=at >= (np.inf if hit_time is None else hit_time),
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


def film_place(mj: mujoco.MjModel, film: Film, target: Target) -> np.ndarray:
    """Return the position [m], (3,), of the camera `view` that films a strike in space."""
    i = mj.cam("view").id
    axes, fovy = mj.cam_mat0[i].reshape(3, 3).T, float(mj.cam_fovy[i])
    return nearest_place(axes, fovy, film.box(target), film.size[0] / film.size[1])


def nearest_place(
    axes: np.ndarray, fovy: float, places: np.ndarray, aspect: float, *, filled: float = 0.9
) -> np.ndarray:
    """Return the nearest position of a pinhole camera from which it sees all points [m], (3,).

    Args:
        axes: Unit vectors of the camera's right, up and backward directions, in rows, (3, 3).
        fovy: Vertical field of view [deg].
        places: Points [m], (..., 3).
        aspect: Width of the picture over its height.
        filled: Fraction of the picture, around its centre, that the points may occupy.
    """
    right, up, back = (places.reshape(-1, 3) @ axes.T).T
    # seen where |right - x| <= tall aspect (z - back), |up - y| <= tall (z - back), for the pinhole at x, y, z
    tall = filled * float(np.tan(np.deg2rad(fovy) / 2))
    x, z_wide = _between(right, back, tall * aspect)
    y, z_tall = _between(up, back, tall)
    return np.array([x, y, max(z_wide, z_tall)]) @ axes


def _between(across: np.ndarray, back: np.ndarray, slope: float) -> tuple[float, float]:
    """Middle, and the least distance back, from which two edges of a slope hold all points."""
    high, low = (across + slope * back).max(), (-across + slope * back).max()
    return (high - low) / 2, (high + low) / (2 * slope)
