"""Trials with whips that are not the model: the units of work of `papers.unknown.whips_report`.

Targets come from one pool, and a plan made from the prior alone depends on material and target only: it is made once,
and struck with every whip of the material.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool import Adaptation, CompiledRollout, Model, Strike, Target, TipPort, default_prior, draw_twin
from whiptool.adaptation.adapter import Options
from whiptool.adaptation.correction import correct
from whiptool.adaptation.first_look import choose_wiggle
from whiptool.adaptation.materials import USUAL, stock_of_material
from whiptool.adaptation.plan_search import Demands, Effort, Plan
from whiptool.adaptation.planner import FIRST, NEXT, plan
from whiptool.adaptation.posterior import Learned, update
from whiptool.adaptation.prior import Belief, knowing
from whiptool.adaptation.steps import Step, Steps
from whiptool.adaptation.twins import FAMILIES, Twin
from whiptool.comparison import LearnerUnit, Scene
from whiptool.comparison.unit import Unit
from whiptool.goals.target import HIT_RADIUS

METHODS = {
    "nominal": "the model's own best strike, repeated",
    "robust": "the strike that hits most of the whips that the prior allows, repeated",
    "correction": "the model's best strike, corrected along the model's Jacobian (iterative learning control)",
    "sac": "SAC, trained on the model with observation relative",
    "uniform": "the strike that hits most uniform whips; then k, b, m, l identified and planned again, nothing else",
    "adapt": "the robust strike; then identified and planned again after every strike",
    "still": "the same, after the whip was filmed once as it hangs",
    "wiggle": "the same, after one slow movement instead, chosen for what it tells",
    "told": "the strike that hits most of the whips that have the true length, which is given, repeated",
}
LEARNING = ("uniform", "adapt", "still", "wiggle")
LOOKING = ("still", "wiggle")
OWN_PLAN = (*LOOKING, "told")  # their first plan is each whip's own
FINEST = 0.01  # [m], a strike that is judged to miss by no more is the last
BRIEF = Effort(pool=96, polished=4, steps=4, whips=8, population=6, rounds=2)
_CLEAR = 0.05  # [m] by which a target has to be within a whip's reach


@dataclass(frozen=True, kw_only=True)
class Study:
    """What all trials share.

    The owner of a whip knows what it is made of and nothing else of it: not its length, nor its diameter. Materials
    take turns by seed. What he plans with, corrects along or trains on is the uniform whip in the middle of what his
    material may be.

    Args:
        scene: The arm, its controller, and a pool of targets, of which every whip gets some.
        strikes: With one whip at one target, at most.
        thorough: Plan with the usual effort; False: with little, to see that all works.
    """

    scene: Scene
    strikes: int = 6
    thorough: bool = True

    def material(self, seed: int) -> str:
        """Return the material of a whip, by its seed."""
        return USUAL[seed % len(USUAL)]

    def model(self, material: str) -> Model:
        """What the owner of a whip has for it."""
        return stock_of_material(material).owned(self.scene.model)

    def prior(self, material: str) -> Belief:
        """Of every whip of a material."""
        return default_prior(self.scene.model, self.scene.controller, stock=stock_of_material(material))

    def uniform(self, material: str) -> Belief:
        """Of whips that are uniform: the family `kin`, but not the others."""
        stock = stock_of_material(material)
        return default_prior(self.scene.model, self.scene.controller, whip="uniform", stock=stock)

    def twin(self, family: str, seed: int) -> Twin:
        """Return an unknown whip of a family, by its seed."""
        stock = stock_of_material(self.material(seed))
        return draw_twin(family, seed, self.scene.model, self.scene.controller, stock)

    def within(self, twin: Twin) -> np.ndarray:
        """Numbers of the pool's targets that a whip can reach, in a random order that differs between whips."""
        near = np.flatnonzero(np.hypot(*self.scene.points().T) <= twin.model.reach - _CLEAR)
        return np.random.default_rng([self.scene.target_seed, FAMILIES.index(twin.family), twin.seed]).permutation(near)

    def target(self, number: int) -> Target:
        """Return a target of the pool, by its number."""
        x, y = self.scene.points()[number]
        return Target((float(x), float(y)), HIT_RADIUS)

    def options(self, **changes: Any) -> Options:
        """Of an adaptation that sees the tip."""
        options = Options(max_strikes=self.strikes, stop_at=FINEST, t_stay=self.scene.t_stay)
        efforts: dict[str, Any] = self.efforts
        return replace(options, **efforts, **changes)

    @property
    def efforts(self) -> dict[str, Effort]:
        """Of plans, where they are not the usual ones."""
        return {} if self.thorough else {"first": BRIEF, "later": BRIEF}


