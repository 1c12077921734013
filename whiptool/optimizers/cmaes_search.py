"""CMA-ES (Hansen and Ostermeier 2001) through pymoo, a generation being one batch of strikes."""

from __future__ import annotations

import numpy as np

from whiptool.objective import Objective

SIGMA = 0.3  # first step size, in units of the box


def cmaes_search(objective: Objective, *, seed: int) -> None:
    """Restart CMA-ES from random strikes until the objective stops it.

    The implementation below pymoo draws from NumPy's global generator, which is put back as it was, and takes seed 0
    for the time of day, which is avoided.

    Raises:
        SearchStopped: The objective ended the search.
    """
    from pymoo.algorithms.soo.nonconvex.cmaes import CMAES
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.problems.static import StaticProblem

    lower, upper = objective.bounds.box
    rng = np.random.default_rng(seed)
    box = Problem(n_var=len(lower), n_obj=1, xl=np.zeros(len(lower)), xu=np.ones(len(lower)))
    outside = np.random.get_state()  # noqa: NPY002
    try:
        while True:
            algorithm = CMAES(x0=rng.uniform(0.2, 0.8, len(lower)), sigma=SIGMA, restarts=0)
            algorithm.setup(box, seed=int(rng.integers(1, 2**31)), verbose=False)
            while algorithm.has_next():
                generation = algorithm.ask()
                if generation is None or len(generation) == 0:
                    break
                strikes = objective.admissible(lower + np.clip(generation.get("X"), 0, 1) * (upper - lower))
                costs = np.array([outcome.cost for outcome in objective.batch(strikes)])
                Evaluator().eval(StaticProblem(box, F=costs[:, None]), generation)
                algorithm.tell(infills=generation)
    finally:
        np.random.set_state(outside)  # noqa: NPY002
