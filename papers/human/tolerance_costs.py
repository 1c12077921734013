"""Tolerance, noise and covariation of strikes: how much error in its numbers a strike bears.

Cohen and Sternad 2009 (Exp. Brain Res. 193, 69) tell what a performer's results lose by where the executions lie
(tolerance), by how much they scatter (noise), and by how their numbers go together (covariation). A machine repeats its
strike exactly: noise is put on its numbers, and it is asked with how much of it the machine hits as rarely as a person.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool import Target
from whiptool.rollout.interface import Rollout

DRAWS = 200
SIZES = np.geomspace(0.01, 1.3, 16)  # [rad, s] of noise that are tried
EXECUTIONS = 60  # of which costs are reported
SMALL = 0.01  # [rad, s] at which sensitivities are taken
_RESAMPLES = 1000
_SCALES = np.linspace(0, 1, 11)  # of the scatter, Cohen and Sternad's N-cost
_ROUNDS = 6  # of exchanges, their C-cost
_SHORTEST = 0.05  # [s]: no noisy strike is shorter


def noisy(strike: np.ndarray, draws: np.ndarray, size: float) -> np.ndarray:
    """Return a strike (m,) with noise of a size [rad, s] times standard draws (n, m) on its numbers, (n, m)."""
    struck = strike + size * draws
    struck[:, -1] = np.maximum(struck[:, -1], _SHORTEST)
    return struck


def misses(rollout: Rollout, target: Target, strikes: np.ndarray) -> np.ndarray:
    """Return the miss distance of each strike (n, m) [m]; where it diverged, the farthest that any can be."""
    near = rollout.approach(strikes, target.position)
    return np.where(near.diverged, rollout.model.farthest_miss(target.position), near.distance)


@dataclass(frozen=True, eq=False)
class Tolerance:
    """What noise does to the strikes of one method; S strikes, m numbers, K sizes of noise.

    Args:
        sensitivity: Root mean square miss per noise in each number alone [m/rad, m/s], (S, m).
        hits: Whether each noisy strike hit, (S, K, draws).
        miss: Mean miss distance at each size [m], (S, K).
    """

    sensitivity: np.ndarray
    hits: np.ndarray
    miss: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """Return the share of hits at each size of noise, over all strikes, (K,)."""
        return self.hits.mean(axis=(0, 2))

    def equivalent_noise(self, share: float) -> float:
        """Return the noise [rad, s] up to which a share of strikes hits; the largest tried if more hit even then."""
        return _crossing(self.shares, share)

    def interval(self, share: float, *, seed: int = 0) -> tuple[float, float]:
        """Return the 95 % interval of `equivalent_noise`: strikes and draws are resampled."""
        rng = np.random.default_rng(seed)
        strikes, _, draws = self.hits.shape
        found = []
        for _ in range(_RESAMPLES):
            some = self.hits[rng.integers(strikes, size=strikes)].mean(axis=0)  # (K, draws)
            found.append(_crossing(some[:, rng.integers(draws, size=draws)].mean(axis=1), share))
        low, high = np.percentile(found, (2.5, 97.5))
        return float(low), float(high)


def _crossing(shares: np.ndarray, share: float) -> float:
    """Return where shares, which decrease with the size of the noise apart from random variation, reach a share."""
    falling = np.minimum.accumulate(shares)
    below = np.flatnonzero(falling < share)
    if not len(below):
        return float(SIZES[-1])
    i = int(below[0])
    if i == 0:
        return float(SIZES[0])
    part = (falling[i - 1] - share) / max(falling[i - 1] - falling[i], 1e-12)
    return float(np.exp(np.log(SIZES[i - 1]) + part * np.log(SIZES[i] / SIZES[i - 1])))


def tolerance(rollout: Rollout, target: Target, strikes: np.ndarray, *, draws: int = DRAWS, seed: int = 0) -> Tolerance:
    """Return the tolerance of strikes (S, m) that one method found; the noise is the same for all methods.

    Args:
        rollout: The machine.
        target: Target of the strike, with its hit radius.
        strikes: The method's.
        draws: Noisy strikes of each size.
        seed: Seed of the noise.
    """
    m = strikes.shape[1]
    normal = np.random.default_rng(seed).standard_normal((draws, m))
    sensitivity, hits, miss = [], [], []
    for strike in strikes:
        alone = [noisy(strike, step * np.eye(m), SMALL) for step in (1.0, -1.0)]
        apart = np.stack([misses(rollout, target, some) for some in alone])  # (2, m)
        sensitivity.append(np.sqrt((apart**2).mean(axis=0)) / SMALL)
        distance = np.stack([misses(rollout, target, noisy(strike, normal, size)) for size in SIZES])
        hits.append(target.goals.hit(distance))
        miss.append(distance.mean(axis=1))
    return Tolerance(np.array(sensitivity), np.array(hits), np.array(miss))


@dataclass(frozen=True)
class Costs:
    """What is lost of the mean miss distance, in [m] (Cohen and Sternad 2009).

    Args:
        miss: Mean of the executions as they are.
        tolerance: Less with the same scatter at the best place known.
        noise: Less with the best scale of the scatter at the same place.
        covariation: Less with the same values of each number, best put together.
    """

    miss: float
    tolerance: float
    noise: float
    covariation: float


def costs(
    rollout: Rollout,
    target: Target,
    strike: np.ndarray,
    places: Sequence[np.ndarray],
    *,
    size: float,
    executions: int = EXECUTIONS,
    seed: int = 0,
) -> Costs:
    """Return the three costs of executions around a strike.

    Args:
        rollout: The machine.
        target: Target of the strike.
        strike: Whose executions have independent normal noise, (m,).
        places: Strikes at which the same scatter is tried for the cost of tolerance.
        size: Size of the noise [rad, s].
        executions: Number of executions.
        seed: Seed of the noise.
    """
    rng = np.random.default_rng(seed)
    draws = rng.standard_normal((executions, len(strike)))
    actual = noisy(strike, draws, size)
    miss = misses(rollout, target, actual)
    elsewhere = [misses(rollout, target, noisy(place, draws, size)).mean() for place in (strike, *places)]
    scaled = [misses(rollout, target, noisy(strike, draws, size * scale)).mean() for scale in _SCALES]
    together = _best_pairs(rollout, target, actual, miss, rng)
    mean = float(miss.mean())
    return Costs(mean, mean - float(min(elsewhere)), mean - float(min(scaled)), mean - float(together.mean()))


def _best_pairs(
    rollout: Rollout, target: Target, executions: np.ndarray, miss: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return the misses after values of one number have been exchanged between executions wherever that is better."""
    executions, miss = executions.copy(), miss.copy()
    n, m = executions.shape
    for _ in range(_ROUNDS):
        for number in range(m):
            order = rng.permutation(n)
            one, other = order[: n // 2], order[n // 2 : 2 * (n // 2)]
            tried = executions.copy()
            tried[one, number], tried[other, number] = executions[other, number], executions[one, number]
            found = misses(rollout, target, tried)
            better = found[one] + found[other] < miss[one] + miss[other]
            for pair in (one[better], other[better]):
                executions[pair], miss[pair] = tried[pair], found[pair]
    return miss
