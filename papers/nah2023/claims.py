"""What the paper says, what of it the data show, and intervals of shares and medians over solutions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binom, binomtest

from papers.nah2023 import published
from whiptool.viz.report import Claim, verdict_over

LEVEL = 0.95


@dataclass(frozen=True)
class Share:
    """How many of some solutions have a property.

    Args:
        count: Count of those that have it.
        of: All.
    """

    count: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the share among all such solutions (Wilson 1927)."""
        if not self.of:
            return 0.0, 1.0
        found = binomtest(self.count, self.of).proportion_ci(LEVEL, method="wilson")
        return float(found.low), float(found.high)

    @property
    def most(self) -> bool:
        """Whether more than half of all have it, beyond the interval."""
        return self.interval[0] > 0.5

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.count} of {self.of} ({100 * low:.0f} to {100 * high:.0f} %)"


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Return the 95 % interval of a median, between two of the values in order; all of them where there are few.

    There has to be at least one.
    """
    ordered = np.sort(values)
    # fewer than k values lie below a median with a probability of 2.5 % at most: the k-th is then the lower end
    k = int(np.sum(binom.cdf(np.arange(len(ordered) // 2), len(ordered), 0.5) <= (1 - LEVEL) / 2))
    left_out = max(k - 1, 0)
    return float(ordered[left_out]), float(ordered[-1 - left_out])


def median_of(values: np.ndarray, unit: str = "", digits: int = 2) -> str:
    """Return a median with its interval, in words; of no values a dash."""
    if not len(values):
        return "-"
    low, high = median_interval(values)
    return f"{np.median(values):.{digits}g}{unit} ({low:.{digits}g} to {high:.{digits}g})"


def share_nearer(trials: int) -> float:
    """Return the share of trials that come nearer than the nearest of so many, which is not exceeded at 95 %.

    Whatever the distances' distribution is, that share is distributed as the least of so many uniform numbers.
    """
    return float(1 - (1 - LEVEL) ** (1 / trials))


PLANAR = 0.02  # a path is nearly planar if no more of its variance lies outside the nearest plane; the published
# strikes, which the authors call planar, have up to 0.017
HALF = 0.5  # a movement lies predominantly along an axis if more than this of its square does
FEW = 250  # evaluations, in the abstract
CLOSE = 0.3  # evaluations count as reproduced within this share of the published


def evaluations(results: Sequence[Mapping[str, Any]]) -> list[Claim]:
    """On DIRECT-L's evaluations by their rule, of the six targets."""
    counts = [f"{r['evaluations']}" + ("" if r["hit"] else f" (no hit, {r['best']:.4f} m)") for r in results]
    theirs = [str(n) for n in published.EVALUATIONS[:5]] + [f"{published.CAP} (no hit, {published.BEST[5]} m)"]
    few = {f"target {i + 1}": r["hit"] and r["evaluations"] < FEW for i, r in enumerate(results[:5])}
    close = {
        f"target {i + 1}": abs(r["evaluations"] / n - 1) <= CLOSE and r["hit"] == (i < 5)
        for i, (r, n) in enumerate(zip(results, published.EVALUATIONS, strict=True))
    }
    said = "targets 1 to 6: " + ", ".join(counts)
    return [
        Claim(
            f"Targets 1 to 5 are hit within fewer than {FEW} evaluations",
            "abstract: fewer than 250 iterations",
            said,
            verdict_over(few),
            "each of the five is hit, and before the 250th evaluation",
        ),
        Claim(
            "DIRECT-L's evaluations until the first hit",
            ", ".join(theirs),
            said,
            verdict_over(close),
            f"within {100 * CLOSE:.0f} % of the published number, at each target; target 6 is not hit",
        ),
    ]


def shares(
    name: str, paper: str, solutions: Sequence[Mapping[str, np.ndarray]], holds, reason: str, unit: str
) -> Claim:
    """Return a claim on a measure of the hand's movement.

    Args:
        name: Name of the claim, and after a colon of the measure.
        paper: What the paper says.
        solutions: By target: values by measure, shares from 0 to 1.
        holds: Whether it holds of a solution, from its value.
        reason: What decides.
        unit: What the shares are of.
    """
    text, measure = name.split(": ")
    found = {f"target {i + 1}": Share(int(holds(x[measure]).sum()), len(x[measure])) for i, x in enumerate(solutions)}
    said = "; ".join(
        f"{target}: median {median_of(100 * x[measure], ' %')} {unit}, holds of {share}"
        for (target, share), x in zip(found.items(), solutions, strict=True)
    )
    return Claim(text, paper, said, verdict_over({target: share.most for target, share in found.items()}), reason)


def planar(solutions: Sequence[Mapping[str, np.ndarray]]) -> Claim:
    """The hand's path lies in a plane."""
    return shares(
        "The hand moves nearly in a plane: outside",
        "abstract: essentially planar arm motions in extrinsic task-space coordinates",
        solutions,
        lambda x: x <= PLANAR,
        f"holds of a solution if at most {100 * PLANAR:g} % of the variance of the hand's places until D lies "
        "outside the nearest plane; of a target, if of more than half of its solutions, beyond the 95 % interval",
        "of the variance outside",
    )


def compliant(solutions: Sequence[Mapping[str, np.ndarray]]) -> list[Claim]:
    """Movements lie along the most compliant direction, at the hand and in the joints."""
    paper = "abstract: predominantly oriented along the most compliant direction of both task-space and joint-space"
    reason = "holds of a solution if more than half of the square lies along that axis; of a target, as above"
    at_hand, in_joints = "of the hand's squared velocity", "of the joints' squared deviation from their reference"
    return [
        shares(f"{text}: {name}", paper, solutions, lambda x: x > HALF, reason, unit)
        for text, name, unit in (
            ("The hand moves along the direction in which the arm's stiffness at the hand is least", "task", at_hand),
            ("The joints deviate along the direction in which their stiffness is least", "joint", in_joints),
        )
    ]


def sensitive(
    scaled: Sequence[np.ndarray], raw: Sequence[np.ndarray], noise: Sequence[Mapping[str, np.ndarray]]
) -> Claim:
    """A strike is most sensitive to D.

    Args:
        scaled, raw: By target: how far each parameter moves the tip's path, the last being D, (solutions, parameters),
            per width of the box, and per rad and s.
        noise: By target: mean miss under noise on `initial`, `final` and `D`, (solutions,) each.
    """
    ways = {
        "parameter by parameter, per width of the box": [_last_is_largest(x) for x in scaled],
        "parameter by parameter, per rad and per s": [_last_is_largest(x) for x in raw],
        "in the three groups of their robustness analysis": [
            Share(int((x["D"] > np.maximum(x["initial"], x["final"])).sum()), len(x["D"])) for x in noise
        ],
    }
    said = "; ".join(f"{way}: " + ", ".join(f"{share}" for share in found) for way, found in ways.items())
    holds = {way: all(share.most for share in found) for way, found in ways.items()}
    return Claim(
        "Striking a target is most sensitive to the duration D",
        "abstract",
        f"share of solutions of targets 1 to 6 of which D is the most sensitive: {said}",
        verdict_over(holds),
        "holds in a way of measuring if D is the most sensitive of more than half of the solutions at every target, "
        "beyond the 95 % interval",
    )


def _last_is_largest(values: np.ndarray) -> Share:
    return Share(int((values.argmax(axis=1) == values.shape[1] - 1).sum()), len(values))
