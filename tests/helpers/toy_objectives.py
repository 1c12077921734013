"""Objectives in closed form for searches, which keep what they are asked."""

from __future__ import annotations

import numpy as np

from whiptool.models.strike import StrikeBounds

LOWER, UPPER = np.array([0.0, -1.0, 2.0, 0.0, 0.4]), np.array([1.0, 1.0, 6.0, 0.5, 1.4])


class Enough(Exception):
    """The search has shown enough generations."""


class Outcome:
    refused: str | None = None

    def __init__(self, miss: float) -> None:
        self.miss_distance = self.cost = miss


class Recorder:
    """An objective that keeps every generation in units of the box; misses are a function of the individual."""

    penalty = 10.0
    smooth = ()

    class bounds:
        box = (LOWER, UPPER)

    def __init__(self, generations: int, miss) -> None:
        self.generations, self.miss, self.seen = generations, miss, []

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        return strikes

    def batch(self, strikes: np.ndarray) -> list[Outcome]:
        assert ((strikes >= LOWER) & (strikes <= UPPER)).all()
        self.seen.append((strikes - LOWER) / (UPPER - LOWER))
        if len(self.seen) == self.generations:
            raise Enough
        return [Outcome(float(x)) for x in self.miss(self.seen[-1])]


BOUNDS = StrikeBounds((0.0, -1.0, 2.0, 0.0, 0.4), (1.0, 1.0, 6.0, 0.5, 1.4))
MINIMUM = np.array([0.3, 0.6, 4.0, 0.2, 1.1])


class Bowl:
    """The miss is the distance from the minimum, at least `floor`; its slope has a kink there."""

    bounds = BOUNDS
    smooth = ()
    criteria = ()

    def clear(self, strike: np.ndarray) -> bool:
        return True

    def __init__(self, floor: float = 0.0, most: int = 10**6) -> None:
        self.floor, self.most, self.batches, self.refined = floor, most, [], []

    def miss(self, x: np.ndarray) -> np.ndarray:
        return np.sqrt(((x - MINIMUM) ** 2).sum(axis=-1) + self.floor**2)

    def random_strikes(self, rng, count):
        return self.bounds.sample(rng, count)

    def admissible(self, strikes):
        return strikes

    def batch(self, strikes):
        self.batches.append(strikes)
        return [Outcome(float(m)) for m in self.miss(strikes)]

    def gradient(self, strike):
        if len(self.refined) == self.most:
            raise Enough
        self.refined.append(np.array(strike))
        return Outcome(float(self.miss(strike))), (strike - MINIMUM) / max(float(self.miss(strike)), 1e-300)
