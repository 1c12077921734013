"""Searches without derivatives: random strikes, NLopt's global methods, evolutionary methods, and learners."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import nlopt
import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.models.numbers import number, whole
from whiptool.objective import Objective


def random_search(objective: Objective, *, seed: int) -> None:
    """Try strikes that are drawn uniformly within the bounds, and shortened so that commands keep the joints' limits.

    The function never returns: the objective ends the search by an exception.
    """
    if objective.max_trials is None and objective.max_time is None:
        raise InputError(
            "max trials",
            None,
            "a number of trials or seconds, for a method that never ends by itself",
            "give max_trials or max_time",
        )
    rng = np.random.default_rng(seed)
    while True:
        objective.trial(objective.admissible(objective.bounds.sample(rng, 1))[0])


DIRECT_L = "GN_DIRECT_L"


def nlopt_names() -> list[str]:
    """Return the names of NLopt's derivative-free global algorithms."""
    return sorted(name for name in vars(nlopt) if name.startswith("GN_"))


def nlopt_search(objective: Objective, *, seed: int, algorithm: str) -> None:
    """Minimise the miss distance until the objective stops the search or the algorithm ends.

    NLopt has one random generator per process, which is seeded here.
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
            raise InputError(
                "crossover, mutation", (0, 0), "at least one > 0", "otherwise children equal their parents"
            )
        for name in ("crossover_eta", "mutation_eta"):
            number(name, getattr(self, name), low=0, high=1e3)
        if self.d_max is not None:
            number("d_max", self.d_max, low=0, high=1e6, strict=True)


def fitness(distance: np.ndarray, d_max: float) -> np.ndarray:
    """Return the fitness (Eq. 20) of distances [m], any shape: 1 at the target, 0 at a miss of `d_max`."""
    return (d_max - np.asarray(distance)) / d_max  # Eq. 20


def genetic_search(objective: Objective, *, seed: int, settings: GASettings | None = None) -> None:
    """Evolve random strikes by selection, crossover and mutation until the objective stops the search, or no child is
    new.
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
    m = len(objective.bounds.box[0])
    box = Problem(n_var=m, n_obj=1, xl=np.zeros(m), xu=np.ones(m))
    algorithm.setup(box, seed=int(np.random.default_rng(seed).integers(1, 2**31)), verbose=False)
    while (generation := algorithm.ask()) is not None and len(generation):
        values = -fitness(_costs(objective, generation.get("X")), d_max)
        Evaluator().eval(StaticProblem(box, F=values[:, None]), generation)
        algorithm.tell(infills=generation)


def cmaes_search(objective: Objective, *, seed: int) -> None:
    """Restart CMA-ES from random strikes until the objective stops the search."""
    from cmaes import CMA  # each search draws from its own generator

    rng, box = np.random.default_rng(seed), np.tile([0.0, 1.0], (len(objective.bounds.box[0]), 1))
    while True:
        start = rng.uniform(0.2, 0.8, len(box))
        _costs(objective, start[None])
        algorithm = CMA(start, SIGMA, bounds=box, seed=int(rng.integers(2**31)))
        while not algorithm.should_stop():
            generation = np.array([algorithm.ask() for _ in range(algorithm.population_size)])
            algorithm.tell(list(zip(generation, _costs(objective, generation).tolist(), strict=True)))


def _costs(objective: Objective, generation: np.ndarray) -> np.ndarray:
    """Return the costs (B,) [m] of strikes (B, m) that are given in the unit box."""
    lower, upper = objective.bounds.box
    strikes = objective.admissible(lower + np.clip(generation, 0, 1) * (upper - lower))
    return np.array([outcome.cost for outcome in objective.batch(strikes)])


BATCH = 10  # strikes between updates
RANDOM_BATCHES = 2  # before the policy strikes
UPDATES = 4  # of an off-policy learner per strike: a trial costs more than an update


def gain(costs: np.ndarray, hits: np.ndarray) -> np.ndarray:
    """Return the rewards (Eq. 17) for costs [m] and hits, of the same shape. Hits that are ranked by a criterion have
    negative costs; their reward is multiplied by the magnitude of the cost.
    """
    from whiptool.rl.task import reward

    return reward(np.maximum(costs, 0), hits) * np.where(costs < 0, -costs, 1.0)


def learner_search(objective: Objective, *, seed: int, learner: str) -> None:
    """Train a learner on the objective's target until the objective stops the search."""
    torch = optional("torch", f"method {learner}")
    from whiptool.rl.actor_critic import LEARNERS
    from whiptool.rl.learner import Diverged, Transitions
    from whiptool.rl.settings import OffPolicy, settings_for

    settings = settings_for(learner)
    if isinstance(settings, OffPolicy):
        settings = settings_for(learner, updates=UPDATES)
    lower, upper = objective.bounds.box
    generator = torch.Generator().manual_seed(seed)
    policy = LEARNERS[learner](settings, n_obs=1, n_act=len(lower), discount=0.0, generator=generator)
    obs, over = torch.zeros(BATCH, 1), torch.ones(BATCH)
    number = 0
    while True:
        number += 1
        explore = number <= RANDOM_BATCHES
        actions = 2 * torch.rand(BATCH, len(lower), generator=generator) - 1 if explore else policy.act(obs)
        box = (np.clip(actions.numpy().astype(float), -1, 1) + 1) / 2
        outcomes = objective.batch(objective.admissible(lower + box * (upper - lower)))
        costs = np.array([outcome.cost for outcome in outcomes])
        gained = gain(costs, np.array([outcome.hit for outcome in outcomes]))
        new = Transitions(obs, actions, torch.as_tensor(gained, dtype=torch.float32), obs, over)
        try:
            policy.learn(new, update=not explore)
        except Diverged as error:
            raise RuntimeError(str(error)) from None  # as NLopt ends a search that failed
