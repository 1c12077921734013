"""Where targets are drawn: a disc (Fig. 5), or the cells of a grid that the tip can reach."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.integrate import cumulative_trapezoid

from whiptool.errors import InputError
from whiptool.models.parameters import number
from whiptool.models.strike import T_STAY, StrikeBounds
from whiptool.target import TARGET
from whiptool.whole_files import write_npz

RADIUS = 0.1  # [m], Sect. 3.1.1


class Zone(Protocol):
    """A region of the plane."""

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Its lower left and upper right corner, (2,) each [m]."""
        ...

    @property
    def area(self) -> float:
        """Area of the zone [m^2]."""
        ...

    def place(self, uniform: np.ndarray) -> np.ndarray:
        """Points of the zone, (B, 2) [m], uniform over its area where the numbers (B, 3) are uniform in [0, 1)."""
        ...

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points (..., 2) [m] lie in it, (...); NaN does not."""
        ...


def sample(zone: Zone, count: int, rng: np.random.Generator) -> np.ndarray:
    """Uniformly random targets [m], (count, 2)."""
    return zone.place(rng.random((count, 3)))


@dataclass(frozen=True)
class Disc:
    """The paper's circle of targets.

    Args:
        centre: [m], not printed in the paper.
        radius: [m], Sect. 3.1.1.

    Raises:
        InputError: A value is not finite, or the radius is not positive.
    """

    centre: tuple[float, float] = TARGET
    radius: float = RADIUS

    def __post_init__(self) -> None:
        if len(self.centre) != 2 or not all(map(math.isfinite, self.centre)):
            raise InputError("centre of the zone", self.centre, "two finite coordinates x y in m")
        number("radius of the zone", self.radius, low=0, strict=True)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the square around it [m]."""
        return np.array(self.centre) - self.radius, np.array(self.centre) + self.radius

    @property
    def area(self) -> float:
        """Area of the zone [m^2]."""
        return math.pi * self.radius**2

    def place(self, uniform: np.ndarray) -> np.ndarray:
        """Points of the disc."""
        angle, r = 2 * np.pi * uniform[:, 0], self.radius * np.sqrt(uniform[:, 1])
        return np.array(self.centre) + np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points lie in the disc."""
        return np.hypot(points[..., 0] - self.centre[0], points[..., 1] - self.centre[1]) <= self.radius


@dataclass(frozen=True)
class ReachableDisc:
    """The part of a disc that lies within reach of the shoulder, which the disc's rim leaves.

    Args:
        disc: All of it.
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
                f"a disc of radius {self.disc.radius:g} m around {self.disc.centre} m",
                f"one that comes within {self.reach:.3f} m of the shoulder, the model's reach",
            )

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the rectangle around it [m]."""
        lower, upper = self.disc.box
        return np.maximum(lower, -self.reach), np.minimum(upper, self.reach)

    @property
    def area(self) -> float:
        """Area of the zone [m^2]."""
        return float(self._areas[1][-1])

    def place(self, uniform: np.ndarray) -> np.ndarray:
        """Points of the disc within reach: at random by the area up to their radius, and then on their arc."""
        r = np.interp(uniform[:, 1] * self.area, self._areas[1], self._areas[0])
        outward = math.atan2(self.disc.centre[1], self.disc.centre[0])
        angle = outward + np.pi + (2 * uniform[:, 0] - 1) * self._half_arc(r)
        return np.array(self.disc.centre) + np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points lie in the disc and within reach."""
        return self.disc.contains(points) & (np.hypot(points[..., 0], points[..., 1]) <= self.reach)

    @cached_property
    def _areas(self) -> tuple[np.ndarray, np.ndarray]:
        """Radii [m], and the area within each of them [m^2], by the trapezoidal rule."""
        r = np.linspace(0, self.disc.radius, 20_001)
        return r, cumulative_trapezoid(2 * r * self._half_arc(r), r, initial=0)

    def _half_arc(self, r: np.ndarray) -> np.ndarray:
        """Half the angle [rad] of a circle about the disc's centre that lies within reach, by the law of cosines.

        It lies around the direction from the disc's centre to the shoulder.
        """
        distance = math.hypot(*self.disc.centre)
        cosine = (r**2 + distance**2 - self.reach**2) / np.maximum(2 * r * distance, 1e-300)
        return np.arccos(np.clip(cosine, -1, 1))


