"""Where the tip of a whip comes: the paths of random strikes within the joints' limits, counted in cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.models.mount import turns_as_a_whole
from whiptool.models.parameters import Model
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.striker import Striker

RATE = 100.0  # [1/s] at which paths are sampled
STRIKES = {2: 512, 3: 384}  # random strikes in the plane and in space, some tenths of a second of two cores
TOLERANCE = 1e-2  # [m] of their simulation, a quarter of a cell
AT_ONCE = 64  # strikes that are simulated before something newer is looked after
CELLS = 40  # along the reach
_BETWEEN = 8  # places between two samples of a path
_THICK = 0.1  # of the reach, on both sides of a plane in space in which paths are counted


@dataclass(frozen=True, eq=False)
class Sampled:
    """Random strikes and the paths of their tips. They keep the limits of the joints, and their tips stay above the
    floor; other distances are not checked, so that a strike that is to be made has to be judged.

    Args:
        strikes: Strike vectors, (B, m).
        paths: Positions of the tip, sampled at `RATE` [m], (B, S, d); NaN after a strike's end.
    """

    strikes: np.ndarray
    paths: np.ndarray

    @property
    def velocities(self) -> np.ndarray:
        """Velocities of the tip [m/s], (B, S, d), by central differences."""
        return np.gradient(self.paths, 1 / RATE, axis=1)

    def nearest(self, goal: Goals, count: int) -> np.ndarray:
        """Return the strikes that come nearest to a goal as searches count it, the best first, (count or fewer, m)."""
        B, S, d = self.paths.shape
        if not B:
            return self.strikes
        tips, velocities = self.paths.reshape(-1, d), self.velocities.reshape(-1, d)
        cost = np.full(len(tips), np.inf)
        known = np.isfinite(velocities).all(axis=1)
        cost[known] = np.linalg.norm(goal.residuals(tips[known], velocities[known]), axis=1)
        best = cost.reshape(B, S).min(axis=1)
        return self.strikes[np.argsort(best, kind="stable")[:count]]


def drawn_strikes(striker: Striker, *, seed: int = 0) -> Iterator[np.ndarray]:
    """Draw random strikes in parts that keep the limits which need no simulation; yield all so far after each part.

    Args:
        striker: Simulator of strikes with its limits.
        seed: Seed of the random strikes.
    """
    rng, count = np.random.default_rng(seed), STRIKES[striker.rollout.model.dimension]
    drawn = np.empty((0, len(striker.lower)))
    while len(drawn) < count:
        some = striker.limits.random_strikes(striker.bounds, rng, min(AT_ONCE, count - len(drawn)))
        drawn = np.concatenate([drawn, some])
        yield drawn


def sampled(striker: Striker, drawn: np.ndarray) -> Iterator[Sampled | None]:
    """Simulate random strikes in parts; yield None after each part, and at the end those that `Striker.paths` keeps.

    Args:
        striker: Simulator of strikes with its limits.
        drawn: Strike vectors, (B, m).
    """
    rollout = striker.rollout
    coarse = CompiledRollout(rollout.model, rollout.controller, free=rollout.free, tolerance=TOLERANCE)
    longest = int((striker.upper[-1] + striker.t_stay) * RATE + 1e-9) + 1
    rough = Striker(coarse, bounds=striker.bounds, limits=striker.limits.members, t_stay=striker.t_stay)
    strikes, paths = [], []
    for first in range(0, len(drawn), AT_ONCE):
        some = drawn[first : first + AT_ONCE]
        within, found = rough.paths(some, rate=RATE)
        strikes.append(some[within])
        ended = np.full((len(found), longest, found.shape[2]), np.nan)
        ended[:, : found.shape[1]] = found
        paths.append(ended[within])
        yield None
    yield Sampled(np.concatenate(strikes), np.concatenate(paths))


@dataclass(frozen=True, eq=False)
class HeatMap:
    """Share of random strikes whose tips pass each cell of a vertical plane.

    Args:
        shares: Share of the strikes, (rows, columns), the highest row first.
        low, high: Corners of the plane [m], (2,) each: along it and up.
        azimuth: Direction of the plane about the vertical from forward [rad].
        cell: Width of a cell [m].
    """

    shares: np.ndarray
    low: np.ndarray
    high: np.ndarray
    azimuth: float
    cell: float


def azimuth_of(place: np.ndarray) -> float:
    """Return the direction from forward of the vertical plane through a position (d,) [rad]; 0 in the plane."""
    return 0.0 if len(place) == 2 else float(np.arctan2(place[1], place[0]))


def same_everywhere(model: Model) -> bool:
    """Return whether the heat map of a model's strikes is the same for all targets, except for its direction."""
    return model.dimension == 2 or turns_as_a_whole(model.arm)


def heat_map(striker: Striker, found: Sampled, place: np.ndarray) -> HeatMap:
    """Return the heat map of random strikes in the plane of a planar model, or through the vertical and a position.

    If the arm's first joint turns the whole arm about the vertical, paths are turned into the plane; otherwise only
    what passes near it is counted.

    Args:
        striker: Simulator of the strikes.
        found: The strikes.
        place: Position of the target, (d,) [m].
    """
    model = striker.rollout.model
    reach = model.reach
    cell = reach / CELLS
    azimuth = azimuth_of(place)
    flat = _in_plane(found.paths, azimuth, turned=turns_as_a_whole(model.arm), thick=_THICK * reach)
    weights = np.arange(_BETWEEN) / _BETWEEN
    between = flat[:, :-1, None] + weights[:, None] * (flat[:, 1:] - flat[:, :-1])[:, :, None]
    low, high = np.full(2, -reach), np.full(2, reach)
    if model.dimension == 3 and turns_as_a_whole(model.arm):
        low[0] = 0.0
    shape = tuple(np.round((high - low) / cell).astype(int))
    at = np.floor((np.nan_to_num(between, nan=np.inf) - low) / cell)
    strike, *_ = inside = np.nonzero(((at >= 0) & (at < shape)).all(axis=-1))
    passed = np.zeros((len(flat), *shape), bool)  # a strike counts once in a cell
    passed[(strike, *at[inside].astype(int).T)] = True
    return HeatMap(passed.sum(axis=0).T[::-1] / max(len(found.strikes), 1), low, high, azimuth, cell)


def _in_plane(paths: np.ndarray, azimuth: float, *, turned: bool, thick: float) -> np.ndarray:
    """Return paths (B, S, d) along a vertical plane and up, (B, S, 2); NaN for what is not near it."""
    if paths.shape[2] == 2:
        return paths
    if turned:
        return np.stack([np.hypot(paths[..., 0], paths[..., 1]), paths[..., 2]], axis=-1)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    along, across = (c * paths[..., 0] + s * paths[..., 1] for c, s in ((cosine, sine), (-sine, cosine)))
    flat = np.stack([along, paths[..., 2]], axis=-1)
    return np.where(np.abs(across)[..., None] <= thick, flat, np.nan)
