"""Methods that find a strike, with one interface: `search(objective, method)`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any

import nlopt
import numpy as np

from whiptool.errors import InputError, expect, no_attribute, refuse_call
from whiptool.extras import Registry
from whiptool.models.numbers import NoArray, whole
from whiptool.models.strike import AnyStrike
from whiptool.objective import Objective, Outcome, SearchStopped, Trial
from whiptool.optimizers.derivative_free import (
    DIRECT_L,
    cmaes_search,
    genetic_search,
    learner_search,
    nlopt_names,
    nlopt_search,
    random_search,
)
from whiptool.optimizers.gradient_search import gradient_search, map_search
from whiptool.rl.settings import SETTINGS
from whiptool.rollout.interface import Rollout
from whiptool.words import counted, method_name

__all__ = ["METHODS", "Result", "Status", "find_method", "run_search", "search"]


class Status(Enum):
    """Reason why a search ended."""

    HIT = "hit"
    CONVERGED = "converged"
    MAX_TRIALS = "max_trials"
    MAX_TIME = "max_time"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


MESSAGES = {
    Status.HIT: "the target was hit",
    Status.CONVERGED: "the method ended by its own criterion",
    Status.MAX_TRIALS: "the budget of trials is used up",
    Status.MAX_TIME: "the budget of time is used up",
    Status.INTERRUPTED: "interrupted; what was found so far is kept",
    Status.FAILED: "the method gave up",
}


@dataclass(frozen=True)
class Result(NoArray, instead="its strike or outcome"):
    """Result of a search.

    Args:
        method: Name of the method on the command line.
        status, message: Reason why the search ended, and its description.
        strike, outcome: The best strike and its outcome; None if there was no trial.
        trace: All trials in order.
        n_diverged: Number of trials that diverged.
        wall_time: Wall time [s].
    """

    method: str
    status: Status
    message: str
    strike: AnyStrike | None
    outcome: Outcome | None
    trace: tuple[Trial, ...]
    n_diverged: int
    wall_time: float

    def __repr__(self) -> str:
        found = self.outcome
        miss = "" if found is None or found.lost else f"miss {found.miss_distance:.4f} m: "
        best = "no trial" if found is None else f"best {miss}{found.status}"
        return f"Result({self.method}: {self.status.value}, {counted(self.n_trials, 'trial')}, {best})"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> None:
            cures = dict.fromkeys(("miss", "distance", "cost"), "result.miss_distance is the best strike's")
            raise no_attribute(self, name, cures)

    def uninterrupted(self) -> Result:
        """Return the result itself, or raise KeyboardInterrupt if the search was interrupted by Ctrl-C.

        Raises:
            KeyboardInterrupt: The search was interrupted.
        """
        if self.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return self

    @property
    def hit(self) -> bool:
        """Whether the best strike hits."""
        return self.outcome is not None and self.outcome.hit

    @property
    def miss_distance(self) -> float:
        """Miss distance of the best strike [m]; infinite if all strikes were refused or diverged."""
        return float("inf") if self.outcome is None or self.outcome.lost else self.outcome.miss_distance

    @property
    def first_hit(self) -> int | None:
        """Number of the first trial that hit, from 1; None if none did."""
        return next((trial.number for trial in self.trace if trial.outcome.hit), None)

    @property
    def n_trials(self) -> int:
        """Number of trials of the search."""
        return len(self.trace)


Method = Callable[..., None]


def _spelled(written: str, names: Iterable[str]) -> str:
    """Return a method's name as it is registered, which others may have done in any spelling."""
    plain = method_name(written)
    return next((own for own in names if method_name(own) == plain), plain)


METHODS: Registry[Method] = Registry(
    "methods",
    Callable,
    {
        "directl": partial(nlopt_search, algorithm=DIRECT_L),
        "gradient": gradient_search,
        "map": map_search,
        "cmaes": cmaes_search,
        "ga": genetic_search,
        **{name: partial(learner_search, learner=name) for name in SETTINGS},
        "random": random_search,
    },
    what="method",
    spelled=_spelled,
)
MAX_TRIALS = 600  # of a search that is given a target and no other end
_STOPS = {"hit": Status.HIT, "trials": Status.MAX_TRIALS, "time": Status.MAX_TIME}


