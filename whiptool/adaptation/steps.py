"""Steps of an adaptation: each strike with its plan, its outcome, the estimated miss distance and the belief after it.

The probability that a strike hit combines the posterior of the whip and the camera's frames. The path of the tip is
that of a whip drawn from the posterior plus a discrepancy, which is large if the frames contradict the whip; see
`whiptool.recording.filmed_approach`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.prior import Belief, Learned, fresh_terms
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike
from whiptool.recording.filmed_approach import RATE, Judgement, approach_seen, frames_of, judge_frames, weigh
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

NOISE = 0.005  # [m], standard error of a miss that a port tells without one: a plain camera's
WHIPS = 32  # of the belief
_SIZES, _PACES = np.geomspace(0.001, 0.5, 9), np.array([0.015, 0.03, 0.06, 0.12])  # [m], [s] of a discrepancy


def judge_seen(miss: float, target: Target, error: float = NOISE) -> Judgement:
    """Return the judgement of a strike from its measured miss distance and standard error [m] alone, for a port without
    a recording. If the target asks for a direction or speed, no hit is claimed, as the tip's velocity is unknown.
    """
    return Judgement(miss, error, float(target.goals.hit_probability(np.array(miss), None, error)))


def judge(
    recording: StrikeRecording,
    target: Target,
    belief: Belief | None = None,
    *,
    until: float | None = None,
    seed: Sequence[int] = (0,),
) -> Judgement | None:
    """Return the miss distance of a recorded strike with its standard error, and the probability that it hit; None if
    too few frames show the tip. Without the posterior `belief` of the whip after this strike only the frames are used.

    Frames after the time `until` [s] are ignored, unless the closest approach is among them: after a contact with the
    target the whip moves as no model predicts.
    """
    frames = frames_of(recording, target, until)
    if frames is None:
        return None
    if belief is not None:
        t, paths = _believed(belief, recording, seed)
        if len(paths):
            watched = t <= (math.inf if until is None else max(until, frames.t[-1]))
            return weigh(t[watched], paths[:, watched], frames, target, _SIZES, _PACES)
    return judge_frames(frames, target)


def _believed(belief: Belief, recording: StrikeRecording, seed: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Paths of the tip with whips drawn from a belief, by the recording's clock: times (T,) [s], (S, T, d) [m].

    Those that diverge are left out.
    """
    assert recording.strike is not None
    plant = belief.at()
    assert plant.controller is not None
    rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief), sag=recording.stood)
    whips = belief.sample(np.random.default_rng(list(seed)), WHIPS)
    t, paths, _ = rollout.tip_path(
        np.tile(recording.strike.vector, (len(whips), 1)),
        t_stay=recording.t_stay,
        rate=RATE,
        models=[whip.model for whip in whips],
        controllers=[whip.controller for whip in whips if whip.controller is not None],
    )
    late = belief.values().get("delay", 0.0)
    return t + late, paths[np.isfinite(paths).all(axis=(1, 2))]


_SAME = 1e-6  # [rad], [s]: two strikes are one
_SHOWN = 5  # strikes that the representation of a whole adaptation shows, the last ones


@dataclass(frozen=True)
class Seen:
    """Result of a strike, which a port returns.

    Args:
        recording: The filmed path of the tip; None: the tip was not seen.
        seen_miss: Miss distance along the filmed path, interpolated smoothly between frames [m]; None: unknown.
        true_miss: True miss distance, which only a simulated twin can measure [m]; None: not measured.
        fault: Reason why the strike was interrupted, which ends the session; empty: not interrupted.
        refused: Reason why the strike was refused before anything moved; empty: not refused. The session continues with
            the next strike.
    """

    recording: StrikeRecording | None
    seen_miss: float | None
    true_miss: float | None = None
    fault: str = ""
    refused: str = ""

    @property
    def carried_out(self) -> bool:
        """Whether the strike was carried out. A refused or interrupted strike is not used for identification."""
        return not (self.fault or self.refused)


def seen_of(
    recording: StrikeRecording, target: Sequence[float], *, true_miss: float | None = None, fault: str = ""
) -> Seen:
    """Return the result of a filmed strike: the recording, and the miss distance in its frames.

    The tip's path is interpolated smoothly between frames; gaps of more than two frames are left out, see
    `approach_seen`.

    Args:
        recording: Path of the tip; its time 0 is the start of the command.
        target: Position of the target [m].
        true_miss: True miss distance, which only a simulated twin can measure [m]; None: not measured.
        fault: Reason why the strike was interrupted; empty: not interrupted. After a fault no miss distance is
            computed.

    Raises:
        InputError: The recording has no marker `tip`, is in pixels, or in a plane although the target is in space.
    """
    _refuse_pixels(recording)
    recording.check_coordinates(len(target))
    near = approach_seen(recording, target)
    return Seen(recording, None if near is None or fault else near.distance, true_miss, fault)


