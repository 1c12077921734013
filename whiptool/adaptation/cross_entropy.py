"""Search with a shrinking normal distribution (cross-entropy, Rubinstein 1999) from a strike that is good already."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

LEAST_ELITE = 2  # strikes that the spread is learned from, at least


@dataclass(frozen=True)
class CrossEntropy:
    """Settings of the cross-entropy search.

    Args:
        width: Width of the box of strikes in each coordinate, (m,).
        spread: Standard deviation of the first draws, as a fraction of the width.
        population: Strikes in a round.
        rounds: Largest number of rounds.
        within: Function that moves strikes (B, m) into the feasible set.
        sure: Function that returns whether the search may stop at a strike of this value.
    """

    width: np.ndarray
    spread: float
    population: int
    rounds: int
    within: Callable[[np.ndarray], np.ndarray]
    sure: Callable[[float], bool]

    def around(
        self, best: np.ndarray, value: float, worth: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the strikes that were drawn around the best one (D, m) and the score of each (D,).

        A round that finds a better strike goes on from there, with the mean of the last spread and of the round's best
        quarter's distance from there; else the spread shrinks to three fifths.

        Args:
            best: Strike to begin at, (m,).
            value: Worth of the strike.
            worth: Function that returns the worth of strikes (B, m), (B,); the larger the better.
            rng: Generator of the draws.
        """
        centre, top, spreads = best, value, np.full(len(best), self.spread)
        strikes, values = np.empty((0, len(best))), np.empty(0)
        for _ in range(self.rounds):
            if self.sure(top):
                break
            draws = self.within(centre + spreads * self.width * rng.standard_normal((self.population, len(best))))
            found = worth(draws)
            strikes, values = np.vstack([strikes, draws]), np.concatenate([values, found])
            elite = draws[np.argsort(-found)[: max(LEAST_ELITE, self.population // 4)]]
            if found.max() > top:
                centre, top = draws[int(found.argmax())], float(found.max())
                spreads = 0.5 * spreads + 0.5 * np.abs(elite - centre).mean(axis=0) / self.width
            else:
                spreads = 0.6 * spreads
        return strikes, values
