"""A new search method: the cross-entropy method (Rubinstein 1999), batch by batch."""

import numpy as np

import whiptool as wt
from whiptool.optimizers import METHODS

BATCH, ELITE = 40, 8


def cross_entropy(objective: wt.Objective, *, seed: int) -> None:
    """Draw strikes from a normal distribution, fit it to the best of them, and draw again.

    A method calls the objective and returns when it is done. The objective counts trials, keeps the best, and raises
    `SearchStopped` when a budget ends or a hit is enough; a method lets that exception pass.
    """
    rng = np.random.default_rng(seed)
    lower, upper = objective.bounds.box
    mean, spread = (lower + upper) / 2, (upper - lower) / 3
    while (spread > 1e-6 * (upper - lower)).any():
        strikes = np.clip(mean + spread * rng.standard_normal((BATCH, len(mean))), lower, upper)
        misses = [outcome.miss_distance for outcome in objective.batch(strikes)]
        best = strikes[np.argsort(misses)[:ELITE]]
        mean, spread = best.mean(axis=0), best.std(axis=0)


METHODS["cross-entropy"] = cross_entropy  # from here on a method like any other

if __name__ == "__main__":
    rollout = wt.CompiledRollout(wt.preset("lemon2024"), wt.Controller())
    objective = wt.Objective(rollout, wt.Target((1.2, 0.1), hit_radius=0.001), max_trials=4000, stop_at_hit=True)
    result = wt.search(objective, "cross-entropy", seed=0)
    assert result.outcome is not None
    assert result.outcome.hit
    print(f"{result.method}: {result.message}, {result.n_trials} trials, {1e3 * result.outcome.miss_distance:.1f} mm")
