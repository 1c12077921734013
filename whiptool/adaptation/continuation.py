"""Numerical continuation: a strike that hits with one whip is corrected while the whip changes into another one.

Near a robot's limits, few strikes hit a goal from its direction, and a search from random strikes can miss them all.
The strike of a map hits with the map's whip; a little different whip needs a little different strike (Allgower and
Georg, Introduction to Numerical Continuation Methods, SIAM 2003).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.models.whip import WhipParameters
from whiptool.strike_map.striker import Striker, refine

FIRST_STEP, LEAST_STEP = 1 / 4, 1 / 64  # of the way from one whip to the other


def between(first: WhipParameters, last: WhipParameters, share: float) -> WhipParameters:
    """Return the whip whose parameters are, at each node, weighted means of those of two whips with equally many nodes;
    `share`, 0 to 1, is the weight of the last.
    """
    mixed: dict[str, Any] = {}
    for name in (f.name for f in fields(last) if f.name not in ("N", "joints")):
        per_node = isinstance(getattr(first, name), tuple) or isinstance(getattr(last, name), tuple)
        ends = (whip.per_node(name) if per_node else getattr(whip, name) for whip in (first, last))
        start, end = map(np.asarray, ends)
        mean = (1 - share) * start + share * end
        mixed[name] = tuple(mean.tolist()) if per_node else float(mean)
    return replace(last, **mixed)


def continued(
    strikes: np.ndarray,
    first: WhipParameters,
    last: WhipParameters,
    goal: Goals,
    striker_of: Callable[[WhipParameters], Striker],
) -> np.ndarray:
    """Return the strikes (C, m) that hit a single goal with the last whip and keep the limits, followed from strikes
    (B, m) that hit with the first; some, or all, are lost on the way.
    """
    alike = (first.N, first.joints) == (last.N, last.joints)
    done, step, kept = 0.0, FIRST_STEP, strikes if alike else strikes[:0]
    while done < 1 and len(kept):
        share = min(1.0, done + step)
        found = refine(striker_of(between(first, last, share)), goal.rows(np.zeros(len(kept), int)), kept)
        hit = found.struck.hit
        if hit.any():
            done, kept = share, found.strikes[hit]
        elif (step := step / 2) < LEAST_STEP:
            return strikes[:0]
    return kept
