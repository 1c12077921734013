"""Trials to the first hit of a method over seeds and targets: series, confidence intervals and tables.

Each seed strikes at the same targets. The mean over S seeds and T targets has two sources of error, the choice of the
seeds and that of the targets:

    variance of the mean = (variance between seeds' means) / S + (variance between targets beyond that of chance) / T

Each part is estimated by its mean square, so that it has Student's t with S - 1 or T - 1 degrees of freedom, and the
half-widths of the parts add in quadrature. The coverage of such an interval is at least the nominal one for any ratio
of the parts, and exact if one part is zero (Banerjee 1960, Sankhya 22, 357): with three seeds between 95.0 and 97.7 %
of the time. Two methods have independent seeds (Welch's degrees of freedom) and the same targets (paired).

Means are taken on a logarithmic scale, on which seeds scatter more evenly; `benchmarks/interval_coverage.py` measures
the coverage.
"""

from __future__ import annotations

import csv
import io
import math
from abc import abstractmethod
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import stdtrit

from whiptool.comparison.target_scene import TargetScene
from whiptool.comparison.units import Unit

LEVEL = 0.95
MAIN_CONVENTION = "mean-first"  # of whiptool.rl.policy


def mean_interval(trials: np.ndarray, *, cap: float = np.inf) -> tuple[float, float]:
    """Return the 95 % confidence interval of the mean number of trials to the first hit, of S seeds at T targets,
    (S, T); its ends are 1 and `cap`, an upper bound of the mean, if there is only one target.

    It is symmetric in the logarithm of the mean number of misses before the hit (mean - 1). With one seed it is the
    interval of the mean over targets for that seed. If every target was hit at the first trial, it has zero width.
    """
    if trials.shape[1] == 1:
        return 1.0, float(cap)
    misses = float(trials.mean()) - 1
    if misses <= 0:
        return 1.0, 1.0
    with np.errstate(over="ignore"):
        factor = float(np.exp(_half_width([trials / misses])))
    return 1 + misses / factor, min(1 + misses * factor, float(cap))


