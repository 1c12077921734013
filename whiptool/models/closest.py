"""The closest approach of a path to a place: of straight segments, or of a smooth curve; and places as given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias, cast

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import array_of

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


class ClosestApproach(NamedTuple):
    """Closest approaches of paths.

    Args:
        distance: Distance [m], (...); infinite where a path has no segment, or none whose ends are known.
        segment: Index of the segment, (...).
        share: Position within the segment, 0 to 1, (...).
    """

    distance: np.ndarray
    segment: np.ndarray
    share: np.ndarray

    def along(self, values: np.ndarray) -> np.ndarray:
        """Return the change of values (T, ...) of one path over the segment of its closest approach, (...)."""
        return values[self.segment + 1] - values[self.segment]

    def between(self, values: np.ndarray) -> np.ndarray:
        """Return values (T, ...) of one path, interpolated linearly at its closest approach, (...)."""
        return values[self.segment] + self.share * self.along(values)


def closest_on_segments(paths: np.ndarray, place: np.ndarray) -> ClosestApproach:
    """Return the closest approaches of polygonal paths to a position.

    Args:
        paths: Paths in d dimensions, (..., T, d) [m]; NaN where there is no point.
        place: Position (d,), or one for each path, (..., d) [m].
    """
    start, step = paths[..., :-1, :] - np.asarray(place)[..., None, :], np.diff(paths, axis=-2)
    squared = (step**2).sum(axis=-1)
    along = -(start * step).sum(axis=-1)
    share = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0), 0, 1)
    distance = np.linalg.norm(start + share[..., None] * step, axis=-1)
    distance = np.where(np.isnan(distance), np.inf, distance)
    if distance.shape[-1] == 0:
        shape = distance.shape[:-1]
        return ClosestApproach(np.full(shape, np.inf), np.zeros(shape, int), np.zeros(shape))
    segment = distance.argmin(axis=-1)
    nearest = segment[..., None]
    found = (np.take_along_axis(x, nearest, axis=-1)[..., 0] for x in (distance, share))
    return ClosestApproach(next(found), segment, next(found))


def closest_on_curve(curve: PPoly, place: np.ndarray, *, samples: int) -> float:
    """Return the time at which a smooth curve comes nearest to a position [s].

    The nearest of `samples` equally spaced instants is refined to the root of the squared distance's derivative.

    Args:
        curve: Positions over time, (d,) [m].
        place: Position, (d,) [m].
        samples: Number of instants, such that the distance has one minimum between three successive ones.
    """
    from scipy.optimize import brentq  # a third of what a command imports

    t = np.linspace(curve.x[0], curve.x[-1], samples)
    nearest = int(np.linalg.norm(curve(t) - place, axis=1).argmin())

    def slope(at: float) -> float:
        return float((curve(at) - place) @ curve(at, 1))

    before, after = t[max(nearest - 1, 0)], t[min(nearest + 1, len(t) - 1)]
    if not slope(before) < 0 < slope(after):  # nearest at an end of the curve
        return float(t[nearest])
    return cast(float, brentq(slope, before, after, xtol=1e-14))


class Placed(Protocol):
    """An object with a position, such as a `Target`."""

    @property
    def position(self) -> tuple[float, ...]:
        """Position (x, y) in the strike plane, or (x, y, z) in space [m]."""
        ...


Points: TypeAlias = Placed | np.ndarray | Sequence[float]


def target_points(target: Points, count: int, dimension: int = 2) -> np.ndarray:
    """Return the positions of targets, (count, dimension) [m].

    Args:
        target: A `Target` or a position for all strikes, or one position for each, (count, dimension) [m].
        count: Number of strikes.
        dimension: 2 in the plane, 3 in space.

    Raises:
        InputError: The target has another shape.
    """
    d, where = dimension, "in the plane" if dimension == 2 else "in space"
    rule = f"a Target {where}, shape ({d},), or one each, ({count}, {d})"
    points = array_of("target", getattr(target, "position", target), rule)
    if points.shape not in ((d,), (count, d)):
        raise InputError("target", f"shape {points.shape}", rule)
    return np.broadcast_to(points, (count, d))
