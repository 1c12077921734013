"""NLopt's global methods; DIRECT-L (Gablonsky and Kelley 2001, Sect. 2.3.6) is the paper's."""

from __future__ import annotations

import math

import nlopt
import numpy as np

from whiptool.objective import Objective

DIRECT_L = "GN_DIRECT_L"


def nlopt_names() -> list[str]:
    """NLopt's derivative-free global algorithms."""
    return sorted(name for name in vars(nlopt) if name.startswith("GN_"))


def nlopt_search(objective: Objective, *, seed: int, algorithm: str) -> None:
    """Minimise the miss distance until the objective stops it or the algorithm ends by itself.

    NLopt has one random generator per process, which is seeded here.

    Raises:
        SearchStopped: The objective ended the search.
    """
    lower, upper = objective.bounds.box
    optimizer = nlopt.opt(getattr(nlopt, algorithm), len(lower))
    optimizer.set_lower_bounds(lower)
    optimizer.set_upper_bounds(upper)
    if "DIRECT" not in algorithm:  # DIRECT takes tolerances as volumes, and needs none
        optimizer.set_xtol_rel(1e-8)
    nlopt.srand(seed)
    ended: list[BaseException] = []

    def cost(x: np.ndarray, gradient: np.ndarray) -> float:
        if not ended:  # some algorithms fill their first population before they see that they are to stop
            try:
                return objective.trial(objective.admissible(x[None])[0]).cost
            except BaseException as error:
                ended.append(error)
                optimizer.force_stop()
        return math.inf

    optimizer.set_min_objective(cost)
    try:
        optimizer.optimize((lower + upper) / 2)
    except nlopt.ForcedStop:
        raise ended[0] from None
    except nlopt.RoundoffLimited:
        pass  # as converged as it gets
    if ended:
        raise ended[0]