def ratio_interval(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return the 95 % confidence interval of the ratio of two methods' mean numbers of misses before the hit, of seeds
    at targets, (S, T) and (S', T); its ends are 0 and infinity if there is only one target.

    Misses, i.e. trials - 1, separate means near 1 trial better than trials do. If a mean is at most 1 trial, the
    interval is that of the ratio of mean trials. Both methods have the same targets.
    """
    if one.shape[1] == 1:
        return 0.0, np.inf
    missed = 1 if min(one.mean(), other.mean()) > 1 else 0
    means = float(one.mean()) - missed, float(other.mean()) - missed
    with np.errstate(over="ignore"):
        factor = float(np.exp(_half_width([one / means[0], other / means[1]])))
    return means[0] / means[1] / factor, means[0] / means[1] * factor


def needs_fewer(one: np.ndarray, other: np.ndarray, *, share: float = 1.0) -> bool:
    """Whether `one` needs significantly (95 %) fewer trials than `share` times `other`; see `ratio_interval`."""
    return ratio_interval(one, share * other)[1] < 1


def _half_width(groups: Sequence[np.ndarray]) -> float:
    """Of the 95 % interval of a group's mean, or of the difference of two groups' means; groups (S, T), (S', T)."""
    seeds, chance = zip(*(_seed_part(group) for group in groups), strict=True)
    between = groups[0].mean(axis=0) - (groups[1].mean(axis=0) if len(groups) > 1 else 0.0)  # (T,)
    T = len(between)
    targets = max(float(between.var(ddof=1)) - sum(chance), 0.0) / T
    known = [(part, len(group) - 1) for part, group in zip(seeds, groups, strict=True) if part > 0]
    total = sum(part for part, _ in known)
    freedom = total**2 / sum(part**2 / df for part, df in known) if known else 1.0  # Welch (1947)
    return float(np.sqrt(_quantile(freedom) ** 2 * total + _quantile(T - 1) ** 2 * targets))


def _seed_part(group: np.ndarray) -> tuple[float, float]:
    """Variance of a group's mean (S, T) that is due to its seeds, and of each target's mean that is due to chance.

    Chance is what neither the seed nor the target explains; one seed shows neither part.
    """
    S, T = group.shape
    if S == 1:
        return 0.0, 0.0
    of_seeds, of_targets, mean = group.mean(axis=1), group.mean(axis=0), group.mean()
    rest = group - of_seeds[:, None] - of_targets + mean
    return float(of_seeds.var(ddof=1)) / S, float((rest**2).sum()) / ((S - 1) * (T - 1)) / S


def _quantile(freedom: float) -> float:
    """Of Student's t, two-sided."""
    return float(stdtrit(freedom, (1 + LEVEL) / 2))


NAMES = {
    "directl": "DIRECT-L",
    "ga": "GA",
    "cmaes": "CMA-ES",
    "gradient": "gradient",
    "random": "random",
    "sac": "SAC",
    "td3": "TD3",
    "ddpg": "DDPG",
    "ppo": "PPO",
}


@dataclass(frozen=True, eq=False, repr=False)
class Series:
    """Results of S seeds of a method at the same T targets.

    Args:
        method: Name of the method on the command line.
        observation: Observation of a learner; empty for a search.
        convention: Convention by which its policy struck (`whiptool.rl.policy.CONVENTIONS`); empty for a search.
        hit_radius: Hit radius [m].
        trials: Trials to the first hit, `cap` without a hit, (S, T).
        hit: Whether there was a hit, (S, T).
        training_trials: Number of strikes in the training, mean over seeds.
        n_diverged: Number of strikes that diverged in search or training, over all seeds.
        wall_time: Duration of the search or training [s], mean over seeds.
        notes: Deviations from the plan.
        cap: Largest number of trials at a target.
    """

    method: str
    observation: str
    convention: str
    hit_radius: float
    trials: np.ndarray
    hit: np.ndarray
    training_trials: float
    n_diverged: int
    wall_time: float
    notes: tuple[str, ...] = ()
    cap: float = math.inf

    def __repr__(self) -> str:
        low, high = self.interval
        way = f" ({self.convention})" if self.convention else ""
        needs = f"{self.mean:.1f} trials to a hit, 95 % interval {low:.1f} to {high:.1f}"
        return f"Series({self.label}{way}: {needs}, {self.hit.mean():.0%} of {self.hit.size} hit)"

    @property
    def label(self) -> str:
        """Name of the series in figures and tables."""
        method, *library = self.method.split("+")
        name = NAMES.get(method, method) + (" from a library" if library else "")
        return f"{name}, {self.observation}" if self.observation else name

    @property
    def learned(self) -> bool:
        """Whether the method is a learner, which was trained before."""
        return bool(self.observation)

    @property
    def main(self) -> bool:
        """Whether the method is a search, or a learner with the main convention (`MAIN_CONVENTION`)."""
        return self.convention in ("", MAIN_CONVENTION)

    @property
    def mean(self) -> float:
        """Mean trials to the first hit over all seeds and targets (Eq. 21)."""
        return float(self.trials.mean())

    @cached_property
    def interval(self) -> tuple[float, float]:
        """95 % interval (low, high) of `mean`, in trials; see `mean_interval`."""
        return mean_interval(self.trials, cap=self.cap)

    def needs_fewer(self, other: Series, *, share: float = 1.0) -> bool:
        """Whether the method needs significantly (95 %) fewer trials than `share` times those of another."""
        return needs_fewer(self.trials, other.trials, share=share)

    def row(self) -> dict[str, Any]:
        """Return one row of the table, by column."""
        low, high = self.interval
        return {
            "method": self.method,
            "observation": self.observation,
            "convention": self.convention,
            "hit_radius": self.hit_radius,
            "mean_trials": self.mean,
            "low": low,
            "high": high,
            "median_trials": float(np.median(self.trials)),
            "largest": int(self.trials.max()),
            "share_hit": float(self.hit.mean()),
            "seeds": len(self.trials),
            "targets": self.trials.shape[1],
            "training_trials": self.training_trials,
            "n_diverged": self.n_diverged,
            "notes": "; ".join(self.notes),
            "wall_time": self.wall_time,
        }


@dataclass(frozen=True, kw_only=True)
class MethodUnit(Unit):
    """A unit that tries a method, with one seed, at targets of a scene."""

    scene: TargetScene

    @property
    @abstractmethod
    def series(self) -> tuple[str, str, int]:
        """Name of the method in tables; observation of a learner, empty for a search; and seed."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of targets."""

    def check(self, result: Mapping[str, Any]) -> None:
        """Raise an exception if a stored result is not one that this unit can have had."""
        series = collect([self], {self.key: result})
        if {one.hit_radius for one in series} != set(self.scene.radii):
            raise ValueError(f"not of the hit radii {self.scene.radii}")
        for one in series:
            one.row()
            if one.trials.shape != (1, self.count) or one.trials.dtype.kind != "i" or one.hit.dtype != bool:
                raise ValueError(f"no {self.count} numbers of trials, each with a hit or none: {one.label}")


def collect(units: Iterable[MethodUnit], results: Mapping[str, Mapping[str, Any]]) -> list[Series]:
    """Return the series of finished units, in the order of the units."""
    groups: dict[tuple[str, str], dict[int, list[Mapping[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    units = list(units)
    for unit in units:
        method, observation, seed = unit.series
        groups[method, observation][seed].append(results[unit.key])
    series = []
    for (method, observation), seeds in groups.items():
        parts = [part for chunks in seeds.values() for part in chunks]
        notes = tuple(f"seed {seed}: {c['note']}" for seed, chunks in seeds.items() for c in chunks if c["note"])
        for i, kind in enumerate(parts[0]["outcomes"]):
            trials, hit = (
                np.array([[x for chunk in chunks for x in chunk["outcomes"][i][key]] for chunks in seeds.values()])
                for key in ("trials", "hit")
            )
            series.append(
                Series(
                    method=method,
                    observation=observation,
                    convention=kind["convention"],
                    hit_radius=kind["hit_radius"],
                    trials=trials,
                    hit=hit,
                    training_trials=float(np.mean([chunks[0]["training_trials"] for chunks in seeds.values()])),
                    n_diverged=sum(part["n_diverged"] for part in parts),
                    wall_time=sum(part["wall_time"] for part in parts) / len(seeds),
                    notes=notes,
                    cap=units[0].scene.cap,
                )
            )
    return series


def as_csv(series: Sequence[Series]) -> str:
    """Return every series as a line of CSV, at full precision."""
    text = io.StringIO()
    rows = [one.row() for one in series]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def main_table(series: Sequence[Series]) -> list[list[str]]:
    """Return header and rows: every method at the widest hit radius, learners with the mean action first."""
    header = [
        "method",
        "mean trials",
        "95 % interval",
        "median",
        "largest",
        "hit",
        "seeds",
        "training trials",
        "time [s]",
    ]
    radius = series[0].hit_radius
    return [header, *(_row(one) for one in series if one.main and one.hit_radius == radius)]


def _row(one: Series) -> list[str]:
    low, high = one.interval
    row = one.row()
    return [
        one.label,
        figure(one.mean),
        f"{figure(low)} to {figure(high)}",
        f"{row['median_trials']:g}",
        f"{row['largest']}",
        percent(row["share_hit"]),
        f"{row['seeds']}",
        f"{one.training_trials:,.0f}",
        f"{one.wall_time:.1f}",
    ]


def radius_table(series: Sequence[Series]) -> list[list[str]]:
    """Return header and rows: mean trials and fraction of targets hit, at every hit radius."""
    radii = list(dict.fromkeys(one.hit_radius for one in series))
    rows: dict[str, list[str]] = {}
    for one in series:
        if one.main:
            rows.setdefault(one.label, [one.label]).append(f"{figure(one.mean)} ({percent(one.hit.mean())})")
    return [["mean trials (hit)", *(f"{radius:g} m" for radius in radii)], *rows.values()]


def convention_table(series: Sequence[Series]) -> list[list[str]]:
    """Return header and rows of the learners: mean trials and fraction of targets hit, by the policy's convention after
    a miss.
    """
    learned = [one for one in series if one.learned and one.hit_radius == series[0].hit_radius]
    conventions = list(dict.fromkeys(one.convention for one in learned))
    rows: dict[str, list[str]] = {}
    for one in learned:
        rows.setdefault(one.label, [one.label]).append(f"{figure(one.mean)} ({percent(one.hit.mean())})")
    return [["mean trials (hit)", *conventions], *rows.values()]


def as_markdown(table: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown with aligned columns."""
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in table
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def figure(value: float) -> str:
    """Return a mean number of trials as text; it is "1" only if every target was hit at the first strike."""
    value = round(value, 9)  # a mean of ones may not be one
    return f"{value:.4f}" if 1 < value < 1.01 else f"{value:.3g}" if value < 10 else f"{value:.1f}"


def percent(share: float) -> str:
    """Return a fraction as text in percent; it is "100 %" only if the fraction is 1."""
    return "100 %" if share == 1 else f"{min(100 * share, 99.9):.1f} %"


CONVENTION_NOTE = f"Learners strike with the policy's mean action first, after a miss with samples ({MAIN_CONVENTION})."


def difficulty_sentence(found: dict[str, Any]) -> str:
    """Return a sentence on the result of a `DifficultyUnit`."""
    return (
        f"One and the same strike hits {percent(found['one_strike_hits'])} of the targets; random strikes hit "
        f"{percent(found['random_strikes_hit'])}."
    )
