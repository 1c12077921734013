"""Zones of targets: a disc (Fig. 5), in space a ball, a sector, or the cells of a grid that the tip can reach."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_arrays
from whiptool.goals.target import TARGET, base_name, check_radius, checked_radius, usual_target
from whiptool.models.numbers import NoArray, metres, number, numbers
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, StrikeBounds
from whiptool.whole_files import write_npz

RADIUS = 0.1  # [m], Sect. 3.1.1


class Zone(ABC):
    """A region of the plane or of space, of d = 2 or 3 dimensions."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension d of the zone: 2 in the plane, 3 in space."""

    @property
    @abstractmethod
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the zone's bounding box [m], (d,) each."""

    @property
    @abstractmethod
    def size(self) -> float:
        """Area of the zone [m^2], in space its volume [m^3]."""

    @abstractmethod
    def place(self, uniform: np.ndarray) -> np.ndarray:
        """Return points of the zone (B, d) [m] for uniform random numbers (B, d + 1) in [0, 1); the points are uniform
        over it.
        """

    @abstractmethod
    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points (..., d) [m] lie in the zone, (...); False for NaN."""


def check_fits(zone: Zone, model: Model, hit_radius: float) -> float:
    """Check that a zone and a hit radius [m] fit a model, and return the hit radius.

    Raises:
        InputError: The zone is in the plane and the model in space, or the reverse; all of it is out of reach; or a
            disc, or the hit radius around the zone's farthest corner, contains all points within the model's reach.
    """
    if zone.dimension != model.dimension:
        raise InputError("coordinates of the zone", zone.dimension, f"{model.dimension}, as the model {model.name} has")
    if (nearest := float(np.linalg.norm(np.clip(0.0, *zone.box)))) > model.reach + checked_radius(hit_radius):
        rule = f"targets within the model's reach of {model.reach:.3f} m"
        raise InputError("zone", f"targets at least {nearest:.4g} m away", rule)
    if isinstance(zone, Disc):
        check_radius("radius of the zone", zone.radius, zone.centre, model)
    check_radius("hit radius", checked_radius(hit_radius), np.abs(zone.box).max(axis=0), model)
    return float(hit_radius)


def sample(zone: Zone, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return `count` random points [m], uniform over the zone, (count, d)."""
    return zone.place(rng.random((count, zone.dimension + 1)))


def directions(uniform: np.ndarray) -> np.ndarray:
    """Return unit vectors (B, d) for random numbers (B, d - 1) in [0, 1), uniform on the circle or sphere."""
    angle = 2 * np.pi * uniform[:, 0]
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if uniform.shape[1] == 1:
        return circle
    z = 2 * uniform[:, 1:2] - 1  # Archimedes: uniform along the axis
    return np.concatenate([np.sqrt(1 - z**2) * circle, z], axis=1)


@dataclass(frozen=True)
class Disc(NoArray, Zone, instead="its centre or radius"):
    """A disc of targets, as in the paper; in space, a ball.

    Args:
        centre: Centre [m], not printed in the paper; (2,), of a ball (3,).
        radius: Radius [m], see Sect. 3.1.1 of the paper.

    Raises:
        InputError: A value is not finite, or the radius is not positive.
    """

    centre: tuple[float, ...] = TARGET
    radius: float = RADIUS

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", numbers("centre of the zone", self.centre))
        if len(self.centre) not in (2, 3):
            raise InputError("centre of the zone", self.centre, "two finite coordinates x y in m, or three in space")
        metres("radius of the zone", self.radius)

    def __str__(self) -> str:
        centre = ", ".join(f"{x:.4g}" for x in self.centre)
        return f"{round_name(self)} of radius {self.radius:.4g} m around ({centre}) m"

    @property
    def dimension(self) -> int:
        return len(self.centre)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.centre) - self.radius, np.array(self.centre) + self.radius

    @property
    def size(self) -> float:
        return math.pi * self.radius**2 if self.dimension == 2 else 4 / 3 * math.pi * self.radius**3

    def place(self, uniform: np.ndarray) -> np.ndarray:
        d = self.dimension
        r = self.radius * (np.sqrt if d == 2 else np.cbrt)(uniform[:, d - 1])
        return np.array(self.centre) + r[:, None] * directions(uniform[:, : d - 1])

    def contains(self, points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - np.array(self.centre), axis=-1) <= self.radius


