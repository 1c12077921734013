"""The probability that a strike hit, from the whip's posterior and the camera's frames, weighed together.

The path of the tip is that of a whip drawn from the posterior, plus a discrepancy that no whip explains. Where the
frames contradict the whip, the frames decide, within their noise; see `whiptool.identification.film_judgement`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.goals.target import Target
from whiptool.identification.film_judgement import RATE, Judgement, frames_of, judge_frames, weigh
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

NOISE = 0.005  # [m], standard error of a miss that a port tells without one: a plain camera's
WHIPS = 32  # of the belief
_SIZES, _PACES = np.geomspace(0.001, 0.5, 9), np.array([0.015, 0.03, 0.06, 0.12])  # [m], [s] of a discrepancy


def judge_seen(miss: float, target: Target, error: float = NOISE) -> Judgement:
    """Return the judgement of a strike of which only the miss distance is known, from a port that returns no recording.

    Args:
        miss: Miss distance [m].
        target: Target. If it asks for a direction or a speed, no hit is claimed, as the tip's velocity is unknown.
        error: Standard error of the miss distance [m].
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
    """Return the miss distance of a recorded strike with its standard error, and the probability that it hit.

    Args:
        recording: Recording of the tip, with the strike's command.
        target: Point and hit radius.
        belief: The posterior of the whip, this strike included; None: the strike is judged by the frames alone.
        until: Frames after this time [s] are ignored, unless the closest approach is among them: after a contact with
            the target the whip moves as no model predicts. None: all frames are used.
        seed: Seed of the whips that are drawn from the belief.

    Returns:
        The judgement; None if too few frames show the tip.
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
