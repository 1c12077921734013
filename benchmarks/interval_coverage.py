"""How often do the 95 % intervals of a comparison hold the truth? Simulated studies whose true means are known.

A study draws T targets and, for each of S seeds, the trials to the first hit at each target: geometric, with a mean
of 1 + (mean - 1) x seed x target, where the factors of seeds and targets are log-normal with mean 1. `mean`: the
interval of a method's mean trials. `ratio`: the interval that decides which of two methods needs fewer trials, at the
same targets, where both need equally many; the second method has seeds that agree (or, `one seed`, the one seed of a
deterministic method). Where it lies too low, the first method was wrongly said to need fewer, else the second.

Seeds that differ have a spread (standard deviation of the factor's logarithm) of 0.3 or 0.6; means of three seeds of
the learners in notebooks/data/comparison.json at 1 cm spread by about that. A spread of 1 is shown next to them: three
seeds that differ so much seldom show it.

    python benchmarks/interval_coverage.py [--quick] [--json] [--studies 1000] [--seeds 3] [--targets 300]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from whiptool.comparison.series import mean_interval, ratio_interval


@dataclass(frozen=True)
class World:
    """Where studies come from.

    Args:
        mean: True mean of the trials.
        seeds, targets: Spread of the factors of seeds and of targets.
    """

    mean: float
    seeds: float
    targets: float

    def target_factors(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count,)"""
        return rng.lognormal(-(self.targets**2) / 2, self.targets, count)

    def trials(self, seeds: int, targets: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """One study's, (seeds, T), at targets of these factors (T,)."""
        of_seeds = rng.lognormal(-(self.seeds**2) / 2, self.seeds, seeds)
        return rng.geometric(1 / (1 + (self.mean - 1) * np.outer(of_seeds, targets)))


WORLDS = {
    "seeds agree, targets alike": World(10.0, 0.0, 0.0),
    "seeds agree": World(10.0, 0.0, 0.5),
    "seeds agree, few misses": World(1.1, 0.0, 0.5),
    "seeds differ by 0.3": World(10.0, 0.3, 0.5),
    "seeds differ by 0.6": World(10.0, 0.6, 0.5),
    "seeds differ by 0.6, few misses": World(1.1, 0.6, 0.5),
    "seeds differ by 1, beyond what it is for": World(10.0, 1.0, 0.5),
}


def study_means(world: World, *, studies: int, seeds: int, targets: int, rng: np.random.Generator) -> dict:
    """How often the interval of the mean lies below, around and above the truth."""
    intervals = np.array(
        [mean_interval(world.trials(seeds, world.target_factors(targets, rng), rng)) for _ in range(studies)]
    )
    return _shares(intervals, world.mean)


def study_ratios(world: World, *, studies: int, seeds: tuple[int, int], targets: int, rng: np.random.Generator) -> dict:
    """The same of the ratio of two methods that need equally many trials."""
    rival, intervals = World(world.mean, 0.0, world.targets), []
    for _ in range(studies):
        factors = world.target_factors(targets, rng)
        intervals.append(ratio_interval(world.trials(seeds[0], factors, rng), rival.trials(seeds[1], factors, rng)))
    return _shares(np.array(intervals), 1.0)


def _shares(intervals: np.ndarray, truth: float) -> dict[str, float]:
    low, high = intervals.T
    held = int(((low <= truth) & (truth <= high)).sum())
    sure = binomtest(held, len(low)).proportion_ci(method="wilson")
    return {
        "coverage": held / len(low),
        "low": float(sure.low),
        "high": float(sure.high),
        "below": float((high < truth).mean()),
        "above": float((low > truth).mean()),
        "median_width": float(np.median(high / low)),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="200 studies")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--studies", type=int, default=1000, help="of each kind (default: 1000)")
    parser.add_argument("--seeds", type=int, default=3, help="of a study (default: 3)")
    parser.add_argument("--targets", type=int, default=300, help="of a study (default: 300)")
    arguments = parser.parse_args()
    size = {"studies": 200 if arguments.quick else arguments.studies, "targets": arguments.targets}
    rng, S = np.random.default_rng(0), arguments.seeds
    rows = {}
    for name, world in WORLDS.items():
        rows[f"mean, {name}"] = study_means(world, seeds=S, rng=rng, **size)
    for name, world in WORLDS.items():
        rows[f"ratio, {name}"] = study_ratios(world, seeds=(S, S), rng=rng, **size)
        rows[f"ratio to one seed, {name}"] = study_ratios(world, seeds=(S, 1), rng=rng, **size)
    if arguments.json:
        print(json.dumps({**size, "seeds": S, "rows": rows}))
        return
    print(f"{size['studies']} studies of {S} seeds at {size['targets']} targets; 95 % intervals")
    for name, row in rows.items():
        print(
            f"{name:61s} {row['coverage']:6.1%} [{row['low']:.1%}, {row['high']:.1%}]  too low {row['below']:.1%}, "
            f"too high {row['above']:.1%}"
        )


if __name__ == "__main__":
    main()
