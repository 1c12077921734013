"""Planning of strikes and identification from their recordings; every step is stored, so that a killed run can be
resumed.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from whiptool.adaptation.first_look import Sag, choose_wiggle, expected_sag, hanging
from whiptool.adaptation.plan_search import Demands, Plan, PlanningEffort
from whiptool.adaptation.planner import FIRST, NEXT, UNSURE, plan
from whiptool.adaptation.posterior import AFTER, driven_by, tip_mislabelled, update
from whiptool.adaptation.prior import Belief, Learned
from whiptool.adaptation.steps import Seen, Step, Steps, checked, judge, judge_seen, seen_of
from whiptool.errors import InputError, WhiptoolError, expect
from whiptool.given_files import build_from, check_kinds, parsing, read_json
from whiptool.goals.target import Target
from whiptool.identification.beginnings import check_beginnings
from whiptool.identification.inputs import check_controllers
from whiptool.identification.predict import Predictor
from whiptool.limits.all_limits import Given
from whiptool.models.numbers import number, whole
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike, StrikeBounds
from whiptool.progress import Progress
from whiptool.recording.filmed_approach import Judgement
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.whole_files import write_whole

_LEARNED = ("rmse", "refused", "wall_time", "redundancy")  # stored with the belief
_JUDGED = ("miss", "error", "probability")  # stored for who follows the run; None where nothing was judged
_SOON = 0.5  # [s] between two looks at the progress of planning
PLAN, OUTCOME, POSTERIOR, JUDGED = "plan.json", "outcome.json", "posterior.json", "judged.json"
RECORDING = "recording.npz"
Stored = TypeVar("Stored")


def strike_folder(run_folder: Path, number: int) -> Path:
    """Return the folder of a strike, or of the measurement before the first one, number 0."""
    return run_folder / f"strike-{number:04d}"


@dataclass(frozen=True)
class Options:
    """Settings of an adaptation.

    Args:
        max_strikes: Largest number of strikes.
        stop_at: End after the first strike whose estimated miss distance is at most this [m]; None: after the first hit
            that is claimed, see `Step.hit`; 0: only after `max_strikes`.
        still: Film the hanging whip before the first strike, as step 0, unless earlier recordings are given.
        wiggle: Make a short, slow movement as step 0 instead.
        adapt: Whether to identify the whip; if not, one strike is planned from the prior and repeated.
        starts: Number of starting points of every identification.
        seed: Seed of candidate strikes, sampled whips and starting points.
        t_stay: Time after the movement's end for which the tip is still observed [s].
        bounds, limits: Bounds and limits of the strikes, see `whiptool.adaptation.plan_search.Demands`.
        check: Function of a strike and the posterior mean of whip and arm that returns the reason why the strike is not
            allowed, or None.
        first, later: Planning effort before and after the first recording that was used for identification.
        retries: Largest number of further searches with effort `first` for a strike that must not be made, or a later
            one whose hit probability is below 50 %.
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
    limits: Given = ()
    check: Callable[[Strike, Model], str | None] | None = None
    first: PlanningEffort = FIRST
    later: PlanningEffort = NEXT
    retries: int = 1

    def __post_init__(self) -> None:
        for name in ("max_strikes", "starts"):
            whole(name.replace("_", " "), getattr(self, name))
        for name in ("seed", "retries"):
            whole(name, getattr(self, name), low=0)
        for name, value in {"t_stay": self.t_stay, "stop at": self.stop_at or 0.0}.items():
            number(name, value, low=0)

    def demands(self, believed: Model) -> Demands:
        """Return the requirements of a strike; `check` is given `believed`, the posterior mean of whip and arm."""
        check = self.check
        asked = None if check is None else lambda strike: check(strike, believed)
        return Demands(self.bounds, self.limits, asked, self.t_stay)


class NoPlan(WhiptoolError):
    """Raised if no strike was found that may be made; none was made, and none counts.

    Args:
        number: Number of the strike in the run.
        reason: Reason of the best plan, which says why it must not be made.
    """

    def __init__(self, number: int, reason: str) -> None:
        super().__init__(f"no plan for strike {number}, which is not made: {reason}")


