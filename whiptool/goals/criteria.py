"""What a strike is judged by besides the hit: miss, effort, largest torque, speed through the target, robustness."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import Registry
from whiptool.goals.goals import Goals
from whiptool.models.numbers import numbers
from whiptool.models.strike import StrikeBounds
from whiptool.models.trajectory import Approach
from whiptool.rollout.interface import Rollout
from whiptool.rollout.slopes import ApproachSlopes

NOISE = 0.01  # [rad, s], usual standard deviation of each number of a strike


class StrikesAtGoal:
    """Strikes at a goal and what they came to, which is rolled out when it is asked for.

    Args:
        rollout: Simulator.
        strikes: Vectors, (B, 2 a + 1).
        goals: One goal of all strikes.
        t_stay: They are watched this long after the movement ended [s].
    """

    def __init__(self, rollout: Rollout, strikes: np.ndarray, goals: Goals, t_stay: float) -> None:
        self.rollout, self.strikes, self.goals, self.t_stay = rollout, strikes, goals, t_stay
        self._others: dict[object, StrikesAtGoal] = {}

    @cached_property
    def near(self) -> Approach:
        """Their closest approaches."""
        return self.rollout.approach(self.strikes, self.goals.positions[0], t_stay=self.t_stay)

    @cached_property
    def slopes(self) -> ApproachSlopes:
        """The exact derivatives of those by the strikes."""
        return self.rollout.slopes(self.strikes, self.goals.positions[0], t_stay=self.t_stay)[1]

    def others(self, of: object, strikes: np.ndarray) -> StrikesAtGoal:
        """Return other strikes at the same goal that `of` asks for, the same ones at every call."""
        if of not in self._others:
            self._others[of] = StrikesAtGoal(self.rollout, strikes, self.goals, self.t_stay)
        return self._others[of]


class Criterion(ABC):
    """One number by which hits are ranked.

    Searches that follow derivatives minimise the largest of its measures, which are smooth where the number is not;
    m is the length of a strike vector.

    Args:
        name: As on the command line.
        words: For people; with the unit in which the number is.
        largest: Whether more is better.
        of_torques: Whether it is computed from torques, which are not known of an arm of unknown inertia.
    """

    name: ClassVar[str]
    words: ClassVar[str]
    unit: ClassVar[str]
    largest: ClassVar[bool] = False
    of_torques: ClassVar[bool] = False

    @abstractmethod
    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""

    @abstractmethod
    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""

    @abstractmethod
    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their exact derivatives by the strike's numbers, (B, k, m)."""

    def measure_of(self, value: float) -> float:
        """Return the measure of a number: a strike whose measures are at most that has at most that number."""
        return value

    def cost(self, value: float, hit_radius: float) -> float:
        """Return what searches minimise of a hit: negative, as of a miss it is not, and growing as the hit is worse."""
        size = math.log1p(max(value, 0.0) / self._scale(hit_radius))
        return -(1 + size) if self.largest else -1 / (1 + size)

    def _scale(self, hit_radius: float) -> float:
        """Return the size of number that is distinguished best from others of its size."""
        return 1.0


class Miss(Criterion):
    """The miss distance; its measure is the square."""

    name, words, unit = "miss", "miss distance", "m"

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""
        return struck.near.distance

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""
        return struck.near.distance[:, None] ** 2

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their exact derivatives by the strike's numbers, (B, k, m)."""
        return (2 * struck.near.distance[:, None] * struck.slopes.distance)[:, None]

    def measure_of(self, value: float) -> float:
        """Return the measure of a number."""
        return value**2

    def _scale(self, hit_radius: float) -> float:
        return hit_radius


class Effort(Criterion):
    """The integral of the squared torques of all joints over the strike; its measure is log(1 + effort).

    Efforts of one robot's strikes span four orders of magnitude: as they are, the best of them would all look alike.
    """

    name, words, unit, of_torques = "effort", "effort", "N² m² s", True

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""
        if struck.near.effort is None:
            raise InputError("simulator", struck.rollout.engine, "one that knows the torques at every instant")
        return struck.near.effort.sum(axis=1)

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""
        return np.log1p(self.values(struck))[:, None]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their exact derivatives by the strike's numbers, (B, k, m)."""
        return struck.slopes.effort.sum(axis=1, keepdims=True) / (1 + self.values(struck))[:, None, None]

    def measure_of(self, value: float) -> float:
        """Return the measure of a number."""
        return math.log1p(value)


class PeakTorque(Criterion):
    """The largest torque of any joint; its measures are the largest of each."""

    name, words, unit, of_torques = "peak-torque", "largest torque", "N m", True

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""
        return struck.near.max_torque.max(axis=1)

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""
        return struck.near.max_torque

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their exact derivatives by the strike's numbers, (B, k, m)."""
        return struck.slopes.max_torque


class Speed(Criterion):
    """The tip's speed at its closest approach, along the goal's direction where it has one; more is better."""

    name, words, unit, largest = "speed", "tip speed through the target", "m/s", True

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""
        return struck.goals.arrival_speed(struck.near.velocity)

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""
        return -self.values(struck)[:, None]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their exact derivatives by the strike's numbers, (B, k, m)."""
        return -struck.goals.arrival_speed_slope(struck.near.velocity, struck.slopes.velocity)[:, None]

    def measure_of(self, value: float) -> float:
        """Return the measure of a number."""
        return -value


