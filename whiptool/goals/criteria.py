"""Criteria by which hits are ranked: miss, effort, largest torque, speed at the target, robustness."""

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
from whiptool.rollout.interface import ApproachSlopes, Rollout

NOISE = 0.01  # [rad, s], usual standard deviation of each number of a strike


class StrikesAtGoal:
    """Strikes at a goal, with results that are simulated on demand.

    Args:
        rollout: Simulator.
        strikes: Strike vectors, (B, 2 a + 1).
        goals: The goal of all strikes.
        t_stay: Time after the movement's end for which the tip is still observed [s].
    """

    def __init__(self, rollout: Rollout, strikes: np.ndarray, goals: Goals, t_stay: float) -> None:
        self.rollout, self.strikes, self.goals, self.t_stay = rollout, strikes, goals, t_stay
        self._others: dict[object, StrikesAtGoal] = {}

    @cached_property
    def near(self) -> Approach:
        """Closest approaches of the strikes."""
        return self.rollout.approach(self.strikes, self.goals.positions[0], t_stay=self.t_stay)

    @cached_property
    def slopes(self) -> ApproachSlopes:
        """Exact derivatives of the closest approaches by the strikes' coordinates."""
        return self.rollout.slopes(self.strikes, self.goals.positions[0], t_stay=self.t_stay)[1]

    def others(self, of: object, strikes: np.ndarray) -> StrikesAtGoal:
        """Return further strikes at the same goal, stored under the key `of` and simulated only once."""
        if of not in self._others:
            self._others[of] = StrikesAtGoal(self.rollout, strikes, self.goals, self.t_stay)
        return self._others[of]


class Criterion(ABC):
    """A quantity by which hits are ranked.

    Gradient-based searches minimise the largest of its k measures, which are smooth even if the quantity is not. m is
    the length of a strike vector.

    Args:
        name: Name on the command line.
        words: Description.
        unit: Unit of its values.
        largest: Whether larger is better.
        of_torques: Whether the criterion is computed from torques, which are unknown for an arm of unknown inertia.
    """

    name: ClassVar[str]
    words: ClassVar[str]
    unit: ClassVar[str]
    largest: ClassVar[bool] = False
    of_torques: ClassVar[bool] = False

    @abstractmethod
    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the criterion of each strike in its `unit`, (B,); smaller is better unless `largest`."""

    @abstractmethod
    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, k)."""

    @abstractmethod
    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the exact derivatives of the measures by the strike's coordinates, (B, k, m)."""

    def measure_of(self, value: float) -> float:
        """Return the upper bound on the measures at which the criterion is `value`, or better."""
        return value

    def cost(self, value: float, hit_radius: float) -> float:
        """Return the cost of a hit in searches: negative, unlike that of a miss, and larger for a worse hit."""
        size = math.log1p(max(value, 0.0) / self._scale(hit_radius))
        return -(1 + size) if self.largest else -1 / (1 + size)

    def _scale(self, hit_radius: float) -> float:
        """Return the size of number that is distinguished best from others of its size."""
        return 1.0


class Miss(Criterion):
    """The miss distance [m]; its measure is the square."""

    name, words, unit = "miss", "miss distance", "m"

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.near.distance

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.near.distance[:, None] ** 2

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        return (2 * struck.near.distance[:, None] * struck.slopes.distance)[:, None]

    def measure_of(self, value: float) -> float:
        return value**2

    def _scale(self, hit_radius: float) -> float:
        return hit_radius


class Effort(Criterion):
    """The integral of the squared torques of all joints over the strike; its measure is log(1 + effort).

    The logarithm is used because efforts of one robot's strikes span four orders of magnitude.
    """

    name, words, unit, of_torques = "effort", "effort", "N² m² s", True

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        if struck.near.effort is None:
            raise InputError("simulator", struck.rollout.engine, "a simulator that computes torques over time")
        return struck.near.effort.sum(axis=1)

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        return np.log1p(self.values(struck))[:, None]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.slopes.effort.sum(axis=1, keepdims=True) / (1 + self.values(struck))[:, None, None]

    def measure_of(self, value: float) -> float:
        return math.log1p(value)


class PeakTorque(Criterion):
    """The largest torque of any joint [N m]; its measures are the largest torques of each joint."""

    name, words, unit, of_torques = "peak-torque", "largest torque", "N m", True

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.near.max_torque.max(axis=1)

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.near.max_torque

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.slopes.max_torque


