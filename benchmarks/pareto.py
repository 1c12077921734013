"""Does anything beat a Pareto front? Speed and effort against miss, for lemon2024 and the UR5e.

The front of each pair is what `python -m whiptool.optimize --pareto` finds, by the epsilon-constraint method along
exact derivatives. Three rivals have ten times its rollouts each, a derivative being one for each number of a strike:
random strikes; CMA-ES, which minimises the weighted Chebyshev distance from the front's ideal point (Miettinen 1999)
with weights spread over the front; pymoo's NSGA-II (Deb et al. 2002), hits being its constraint. By how much a
rival's hit dominates the front is the additive epsilon indicator in parts of the front's range: as far as the front
would have to be moved in both criteria; next to it are the share of the hits on a rival's front that a hit on ours
dominates, and the share of ours that one of the rival's dominates. NSGA-II is also given the front's own number of
rollouts. Hypervolumes are parts of the box around all fronts, 1 being all of it.

    python benchmarks/pareto.py [--quick] [--json] [--only MODEL] [--pair NAME] [--out FOLDER]

With --out, what is found stands in that folder, with a figure of each pair's fronts, and a run that was interrupted
goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from whiptool.goals.criteria import Criterion, find_criterion
from whiptool.goals.target import Target
from whiptool.impedance import Controller, PositionControl
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import preset
from whiptool.models.strike import default_bounds
from whiptool.objective import Objective, SearchStopped
from whiptool.optimizers import run_search
from whiptool.optimizers.derivative_free import cmaes_search
from whiptool.optimizers.pareto_search import ParetoFront, dominated_by, oriented, pareto_search
from whiptool.rollout import CompiledRollout
from whiptool.viz.plots_search import plot_front
from whiptool.viz.style import COLORS, STYLE, save_figure
from whiptool.whole_files import write_whole

PAIRS = (("effort", "miss"), ("speed", "miss"))
TRIALS = 1200
TARGETS = {"lemon2024": (1.3, 0.0), "ur5e": (1.0, 0.0, 0.0)}
TIMESTEPS = {"lemon2024": 5e-4, "ur5e": 1e-3}  # [s]
TIMES = 10  # the front's rollouts
WEIGHTS = 8  # of CMA-ES
MARGIN = 0.02  # part of a criterion's range by which the front may be dominated
REACH = 1.0  # of the front's range, within which a figure shows what rivals found
POPULATION = 40
RANDOM_BATCH = 1000


@dataclass(frozen=True)
class Found:
    """The front of what one search tried.

    Args:
        values: Both criteria of its hits, (P, 2).
        hits: Of all that was tried.
        seconds: Processor time.
    """

    values: np.ndarray
    hits: int
    seconds: float


class Case:
    """One model and two criteria; what is found stands in a folder, if there is one, and is not searched again.

    Args:
        name: Name of the model.
        pair: Names of the criteria.
        folder: None: nothing is kept.
    """

    def __init__(self, name: str, pair: tuple[str, str], folder: Path | None) -> None:
        model = preset(name)
        robot = name == "ur5e"
        controller = Controller(PositionControl()) if robot else Controller()
        self.rollout = CompiledRollout(model, controller, timestep=TIMESTEPS[name])
        self.limits = ArmLimits.of(model.arm) if robot else None
        self.bounds, self.target = default_bounds(model.arm), Target(TARGETS[name])
        first, second = (find_criterion(x, self.bounds) for x in pair)
        self.criteria = (first, second)
        self.label, self.folder = f"{name}-{pair[0]}-{pair[1]}", folder
        self.rollouts_per_gradient = 1 + len(self.bounds.lower)

    def run(self, name: str, method: Callable, trials: int) -> Found:
        """Return what a search of so many trials finds."""
        kept = None if self.folder is None else self.folder / f"{self.label}-{name}-{trials}.json"
        if kept is not None and kept.exists():
            stored = json.loads(kept.read_text())
            return Found(np.array(stored["values"]).reshape(-1, 2), stored["hits"], stored["seconds"])
        options = {"bounds": self.bounds, "limits": self.limits, "criteria": self.criteria}
        objective = Objective(self.rollout, self.target, max_trials=trials, **options)
        start = time.process_time()
        run_search(objective, method, name, seed=0)
        hits = sum(trial.outcome.hit for trial in objective.trials)
        front = ParetoFront.of(self.criteria, objective.trials)
        found = Found(front.values, hits, time.process_time() - start)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            stored = {"values": found.values.tolist(), "hits": hits, "seconds": found.seconds}
            write_whole(kept, json.dumps(stored))
        return found


def random_strikes(objective: Objective, *, seed: int) -> None:
    """Try random strikes, many at a time, until the objective stops it."""
    rng = np.random.default_rng(seed)
    while True:
        objective.batch(objective.admissible(objective.bounds.sample(rng, RANDOM_BATCH)))


def chebyshev(criteria: Sequence[Criterion], front: np.ndarray) -> Callable:
    """Return CMA-ES towards points of a front (P, 2), one weighting after the other, each with its share of trials."""
    costs = oriented(criteria, front)
    ideal, span = costs.min(axis=0), np.ptp(costs, axis=0)

    def method(objective: Objective, *, seed: int) -> None:
        assert objective.max_trials is not None
        share = objective.max_trials // WEIGHTS
        for k, weight in enumerate(np.linspace(0.05, 0.95, WEIGHTS)):
            weights, last = np.array([weight, 1 - weight]), (k + 1) * share

            def batch(strikes: np.ndarray, weights: np.ndarray = weights, last: int = last) -> list[SimpleNamespace]:
                if len(objective.trials) >= last:
                    raise SearchStopped("trials")
                found = []
                for outcome in objective.batch(strikes):
                    cost = outcome.miss_distance
                    if outcome.hit:
                        above = (oriented(criteria, [outcome.values])[0] - ideal) / span
                        cost = -1 / (1 + np.log1p(max((weights * above).max(), 0)))
                    found.append(SimpleNamespace(cost=cost))
                return found

            one = SimpleNamespace(bounds=objective.bounds, admissible=objective.admissible, batch=batch)
            try:
                cmaes_search(one, seed=seed + k)
            except SearchStopped:
                continue

    return method


def nsga2(objective: Objective, *, seed: int) -> None:
    """Evolve strikes by NSGA-II, hits being its constraint, until the objective stops it."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.problems.static import StaticProblem

    lower, upper = objective.bounds.box
    ends = {"xl": np.zeros(len(lower)), "xu": np.ones(len(lower))}
    box = Problem(n_var=len(lower), n_obj=2, n_ieq_constr=1, **ends)
    algorithm = NSGA2(pop_size=POPULATION)
    algorithm.setup(box, seed=seed + 1, verbose=False, termination=("n_gen", 10**9))
    while (generation := algorithm.ask()) is not None:
        unit = np.clip(generation.get("X"), 0, 1)
        outcomes = objective.batch(objective.admissible(lower + unit * (upper - lower)))
        costs = [oriented(objective.criteria, [x.values])[0] if x.values else np.full(2, 1e9) for x in outcomes]
        missing = [0.0 if x.hit else max(x.miss_distance, 1e-9) for x in outcomes]
        Evaluator().eval(StaticProblem(box, F=np.array(costs), G=np.array(missing)[:, None]), generation)
        algorithm.tell(infills=generation)