class Robustness(Criterion):
    """The root mean square of the miss distance where the strike's numbers are noisy; its measure is the mean square.

    The mean over normal noise is that over 2 m strikes around the one that is judged: the third-degree cubature rule
    (Arasaratnam and Haykin 2009, Eq. 20), exact where the square of the miss is a polynomial of third degree.

    Args:
        noise: Standard deviation of each number [rad, s], (m,).

    Raises:
        InputError: One is not finite or negative, or all are zero.
    """

    name, words, unit = "robustness", "root mean square miss under noise", "m"

    def __init__(self, noise: Sequence[float]) -> None:
        self.noise = np.array(numbers("noise", tuple(noise), len(noise)))
        if (self.noise < 0).any() or not self.noise.any():
            raise InputError("noise", tuple(noise), "standard deviations of 0 or more, and not all 0")

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""
        return np.sqrt(self.measures(struck)[:, 0])

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""
        around = self._around(struck)
        distance = np.where(around.near.known, around.near.distance, np.inf)
        return self._mean(distance**2, len(struck.strikes))[:, None]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their exact derivatives by the strike's numbers, (B, k, m)."""
        around = self._around(struck)
        return self._mean(2 * around.near.distance[:, None] * around.slopes.distance, len(struck.strikes))[:, None]

    def measure_of(self, value: float) -> float:
        """Return the measure of a number."""
        return value**2

    def _scale(self, hit_radius: float) -> float:
        return hit_radius

    @property
    def reach(self) -> np.ndarray:
        """How far from a strike those lie that judge it, in each of its numbers [rad, s], (m,)."""
        return self.noise * math.sqrt(np.count_nonzero(self.noise))

    def _around(self, struck: StrikesAtGoal) -> StrikesAtGoal:
        """Return the strikes of the cubature rule around each strike, the first strike's first."""
        some = np.diag(self.reach)[self.noise > 0]
        points = struck.strikes[:, None] + np.concatenate([some, -some])
        return struck.others(self, points.reshape(-1, struck.strikes.shape[1]))

    @staticmethod
    def _mean(values: np.ndarray, strikes: int) -> np.ndarray:
        """Return the mean over the strikes around each, (B, ...)."""
        return values.reshape(strikes, -1, *values.shape[1:]).mean(axis=1)


def find_criterion(name: str, bounds: StrikeBounds, *, noise: Sequence[float] = (NOISE,)) -> Criterion:
    """Return a criterion by its name.

    Args:
        name: One of `CRITERIA`.
        bounds: Bounds of the strikes.
        noise: Standard deviations for `robustness` [rad, s]: one of all numbers of a strike, or one each.

    Raises:
        InputError: No criterion has that name, or the noise does not fit the bounds.
    """
    kind = CRITERIA.find(name)
    return _robustness(bounds, tuple(noise)) if kind is Robustness else kind()


CRITERIA: Registry[type[Criterion]] = Registry(
    "criteria",
    type,
    {kind.name: kind for kind in (Miss, Effort, PeakTorque, Speed, Robustness)},
    what="criterion",
)


def _robustness(bounds: StrikeBounds, noise: tuple[float, ...]) -> Robustness:
    """Return the criterion under noise of one number for all, or one each."""
    count = len(bounds.lower)
    if len(noise) not in (1, count):
        raise InputError("noise", noise, f"one number, or {count}: one of each number of a strike")
    found = Robustness(noise * (count if len(noise) == 1 else 1))
    if found.reach[-1] >= bounds.lower[-1]:
        least = found.noise[-1] * bounds.lower[-1] / found.reach[-1]
        raise InputError("noise", noise, f"less than {least:.3g} s for D, so that noisy durations stay positive")
    return found


def hit_excess(struck: StrikesAtGoal) -> np.ndarray:
    """Return by how much strikes fall short of a hit, (B, c): of distance, direction and speed, where asked for.

    Each is 0 or less at a hit, and has a derivative everywhere: the squared parts of the cost in hit radii, less one,
    and the share of the least speed that is missing.
    """
    goals, near = struck.goals, struck.near
    left = goals.residuals(near.tip, near.velocity) / goals.hit_radius
    parts = [(block**2).sum(axis=1) - 1 for block in _blocks(goals, left)]
    if goals.speed is not None:
        parts.append(1 - goals.arrival_speed(near.velocity) / goals.speed)
    return np.stack(parts, axis=1)


def hit_excess_slopes(struck: StrikesAtGoal) -> np.ndarray:
    """Return the exact derivatives of `hit_excess` by the strikes' numbers, (B, c, m)."""
    goals, near, slopes = struck.goals, struck.near, struck.slopes
    left = goals.residuals(near.tip, near.velocity) / goals.hit_radius
    changes = goals.residual_slopes(near.velocity, slopes.tip, slopes.velocity) / goals.hit_radius
    both = zip(_blocks(goals, left), _blocks(goals, changes), strict=True)
    parts = [2 * np.einsum("br,brm->bm", block, change) for block, change in both]
    if goals.speed is not None:
        parts.append(-goals.arrival_speed_slope(near.velocity, slopes.velocity) / goals.speed)
    return np.stack(parts, axis=1)


def _blocks(goals: Goals, residuals: np.ndarray) -> list[np.ndarray]:
    """Return the parts of residuals (B, r, ...) that are the place and, where there is one, the direction."""
    d = goals.positions.shape[1]
    return [residuals[:, :d]] + ([] if goals.directions is None else [residuals[:, d : 2 * d]])
