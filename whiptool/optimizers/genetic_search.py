"""Genetic algorithm with the paper's operators (Sect. 2.3.7) through pymoo, a generation being one batch of strikes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.models.parameters import number, whole
from whiptool.objective import Objective


@dataclass(frozen=True, kw_only=True)
class GASettings:
    """Sizes and rates, none of which the paper prints; usual values.

    Args:
        population: Individuals of a generation.
        tournament: Individuals among which the fittest is selected.
        crossover: Probability that two parents are crossed (simulated binary crossover).
        crossover_eta, mutation_eta: Distribution indices; larger: children nearer to their parents.
        mutation: Probability that a gene mutates (polynomial mutation).
        d_max: D_max of Eq. 20 [m]; None: reach plus the target's distance, farther than any miss.
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
    """Eq. 20: 1 for a hit of the target itself, 0 at the farthest miss."""
    return (d_max - np.asarray(distance)) / d_max  # Eq. 20


def genetic_search(objective: Objective, *, seed: int, settings: GASettings | None = None) -> None:
    """Evolve random strikes by selection, crossover and mutation until the objective stops it, or no child is new.

    Raises:
        SearchStopped: The objective ended the search.
    """
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.operators.crossover.sbx import SBX
    from pymoo.operators.mutation.pm import PM
    from pymoo.operators.sampling.rnd import FloatRandomSampling
    from pymoo.operators.selection.tournament import TournamentSelection
    from pymoo.problems.static import StaticProblem

    s = settings or GASettings()
    d_max = objective.penalty if s.d_max is None else s.d_max
    lower, upper = objective.bounds.box
    box = Problem(n_var=len(lower), n_obj=1, xl=np.zeros(len(lower)), xu=np.ones(len(lower)))

    def fittest(population, rivals: np.ndarray, **_) -> np.ndarray:
        """Of each row of rivals the one with the least -f, as a column."""
        values = population.get("F")[rivals, 0]
        return rivals[np.arange(len(rivals)), values.argmin(axis=1)][:, None]

    algorithm = GA(
        pop_size=s.population,
        sampling=FloatRandomSampling(),
        selection=TournamentSelection(func_comp=fittest, pressure=s.tournament),
        crossover=SBX(prob=s.crossover, eta=s.crossover_eta),
        mutation=PM(prob=1.0, prob_var=s.mutation, eta=s.mutation_eta),
    )
    # pymoo takes seed 0 for the time of day
    algorithm.setup(
        box, seed=int(np.random.default_rng(seed).integers(1, 2**31)), verbose=False, termination=("n_gen", 10**9)
    )
    while True:
        generation = algorithm.ask()
        if generation is None:  # no child differs from what was tried
            return
        strikes = objective.admissible(lower + np.clip(generation.get("X"), 0, 1) * (upper - lower))
        misses = np.array([outcome.cost for outcome in objective.batch(strikes)])
        Evaluator().eval(StaticProblem(box, F=-fitness(misses, d_max)[:, None]), generation)
        algorithm.tell(infills=generation)