@dataclass(frozen=True)
class ReachableDisc(Zone):
    """The part of a disc or ball that lies within reach of the shoulder.

    Args:
        disc: The whole disc or ball.
        reach: Largest distance of a target from the shoulder [m].

    Raises:
        InputError: No point of the disc lies within reach.
    """

    disc: Disc
    reach: float

    def __post_init__(self) -> None:
        nearest = max(0.0, math.hypot(*self.disc.centre) - self.disc.radius)
        if nearest >= self.reach:
            raise InputError(
                "zone",
                f"{round_name(self.disc)} of radius {self.disc.radius:g} m around {self.disc.centre} m",
                f"a zone that comes within {self.reach:.3f} m of the {base_name(self.dimension)}, the model's reach",
            )

    def __str__(self) -> str:
        return f"{self.disc}, as far as {self.reach:.4g} m from the {base_name(self.dimension)}"

    @property
    def dimension(self) -> int:
        return self.disc.dimension

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        lower, upper = self.disc.box
        return np.maximum(lower, -self.reach), np.minimum(upper, self.reach)

    @property
    def size(self) -> float:
        return float(self._sizes[1][-1])

    def place(self, uniform: np.ndarray) -> np.ndarray:
        """Return points of the zone (B, d) [m], see `Zone.place`; first their distance from the centre is drawn, then
        the angles.
        """
        centre, d = np.array(self.disc.centre), self.dimension
        r = np.interp(uniform[:, d - 1] * self.size, self._sizes[1], self._sizes[0])
        half = self._half_arc(r)
        if d == 2:
            angle = math.atan2(centre[1], centre[0]) + np.pi + (2 * uniform[:, 0] - 1) * half
            return centre + r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        along = 1 - uniform[:, 1] * (1 - np.cos(half))  # cosine of the angle from the cap's axis
        around = directions(uniform[:, :1]) * np.sqrt(1 - along**2)[:, None]
        return centre + r[:, None] * (along[:, None] * self._inward + around @ _across(self._inward))

    def contains(self, points: np.ndarray) -> np.ndarray:
        return self.disc.contains(points) & (np.linalg.norm(points, axis=-1) <= self.reach)

    @property
    def _inward(self) -> np.ndarray:
        """Direction from the centre to the shoulder, (d,)."""
        centre = np.array(self.disc.centre)
        distance = np.linalg.norm(centre)
        return -centre / distance if distance > 0 else np.eye(len(centre))[0]

    @cached_property
    def _sizes(self) -> tuple[np.ndarray, np.ndarray]:
        """Radii [m], and the area [m^2] or volume [m^3] within each of them, by the trapezoidal rule."""
        r = np.linspace(0, self.disc.radius, 20_001)
        half = self._half_arc(r)
        rim = 2 * r * half if self.dimension == 2 else 2 * np.pi * r**2 * (1 - np.cos(half))
        return r, _integrals(rim, r)

    def _half_arc(self, r: np.ndarray) -> np.ndarray:
        """Half the angle [rad] of a circle about the disc's centre that lies within reach, by the law of cosines.

        It lies around the direction from the disc's centre to the shoulder; of a sphere it is the angle of the cap.
        """
        distance = math.hypot(*self.disc.centre)
        cosine = (r**2 + distance**2 - self.reach**2) / np.maximum(2 * r * distance, 1e-300)
        return np.arccos(np.clip(cosine, -1, 1))


