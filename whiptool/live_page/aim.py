"""The strike for a target: from the map of the model's preset, else from random strikes, refined by simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from whiptool.goals.target import Target
from whiptool.live_page.heat_map import Sampled
from whiptool.models.parameters import Model
from whiptool.models.presets import PRESETS
from whiptool.strike_map.map_files import shipped_map, shipped_names
from whiptool.strike_map.strike_map import REFINED, StrikeMap
from whiptool.strike_map.striker import Striker, refine

TRIED = 4  # entries of the map that are refined at first at most, one after the other
_NEAREST = 3  # random strikes that are refined
_STEPS = 10  # of a refinement


@dataclass(frozen=True, eq=False)
class Aimed:
    """A strike that was found for a target.

    Args:
        strike: Strike vector, (m,).
        hit: Whether it hits within the limits.
        source: Where it came from, in words.
    """

    strike: np.ndarray
    hit: bool
    source: str


def map_name(model: Model) -> str | None:
    """Return the name of the preset with a map that a model is; None: the model has no map."""
    return next((name for name in shipped_names() if PRESETS[name] == model), None)


def aimed(
    striker: Striker, target: Target, *, of_map: str | None, others: Callable[[], Sampled], present: np.ndarray | None
) -> Aimed:
    """Return the best strike that is found for a target.

    Args:
        striker: Simulator of strikes of the model, which may differ from that of the map.
        target: The target.
        of_map: Name of the preset whose map is used; None: no map is used.
        others: Function that returns random strikes, which are used without a map, or where its strikes miss.
        present: Strike vector (m,) that is kept if nothing better is found.
    """
    found = None if of_map is None else _from_map(striker, target, of_map, tried=TRIED)
    if found is not None and found.hit:
        return found
    starts = np.empty((0, len(striker.lower)))
    if np.linalg.norm(target.position) <= striker.rollout.model.reach + target.hit_radius:  # nothing hits elsewhere
        starts = others().nearest(target.goals, _NEAREST)
    drawn = len(starts)
    if present is not None:
        starts = np.concatenate([starts, present[None]])
    mine = _from_starts(striker, target, starts, drawn)
    if of_map is None or found is None or mine.hit:
        return mine
    if shipped_map(of_map).region.zone.contains(np.array([target.position]))[0]:  # all entries, which takes long
        return _from_map(striker, target, of_map, tried=REFINED)
    return found


def _from_starts(striker: Striker, target: Target, starts: np.ndarray, drawn: int) -> Aimed:
    """Return the best strike that is refined from some (B, m), of which so many were drawn at random."""
    if not len(starts):
        return Aimed(striker.admissible((striker.lower + striker.upper)[None] / 2)[0], False, "no strike")
    refined = refine(striker, target.goals.rows(np.zeros(len(starts), int)), starts, steps=_STEPS)
    best = int(np.lexsort([refined.struck.cost, ~refined.struck.hit])[0])
    source = "random strikes, refined" if best < drawn else "the strike before, refined"
    return Aimed(refined.strikes[best], bool(refined.struck.hit[best]), source)


def _from_map(striker: Striker, target: Target, name: str, *, tried: int) -> Aimed:
    """Return the strike that is refined from the entries of a map, of which so many are tried."""
    shipped = shipped_map(name)
    refined = StrikeMap(striker, shipped.region, shipped.answers, shipped.gate).refined(target.goals, tried=tried)
    return Aimed(refined.strikes[0], bool(refined.struck.hit[0]), f"the map of {name}, refined")