class Speed(Criterion):
    """The tip's speed at its closest approach [m/s], along the goal's direction if it has one; larger is better."""

    name, words, unit, largest = "speed", "tip speed through the target", "m/s", True

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        return struck.goals.arrival_speed(struck.near.velocity)

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        return -self.values(struck)[:, None]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        return -struck.goals.arrival_speed_slope(struck.near.velocity, struck.slopes.velocity)[:, None]

    def measure_of(self, value: float) -> float:
        return -value


class Robustness(Miss):
    """The root mean square of the miss distance [m] under noise in the strike's coordinates; its measure is the mean
    square.

    The mean over normal noise is computed from 2 m strikes around the given one by the third-degree cubature rule
    (Arasaratnam and Haykin 2009, Eq. 20), which is exact if the squared miss is a polynomial of third degree.

    Args:
        noise: Standard deviation of each coordinate of the strike [rad, s], (m,).

    Raises:
        InputError: A standard deviation is negative or not finite, or all are zero.
    """

    name, words, unit = "robustness", "root mean square miss under noise", "m"

    def __init__(self, noise: Sequence[float]) -> None:
        self.noise = np.array(numbers("noise", tuple(noise), len(noise)))
        if (self.noise < 0).any() or not self.noise.any():
            raise InputError("noise", tuple(noise), "standard deviations of 0 or more, and not all 0")

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        return np.sqrt(self.measures(struck)[:, 0])

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        around = self._around(struck)
        distance = np.where(around.near.known, around.near.distance, np.inf)
        return self._mean(distance**2, len(struck.strikes))[:, None]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        around = self._around(struck)
        return self._mean(2 * around.near.distance[:, None] * around.slopes.distance, len(struck.strikes))[:, None]

    @property
    def reach(self) -> np.ndarray:
        """Distance of the cubature points from a strike in each of its coordinates [rad, s], (m,)."""
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
        noise: Standard deviations for `robustness` [rad, s]: one for all coordinates of a strike, or one for each.

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
        raise InputError("noise", noise, f"one number, or {count}, one for each coordinate of a strike")
    found = Robustness(noise * (count if len(noise) == 1 else 1))
    if found.reach[-1] >= bounds.lower[-1]:
        least = found.noise[-1] * bounds.lower[-1] / found.reach[-1]
        raise InputError("noise", noise, f"less than {least:.3g} s for D, so that noisy durations stay positive")
    return found


def hit_excess(struck: StrikesAtGoal) -> np.ndarray:
    """Return by how much strikes fall short of a hit, (B, c), in distance and, where required, direction and speed.

    Each entry is at most 0 for a hit, and differentiable everywhere: the squared parts of the cost in units of the hit
    radius, less 1, and the relative shortfall of the speed.
    """
    goals, near = struck.goals, struck.near
    left = goals.residuals(near.tip, near.velocity) / goals.hit_radius
    parts = [(block**2).sum(axis=1) - 1 for block in _blocks(goals, left)]
    if goals.bounds_speed:
        parts.append(goals.speed_excess(near.velocity)[0])
    return np.stack(parts, axis=1)


def hit_excess_slopes(struck: StrikesAtGoal) -> np.ndarray:
    """Return the exact derivatives of the c parts of `hit_excess` by the strikes' m coordinates, (B, c, m)."""
    goals, near, slopes = struck.goals, struck.near, struck.slopes
    left = goals.residuals(near.tip, near.velocity) / goals.hit_radius
    changes = goals.residual_slopes(near.velocity, slopes.tip, slopes.velocity) / goals.hit_radius
    both = zip(_blocks(goals, left), _blocks(goals, changes), strict=True)
    parts = [2 * np.einsum("br,brm->bm", block, change) for block, change in both]
    if goals.bounds_speed:
        by_speed = goals.speed_excess(near.velocity)[1][:, None]
        parts.append(by_speed * goals.arrival_speed_slope(near.velocity, slopes.velocity))
    return np.stack(parts, axis=1)


def _blocks(goals: Goals, residuals: np.ndarray) -> list[np.ndarray]:
    """Return the parts of residuals (B, r, ...) that are the place and, where there is one, the direction."""
    d = goals.positions.shape[1]
    return [residuals[:, :d]] + ([] if goals.directions is None else [residuals[:, d : 2 * d]])
