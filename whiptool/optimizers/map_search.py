"""Search from a map: the strikes that the model's map has for the target, refined with the exact gradient."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from whiptool.errors import InputError
from whiptool.objective import Objective
from whiptool.optimizers.gradient_search import gradient_search, refine

if TYPE_CHECKING:
    from whiptool.strike_map import StrikeMap

REFINED = 8  # candidates of the map that are refined


def map_for(objective: Objective) -> StrikeMap:
    """Return the map that comes with the package for the model of an objective.

    Raises:
        InputError: The model has no map, or strikes are not in joint space.
    """
    from whiptool.strike_map.map_files import map_of

    if objective.space.kind != "joint":
        raise InputError("space of strikes", objective.space.kind, "joint, for a strike map")
    return map_of(objective.rollout.model)


def map_search(objective: Objective, *, seed: int) -> None:
    """Try and refine the strikes that the package's map gives for the target; if none reaches it, or if the objective
    has criteria, continue with `gradient_search`.

    Raises:
        InputError: See `map_for`.
        SearchStopped: The objective ended the search.
    """
    strikes = map_for(objective).candidates(objective.goals).strikes
    lower, upper = objective.bounds.box
    inside = strikes[((lower <= strikes) & (strikes <= upper)).all(axis=1)]
    for strike in islice((x for x in objective.admissible(inside) if objective.clear(x)), REFINED):
        objective.trial(strike)
        if refine(objective, strike) and not objective.criteria:
            return
    gradient_search(objective, seed=seed)