def find_method(name: str) -> Method:
    """Return the method called `name`: one of `METHODS`, or `nlopt:` and the name of an NLopt global algorithm.

    Capital letters, hyphens and underscores make no difference: `DIRECT-L` is `directl`.
    """
    expect(str, method=name)
    algorithm = method_name(name).removeprefix("nlopt:")
    if method_name(name) != algorithm and algorithm in nlopt_names():
        return partial(nlopt_search, algorithm=algorithm)
    try:
        return METHODS.find(name)
    except InputError as error:
        if error.name != METHODS.what:
            raise
        raise InputError("method", name, ", ".join([*METHODS, *(f"nlopt:{n}" for n in nlopt_names())])) from None


def usual_method(rollout: Rollout) -> str:
    """Return the default method: `directl` in the plane, `gradient` in space if the simulator has derivatives.

    Hardly any random strike of a robot is within its limits and collision-free, so that DIRECT-L takes long to find
    one; the gradient search begins with such strikes.
    """
    has_derivatives = type(rollout).slopes is not Rollout.slopes
    return "gradient" if rollout.model.dimension == 3 and has_derivatives else "directl"


def search(
    objective: Objective | Rollout,
    target: Any = None,
    method: str | None = None,
    *,
    seed: int = 0,
    first: Sequence[float] | np.ndarray | None = None,
    **options: Any,
) -> Result:
    """Run a method on an objective until it hits, converges, uses up its budget, or is interrupted (Ctrl-C).

    `search(objective, method)` searches an `Objective`. `search(rollout, target, method)` constructs the objective,
    which stops at the first hit or after 600 trials, as `python -m whiptool.optimize` does.

    Args:
        objective: An `Objective`, or the rollout from which it is constructed.
        target: Target of a search with a rollout: a `Target`, or its position (x, y) or (x, y, z) [m]; None: the
            default target. With an `Objective`, which has a target, this argument may be the method.
        method: One of `METHODS`, or `nlopt:NAME`; default: `usual_method`. Capital letters, hyphens and underscores
            make no difference.
        seed: Seed of the method's random numbers.
        first: A strike vector to try before the method begins.
        options: Options of a search with a rollout: those of `Objective`, by name, such as `max_trials`, `bounds` and
            `limits`.

    Raises:
        InputError: The method is unknown, or does not fit the objective, the target is out of reach, or an option is
            unknown.
    """
    expect(Objective, Rollout, objective=objective)
    if isinstance(objective, Objective) and isinstance(target, str):
        target, method = None, target
    if method is not None:
        find_method(method)
    seed = whole("seed", seed, low=0)
    if isinstance(objective, Rollout):
        ends: dict[str, Any] = {"stop_at_hit": True, "max_trials": MAX_TRIALS}
        if "hit_radius" in options:
            fix = f"it belongs to the target: Target(..., hit_radius={options['hit_radius']!r})"
            raise InputError("argument of search", "hit_radius", "options of Objective, by name", fix)
        refuse_call("search", Objective, objective, target, **options)
        objective = Objective(objective, target, **ends | options)
    elif target is not None or options:
        given = ["target"] * (target is not None) + list(options)
        raise InputError(
            "search", ", ".join(given), "only method, seed and first, because an Objective has all other options"
        )
    method = usual_method(objective.rollout) if method is None else _spelled(method, METHODS)
    return run_search(objective, find_method(method), method, seed=seed, first=first)


def run_search(
    objective: Objective, run: Method, name: str, *, seed: int, first: Sequence[float] | np.ndarray | None = None
) -> Result:
    """Run the search function `run`, which need not be in `METHODS`, under a name; the other arguments are as in
    `search`.
    """
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
