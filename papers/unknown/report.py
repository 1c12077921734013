"""Unknown whips in the plane or in space: how often the command `adapt` hits them by strike 1, 2, ...

Stated probabilities and predicted misses are scored against what came.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from papers.context import Context
from papers.unknown.study import MATERIALS, PLANE, REGIONS, ROPE, SPACE, WAYS, WhipUnit, families
from whiptool import Target
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.viz.style import COLORS, STYLE
from whiptool.words import counted, fixed, rounded

BINS = 5  # of stated probabilities
_LOST = 1.0  # [m] that a miss counts as at most in the continuous ranked probability score


@dataclass(frozen=True)
class Forecast:
    """What was stated about one strike beforehand, and what came.

    Args:
        probability: Stated hit probability.
        misses: Predictive sample of the miss distance [m]; None for a sample that diverges.
        miss: True miss distance [m]; None: there was none.
        hit: Whether it hit.
    """

    probability: float
    misses: Sequence[float | None]
    miss: float | None
    hit: bool


@dataclass(frozen=True)
class Scores:
    """Proper scores of probabilities (Gneiting and Raftery 2007), and how often predicted misses were kept.

    Args:
        count: Strikes.
        hits: Share that hit.
        brier, log: Mean square error of the stated probability, and mean negative logarithm of what was stated of that
            which came; smaller is better.
        brier_constant, log_constant: The same of the best constant forecast, which is the share of hits, known
            afterwards.
        within: Share of true misses up to the 50 % and the 90 % quantile of the predictive sample.
        crps, crps_constant: Mean continuous ranked probability score of the predicted misses [m], and that of the best
            constant forecast, the sample of all true misses, known afterwards; smaller is better.
        beyond: Share of true misses beyond all of the sample; of a sample of n, 1 / (n + 1) is to be expected.
    """

    count: int
    hits: float
    brier: float
    brier_constant: float
    log: float
    log_constant: float
    within: tuple[float, float]
    beyond: float
    crps: float
    crps_constant: float

    @classmethod
    def of(cls, forecasts: Sequence[Forecast]) -> Scores:
        """Of any number of strikes, at least one."""
        stated = np.array([f.probability for f in forecasts])
        hit = np.array([f.hit for f in forecasts])
        share = float(hit.mean())
        ranks = np.array([_rank(f) for f in forecasts])
        misses = np.array([_capped([f.miss])[0] for f in forecasts])
        return cls(
            count=len(forecasts),
            hits=share,
            brier=brier_score(stated, hit),
            brier_constant=brier_score(np.full(len(hit), share), hit),
            log=log_score(stated, hit),
            log_constant=log_score(np.full(len(hit), share), hit),
            within=(float(np.mean(ranks <= 0.5)), float(np.mean(ranks <= 0.9))),
            beyond=float(np.mean(ranks >= 1)),
            crps=float(np.mean([crps(_capped(f.misses), miss) for f, miss in zip(forecasts, misses, strict=True)])),
            crps_constant=spread(misses) / 2,
        )


def brier_score(stated: np.ndarray, came: np.ndarray) -> float:
    """Return the mean of `(stated - came)^2`; both (T,)."""
    return float(np.mean((stated - came) ** 2))


def log_score(stated: np.ndarray, came: np.ndarray) -> float:
    """Return the mean of `-log` of the probability that was stated of what came; infinite where that was 0."""
    of_what_came = np.where(came, stated, 1 - stated)
    with np.errstate(divide="ignore"):
        return float(-np.mean(np.log(of_what_came)))


def crps(sample: np.ndarray, came: float) -> float:
    """Return the continuous ranked probability score of a predictive sample (S,) for what came, in their unit: the mean
    distance from it less half the mean distance within the sample (Gneiting and Raftery 2007, Eq. 21)."""
    return float(np.mean(np.abs(sample - came))) - spread(sample) / 2


def spread(sample: np.ndarray) -> float:
    """Return the mean distance between two draws, with replacement, from a sample (S,), in its unit."""
    S = len(sample)
    return float(2 * np.sort(sample) @ (2 * np.arange(S) + 1 - S) / S**2)


def _capped(misses: Sequence[float | None]) -> np.ndarray:
    """Misses [m], (S,), those of strikes that diverge or miss by more at `_LOST`."""
    return np.array([_LOST if x is None else min(x, _LOST) for x in misses])


def reliability(stated: np.ndarray, came: np.ndarray) -> float:
    """Return the expected calibration error of stated probabilities, (T,), against what came, (T,), in `BINS` bins."""
    which = np.minimum((stated * BINS).astype(int), BINS - 1)
    inside = [which == i for i in range(BINS) if (which == i).any()]
    return float(sum(abs(stated[x].mean() - came[x].mean()) * x.mean() for x in inside))


def _rank(forecast: Forecast) -> float:
    """Share of the predictive sample below the true miss."""
    sample = np.array([np.inf if x is None else x for x in forecast.misses])
    miss = np.inf if forecast.miss is None else forecast.miss
    return float(np.mean(sample < miss))


SHOWN = 3  # strikes of which a table tells
_LINES: dict[str, str] = dict(zip((*families(PLANE), ROPE), ("blue", "orange", "vermilion", "black"), strict=True))
Strikes = Sequence[Mapping[str, Any]]  # of one trial
Trials = Sequence[Strikes]
ByWay = Mapping[tuple[str, str], Trials]  # by way and family


def sections(context: Context) -> list[Section]:
    """What was run, hits by strike, misses, and whether the stated probabilities came true."""
    model = SPACE if context.space else PLANE
    ways = [way for way in WAYS if way in context.rows]
    whips, goals = (1, 1) if context.quick else (context.whips, context.whip_targets)
    units = [
        WhipUnit(model=model, family=family, seed=seed, way=way, goals=goals, brief=context.quick)
        for seed in range(whips)  # a killed run has about as many of each family
        for family in families(model)
        for way in ways
    ]
    results = context.results(units, "unknown whips")
    trials = {
        (way, family): [
            t["struck"] for u in units if (u.way, u.family) == (way, family) for t in results[u.key]["trials"]
        ]
        for way in ways
        for family in families(model)
    }
    found = {of: some for of, some in trials.items() if some}
    return [
        Section(
            "Unknown whips, strike by strike",
            [
                Text(_about(model, whips, goals, ways)),
                Table(hits_table(model, found), "Share of trials with a hit by strike 1, 2, ...; misses of strike 1."),
                Picture(
                    _misses(model, found, ways), "Share of first strikes that miss by no more; dashed: the hit radius."
                ),
            ],
        ),
        Section(
            "Stated probabilities and misses, scored",
            [
                Text(_CALIBRATION),
                Table(
                    scores_table(found),
                    "Scores of what was stated of first and of later strikes, and of the best constant forecast.",
                ),
            ],
        ),
    ]


def _about(model: str, whips: int, goals: int, ways: Sequence[str]) -> str:
    of_space = (
        f" {ROPE}: a Cosserat rod in PyElastica that stretches and twists, with a knot and a late clock. Goals are "
        "those of the robot's map: points in a shell around its base, above the floor, each with an arrival angle; a "
        "hit is within 5 cm and 10 degrees, at 1 m/s or more."
    )
    return (
        f"{counted(whips, 'whip')} of each family, of {', '.join(MATERIALS[model])} in turn, struck at "
        f"{counted(goals, 'goal')} each within reach. Each trial is a run of `python -m whiptool.adapt --model "
        f"{model} --camera tip --material NAME` with its other options as usual: the tip is seen 60 times a second, "
        "with 5 mm noise. A trial ends at the first true hit, or where the command ends by itself. kin: uniform whips. "
        "strange: 36 nodes, a cone with random deviations, a bead, a soft joint, springs that stiffen with the bend, "
        "uneven friction and drag, a late camera, in the plane another arm. stranger: twice these deviations."
        + (of_space if model == SPACE else f" Hits are within {100 * REGIONS[model].hit_radius:g} cm.")
        + "".join(f" {way}: {WAYS[way]}." for way in ways)
    )


def hit_by(trials: Trials, strike: int) -> float:
    """Return the share of trials with a hit by a strike, counted from 1."""
    return float(np.mean([any(x["hit"] for x in struck[:strike]) for struck in trials]))


def hits_table(model: str, found: ByWay) -> list[list[str]]:
    """Return hits by strike and the misses of first strikes, by way and family."""
    near = Target(hit_radius=REGIONS[model].hit_radius).goals.hit
    head = ["way", "family", "trials", *(f"hit by {i + 1}" for i in range(SHOWN))]
    head += ["first strike by distance alone", "its miss: median, 95 % [mm]", "never hit"]
    rows = [[*head, "plan of the first strike: median, 90 % [s]"]]
    for (way, family), trials in found.items():
        first = 1e3 * misses(trials)
        seconds = [struck[0]["seconds"] for struck in trials if struck]
        rows.append(
            [
                way,
                family,
                str(len(trials)),
                *(f"{100 * hit_by(trials, i + 1):.0f} %" for i in range(SHOWN)),
                f"{100 * np.mean(near(1e-3 * first)):.0f} %",
                ", ".join(fixed(x, 1) for x in (np.median(first), np.percentile(first, 95, method="higher"))),
                str(sum(not any(x["hit"] for x in struck) for struck in trials)),
                ", ".join(rounded(float(x), 2) for x in np.percentile(seconds, (50, 90))) if seconds else "",
            ]
        )
    return rows


def misses(trials: Trials) -> np.ndarray:
    """Return the true misses of first strikes [m]; infinite where there was none."""
    return np.array([np.inf if not x or x[0]["miss"] is None else x[0]["miss"] for x in trials])


def _misses(model: str, found: ByWay, ways: Sequence[str]) -> Figure:
    radius = REGIONS[model].hit_radius
    with matplotlib.rc_context(STYLE):
        figure = Figure((4.6 * len(ways), 3.8), layout="constrained")
        axes = figure.subplots(1, len(ways), sharey=True, squeeze=False)[0]
        for ax, way in zip(axes, ways, strict=True):
            for family in (f for w, f in found if w == way):
                miss = np.sort(100 * misses(found[way, family]))
                share = 100 * np.arange(1, len(miss) + 1) / len(miss)
                ax.step(np.maximum(miss, 1e-3), share, where="post", color=COLORS[_LINES[family]], label=family)
            ax.axvline(100 * radius, color="0.4", linestyle="--", linewidth=1.2)
            ax.set(xscale="log", xlabel="miss [cm]", ylim=(0, 102), title=WAYS[way].split(",")[0])
            ax.xaxis.set_major_formatter("{x:g}")
        axes[0].set_ylabel("first strikes [%]")
        axes[0].legend()
    return figure


_CALIBRATION = (
    "The planner states the probability of a hit for every strike. The calibration error is the mean distance between "
    "it and the share that hit, over strikes with about the same probability (Naeini et al. 2015). Where nearly all "
    "strikes hit it says little; the Brier and the log score say more, next to those of the best constant forecast "
    "(the share of hits, known afterwards), and so does where the true miss lies in the predictive sample. A trial "
    "ends at its first hit, so that later strikes are those after a miss."
)


def scores_table(found: ByWay) -> list[list[str]]:
    """Return the scores of what was stated of first and of later strikes, by way, of each family and of all."""
    head = ["way", "family", "which", "strikes", "stated", "hit", "calibration error", "Brier", "constant", "log"]
    rows = [[*head, "constant", "CRPS [mm]", "constant", "miss within 50 %", "within 90 %", "beyond all samples"]]
    for (way, family), trials in {**found, **_pooled(found)}.items():
        for which, some in (("first", slice(1)), ("later", slice(1, None))):
            strikes = [x for struck in trials for x in struck[some]]
            known = [Forecast(x["probability"] or 0.0, x["misses"], x["miss"], x["hit"]) for x in strikes]
            if known:
                rows.append([way, family, which, *_scored(known)])
    return rows


def _pooled(found: ByWay) -> ByWay:
    """Trials of all families together, by way: what is stated is the same for all where a look cannot tell them."""
    ways = dict.fromkeys(way for way, _ in found)
    return {
        (way, "all"): [struck for (of, _), trials in found.items() if of == way for struck in trials] for way in ways
    }


def _scored(known: Sequence[Forecast]) -> list[str]:
    s = Scores.of(known)
    stated, hit = (np.array([getattr(f, name) for f in known]) for name in ("probability", "hit"))
    said = [str(s.count), *(f"{100 * x:.0f} %" for x in (stated.mean(), s.hits))]
    said += [f"{x + 0.0:.3f}" for x in (reliability(stated, hit), s.brier, s.brier_constant, s.log, s.log_constant)]
    said += [f"{1e3 * x:.1f}" for x in (s.crps, s.crps_constant)]
    return [*said, *(f"{100 * x:.0f} %" for x in (*s.within, s.beyond))]