@dataclass(frozen=True, kw_only=True)
class OpeningUnit(Unit):
    """A first plan, from the model alone (`nominal`), from the prior (`robust`) or that of uniform whips."""

    study: Study
    kind: str
    material: str
    target: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Plan the first strike at every target."""
        s, known = self.study, {"nominal": certain, "robust": Study.prior, "uniform": Study.uniform}
        belief = known[self.kind](s, self.material)
        rng = np.random.default_rng([s.scene.target_seed, self.target])
        demands, effort = Demands(t_stay=s.scene.t_stay), FIRST if s.thorough else BRIEF
        found = plan(belief, s.target(self.target), rng=rng, demands=demands, effort=effort)
        return asdict(found)


def certain(study: Study, material: str) -> Belief:
    """That the whip is the owner's model."""
    uniform = study.uniform(material)
    return replace(uniform, covariance=1e-8 * uniform.covariance)


@dataclass(frozen=True, kw_only=True)
class LookUnit(Unit):
    """The slow movement, chosen once for a material."""

    study: Study
    material: str

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Choose the movement that tells most about the whip."""
        rng = np.random.default_rng(self.study.scene.target_seed)
        candidates, prior = 64 if self.study.thorough else 8, self.study.prior(self.material)
        strike, gain = choose_wiggle(prior, rng=rng, t_stay=self.study.scene.t_stay, candidates=candidates)
        return {"strike": strike.vector.tolist(), "told": gain}


@dataclass(frozen=True, kw_only=True)
class WhipUnit(Unit):
    """Strikes with one unknown whip at some targets, its tip seen 60 times a second with 5 mm noise.

    Args:
        study: See there.
        family, seed: Family and seed of the whip.
        method: One of `METHODS`, not `sac`.
        targets: Their numbers.
        openings: First plans, by target; empty: each whip has its own.
        look: The slow movement; empty: none.
        transfer: Numbers of further targets, each struck at once with what was learned at the first.
    """

    study: Study
    family: str
    seed: int
    method: str
    targets: tuple[int, ...]
    openings: Mapping[int, Mapping[str, Any]]
    look: tuple[float, ...] = ()
    transfer: tuple[int, ...] = ()

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike the unknown whip until it hits or the strikes are used up."""
        looked = self._look() if self.method == "wiggle" else None
        trials, transferred = [], []
        for i, number in enumerate(self.targets):
            if self.method == "correction":
                trials.append(self._corrected(number))
                continue
            steps = self._adapted(number, looked)
            trials.append(self._told(number, steps))
            if i == 0 and self.transfer and steps[-1].learned is not None:
                transferred = [self._transferred(steps[-1].learned.belief, n) for n in self.transfer]
        return {"trials": trials, "transferred": transferred}

    def _port(self, number: int) -> TipPort:
        s = self.study
        return TipPort(s.twin(self.family, self.seed), s.target(number).position, t_stay=s.scene.t_stay)

    def _look(self) -> tuple[Any, Learned]:
        """The slow movement with this whip, and what it taught."""
        seen = self._port(self.targets[0]).strike(Strike.from_vector(self.look), 0, None)
        assert seen.recording is not None
        recording = replace(seen.recording, target=None)  # meant for none, and of use to its end
        return recording, update(self.study.prior(self.material), [recording], seed=self.seed)

    @property
    def material(self) -> str:
        """Material of the unit's whip."""
        return self.study.material(self.seed)

    def _prior(self) -> Belief:
        s = self.study
        if self.method == "uniform":
            return s.uniform(self.material)
        if self.method == "told":
            true = s.twin(self.family, self.seed).model.whip.length
            return knowing(s.prior(self.material), {"profile.length": true})
        return s.prior(self.material)

    def _adapted(self, number: int, looked: tuple[Any, Learned] | None) -> Steps:
        s = self.study
        adaptation = Adaptation(
            self._prior(),
            self._port(number),
            s.target(number),
            s.options(adapt=self.method in LEARNING, still=self.method == "still", seed=self.seed),
            recordings=[] if looked is None else [looked[0]],
            known=None if looked is None else looked[1].belief,
            opening=as_plan(self.openings[number]) if number in self.openings else None,
        )
        return adaptation.run()

    def _corrected(self, number: int) -> dict[str, Any]:
        s, port = self.study, self._port(number)
        model = CompiledRollout(s.model(self.material), s.scene.controller)
        strike, misses = Strike.from_vector(as_plan(self.openings[number]).strike), []
        for k in range(1, s.strikes + 1):
            seen = port.strike(strike, k, None)
            misses.append(seen.true_miss)
            if seen.recording is None or (seen.seen_miss or 0.0) <= FINEST:
                break
            strike = correct(strike, seen.recording, model, s.target(number).position, t_stay=s.scene.t_stay)
        return {"target": number, "miss": padded(misses, s.strikes)}

    def _told(self, number: int, steps: Steps) -> dict[str, Any]:
        strikes = steps.strikes
        return {
            "target": number,
            "miss": padded([step.outcome.true_miss for step in strikes], self.study.strikes),
            **predictions(strikes),
            "seconds": times(strikes),
            "refused": sum(len(step.learned.refused) for step in steps if step.learned),
        }

    def _transferred(self, belief: Belief, number: int) -> dict[str, Any]:
        """One strike at another target."""
        s, rng = self.study, np.random.default_rng([self.seed, number])
        effort = NEXT if s.thorough else BRIEF
        demands = Demands(t_stay=s.scene.t_stay)
        chosen = plan(belief, s.target(number), rng=rng, demands=demands, effort=effort)
        seen = self._port(number).strike(Strike.from_vector(chosen.strike), 1, None)
        return {
            "target": number,
            "miss": seen.true_miss,
            "probability": chosen.probability,
            "predicted": chosen.misses,
        }


