"""Unknown whips: hits strike by strike, for a whip that is learned and for one that is not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.adaptation.loop import Adaptation, Options
from whiptool.adaptation.planner import FIRST, NEXT, Effort
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.prior import default_prior
from whiptool.adaptation.twins import FAMILIES, draw_twin
from whiptool.comparison import Scene
from whiptool.objective import HIT_RADIUS, Target
from whiptool.report import Section, Table, Text
from whiptool.reproduction.context import Context
from whiptool.zone import sample

METHODS = {
    "nominal": "the model's own best strike, repeated",
    "robust": "a strike robust to the prior, repeated",
    "adapt": "identified again and planned again after every strike",
    "wiggle": "the same, after a slow movement chosen for what it tells",
}
RADII = (0.06, 0.03, 0.01)  # [m]
STRIKES = 3
BRIEF = Effort(pool=96, polished=4, steps=4, whips=8, population=6, rounds=2)
_DRAWS = 50  # of a target, until it is within the whip's reach
_CLEAR = 0.05  # [m] by which it has to be
_BINS = 5


@dataclass(frozen=True, kw_only=True)
class AdaptUnit:
    """Strikes with one unknown whip at one target, its tip seen 60 times a second with 5 mm noise.

    Args:
        scene: The model that is believed, its controller, the zone of targets.
        family, seed: Of the whip.
        target: Number of the target.
        method: One of `METHODS`.
        strikes: How many.
        thorough: Plan with the usual effort; False: with little, to see that all works.
    """

    scene: Scene
    family: str
    seed: int
    target: int
    method: str
    strikes: int = STRIKES
    thorough: bool = True

    @property
    def name(self) -> str:
        """Whip, target, method."""
        brief = "" if self.thorough else "-brief"
        return f"adapt-{self.family}-{self.seed}-{self.target}-{self.method}-{self.strikes}{brief}"

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike."""
        scene = self.scene
        twin = draw_twin(self.family, self.seed, scene.model, scene.controller)
        rng = np.random.default_rng([scene.target_seed, self.seed, self.target])
        drawn = sample(scene.zone, _DRAWS, rng)
        within = np.flatnonzero(np.hypot(*drawn.T) <= twin.model.reach - _CLEAR)
        if not len(within):
            return {"excluded": True}
        x, y = (float(z) for z in drawn[within[0]])
        prior = default_prior(scene.model, scene.controller, whip="uniform" if self.method == "nominal" else "profile")
        if self.method == "nominal":  # nothing is uncertain
            prior = replace(prior, covariance=1e-8 * prior.covariance)
        options = Options(
            max_strikes=self.strikes,
            stop_at_hit=False,
            wiggle=self.method == "wiggle",
            adapt=self.method in ("adapt", "wiggle"),
            seed=self.seed,
            t_stay=scene.t_stay,
            first=FIRST if self.thorough else BRIEF,
            later=NEXT if self.thorough else BRIEF,
        )
        port = TipPort(twin, (x, y), t_stay=scene.t_stay)
        steps = [s for s in Adaptation(prior, port, Target((x, y), HIT_RADIUS), options).run() if s.number]
        return {
            "excluded": False,
            "target": [x, y],
            "miss": [s.outcome.miss for s in steps],
            "probability": [s.plan.probability for s in steps],
            "seconds": [s.plan.wall_time + (s.learned.wall_time if s.learned else 0.0) for s in steps],
            "refused": [sorted(s.learned.refused) if s.learned else [] for s in steps],
        }


def units(scene: Scene, *, whips: int, targets: int, thorough: bool = True) -> list[AdaptUnit]:
    """All of them: so many whips of each family, so many targets for each."""
    return [
        AdaptUnit(scene=scene, family=family, seed=seed, target=target, method=method, thorough=thorough)
        for family in FAMILIES
        for method in METHODS
        for seed in range(whips)
        for target in range(targets)
    ]