def _integrals(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the integrals of values (n,) from the first of the places x (n,) to each, by the trapezoidal rule."""
    from scipy.integrate import cumulative_trapezoid

    return cumulative_trapezoid(values, x, initial=0)


def _across(axis: np.ndarray) -> np.ndarray:
    """Return two unit vectors at right angles to a unit vector (3,) and to each other, (2, 3)."""
    aside = np.eye(3)[np.abs(axis).argmin()]
    first = np.cross(axis, aside)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def usual_disc(model: Model) -> Disc:
    """Return the paper's disc, or in space a ball around the default target of a model."""
    return Disc(usual_target(model).position)


def round_name(disc: Disc) -> str:
    """Return "a disc" or "a ball", by the dimension."""
    return "a disc" if disc.dimension == 2 else "a ball"


def disc_within_reach(disc: Disc, reach: float) -> Disc | ReachableDisc:
    """Return the part of a disc or ball that lies within reach [m] of the shoulder; the whole if all of it does.

    Raises:
        InputError: No point of it is within reach, or the disc contains all points within reach.
    """
    widest = math.hypot(*disc.centre) + reach
    if disc.radius >= widest:
        raise InputError(
            "radius of the zone", disc.radius, f"less than {widest:.3f} m, where it holds all points in reach"
        )
    whole = math.hypot(*disc.centre) + disc.radius <= reach
    return disc if whole else ReachableDisc(disc, reach)


_MOST_CELLS = 1e8  # of the block around a region


@dataclass(frozen=True, eq=False)
class Region(Zone):
    """A zone that consists of cells of a grid.

    Args:
        corners: Lowest corner of each cell [m], (C, d).
        cell: Width of a cell [m].
    """

    corners: np.ndarray
    cell: float

    @property
    def dimension(self) -> int:
        return self.corners.shape[1]

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        return self.corners.min(axis=0), self.corners.max(axis=0) + self.cell

    @property
    def size(self) -> float:
        return len(self.corners) * self.cell**self.dimension

    def place(self, uniform: np.ndarray) -> np.ndarray:
        which = np.minimum((uniform[:, 0] * len(self.corners)).astype(int), len(self.corners) - 1)
        return self.corners[which] + self.cell * uniform[:, 1 : self.dimension + 1]

    def contains(self, points: np.ndarray) -> np.ndarray:
        lower = self.box[0]
        taken = np.round((self.corners - lower) / self.cell).astype(int)
        grid = np.zeros(taken.max(axis=0) + 3, bool)  # an empty row all around
        grid[tuple((taken + 1).T)] = True
        cells = np.floor((np.nan_to_num(points, nan=-np.inf) - lower) / self.cell)
        return grid[tuple(np.moveaxis(np.clip(cells, -1, np.array(grid.shape) - 2).astype(int) + 1, -1, 0))]

    def save(self, path: Path | str) -> None:
        """Write an NPZ file, without pickle, with the arrays `corners` and `cell`."""
        write_npz(path, {"corners": self.corners, "cell": self.cell})

    @classmethod
    def load(cls, path: Path | str) -> Region:
        """Read a region that `save` wrote.

        Raises:
            InputError: The file does not exist, or is not a region.
        """
        arrays = read_arrays(path, "region", {"corners": "Cd", "cell": ""})
        corners, cell = arrays["corners"].astype(float), float(arrays["cell"])
        if corners.shape[1] not in (2, 3) or not len(corners) or not np.isfinite(corners).all():
            raise InputError(f"{path}: corners", corners.shape, "one finite corner or more, in the plane or in space")
        number(f"{path}: cell", cell, low=0, strict=True)
        within = np.prod(np.ptp(corners, axis=0) / cell + 1)
        if within > _MOST_CELLS:
            raise InputError(
                f"{path}: corners",
                f"spread over {within:.0e} cells",
                f"corners spread over at most {_MOST_CELLS:.0e} cells",
            )
        return cls(corners, cell)


def random_paths(
    rollout, bounds: StrikeBounds, count: int, rng: np.random.Generator, *, rate: float
) -> Iterator[np.ndarray]:
    """Yield the tip paths (b, S, d) [m] of `count` random strikes, up to 4096 at a time.

    Paths are sampled at `rate` [Hz]; after the end of a strike they are NaN.
    """
    for first in range(0, count, 4096):
        strikes = bounds.sample(rng, min(4096, count - first))
        yield rollout.tip_path(strikes, t_stay=T_STAY, rate=rate)[1]


def reachable_region(
    rollout,
    bounds: StrikeBounds,
    *,
    speed: float = 3.0,
    count: int = 1_000_000,
    cell: float = 0.02,
    rate: float = 200.0,
    seed: int = 0,
) -> Region:
    """Return the region of all cells, wholly within reach, that tips of random strikes pass with at least a given
    speed.

    Between successive samples the path is taken as a straight line with constant speed.

    Args:
        rollout: Simulator with `tip_path`.
        bounds: Box of the strikes.
        speed: Least speed [m/s].
        count: Number of strikes.
        cell: Width of the cells [m].
        rate: Sampling rate of the paths [1/s].
        seed: Seed of the random strikes.
    """
    reach = rollout.model.reach + cell
    n = 2 * math.ceil(reach / cell)
    seen = np.zeros((n,) * rollout.model.dimension, bool)
    rng = np.random.default_rng(seed)
    for paths in random_paths(rollout, bounds, count, rng, rate=rate):
        steps = np.diff(paths, axis=1)
        fast = np.linalg.norm(steps, axis=-1) * rate >= speed  # False for NaN
        starts, steps = paths[:, :-1][fast], steps[fast]
        parts = max(1, math.ceil(float(np.linalg.norm(steps, axis=-1).max(initial=0)) / (cell / 2)))
        for part in range(parts):
            cells = np.floor((starts + (part + 0.5) / parts * steps) / cell).astype(int) + n // 2
            seen[tuple(cells.T)] = True
    corners = (np.argwhere(seen) - n // 2) * cell
    farthest = np.linalg.norm(np.abs(corners + cell / 2) + cell / 2, axis=-1)
    return Region(corners[farthest <= rollout.model.reach], cell)


@dataclass(frozen=True)
class Sector(Zone):
    """A part of a spherical shell around the base, limited in distance, height and azimuth.

    Args:
        near, far: Distances from the base [m].
        low, high: Heights above the base [m], within `far`.
        aside: Largest azimuth from forward to either side [rad], at most pi.

    Raises:
        InputError: A value is out of range, or no point has such a distance and height.
    """

    near: float
    far: float
    low: float
    high: float
    aside: float

    def __post_init__(self) -> None:
        number("nearest distance", self.near, low=0)
        metres("farthest distance", self.far, low=self.near)
        number("lowest height", self.low, low=-self.far)
        number("highest height", self.high, low=self.low, high=self.far, strict=True)
        number("angle to either side", self.aside, low=0, high=math.pi, strict=True)

    def __str__(self) -> str:
        aside = f"up to {math.degrees(self.aside):.4g} degrees to either side"
        return f"{self.near:g} to {self.far:g} m from the base, {self.low:g} to {self.high:g} m above it, {aside}"

    @property
    def dimension(self) -> int:
        return 3

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        flat = 0.0 if self.low <= 0 <= self.high else min(abs(self.low), abs(self.high))
        widest = math.sqrt(self.far**2 - flat**2)
        nearest = math.sqrt(max(0.0, self.near**2 - max(self.low**2, self.high**2)))
        side = widest * (math.sin(self.aside) if self.aside < math.pi / 2 else 1.0)
        cosine = math.cos(self.aside)
        back = (nearest if cosine > 0 else widest) * cosine
        return np.array([back, -side, self.low]), np.array([widest, side, self.high])

    @property
    def size(self) -> float:
        return float(self._volumes[1][-1])

    def place(self, uniform: np.ndarray) -> np.ndarray:
        z = np.interp(uniform[:, 0] * self.size, self._volumes[1], self._volumes[0])
        inner, outer = self._rims(z)
        across = np.sqrt(inner + uniform[:, 1] * (outer - inner))
        angle = (2 * uniform[:, 2] - 1) * self.aside
        return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)

    def contains(self, points: np.ndarray) -> np.ndarray:
        distance, z = np.linalg.norm(points, axis=-1), points[..., 2]
        ahead = np.abs(np.arctan2(points[..., 1], points[..., 0])) <= self.aside
        return ahead & (distance >= self.near) & (distance <= self.far) & (z >= self.low) & (z <= self.high)

    @cached_property
    def _volumes(self) -> tuple[np.ndarray, np.ndarray]:
        """Heights [m], and the volume [m^3] below each of them, by the trapezoidal rule."""
        z = np.linspace(self.low, self.high, 20_001)
        inner, outer = self._rims(z)
        volumes = _integrals(self.aside * (outer - inner), z)
        if not volumes[-1] > 0:
            raise InputError("sector", (self.near, self.far, self.low, self.high), "a sector that contains points")
        return z, volumes

    def _rims(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squares of the smallest and the largest distance from the vertical through the base at heights z [m^2]."""
        return np.maximum(self.near**2 - z**2, 0.0), np.maximum(self.far**2 - z**2, 0.0)