def disc_within_reach(disc: Disc, reach: float) -> Disc | ReachableDisc:
    """Return the disc itself where all of it lies within reach [m] of the shoulder, else the part that does.

    Raises:
        InputError: No point of it does, or all that is within reach lies in the disc, whose radius says nothing then.
    """
    widest = math.hypot(*disc.centre) + reach
    if disc.radius >= widest:
        raise InputError("radius of the zone", disc.radius, f"less than {widest:.3f} m: beyond, it is all within reach")
    whole = math.hypot(*disc.centre) + disc.radius <= reach
    return disc if whole else ReachableDisc(disc, reach)


@dataclass(frozen=True, eq=False)
class Region:
    """Cells of a grid.

    Args:
        corners: Lower left corner of each cell [m], (C, 2).
        cell: Width of a cell [m].
    """

    corners: np.ndarray
    cell: float

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the rectangle around it [m]."""
        return self.corners.min(axis=0), self.corners.max(axis=0) + self.cell

    @property
    def area(self) -> float:
        """Area of the zone [m^2]."""
        return len(self.corners) * self.cell**2

    def place(self, uniform: np.ndarray) -> np.ndarray:
        """Points of the region."""
        which = np.minimum((uniform[:, 0] * len(self.corners)).astype(int), len(self.corners) - 1)
        return self.corners[which] + self.cell * uniform[:, 1:3]

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points lie in one of the cells."""
        lower = self.box[0]
        taken = np.round((self.corners - lower) / self.cell).astype(int)
        grid = np.zeros(taken.max(axis=0) + 3, bool)  # an empty row all around
        grid[tuple((taken + 1).T)] = True
        cells = np.floor((np.nan_to_num(points, nan=-np.inf) - lower) / self.cell)
        i, j = np.moveaxis(np.clip(cells, -1, np.array(grid.shape) - 2).astype(int) + 1, -1, 0)
        return grid[i, j]

    def save(self, path: Path) -> None:
        """Write an NPZ file, without pickle."""
        write_npz(path, {"corners": self.corners, "cell": self.cell})

    @classmethod
    def load(cls, path: Path) -> Region:
        """Read what `save` wrote.

        Raises:
            InputError: There is no such file, or it is not one of these.
        """
        try:
            with np.load(path, allow_pickle=False) as data:
                return cls(data["corners"], float(data["cell"]))
        except (OSError, ValueError, KeyError) as error:
            raise InputError("region", str(path), f"an .npz file that Region.save wrote ({error})"[:200]) from None


def random_paths(
    rollout, bounds: StrikeBounds, count: int, rng: np.random.Generator, *, rate: float, progress: bool = False
) -> Iterator[np.ndarray]:
    """Tip paths of random strikes, some thousands at a time: (b, S, 2) [m], NaN after a strike's end."""
    from tqdm import tqdm

    with tqdm(total=count, unit=" strikes", disable=not progress, leave=False) as bar:
        for first in range(0, count, 4096):
            strikes = bounds.sample(rng, min(4096, count - first))
            yield rollout.tip_path(strikes, t_stay=T_STAY, rate=rate)[1]
            bar.update(len(strikes))


def reachable_region(
    rollout,
    bounds: StrikeBounds,
    *,
    speed: float = 3.0,
    count: int = 1_000_000,
    cell: float = 0.02,
    rate: float = 200.0,
    seed: int = 0,
    progress: bool = False,
) -> Region:
    """The cells, wholly within reach, through which the tip of random strikes passes with at least this speed.

    The speed is that of the straight line between successive samples, and so is the path in between.

    Args:
        rollout: Simulator with `tip_path`.
        bounds: Box of the strikes.
        speed: [m/s]
        count: Strikes.
        cell: [m]
        rate: Samples of each path a second [1/s].
        seed: Of the strikes.
        progress: Show a bar.
    """
    reach = rollout.model.reach + cell
    n = 2 * math.ceil(reach / cell)
    seen = np.zeros((n, n), bool)
    rng = np.random.default_rng(seed)
    for paths in random_paths(rollout, bounds, count, rng, rate=rate, progress=progress):
        steps = np.diff(paths, axis=1)
        fast = np.hypot(steps[..., 0], steps[..., 1]) * rate >= speed  # False for NaN
        starts, steps = paths[:, :-1][fast], steps[fast]
        parts = max(1, math.ceil(float(np.hypot(*steps.T).max(initial=0)) / (cell / 2)))
        for part in range(parts):
            i, j = np.floor((starts + (part + 0.5) / parts * steps) / cell).astype(int).T + n // 2
            seen[i, j] = True
    corners = (np.argwhere(seen) - n // 2) * cell
    farthest = np.hypot(*(np.abs(corners + cell / 2) + cell / 2).T)
    return Region(corners[farthest <= rollout.model.reach], cell)
