"""Capsules, and cylinders, boxes or hulls in them, as shapes of an arm's links, and distances between shapes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.numbers import number, numbers


def nearest_points(
    start: np.ndarray, end: np.ndarray, other_start: np.ndarray, other_end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points of pairs of segments, by their starts and ends [m], all (..., 3); segments may be
    points (Ericson, Real-Time Collision Detection, 2005, section 5.1.9).
    """
    along, other_along, between = end - start, other_end - other_start, start - other_start
    a, e, b = _dot(along, along), _dot(other_along, other_along), _dot(along, other_along)
    c, f = _dot(along, between), _dot(other_along, between)
    s = np.clip(_ratio(b * f - c * e, a * e - b * b, 1e-12 * a * e), 0.0, 1.0)  # of lines; parallel ones: anywhere
    t = np.clip(_ratio(b * s + f, e), 0.0, 1.0)
    s = np.clip(_ratio(b * t - c, a), 0.0, 1.0)
    return start + s[..., None] * along, other_start + t[..., None] * other_along


def _dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", x, y)


def _ratio(over: np.ndarray, under: np.ndarray, least: np.ndarray | float = 0.0) -> np.ndarray:
    """A quotient, 0 where what is divided by is no more than the least."""
    defined = under > least
    return np.where(defined, over / np.where(defined, under, 1.0), 0.0)


Point: TypeAlias = tuple[float, float, float]


def turned_point(R: np.ndarray, point: Point) -> Point:
    x, y, z = (R @ np.array(point)).tolist()
    return x, y, z


THINNEST = 5e-4  # [m] half of a thing that has no thickness


