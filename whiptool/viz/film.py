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
GRID, TEXT = (0.70, 0.73, 0.77), (0.15, 0.16, 0.18)  # colours
AIM, HIT = (0.90, 0.62, 0.0), (0.0, 0.62, 0.45)  # colours of the ring around the target before and after the hit
_FILLED = 0.9  # of a frame's width and height, by the strike
_OF_TEXTS = 0.22  # of a frame's width, at its left
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
        thing: Positions of a thing that is thrown, (F, 3) [m]; None: nothing is thrown.
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
    thing: np.ndarray | None = None

    def places(self, target: Target) -> np.ndarray:
        """Return all points that a film of the strike has to show: of base, arm and whip in all frames, of the tip's
        path, and the ends of the target along each axis [m], (P, 3).
        """
        place, out = np.array(target.position), target.hit_radius * np.eye(len(target.position))
        points = joint_points(self.model, self.q).reshape(-1, len(place))
        every = np.concatenate([points, self.trail.reshape(-1, len(place)), place - out, place + out])
        every = in_three(every)
        return np.r_[every[np.isfinite(every).all(axis=1)], np.zeros((1, 3))]

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
    hit = at >= (np.inf if hit_time is None else hit_time)
    return Film(
        model=shown,
        q=q,
        trail=np.stack([trail[:-1], trail[1:]], axis=1),
        trail_rgb=np.array(_SLOW) + share[:, None] * (np.array(_FAST) - np.array(_SLOW)),
        shown=np.searchsorted(along, np.interp(at, t, path), side="right") - 1,
        hit=hit,
        readings={
            "time": [f"{x:.3f} s" for x in at],
            "tip speed" if trajectory.FOLLOWED == "tip" else "speed": [
                f"{x:.1f} m/s" for x in np.interp(at, t, tip_speed)
            ],
            "distance": [f"{x:.3f} m" for x in np.interp(at, t, distance)],
            "closest": [f"{x:.3f} m" for x in closest],
            "target": ["hit" if struck else "not hit" for struck in hit],
        },
        note=f"{speed:g} x real time, grid {grid:g} m",
        grid=grid,
        size=(int(size[0]), int(size[1])),
        thing=None if trajectory.FOLLOWED == "tip" else in_three(at_times(at, t, tip)),
    )


def in_three(points: np.ndarray) -> np.ndarray:
    """Return points (F, 2) of the strike plane, which is that of x and z, or (F, 3) in space, (F, 3)."""
    return np.insert(points, 1, 0.0, axis=1) if points.shape[1] == 2 else points


def film_place(mj: mujoco.MjModel, film: Film, target: Target) -> np.ndarray:
    """Return the position [m], (3,), of the camera `view` that films a strike in space."""
    i = mj.cam("view").id
    axes, fovy = mj.cam_mat0[i].reshape(3, 3).T, float(mj.cam_fovy[i])
    return nearest_place(axes, fovy, film.places(target), film.size[0] / film.size[1], left_free=_OF_TEXTS)


def side_view(film: Film, target: Target) -> tuple[np.ndarray, float]:
    """Return the middle (3,) and the height [m] of what a camera at the side has to show of a strike in the plane.

    The strike fills the frame except for a margin, and for a column at the left that is left to the texts.
    """
    places, aspect = film.places(target), film.size[0] / film.size[1]
    low, high = places.min(axis=0), places.max(axis=0)
    wide, _, tall = (high - low) / _FILLED
    height = max(tall, wide / ((1 - _OF_TEXTS) * aspect))
    return (low + high) / 2 - np.array([_OF_TEXTS * aspect * height / 2, 0, 0]), float(height)


def nearest_place(
    axes: np.ndarray,
    fovy: float,
    places: np.ndarray,
    aspect: float,
    *,
    filled: float = _FILLED,
    left_free: float = 0.0,
) -> np.ndarray:
    """Return the nearest position of a pinhole camera from which it sees all points [m], (3,).

    Args:
        axes: Unit vectors of the camera's right, up and backward directions, in rows, (3, 3).
        fovy: Vertical field of view [deg].
        places: Points [m], (..., 3).
        aspect: Width of the picture over its height.
        filled: Fraction of the picture, around its centre, that the points may occupy.
        left_free: Fraction of the picture's width, at its left, that stays free of the points.
    """
    right, up, back = (places.reshape(-1, 3) @ axes.T).T
    # seen where right - x <= wide (z - back), x - right <= left (z - back), |up - y| <= tall (z - back), for the
    # pinhole at x, y, z
    tall = float(np.tan(np.deg2rad(fovy) / 2))
    wide, left, tall = filled * tall * aspect, (filled - 2 * left_free) * tall * aspect, filled * tall
    z = max(_least_far(right, back, wide, left), _least_far(up, back, tall, tall))
    return np.array([_middle(right, back, wide, left, z), _middle(up, back, tall, tall, z), z]) @ axes


def _least_far(across: np.ndarray, back: np.ndarray, high: float, low: float) -> float:
    """Least distance back from which edges of these slopes above and below hold all points."""
    return float(((across + high * back).max() + (low * back - across).max()) / (high + low))


def _middle(across: np.ndarray, back: np.ndarray, high: float, low: float, z: float) -> float:
    """Middle of the places from which edges of these slopes hold all points at a distance z back."""
    least, most = (across + high * back).max() - high * z, low * z - (low * back - across).max()
    return float(least + most) / 2
