"""Search from a map: the strikes that the model's map has for the target, refined with the exact gradient."""

from __future__ import annotations

from itertools import islice

from whiptool.errors import InputError
from whiptool.objective import Objective
from whiptool.optimizers.gradient_search import gradient_search, refine

REFINED = 8  # candidates of the map that are refined


def map_search(objective: Objective, *, seed: int) -> None:
    """Strike what the map that comes with the package has for the target, and refine it; then `gradient_search`.

    Raises:
        InputError: The model has no map, or strikes are not told by its joints.
        SearchStopped: The objective ended the search.
    """
    from whiptool.strike_map.shipped import map_of

    if objective.space.kind != "joint":
        raise InputError("space of strikes", objective.space.kind, "joint, for a strike map")
    found = map_of(objective.rollout.model).candidates(objective.goals)
    strikes = objective.admissible(found.strikes).clip(*objective.bounds.box)
    for strike in islice((x for x in strikes if objective.clear(x)), REFINED):
        objective.trial(strike)
        if refine(objective, strike) and not objective.criteria:
            return
    gradient_search(objective, seed=seed)
