"""Ways to find a strike, all behind one call: `search(objective, method)`."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import nlopt
import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.numbers import whole
from whiptool.objective import Objective, SearchStopped
from whiptool.optimizers.cmaes_search import cmaes_search
from whiptool.optimizers.genetic_search import genetic_search
from whiptool.optimizers.gradient_search import gradient_search
from whiptool.optimizers.learner_search import learner_search
from whiptool.optimizers.nlopt_search import DIRECT_L, nlopt_names, nlopt_search
from whiptool.optimizers.random_search import random_search
from whiptool.optimizers.result import MESSAGES, Result, Status

__all__ = ["METHODS", "Result", "Status", "find_method", "run_search", "search"]

Method = Callable[..., None]
LEARNERS = ("sac", "td3", "ddpg", "ppo")  # named here so that listing methods does not import torch
METHODS: dict[str, Method] = {
    "directl": partial(nlopt_search, algorithm=DIRECT_L),
    "gradient": gradient_search,
    "cmaes": cmaes_search,
    "ga": genetic_search,
    **{name: partial(learner_search, learner=name) for name in LEARNERS},
    "random": random_search,
}
_STOPS = {"hit": Status.HIT, "trials": Status.MAX_TRIALS, "time": Status.MAX_TIME}


def find_method(name: str) -> Method:
    """The method called `name`: one of `METHODS`, or `nlopt:` and the name of an NLopt global algorithm.

    Raises:
        InputError: There is none of that name; the message lists them.
    """
    expect(str, method=name)
    if name in METHODS:
        return METHODS[name]
    if name.startswith("nlopt:") and name.removeprefix("nlopt:") in nlopt_names():
        return partial(nlopt_search, algorithm=name.removeprefix("nlopt:"))
    raise InputError("method", name, ", ".join([*METHODS, *(f"nlopt:{n}" for n in nlopt_names())]))


def search(objective: Objective, method: str, *, seed: int = 0, first: np.ndarray | None = None) -> Result:
    """Run a method on an objective until it hits, converges, uses up its budget, or is interrupted (Ctrl-C).

    Args:
        objective: What is searched.
        method: One of `METHODS`, or `nlopt:NAME`.
        seed: Of what is random in the method.
        first: A strike vector to try before the method begins.

    Raises:
        InputError: The method is unknown, or does not fit the objective.
    """
    expect(Objective, objective=objective)
    return run_search(objective, find_method(method), method, seed=whole("seed", seed, low=0), first=first)


def run_search(objective: Objective, run: Method, name: str, *, seed: int, first: np.ndarray | None = None) -> Result:
    """As `search`, of a function that is no method of the command line."""
    start = time.monotonic()
    try:
        if first is not None:
            objective.trial(first)
        run(objective, seed=seed)
        status, detail = Status.CONVERGED, ""
    except SearchStopped as stop:
        status, detail = _STOPS[stop.reason], ""
    except KeyboardInterrupt as error:
        status, detail = Status.INTERRUPTED, "".join(f"; {note}" for note in getattr(error, "__notes__", []))
    except (RuntimeError, MemoryError, nlopt.runtime_error) as error:  # NLopt's own failures
        status, detail = Status.FAILED, f": {error}"
    best = objective.best
    return Result(
        method=name,
        status=status,
        message=MESSAGES[status] + detail,
        strike=None if best is None else objective.space.strike(best.strike),
        outcome=None if best is None else best.outcome,
        trace=tuple(objective.trials),
        n_diverged=objective.n_diverged,
        wall_time=time.monotonic() - start,
    )