def compare(case: Case, trials: int, times: int) -> tuple[dict, dict[str, np.ndarray]]:
    """Return numbers of one front and its rivals, and the hits on each."""
    from pymoo.indicators.hv import HV

    budget = trials * case.rollouts_per_gradient
    front = case.run("front", pareto_search, trials)
    entry = {"trials": trials, "rollouts": budget, "hits": front.hits, "points": len(front.values)}
    entry |= {"cpu_seconds": front.seconds, "from": front.values[0].tolist(), "to": front.values[-1].tolist()}
    rivals = {
        "nsga2-equal": (nsga2, budget),
        "cmaes": (chebyshev(case.criteria, front.values), times * budget),
        "random": (random_strikes, times * budget),
        "nsga2": (nsga2, times * budget),
    }
    found = {"front": front} | {name: case.run(name, *how) for name, how in rivals.items()}
    costs = {name: oriented(case.criteria, x.values) for name, x in found.items()}
    together = np.concatenate(list(costs.values()))
    low, high = together.min(axis=0), together.max(axis=0)
    volume = HV(ref_point=np.ones(2))
    volumes = {name: float(volume((x - low) / (high - low))) if len(x) else 0.0 for name, x in costs.items()}
    entry |= {"hypervolume": volumes["front"], "rivals": {}}
    for name, (_, rollouts) in rivals.items():
        other, by = found[name], 0.0
        if len(other.values):
            by = max(float(dominated_by(case.criteria, front.values, other.values).max()), 0.0)
        entry["rivals"][name] = {
            "rollouts": rollouts,
            "hits": other.hits,
            "points": len(other.values),
            "dominates_by": by,
            "share_dominated": dominated(case.criteria, other.values, front.values),
            "share_dominating": dominated(case.criteria, front.values, other.values),
            "hypervolume": volumes[name],
            "cpu_seconds": other.seconds,
        }
    return entry, {name: x.values for name, x in found.items()}