def sections(context: Context) -> list[Section]:
    """Hits by strike number, and stated beside observed probability of a hit."""
    whips, targets = (2, 1) if context.quick else (100, 3)
    work = units(context.comparison.scene, whips=whips, targets=targets, thorough=not context.quick)
    results = context.store.results(work, desc="unknown whips")  # type: ignore[arg-type]
    return [summarise(work, results)]


def summarise(work: list[AdaptUnit], results: dict[str, dict[str, Any]]) -> Section:
    """The tables.

    Args:
        work: What was done, the same number of strikes each.
        results: By the units' names.
    """
    strikes = work[0].strikes
    header = ["family", "method", "whips x targets", *(f"hits at strike {i + 1}" for i in range(strikes))]
    header += [f"median miss {i + 1} [cm]" for i in range(strikes)]
    header += [f"hit within {strikes} at {100 * r:g} cm" for r in RADII]
    rows, excluded = [header], 0
    stated, observed = [], []
    for family in FAMILIES:
        for method in dict.fromkeys(unit.method for unit in work):
            all_of = [results[u.name] for u in work if (u.family, u.method) == (family, method)]
            done = [r for r in all_of if not r["excluded"]]
            excluded += len(all_of) - len(done)
            if not done:
                continue
            miss = np.array([[np.inf if x is None else x for x in r["miss"]] for r in done])  # (trials, strikes)
            hits = miss <= HIT_RADIUS
            rows.append(
                [
                    family,
                    method,
                    str(len(done)),
                    *(f"{100 * x:.0f} ± {100 * _error(x, len(done)):.0f} %" for x in hits.mean(axis=0)),
                    *(f"{100 * x:.2f}" for x in np.median(miss, axis=0)),
                    *(f"{100 * (miss <= r).any(axis=1).mean():.0f} %" for r in RADII),
                ]
            )
            if method in ("adapt", "wiggle"):
                stated += np.ravel([r["probability"] for r in done]).tolist()
                observed += hits.ravel().tolist()
    parts: list[Any] = [
        Text(
            "Whips that are not the model, drawn by seed: `kin` has other k, b, m, l; `strange` has 36 nodes, tapers, "
            "a bead, a soft joint, drag, friction, a wrong arm and a late camera; `stranger` deviates twice as much. "
            "The tip is seen 60 times a second with 5 mm noise; there are no servos. These are twins: published misses "
            "(3.6 cm without a second strike, 2 cm after up to nine) and people's (6 cm after two throws) are of real "
            "whips. "
            + " ".join(f"`{name}`: {what}." for name, what in METHODS.items())
            + (f" {excluded} trials had no target within the whip's reach." if excluded else "")
        ),
        Table(rows, caption=f"Hits at {100 * HIT_RADIUS:g} cm, with one standard error, and misses by strike number"),
    ]
    if stated:
        table, error = reliability(np.array(stated), np.array(observed))
        parts.append(Table(table, caption=f"Stated probability of a hit and what came; calibration error {error:.2f}"))
    return Section("Unknown whips, strike by strike", parts)


def reliability(stated: np.ndarray, observed: np.ndarray) -> tuple[list[list[str]], float]:
    """Rows of stated against observed frequency, and the expected calibration error (Naeini et al. 2015).

    Args:
        stated: Probabilities, (T,).
        observed: Whether it came, (T,).
    """
    which = np.minimum((stated * _BINS).astype(int), _BINS - 1)
    rows, error = [["stated", "mean stated", "observed", "strikes"]], 0.0
    for i in range(_BINS):
        inside = which == i
        if inside.any():
            mean, came = float(stated[inside].mean()), float(observed[inside].mean())
            error += float(inside.mean()) * abs(mean - came)
            rows.append([f"{i / _BINS:.1f} to {(i + 1) / _BINS:.1f}", f"{mean:.2f}", f"{came:.2f}", str(inside.sum())])
    return rows, error


def _error(share: float, count: int) -> float:
    """One standard error of a share."""
    return float(np.sqrt(share * (1 - share) / count))