@dataclass(frozen=True, kw_only=True)
class PolicyUnit(Unit):
    """SAC, trained on the model of a material, strikes with every whip of it, seeing where its tip came nearest.

    Args:
        study: See there.
        material: Material of the whips.
        whips: Family, seed, and numbers of the targets of each.
        episodes: Episodes of training, of 100 strikes.
    """

    study: Study
    material: str
    whips: tuple[tuple[str, int, tuple[int, ...]], ...]
    episodes: int = 500  # the paper's

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Train a policy on the whip, and strike with it."""
        from whiptool.comparison.learner_unit import MAIN_CONVENTION, one_torch_thread
        from whiptool.comparison.policy_trials import misses_of
        from whiptool.rl.task import StrikeTask

        s = self.study
        unit = LearnerUnit(
            scene=replace(s.scene, model=s.model(self.material)),
            method="sac",
            observation="relative",
            seed=0,
            episodes=self.episodes,
            random_episodes=max(1, self.episodes // 10),
        )
        with one_torch_thread():
            learner = unit.trained(folder, threads)[0].learner
            found: dict[str, list] = {}
            for family, seed, targets in self.whips:
                twin = s.twin(family, seed)
                rollout = CompiledRollout(twin.model, twin.controller, threads=threads)
                task = StrikeTask(
                    rollout, s.scene.zone, observation="relative", hit_radius=FINEST, t_stay=s.scene.t_stay
                )
                learner.generator.manual_seed(seed)
                points = s.scene.points()[list(targets)]
                misses = misses_of(learner, task, points, cap=s.strikes, convention=MAIN_CONVENTION)
                found[f"{family}-{seed}"] = [
                    {"target": number, "miss": padded(row, s.strikes)}
                    for number, row in zip(targets, misses, strict=True)
                ]
        return found


def as_plan(table: Mapping[str, Any]) -> Plan:
    """Return the plan that `OpeningUnit` found."""
    found = dict(table)
    found["strike"], found["misses"] = tuple(table["strike"]), tuple(table["misses"])
    return Plan(**found)


def predictions(strikes: Sequence[Step]) -> dict[str, list]:
    """What was stated before each strike: the probability of a hit, and the sample of the miss distance."""
    return {
        "probability": [step.plan.probability for step in strikes],
        "predicted": [step.plan.misses for step in strikes],
    }


def times(strikes: Sequence[Step]) -> list[float]:
    """What each strike took to plan, and to learn from the one before [s]; the first: to plan alone."""
    learned = [step.learned.wall_time if step.learned else 0.0 for step in strikes]
    return [a + step.plan.wall_time for a, step in zip([0.0, *learned], strikes, strict=False)]


def padded(misses: Iterable[float | None], strikes: int) -> list[float | None]:
    """Miss distances by strike; whoever stopped would strike the same again."""
    known = list(misses)
    return known + known[-1:] * (strikes - len(known))