@dataclass(frozen=True)
class Capsule:
    """A capsule, i.e. all points within a radius of a segment; or a cylinder, box or convex hull inside it."""

    start: Point  # start of the segment in the frame of its link [m], (3,)
    end: Point  # end of the segment [m], (3,); a sphere if it is the start
    radius: float  # [m]
    flat: bool = False  # whether the shape is the cylinder without round ends
    width: Point | None = None  # half vector of a box's side across the segment [m]; the box's edges are at the radius
    hull: tuple[Point, ...] = ()  # corners of the convex hull inside, in its link's frame [m], (V, 3); none: no hull
    name: str = ""  # of a thing that stands next to the robot, such as a table; empty for parts of the robot

    def __post_init__(self) -> None:
        for name in ("start", "end"):
            object.__setattr__(self, name, numbers(name, getattr(self, name), 3))
        object.__setattr__(self, "radius", number("radius", self.radius, low=0))
        expect(str, name=self.name)
        self._check_hull()
        if not isinstance(self.flat, bool):
            raise InputError("flat", self.flat, "true or false")
        if self.flat and not (self.length and self.radius):
            raise InputError("flat", self.flat, "false if start and end are the same, or the radius is 0")
        if self.width is not None:
            object.__setattr__(self, "width", numbers("width", self.width, 3))
            along, across = np.subtract(self.end, self.start), np.array(self.width)
            size = float(np.linalg.norm(across))
            if self.flat or not self.length or not 0 < size < self.radius or abs(along @ across) > 1e-6 * size:
                raise InputError("width", self.width, "a vector across the segment, shorter than the radius")

    def _check_hull(self) -> None:
        """Refuse what is no hull inside the capsule."""
        if not isinstance(self.hull, (list, tuple)):
            raise InputError("hull", self.hull, "corners, of three numbers each")
        object.__setattr__(self, "hull", tuple(numbers("hull", corner, 3) for corner in self.hull))
        corners = np.reshape(self.hull, (-1, 3))
        nearest = nearest_points(np.array(self.start), np.array(self.end), corners, corners)[0]
        outside = float(np.linalg.norm(nearest - corners, axis=1).max(initial=0.0)) > self.radius * (1 + 1e-6)
        if self.hull and (outside or self.flat or self.width is not None or not self.length or len(self.hull) < 4):
            rule = "four corners or more inside the capsule, which has a length, and neither flat nor width"
            raise InputError("hull", f"{len(self.hull)} corners", rule)

    def turned(self, R: np.ndarray) -> Capsule:
        """Return the shape turned about the origin by a rotation (3, 3)."""
        width = None if self.width is None else turned_point(R, self.width)
        hull = tuple(turned_point(R, corner) for corner in self.hull)
        return replace(self, start=turned_point(R, self.start), end=turned_point(R, self.end), width=width, hull=hull)

    @property
    def length(self) -> float:
        """Length of the segment [m]."""
        return math.dist(self.start, self.end)

    @property
    def exact(self) -> bool:
        """Whether the shape is the capsule itself and not a cylinder, a box or a hull inside it."""
        return not self.flat and self.width is None and not self.hull

    @property
    def inner_radius(self) -> float:
        """Radius of the largest sphere about the middle that is inside the shape [m]; of a hull, in which the middle
        need not be, less than 0: all of it is so far from there at most.
        """
        if self.hull:
            return -self.length / 2 - self.radius
        if self.width is not None:
            return min(self.length / 2, float(np.linalg.norm(self.width)), self._height)
        return min(self.length / 2, self.radius) if self.flat else self.radius

    @property
    def _height(self) -> float:
        """Half of a box's other side across [m]."""
        assert self.width is not None
        return math.sqrt(self.radius**2 - float(np.dot(self.width, self.width)))

    @property
    def rotation(self) -> np.ndarray:
        """Rotation (3, 3) of the shape in its link's frame: last axis along the segment, first along a box's width."""
        length = self.length
        z = np.subtract(self.end, self.start) / length if length else np.array([0.0, 0.0, 1.0])
        x = np.eye(3)[np.abs(z).argmin()] if self.width is None else np.array(self.width)
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(z, x), z])

    def solid(self) -> Any:
        """Return the shape as an object of the library coal, centred at the origin, with the axes of `rotation`."""
        import coal

        if self.hull:
            return _convex((np.array(self.hull) - (np.array(self.start) + self.end) / 2) @ self.rotation)
        if self.width is not None:
            return coal.Box(2 * float(np.linalg.norm(self.width)), 2 * self._height, self.length)
        return coal.Cylinder(self.radius, self.length) if self.flat else coal.Capsule(self.radius, self.length)

    @classmethod
    def along(
        cls, rotation: np.ndarray, position: np.ndarray, half: float, radius: float, *, flat: bool = False
    ) -> Capsule:
        """Return the capsule or, with `flat`, the cylinder around the z axis of a frame, with its rotation (3, 3) and
        position (3,) [m] in the link's frame; its segment extends by `half` [m] from there to either side.
        """
        reach = half * np.asarray(rotation)[:, 2]
        ends = tuple((position - reach).tolist()), tuple((position + reach).tolist())
        return cls(*ends, radius, flat and half > 0 and radius > 0)

    @classmethod
    def around_box(cls, rotation: np.ndarray, position: np.ndarray, halves: np.ndarray) -> Capsule:
        """Return a box with sides of half lengths `halves` (3,) [m], with the capsule around it along its longest side;
        rotation (3, 3) and position (3,) [m] of the box are in the link's frame.
        """
        longest = int(np.argmax(halves))
        across = float(np.linalg.norm(np.delete(halves, longest)))
        turned = np.roll(np.asarray(rotation), 2 - longest, axis=1)  # the longest side becomes the last axis
        held = cls.along(turned, position, float(halves[longest]), across)
        if not all(halves):  # a plate without thickness
            return held
        width = turned[:, 0] * np.roll(halves, 2 - longest)[0]
        return replace(held, width=tuple(width.tolist()))

    @classmethod
    def around(cls, points: np.ndarray) -> Capsule:
        """Return the convex hull of points (V, 3) [m], with a capsule around it along its longest axis; points in a
        plane get a thickness of 1 mm.
        """
        _, sizes, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        for axis in axes[sizes <= 1e-3 * sizes[0]]:
            points = np.concatenate([points - THINNEST * axis, points + THINNEST * axis])
        corners = _convex(points).points()
        middle, (x, y, z) = corners.mean(axis=0), ((corners - corners.mean(axis=0)) @ axes[(2, 1, 0), :].T).T
        radius = float(np.hypot(x, y).max())
        half = float(max((np.abs(z) - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0.0))).max(), THINNEST))
        held = cls.along(axes[(2, 1, 0), :].T, middle, half, radius * (1 + 1e-9))
        return replace(held, hull=tuple(map(tuple, corners.tolist())))


def _convex(points: np.ndarray) -> Any:
    """The convex hull of points (V, 3) as an object of the library coal."""
    import coal

    found = coal.StdVec_Vec3s()
    for point in points:
        found.append(point)
    return coal.Convex.convexHull(found, True, "Qt")


def checked_capsules(name: str, given: object) -> tuple[Capsule, ...]:
    """Return capsules as a tuple; an entry that is not a capsule is refused."""
    if not isinstance(given, (list, tuple)) or not all(isinstance(x, Capsule) for x in given):
        raise InputError(name, given, "capsules, each a Capsule")
    return tuple(given)