class Port(Protocol):
    """Base class of ports, which make strikes and film them: a simulated twin, a whiptool rig, or a user's robot.

    A port may also have a method `refusal(strike, believed)`, which returns why it would refuse a strike if it were
    made next, or None; strikes that it refuses are then not planned, unless `Options.check` is given.
    """

    def strike(self, strike: Strike, number: int, folder: Path | None, believed: Model | None = None) -> Seen:
        """Make a strike, film it, and return the result.

        Args:
            strike: The strike to make.
            number: Number of the strike, from 1; 0 is the measurement of the whip before the first strike. A simulated
                port draws the same noise for the same number.
            folder: For the port's own records; None: none are kept.
            believed: The posterior mean of whip and arm, with which a port may simulate the strike before making it.

        Returns:
            See `seen_of`; a strike that was refused is `Seen(None, None, refused="why")`, one that was interrupted
            `Seen(None, None, fault="why")`. An exception ends the session as a fault does.
        """
        ...


def checked(seen: Any, strike: Strike, number: int) -> Seen:
    """Return a port's result of strike `number` after checking it; its recording gets the strike and a source that
    names the number.
    """
    if not isinstance(seen, Seen):
        given = f"{type(seen).__name__} from strike {number}"
        raise InputError("port", given, "a Seen", "return whiptool.adaptation.steps.seen_of(recording, target)")
    recording = seen.recording
    if recording is None:
        return seen
    if not isinstance(recording, StrikeRecording):
        given = f"{type(recording).__name__} from strike {number}"
        raise InputError("port: recording", given, "a StrikeRecording, or None if the tip was not seen")
    _refuse_pixels(recording)
    if "tip" not in recording.markers:
        raise InputError("port: markers", recording.markers, "the tip among them")
    if recording.strike is not None and not _is_same(recording.strike, strike):
        given = recording.strike.vector.tolist()
        raise InputError("port: strike of the recording", given, f"{strike.vector.tolist()}, the requested strike")
    named = f"strike {number}"
    source = recording.source if recording.source.endswith(named) else f"{recording.source or 'port'}, {named}"
    return dataclasses.replace(seen, recording=dataclasses.replace(recording, strike=strike, source=source))


def _is_same(one: Strike, other: Strike) -> bool:
    """Whether two strikes are one; of arms with different numbers of joints they are not."""
    a, b = one.vector, other.vector
    return len(a) == len(b) and np.allclose(a, b, rtol=0, atol=_SAME)


def _refuse_pixels(recording: StrikeRecording) -> None:
    """Refuse what one camera in space saw: one camera alone does not determine where the tip was."""
    if recording.view is not None:
        fix = "give the recordings of two cameras or more, or use motion capture"
        raise InputError("recording", f"{recording.source or 'one'} in pixels", "positions of the tip in m", fix)


@dataclass(frozen=True, repr=False)
class Step:
    """One strike: its plan, its outcome, and the belief after it.

    Args:
        number: Counted from 1; 0 is the measurement of the whip before the first strike.
        plan: The strike that was planned, and its predicted probability of a hit.
        outcome: The recording, and the miss distance that it shows.
        learned: The belief about the whip after this strike; None if the adaptation does not identify the whip.
        judged: The estimated miss distance with its standard error: from the belief and the camera if the recording was
            used for identification, else from the camera alone; the true path of a twin is not used. None: the tip was
            not seen.
    """

    number: int
    plan: Plan
    outcome: Seen
    learned: Learned | None
    judged: Judgement | None

    def __repr__(self) -> str:
        if not self.number:
            return "Step(first look at the whip)"
        verdict = "not seen" if self.judged is None else f"{self.judged.verdict}, {_millimetres(self)}"
        return f"Step(strike {self.number}: {verdict}; probability of a hit as planned {_planned(self)})"

    @property
    def strike(self) -> Strike:
        """The strike that was planned."""
        return Strike.from_vector(self.plan.strike)

    @property
    def hit(self) -> bool | None:
        """Whether a hit is claimed, which takes a hit probability of 90 % or more; None: the tip was not seen."""
        return None if self.judged is None else self.judged.hit


class Steps(list[Step]):
    """All steps of a run in order, beginning with the measurement before the first strike, number 0, if any."""

    def __repr__(self) -> str:
        strikes = self.strikes
        if not strikes:
            return "Steps(0 strikes)"
        count = f"{len(strikes)} strike{'s' * (len(strikes) > 1)}, {sum(bool(s.hit) for s in strikes)} hit"
        of = "" if len(strikes) <= _SHOWN else f" of the last {_SHOWN}"
        misses = ", ".join(_millimetres(step) for step in strikes[-_SHOWN:])
        planned = ", ".join(_planned(step) for step in strikes[-_SHOWN:])
        return f"Steps({count}; misses{of}: {misses}; probability of a hit as planned: {planned})"

    @property
    def strikes(self) -> list[Step]:
        """The steps of strikes at the target: all except number 0, the measurement before the first strike."""
        return [step for step in self if step.number]


def percent(probability: float) -> str:
    """Return a probability as text in percent, never rounded to 0 % or 100 %."""
    if 0.995 <= probability < 1 or 0 < probability < 0.005:
        return "> 99 %" if probability > 0.5 else "< 1 %"
    return f"{100 * probability:.0f} %"


def _millimetres(step: Step) -> str:
    """The judged miss distance with its standard error."""
    judged = step.judged
    return "not seen" if judged is None else f"{1e3 * judged.miss:.0f} ± {1e3 * judged.error:.0f} mm"


def _planned(step: Step) -> str:
    """The probability of a hit that was stated before the strike."""
    return "unknown" if step.plan.probability is None else percent(step.plan.probability)
