"""Strike, film, identify again, plan again, until it hits; every step is kept, so that a killed run goes on."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.adaptation.first_look import choose_wiggle, hanging
from whiptool.adaptation.judgement import judge, judge_seen
from whiptool.adaptation.planner import FIRST, NEXT, Demands, Effort, Plan, plan
from whiptool.adaptation.ports import Port, Seen, checked
from whiptool.adaptation.posterior import AFTER, Learned, update
from whiptool.adaptation.prior import Belief
from whiptool.adaptation.sag import Sag, expected_sag
from whiptool.adaptation.steps import Step, Steps
from whiptool.errors import InputError
from whiptool.identification.judgement import Judgement
from whiptool.models import parameters
from whiptool.models.motor_limits import MotorLimits
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike, StrikeBounds
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.target import Target
from whiptool.whole_files import write_whole

UNSURE = 0.5  # probability of a hit below which a plan is looked for once more, as hard as the first one
_LEARNED = ("rmse", "refused", "wall_time", "redundancy")  # beside the belief
PLAN, OUTCOME, POSTERIOR, RECORDING = "plan.json", "outcome.json", "posterior.json", "recording.npz"


@dataclass(frozen=True)
class Options:
    """Settings of an adaptation.

    Args:
        max_strikes: Largest number of strikes.
        stop_at: End after the first strike whose judged miss distance is at most this [m]; None: after the first hit
            that is claimed; 0: only after `max_strikes`.
        still: Film the hanging whip before the first strike, as step 0, unless earlier recordings are given.
        wiggle: Make a short, slow movement as step 0 instead.
        adapt: Whether to learn; if not, one strike is planned from the prior and repeated.
        starts: Number of starting points of every identification.
        seed: Seed of candidate strikes, sampled whips and starting points.
        t_stay: A strike is watched so long after the movement ended [s].
        bounds, limits, speed: Of the strikes, see `whiptool.adaptation.planner.Demands`.
        admissible: See `whiptool.adaptation.planner.Demands`.
        check: Called with a strike and the posterior mean of whip and arm; returns why the strike is not allowed, or
            None if it is.
        first, later: Planning effort before any recording has been learned from, and after.
    """

    max_strikes: int = 6
    stop_at: float | None = None
    still: bool = True
    wiggle: bool = False
    adapt: bool = True
    starts: int = 3
    seed: int = 0
    t_stay: float = T_STAY
    bounds: StrikeBounds | None = None
    limits: MotorLimits | None = None
    speed: float = 0.0
    check: Callable[[Strike, Model], str | None] | None = None
    admissible: Callable[[np.ndarray], np.ndarray] = lambda strikes: strikes
    first: Effort = FIRST
    later: Effort = NEXT

    def __post_init__(self) -> None:
        for name in ("max_strikes", "starts"):
            parameters.whole(name.replace("_", " "), getattr(self, name))
        parameters.whole("seed", self.seed, low=0)
        for name, value in {"t_stay": self.t_stay, "speed": self.speed, "stop at": self.stop_at or 0.0}.items():
            parameters.number(name, value, low=0)

    def demands(self, believed: Model) -> Demands:
        """What is asked of a strike, where whip and arm are believed to be these."""
        check = self.check
        asked = None if check is None else lambda strike: check(strike, believed)
        return Demands(self.bounds, self.limits, self.speed, asked, self.t_stay, self.admissible)


@dataclass
class Adaptation:
    """Strike with an unknown whip, learn it from each recording, and plan the next strike, until it hits.

    Args:
        prior: Belief about the whip before the first strike.
        port: Strikes and films: a twin, a rig, or your own robot.
        target: Point to hit, and hit radius.
        options: See `Options`.
        folder: Run folder; None: nothing is written.
        recordings: Earlier recordings of the same whip, from which the first strike is planned.
        known: Belief after those recordings, if it was computed before; None: it is identified from them.
        opening: The first plan, if it was made before; None: it is computed.
    """

    prior: Belief
    port: Port
    target: Target
    options: Options = field(default_factory=Options)
    folder: Path | None = None
    recordings: list[StrikeRecording] = field(default_factory=list)
    known: Belief | None = None
    opening: Plan | None = None

    def run(self, on_step: Callable[[Step], None] = lambda step: None) -> Steps:
        """Strike until it hits, or to the last strike.

        What the folder holds of an earlier run is read, not struck again. A strike that was killed before its outcome
        was written is struck again.

        Args:
            on_step: Called with every step as soon as it is complete.

        Returns:
            All steps, the first look included.

        Raises:
            InputError: The folder is damaged.
        """
        o, belief, steps = self.options, self.known or self.prior, Steps()
        recordings, past = list(self.recordings), []
        taught, resting = self.known is not None, set[str]()
        contacts: dict[str, float] = {}
        if recordings and o.adapt and not taught:
            learned = update(self.prior, recordings, starts=o.starts, seed=o.seed)
            belief, taught = learned.belief, bool(learned.rmse)
        look = o.wiggle or (o.still and o.adapt and not taught)
        for number in range(0 if look else 1, o.max_strikes + 1):
            chosen = self._planned(number, belief, past, steps, o.later if taught else o.first)
            outcome = self._struck(number, chosen, belief)
            if number and not (outcome.fault and outcome.recording is None):  # a strike that was refused is none
                past.append(chosen.strike)
            if outcome.recording is not None:
                recordings.append(outcome.recording)
                if chosen.contact is not None:
                    contacts[outcome.recording.source] = chosen.contact
            learned = None
            if o.adapt and recordings:
                learned = self._learned(number, recordings, belief, contacts)
                belief = learned.belief
                if number == 0 and not o.wiggle:  # tells the length alone: the next plan is a first one
                    resting = set(learned.rmse)
                taught = taught or bool(set(learned.rmse) - resting)
            judged = self._judged(number, chosen, outcome, learned) if number else None
            steps.append(Step(number, chosen, outcome, learned, judged))
            on_step(steps[-1])
            if number and judged is not None and self._enough(judged):
                break
        return steps

    def _enough(self, judged: Judgement) -> bool:
        return judged.hit if self.options.stop_at is None else judged.miss <= self.options.stop_at

    def _planned(self, number: int, belief: Belief, past: list, steps: Steps, effort: Effort) -> Plan:
        stored = self._read(number, PLAN)
        if stored is not None:
            return Plan(**{**stored, "strike": tuple(stored["strike"]), "misses": tuple(stored.get("misses", ()))})
        o, rng, began = self.options, np.random.default_rng([self.options.seed, number]), time.perf_counter()
        if number == 0:
            if o.wiggle:
                strike, told = choose_wiggle(belief, rng=rng, bounds=o.bounds, t_stay=o.t_stay)
                reason = f"a movement that tells {told:.1f} nat about the whip"
            else:
                strike, reason = hanging(belief, o.bounds), "the whip as it hangs: how long it is"
            chosen = Plan(tuple(map(float, strike.vector)), None, None, None, None, reason, time.perf_counter() - began)
        elif number > 1 and not o.adapt:
            chosen = steps[-1].plan
        elif number == 1 and self.opening is not None:
            chosen = self.opening
        else:
            sag = self._expected_sag(steps)
            chosen = self._sought(belief, rng, past, effort, sag)
            if effort is not o.first and (chosen.probability or 0.0) < UNSURE:
                both = chosen, self._sought(belief, rng, past, o.first, sag)
                chosen = max(both, key=lambda x: (x.allowed, x.probability or 0.0))
                chosen = replace(chosen, wall_time=time.perf_counter() - began)
        self._write(number, PLAN, asdict(chosen))
        return chosen

    def _expected_sag(self, steps: Steps) -> Sag | None:
        controller = self.prior.plant.controller
        assert controller is not None
        if controller.prescribed:
            return None
        return expected_sag(controller.law, [*self.recordings, *(step.outcome.recording for step in steps)])

    def _sought(self, belief: Belief, rng: np.random.Generator, past: list, effort: Effort, sag: Sag | None) -> Plan:
        demands = self.options.demands(belief.at().model)
        return plan(belief, self.target, rng=rng, past=past, demands=demands, effort=effort, sag=sag)

    def _struck(self, number: int, chosen: Plan, belief: Belief) -> Seen:
        stored, folder = self._read(number, OUTCOME), self._place(number)
        if stored is not None:
            assert folder is not None
            filmed = stored.pop("filmed")
            recording = None
            if filmed is not None:
                recording = StrikeRecording.load(folder / RECORDING)
                recording = replace(recording, source=filmed)  # its name from before it was a file
            return Seen(recording, **stored)
        strike = Strike.from_vector(chosen.strike)
        seen = checked(self.port.strike(strike, number, folder, belief.at().model), strike, number)
        if number == 0 and seen.recording is not None:  # meant for no target, and of use to its end
            seen = replace(seen, recording=replace(seen.recording, target=None))
        if folder is not None and seen.recording is not None:
            seen.recording.save(folder / RECORDING)
        told: dict[str, Any] = {name: getattr(seen, name) for name in ("seen_miss", "true_miss", "fault")}
        self._write(number, OUTCOME, told | {"filmed": None if seen.recording is None else seen.recording.source})
        return seen

    def _judged(self, number: int, chosen: Plan, outcome: Seen, learned: Learned | None) -> Judgement | None:
        recording, o = outcome.recording, self.options
        if recording is None or outcome.fault:
            return None if outcome.seen_miss is None else judge_seen(outcome.seen_miss, self.target)
        belief = learned.belief if learned is not None and recording.source in learned.rmse else None
        until = None if chosen.contact is None else chosen.contact + AFTER
        return judge(recording, self.target, belief, until=until, seed=(o.seed, number))

    def _learned(
        self, number: int, recordings: list[StrikeRecording], belief: Belief, contacts: dict[str, float]
    ) -> Learned:
        stored = self._read(number, POSTERIOR)
        if stored is not None:
            rest = {name: stored[name] for name in _LEARNED}
            return Learned(Belief.from_table(self.prior.plant, stored), **rest)
        o = self.options
        learned = update(self.prior, recordings, guess=belief, contacts=contacts, starts=o.starts, seed=o.seed)
        told = {name: getattr(learned, name) for name in _LEARNED}
        self._write(number, POSTERIOR, learned.belief.to_table() | told)
        return learned

    def _place(self, number: int) -> Path | None:
        if self.folder is None:
            return None
        place = self.folder / f"strike-{number:04d}"
        place.mkdir(parents=True, exist_ok=True)
        return place

    def _read(self, number: int, name: str) -> dict[str, Any] | None:
        place = None if self.folder is None else self.folder / f"strike-{number:04d}" / name
        if place is None or not place.exists():
            return None
        try:
            return json.loads(place.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(str(place), str(error)[:80], "what whiptool wrote", f"delete {place.parent}") from None

    def _write(self, number: int, name: str, table: dict[str, Any]) -> None:
        place = self._place(number)
        if place is not None:
            write_whole(place / name, json.dumps(table, indent=1) + "\n")
