"""Evolutionary searches through pymoo, a generation being one batch of strikes.

CMA-ES (Hansen and Ostermeier 2001), and the genetic algorithm with the paper's operators (Sect. 2.3.7).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import number, whole
from whiptool.objective import Objective

SIGMA = 0.3  # first step size of CMA-ES, in units of the box


@dataclass(frozen=True, kw_only=True)
class GASettings:
    """Sizes and rates of the genetic algorithm; the paper does not state them, so these are common values.

    Args:
        population: Number of individuals in a generation.
        tournament: Number of individuals among which the fittest is selected.
        crossover: Probability that two parents are crossed (simulated binary crossover).
        crossover_eta, mutation_eta: Distribution indices; children are nearer to their parents with larger indices.
        mutation: Probability that a gene mutates (polynomial mutation).
        d_max: D_max of Eq. 20 [m]; None: reach plus the target's distance, an upper bound of any miss.
    """

    population: int = 20
    tournament: int = 2
    crossover: float = 0.9
    crossover_eta: float = 15.0
    mutation: float = 0.2
    mutation_eta: float = 20.0
    d_max: float | None = None

    def __post_init__(self) -> None:
        whole("population", self.population, low=4, high=1_000_000)
        whole("tournament", self.tournament, high=self.population)
        for name in ("crossover", "mutation"):
            number(name, getattr(self, name), low=0, high=1)
        if self.crossover == self.mutation == 0:
            raise InputError("crossover, mutation", (0, 0), "one of them > 0", "children would be like their parents")
        for name in ("crossover_eta", "mutation_eta"):
            number(name, getattr(self, name), low=0, high=1e3)
        if self.d_max is not None:
            number("d_max", self.d_max, low=0, high=1e6, strict=True)


def fitness(distance: np.ndarray, d_max: float) -> np.ndarray:
    """Return the fitness (Eq. 20) of distances [m], any shape: 1 at the target itself, 0 at the farthest miss."""
    return (d_max - np.asarray(distance)) / d_max  # Eq. 20


def genetic_search(objective: Objective, *, seed: int, settings: GASettings | None = None) -> None:
    """Evolve random strikes by selection, crossover and mutation until the objective stops it, or no child is new.

    Raises:
        SearchStopped: The objective ended the search.
    """
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.mutation.pm import PM
    from pymoo.operators.sampling.rnd import FloatRandomSampling
    from pymoo.operators.selection.tournament import TournamentSelection

    s = settings or GASettings()
    d_max = objective.penalty if s.d_max is None else s.d_max

    def fittest(population, rivals: np.ndarray, **_) -> np.ndarray:
        """Of each row of rivals the one with the least -f, as a column."""
        values = population.get("F")[rivals, 0]
        return rivals[np.arange(len(rivals)), values.argmin(axis=1)][:, None]

    algorithm: Any = GA(
        pop_size=s.population,
        sampling=FloatRandomSampling(),
        selection=TournamentSelection(func_comp=fittest, pressure=s.tournament),
        crossover=SBX(prob=s.crossover, eta=s.crossover_eta),
        mutation=PM(prob=1.0, prob_var=s.mutation, eta=s.mutation_eta),
    )
    algorithm.termination = ("n_gen", 10**9)
    _evolve(objective, algorithm, np.random.default_rng(seed), lambda costs: -fitness(costs, d_max))


def cmaes_search(objective: Objective, *, seed: int) -> None:
    """Restart CMA-ES from random strikes until the objective stops it.

    The implementation below pymoo draws from NumPy's global generator, which is put back as it was.

    Raises:
        SearchStopped: The objective ended the search.
    """
    from pymoo.algorithms.soo.nonconvex.cmaes import CMAES

    rng = np.random.default_rng(seed)
    outside = np.random.get_state()  # noqa: NPY002
    try:
        while True:
            algorithm = CMAES(x0=rng.uniform(0.2, 0.8, len(objective.bounds.box[0])), sigma=SIGMA, restarts=0)
            _evolve(objective, algorithm, rng, lambda costs: costs)
    finally:
        np.random.set_state(outside)  # noqa: NPY002


def _evolve(
    objective: Objective, algorithm: Any, rng: np.random.Generator, minimised: Callable[[np.ndarray], np.ndarray]
) -> None:
    """Show a pymoo algorithm what its generations in the unit box come to, until it ends or has no new strike.

    Args:
        objective: Rolls out.
        algorithm: To run.
        rng: Gives its seed, but never 0, which pymoo takes for the time of day.
        minimised: Function of the costs of strikes that the algorithm minimises.
    """
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.problems.static import StaticProblem

    lower, upper = objective.bounds.box
    box = Problem(n_var=len(lower), n_obj=1, xl=np.zeros(len(lower)), xu=np.ones(len(lower)))
    algorithm.setup(box, seed=int(rng.integers(1, 2**31)), verbose=False)
    while algorithm.has_next():
        generation = algorithm.ask()
        if generation is None or len(generation) == 0:
            return
        strikes = objective.admissible(lower + np.clip(generation.get("X"), 0, 1) * (upper - lower))
        costs = np.array([outcome.cost for outcome in objective.batch(strikes)])
        Evaluator().eval(StaticProblem(box, F=minimised(costs)[:, None]), generation)
        algorithm.tell(infills=generation)