def dominated(criteria: Sequence[Criterion], values: np.ndarray, by: np.ndarray) -> float | None:
    """Return the share of hits that some of other hits dominate; None without hits."""
    if not len(values):
        return None
    costs, others = oriented(criteria, values), oriented(criteria, by)
    better = (others[:, None] <= costs).all(axis=2) & (others[:, None] < costs).any(axis=2)
    return float(better.any(axis=0).mean())


def draw(folder: Path, case: Case, fronts: dict[str, np.ndarray]) -> None:
    """Write a figure of a front and its rivals."""
    labels = [f"{x.words} [{x.unit}]" for x in case.criteria]
    rivals = {"random": ("orange", "s"), "cmaes": ("green", "^"), "nsga2": ("vermilion", "x")}
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 4.4), layout="constrained")
        ax = plot_front(figure.subplots(), fronts["front"], np.empty((0, 2)), labels=labels)
        low, high = fronts["front"].min(axis=0), fronts["front"].max(axis=0)
        low, high = low - REACH * (high - low), high + REACH * (high - low)
        for rival, (color, marker) in rivals.items():
            style = {"linestyle": "", "marker": marker, "markersize": 4, "color": COLORS[color]}
            near = fronts[rival][((low <= fronts[rival]) & (fronts[rival] <= high)).all(axis=1)]
            ax.plot(*near.T, label=f"{rival}, {TIMES} times the rollouts", **style)
        ax.autoscale()
        ax.get_legend().remove()
        lines = [x for x in ax.get_lines() if len(x.get_xdata())]
        figure.legend(handles=lines, loc="outside upper center", ncols=1)
        save_figure(figure, folder / f"{case.label}.png")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="lemon2024 alone, effort against miss, a small budget")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--only", metavar="MODEL", choices=TARGETS, help="this model alone")
    parser.add_argument("--pair", metavar="NAME", choices=[first for first, _ in PAIRS], help="this against miss alone")
    parser.add_argument("--out", type=Path, help="draw the fronts into this folder")
    arguments = parser.parse_args()
    report: dict[str, dict] = {}
    models = ["lemon2024"] if arguments.quick else [x for x in TARGETS if arguments.only in (None, x)]
    pairs = PAIRS[:1] if arguments.quick else [pair for pair in PAIRS if arguments.pair in (None, pair[0])]
    for name in models:
        for pair in pairs:
            case = Case(name, pair, arguments.out)
            trials, times = (150, 1) if arguments.quick else (TRIALS, TIMES)
            report[case.label], fronts = compare(case, trials, times)
            if arguments.out is not None:
                draw(arguments.out, case, fronts)
            if not arguments.json:
                tell(case.label, report[case.label])
    worst = max(rival["dominates_by"] for entry in report.values() for rival in entry["rivals"].values())
    if arguments.json:
        print(json.dumps({"worst": worst, "margin": MARGIN, "fronts": report}, allow_nan=False))
    else:
        print(f"no rival's hit dominates a front by more than {worst:.3f} of its range (margin {MARGIN:g})")


def tell(label: str, entry: dict) -> None:
    """Print one pair's numbers."""
    print(
        f"{label}: {entry['points']} hits on the front of {entry['trials']} trials ({entry['rollouts']} rollouts, "
        f"{entry['cpu_seconds']:.0f} s), from {entry['from']} to {entry['to']}, hypervolume {entry['hypervolume']:.4f}"
    )
    for name, rival in entry["rivals"].items():
        shares = ["none" if x is None else f"{x:.0%}" for x in (rival["share_dominated"], rival["share_dominating"])]
        print(
            f"  {name:12s} {rival['rollouts']:7d} rollouts, {rival['cpu_seconds']:4.0f} s, {rival['hits']:6d} hits, "
            f"{rival['points']:4d} on its front, {shares[0]} of them dominated, dominates {shares[1]} of ours, "
            f"by {rival['dominates_by']:.4f}, hypervolume {rival['hypervolume']:.4f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
