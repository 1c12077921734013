"""Unknown whips through servos, rendered images and tracker, within the motors' limits: units of work of
`papers.unknown.whips_report`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from papers.unknown.unknown_whips import FINEST, Study, padded, predictions, times
from whiptool import Adaptation, Plant, draw_twin
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.plan_search import Demands
from whiptool.adaptation.planner import plan
from whiptool.adaptation.prior import Belief, driven
from whiptool.adaptation.steps import Step
from whiptool.comparison.unit import Unit
from whiptool.rig.emulator.motor import HARDWARE
from whiptool.rig.stops import StrikeStopped

_SLOW_POOL = 512  # candidates of a brief plan, most of which ask too much of motors
_TRIED = 5  # targets of a whip's own that are tried


def until_stopped(adaptation: Adaptation) -> tuple[list[Step], str]:
    """All steps of an adaptation, and the fault of the twin that ended it; empty: none did."""
    steps: list[Step] = []
    try:
        adaptation.run(steps.append)
    except StrikeStopped as stopped:
        return steps, stopped.reason
    return steps, ""


def prepared(study: Study, family: str, seed: int, number: int, **changes: Any) -> Adaptation:
    """Of a whip through servos, rendered images and tracker, at a target of the pool; changes of `AdaptOptions`.

    In the brief form of a study, the tip's position with the error of images takes their place.
    """
    from whiptool.adaptation.options import AdaptOptions, prepare

    options = AdaptOptions(
        target=study.target(number).position,
        port="twin",
        camera="twin" if study.thorough else "points",
        seed=seed,
        max_strikes=study.strikes,
    )
    unknown: dict[str, Any] = {"family": family, "material": study.material(seed)}
    adaptation = prepare(replace(options, **(unknown | changes)))
    efforts: dict[str, Any] = {name: replace(effort, pool=_SLOW_POOL) for name, effort in study.efforts.items()}
    adaptation.options = replace(adaptation.options, stop_at=FINEST, **efforts)
    return adaptation


def motors_reach(study: Study, family: str, seed: int, number: int) -> bool:
    """Whether a target can be hit within the motors' limits, planned with the true whip."""
    adaptation = prepared(study, family, seed, number)
    usual, controller = adaptation.options, adaptation.prior.plant.controller
    assert controller is not None
    stock = stock_of_material(study.material(seed))
    twin = draw_twin(family, seed, study.scene.model, controller, stock)  # a rig's controller is not the scene's
    truth = Plant(driven(twin.model, HARDWARE), twin.controller)
    known = Belief(truth, ("delay",), np.zeros(1), 1e-8 * np.eye(1))
    effort = replace(usual.later, whips=1, **({} if study.thorough else {"polished": 4, "rounds": 0}))
    rng, target = np.random.default_rng([seed, number]), study.target(number)
    found = plan(known, target, rng=rng, demands=Demands(usual.bounds, usual.limits), effort=effort)
    hit = found.mean_miss is not None and bool(target.goals.hit(np.array(found.mean_miss)))
    return hit and found.usage is not None and found.usage <= 1


@dataclass(frozen=True, kw_only=True)
class ReachUnit(Unit):
    """The first target of a whip's own that the motors can reach with it, found with the true whip known."""

    study: Study
    family: str
    seed: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Plan with the truth; `target` is None where none of the first few can be reached."""
        s, passed = self.study, 0
        for passed, number in enumerate(s.within(s.twin(self.family, self.seed))[:_TRIED].tolist()):
            if motors_reach(s, self.family, self.seed, number):
                return {"target": number, "passed": passed}
        return {"target": None, "passed": passed + 1}


@dataclass(frozen=True, kw_only=True)
class RigUnit(Unit):
    """Strikes through the whole chain: servos, rendered images, tracker, within the motors' limits.

    Args:
        study: See there.
        family, seed: Family and seed of the whip.
        target: Number of the target.
        method: `adapt`, `still`, `wiggle` or `uniform`.
    """

    study: Study
    family: str
    seed: int
    target: int
    method: str = "adapt"

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike through servos, images and tracker until it hits."""
        s = self.study
        adaptation = prepared(
            s,
            self.family,
            self.seed,
            self.target,
            still=self.method == "still",
            wiggle=self.method == "wiggle",
            whip="uniform" if self.method == "uniform" else "profile",
        )
        steps, fault = until_stopped(adaptation)
        strikes = [step for step in steps if step.number]
        return {
            "target": self.target,
            "miss": padded([step.outcome.true_miss for step in strikes] or [None], s.strikes),
            **predictions(strikes),
            "seconds": times(strikes),
            "faults": [*(step.outcome.refused for step in strikes), *([fault] if fault else [])],
        }


@dataclass(frozen=True, kw_only=True)
class RigTransferUnit(Unit):
    """A whip learned at one target through the whole chain, without a look before, then struck once at others.

    Args:
        study: See there.
        family, seed: Family and seed of the whip.
        target: Number of the target.
        further: Numbers of the others; those that the motors do not reach are left out.
    """

    study: Study
    family: str
    seed: int
    target: int
    further: tuple[int, ...]

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Learn the whip at one target, and strike at the others."""
        s = self.study
        last = until_stopped(prepared(s, self.family, self.seed, self.target, still=False))[0][-1].learned
        assert last is not None
        reached = [n for n in self.further if motors_reach(s, self.family, self.seed, n)]
        transferred = []
        for number in reached:
            again = prepared(s, self.family, self.seed, number, max_strikes=1)
            again.known, again.options = last.belief, replace(again.options, adapt=False)
            steps, fault = until_stopped(again)
            if fault:
                continue
            transferred.append({
                "target": number,
                "miss": steps[-1].outcome.true_miss,
                "probability": steps[-1].plan.probability,
                "predicted": steps[-1].plan.misses,
                "fault": steps[-1].outcome.refused,
            })  # fmt: skip
        return {"transferred": transferred, "passed": len(self.further) - len(reached)}