class Adapter:
    """Plans strikes and identifies an unknown whip from their recordings: `ask` plans a strike, `tell` takes its
    recording.

    Steps of an earlier run are read from the folder and not planned again. A strike that was planned but not reported
    is returned by `ask` again, unchanged.

    Args:
        prior: Belief about the whip before the first strike.
        target: Point to hit, and hit radius.
        options: See `Options`.
        folder: Run folder; None: nothing is written.
        recordings: Earlier recordings of the same whip, from which the first strike is planned.
        known: Belief after those recordings, if it was computed before; None: the belief is identified from the
            recordings.
        opening: The first plan, if it was made before; None: it is computed.

    Attributes:
        number: Number of the strike that is to be planned or reported next, from 1; 0 is the measurement of the whip
            before the first strike.
        belief: Belief about the whip after all reported recordings.
        steps: All steps that were reported.
        done: Whether all strikes have been made, or the last one hit.
    """

    def __init__(
        self,
        prior: Belief,
        target: Target,
        options: Options | None = None,
        folder: Path | None = None,
        *,
        recordings: Sequence[StrikeRecording] = (),
        known: Belief | None = None,
        opening: Plan | None = None,
    ) -> None:
        self.prior, self.target, self.folder, self.opening = prior, target, folder, opening
        self.options = o = options or Options()
        self.belief, self.steps, self.done = known or prior, Steps(), False
        self._recordings, self._past, self._contacts = list(recordings), [], dict[str, float]()
        self._taught, self._resting = known is not None, set[str]()
        self._asked: Plan | None = None
        self._check_controllers(self._recordings)
        if self._recordings and o.adapt and not self._taught:
            learned = update(prior, self._recordings, starts=o.starts, seed=o.seed)
            for recording in self._recordings:
                _refuse_unused(learned, recording, "leave it out")
            self.belief, self._taught = learned.belief, bool(learned.rmse)
        self.number = 0 if o.wiggle or (o.still and o.adapt and not self._taught) else 1

    def __repr__(self) -> str:
        return f"Adapter({self.steps!r}, {'done' if self.done else f'next is strike {self.number}'})"

    @property
    def place(self) -> Path | None:
        """Folder of the next strike; None: there is no run folder."""
        return None if self.folder is None else strike_folder(self.folder, self.number)

    def ask(self) -> Strike | None:
        """Return the strike to be made next, the same until its recording is reported; None after the last strike.

        Raises:
            NoPlan: Limits or `check` forbid every strike that was found.
            InputError: The folder is damaged.
        """
        self._catch_up()
        return None if self.done else Strike.from_vector(self._plan().strike)

    @property
    def asked(self) -> Strike:
        """The strike that was planned and not reported yet.

        Raises:
            InputError: The folder holds no run, or is damaged.
        """
        self._catch_up()
        if self.done or (self._asked is None and self._read(PLAN, self._plan_of) is None):
            ask = "call ask() first; on the command line, whiptool adapt next without a recording"
            fix = "the run has ended" if self.done else ask
            given, rule = f"one of strike {self.number}", "the recording of a strike that was planned"
            raise InputError("recording", given, rule, fix)
        return Strike.from_vector(self._plan().strike)

    def tell(self, told: StrikeRecording | Seen, *, must_teach: bool = False) -> Step:
        """Learn from the recording of the planned strike, and return the step: plan, outcome and posterior.

        Args:
            told: Recording of the strike with the marker `tip`, in which time 0 is the start of the command; or a
                `Seen`, which can say why there is no recording.
            must_teach: Whether to refuse a recording without information instead of storing it, so that a person can
                correct it or record the strike again.

        Raises:
            InputError: `ask` was not called before, the recording is of another strike or controller or was reported
                before, `must_teach` is true and it has no information, or the folder is damaged.
        """
        strike = self.asked
        if isinstance(told, StrikeRecording):
            told = told.for_model(self.prior.plant.model)
        seen = seen_of(told, self.target.position) if isinstance(told, StrikeRecording) else told
        seen = checked(seen, strike, self.number)
        if seen.recording is not None:
            self._refuse_told_before(seen.recording)
            if must_teach or isinstance(told, StrikeRecording):  # a twin's own port may strike with gains unlike these
                self._check_controllers([seen.recording])
        learned = self._taught_by(seen) if must_teach else None
        return self._step(self._keep(seen), learned)

    def _taught_by(self, seen: Seen) -> Learned | None:
        """Return the posterior with a recording, before it is kept; None where nothing can be learned from it."""
        if seen.recording is None or not seen.carried_out or not self.options.adapt:
            return None
        plant, drive = self.prior.plant, driven_by(self.prior.plant, [seen.recording])
        check_beginnings(Predictor([seen.recording], plant, drive=drive, shared=()), plant)
        contact, source = self._plan().contact, seen.recording.source
        contacts = self._contacts if contact is None else {**self._contacts, source: contact}
        learned = self._update([*self._recordings, seen.recording], contacts)
        _refuse_unused(learned, seen.recording, "mend it, or record the strike again, and tell it then: none was kept")
        return learned

    def kept_steps(self) -> Iterator[Step]:
        """Resume an earlier run: process, one after the other, the recordings that the folder holds, and yield each
        step.
        """
        while not self.done and (seen := self._kept()) is not None:
            yield self._step(seen)

    def _catch_up(self) -> None:
        """Go on with all of these."""
        for _ in self.kept_steps():
            pass

    def _step(self, seen: Seen, taught: Learned | None = None) -> Step:
        """Update the posterior with what was seen of the planned strike, unless that was done, and go on."""
        o, number, chosen = self.options, self.number, self._plan()
        if number and seen.carried_out:
            self._past.append(chosen.strike)
        if seen.recording is not None and seen.carried_out:
            self._recordings.append(seen.recording)
            if chosen.contact is not None:
                self._contacts[seen.recording.source] = chosen.contact
        learned = None
        if o.adapt and self._recordings:
            learned = self._learned(taught)
            self.belief = learned.belief
            if number == 0 and not o.wiggle:  # tells the length alone: the next plan is a first one
                self._resting = set(learned.rmse)
            self._taught = self._taught or bool(set(learned.rmse) - self._resting)
        judged = self._judged(chosen, seen, learned) if number else None
        self._write(JUDGED, {name: getattr(judged, name, None) for name in _JUDGED})
        step = Step(number, chosen, seen, learned, judged)
        self.steps.append(step)
        self.number, self._asked = number + 1, None
        self.done = self.number > o.max_strikes or (judged is not None and self._enough(judged))
        return step

    def _enough(self, judged: Judgement) -> bool:
        return judged.hit if self.options.stop_at is None else judged.miss <= self.options.stop_at

    def _plan(self) -> Plan:
        """The plan of the next strike, made where it was not made before."""
        if self._asked is None:
            self._asked = self._read(PLAN, self._plan_of)
            if self._asked is None:
                self._asked = self._planned()
                self._write(PLAN, asdict(self._asked))
        return self._asked

    def _plan_of(self, table: dict[str, Any]) -> Plan:
        row = tuple(Strike.from_vector(table["strike"]).vector.tolist())
        kept = {**table, "strike": row, "misses": tuple(table.get("misses", ()))}
        check_kinds(Plan, kept)
        if len(row) != (count := 2 * self.prior.plant.model.arm.n + 1):
            raise InputError("strike", row, f"{count} numbers")
        return build_from(Plan, kept, "")

    def _planned(self) -> Plan:
        """Plan a step; a bar shows how many strikes were judged."""
        check, what = self.options.check, f"planning strike {self.number}" if self.number else "planning a first look"
        with Progress(desc=what, unit=" strikes judged", mininterval=_SOON, leave=False, disable=check is None) as bar:

            def counted(strike: Strike, believed: Model) -> str | None:
                bar.update()
                return None if check is None else check(strike, believed)

            return self._searched(self.options if check is None else replace(self.options, check=counted))

    def _searched(self, o: Options) -> Plan:
        """Plan a step with other options than those of the run, such as a `check` that counts."""
        number, began = self.number, time.perf_counter()
        rng = np.random.default_rng([o.seed, number])
        if number == 0:
            in_space = self.prior.plant.model.dimension == 3  # in the plane a rig rehearses it
            check = o.demands(self.belief.at().model).check if in_space else None
            kept: dict[str, Any] = {"t_stay": o.t_stay, "keeps": o.limits if in_space else (), "check": check}
            if o.wiggle:
                strike, gain = choose_wiggle(self.belief, rng=rng, bounds=o.bounds, **kept)
                reason = f"a movement from which {gain:.1f} nat are learned about the whip"
            else:
                strike = hanging(self.belief, o.bounds, rng=rng, **kept)
                reason = "the whip as it hangs: how long it is"
            return Plan(tuple(map(float, strike.vector)), None, None, None, None, reason, time.perf_counter() - began)
        if number > 1 and not o.adapt:
            return self.steps[-1].plan
        if number == 1 and self.opening is not None:
            return self.opening
        found = plan(
            self.belief,
            self.target,
            rng=rng,
            past=self._past,
            demands=o.demands(self.belief.at().model),
            effort=o.later if self._taught else o.first,
            retries=[o.first] * o.retries,
            enough=UNSURE if self._taught else 0.0,  # before the first recording whatever may be made is enough
            sag=self._expected_sag(),
        )
        if not found.allowed:
            raise NoPlan(number, found.reason)
        return found

    def _expected_sag(self) -> Sag | None:
        controller = self.prior.plant.controller
        assert controller is not None
        return None if controller.prescribed else expected_sag(controller.law, self._recordings)

    def _judged(self, chosen: Plan, seen: Seen, learned: Learned | None) -> Judgement | None:
        recording = seen.recording
        if not seen.carried_out:
            return None
        if recording is None:
            return None if seen.seen_miss is None else judge_seen(seen.seen_miss, self.target)
        if tip_mislabelled(recording):
            return None  # no frame can be trusted to show the tip
        belief = learned.belief if learned is not None and recording.source in learned.rmse else None
        until = None if chosen.contact is None else chosen.contact + AFTER
        return judge(recording, self.target, belief, until=until, seed=(self.options.seed, self.number))

    def _learned(self, taught: Learned | None) -> Learned:
        stored = self._read(POSTERIOR, self._learned_of)
        if stored is not None:
            return stored
        learned = taught or self._update(self._recordings, self._contacts)
        kept = {name: getattr(learned, name) for name in _LEARNED}
        self._write(POSTERIOR, learned.belief.to_table() | kept)
        return learned

    def _learned_of(self, table: dict[str, Any]) -> Learned:
        kept = {name: table[name] for name in _LEARNED}
        check_kinds(Learned, kept)
        return Learned(Belief.from_table(self.prior.plant, table), **kept)

    def _update(self, recordings: Sequence[StrikeRecording], contacts: dict[str, float]) -> Learned:
        o = self.options
        return update(self.prior, recordings, guess=self.belief, contacts=contacts, starts=o.starts, seed=o.seed)

    def _check_controllers(self, recordings: Sequence[StrikeRecording]) -> None:
        """Refuse what another controller struck than that of the prior."""
        if self.prior.plant.controller is not None:
            check_controllers(recordings, self.prior.plant.controller)

    def _refuse_told_before(self, recording: StrikeRecording) -> None:
        """Raise InputError for the recording of a strike that was reported before."""
        for step in self.steps:
            earlier = step.outcome.recording
            if earlier is None or earlier.points.shape != recording.points.shape:
                continue
            if np.array_equal(earlier.points, recording.points, equal_nan=True):
                fix = "record the requested strike"
                raise InputError(
                    "recording", recording.source, f"another recording than that of strike {step.number}", fix
                )

    def _kept(self) -> Seen | None:
        """What was seen of the next strike, if the folder has it."""
        return self._read(OUTCOME, self._seen_of)

    def _seen_of(self, table: dict[str, Any]) -> Seen:
        assert self.place is not None
        filmed, recording = table.pop("filmed"), None
        expect(str, type(None), filmed=filmed)
        if filmed is not None:  # its name from before it was a file
            recording = replace(StrikeRecording.load(self.place / RECORDING), source=filmed)
        check_kinds(Seen, table)
        return build_from(Seen, table, "", recording=recording)

    def _keep(self, seen: Seen) -> Seen:
        if self.number == 0 and seen.recording is not None:  # meant for no target, and of use to its end
            seen = replace(seen, recording=replace(seen.recording, target=None))
        if self.place is not None and seen.recording is not None:
            self.place.mkdir(parents=True, exist_ok=True)
            seen.recording.save(self.place / RECORDING)
        kept: dict[str, Any] = {name: getattr(seen, name) for name in ("seen_miss", "true_miss", "fault", "refused")}
        self._write(OUTCOME, kept | {"filmed": None if seen.recording is None else seen.recording.source})
        return seen

    def _read(self, name: str, made_of: Callable[[dict[str, Any]], Stored]) -> Stored | None:
        """Return what a stored file says of this strike; None: the file is missing."""
        place = None if self.place is None else self.place / name
        if place is None or not place.exists():
            return None
        try:
            with parsing(place, "JSON"):
                return made_of(read_json(place))
        except InputError as error:
            raise error.advising(f"delete {place.parent}") from None

    def _write(self, name: str, table: dict[str, Any]) -> None:
        if self.place is not None:
            self.place.mkdir(parents=True, exist_ok=True)
            write_whole(self.place / name, json.dumps(table, indent=1, allow_nan=False) + "\n")


def _refuse_unused(learned: Learned, recording: StrikeRecording, fix: str) -> None:
    """Raise InputError with the reason if nothing was learned from a recording."""
    if (reason := learned.refused.get(recording.source)) is not None:
        raise InputError(
            recording.source, f"nothing to learn from: {reason}", "a recording with information on the whip", fix
        )
