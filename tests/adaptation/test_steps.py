"""Judged hits: the probability is right where the truth is known, frames that contradict a whip win, noise counts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.adaptation.steps import _PACES, _SIZES, Seen, Step, Steps, judge, judge_seen, percent
from whiptool.goals.goals import CLAIMED
from whiptool.goals.target import Target
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.models.trajectory import closest_on_segments
from whiptool.recording.filmed_approach import Frames, Judgement, weigh
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)


@pytest.fixture(scope="module")
def sure() -> Belief:
    """That the whip is the model, all but certainly."""
    prior = default_prior(MODEL, CONTROLLER, whip="uniform")
    return dataclasses.replace(prior, covariance=1e-8 * prior.covariance)


@pytest.fixture(scope="module")
def path() -> tuple[np.ndarray, np.ndarray]:
    """The model's tip: times, and places."""
    t, paths, _ = CompiledRollout(MODEL, CONTROLLER).tip_path(STRIKE.vector[None], t_stay=0.3, rate=2000.0)
    return t, paths[0]


def filmed(path, *, off=None, noise: float = 0.005, seed: int = 0, stated: float | None = None) -> StrikeRecording:
    t, points = path
    points = points + (0 if off is None else off)
    frames = np.arange(int(t[-1] * 60) + 1) / 60
    seen = np.stack([np.interp(frames, t, points[:, i]) for i in range(2)], axis=1)
    seen += noise * np.random.default_rng(seed).standard_normal(seen.shape)
    return StrikeRecording(frames, seen[:, None], ("tip",), np.array(stated or noise), strike=STRIKE, t_stay=0.3)


def passing(path, side: float) -> tuple[float, float]:
    """A place that the path passes at a distance, at 0.7 s."""
    t, points = path
    k = int(np.searchsorted(t, 0.7))
    along = points[k + 1] - points[k - 1]
    x, y = points[k] + side * np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return float(x), float(y)


def nearest(points: np.ndarray, place) -> float:
    return float(np.linalg.norm(points - place, axis=1).min())


@pytest.mark.slow
def test_stated_probabilities_and_errors_hold_over_many_strikes(path):
    """Discrepancies of sizes and paces that no judge knows, frames with noise, targets near the edge of a hit."""
    rng, t, points = np.random.default_rng(2), *path
    t, points = t[::4], points[::4]
    frames = np.arange(int(t[-1] * 60) + 1) / 60
    stated, hits, scores = [], [], []
    for _ in range(150):
        size, pace = np.exp(rng.uniform(np.log(0.004), np.log(0.1))), rng.uniform(0.03, 0.15)
        x = np.abs(t[:, None] - t) / pace
        wave = np.linalg.cholesky(np.exp(-(x**2) / 2) + 1e-6 * np.eye(len(t)))  # smoother than the judge takes it
        true = points + size * wave @ rng.standard_normal((len(t), 2))
        seen = np.stack([np.interp(frames, t, true[:, i]) for i in range(2)], axis=1)
        seen += 0.005 * rng.standard_normal(seen.shape)
        place = passing((t, true), rng.uniform(0.03, 0.09))
        target = Target(place, 0.06)
        noise = np.full(len(frames), 0.005)
        judged = weigh(t, points[None], Frames(frames, seen, noise), target, _SIZES, _PACES)
        miss = float(closest_on_segments(true, np.array(place)).distance)
        stated.append(judged.probability)
        hits.append(miss <= 0.06)
        scores.append((miss - judged.miss) / judged.error)
    stated, hits, scores = np.array(stated), np.array(hits), np.abs(scores)
    brier, constant = np.mean((stated - hits) ** 2), hits.mean() * (1 - hits.mean())
    assert brier < 0.5 * constant
    assert abs(stated.mean() - hits.mean()) < 0.06
    assert np.mean(scores <= 1.645) > 0.84
    assert np.mean(hits[stated > CLAIMED]) > 0.9
    assert (stated > CLAIMED).mean() > 0.2  # it is not always in doubt


def test_a_whip_that_explains_the_frames_is_believed(sure, path):
    """Its miss is told far more sharply than single frames could."""
    place = passing(path, 0.03)
    judged = judge(filmed(path), Target(place, 0.06), sure)
    assert judged is not None
    assert judged.miss == pytest.approx(nearest(path[1], place), abs=0.003)
    assert judged.error < 0.004
    assert judged.hit


def test_frames_that_contradict_the_whip_win(sure, path):
    """The whip as it is believed passes 1 cm from the target; the tip was 20 cm away by then, and never nearer."""
    t, points = path
    place = passing(path, 0.01)
    away = points[np.searchsorted(t, 0.7)] - np.array(place)  # 1 cm
    off = 20 * np.clip((t - 0.45) / 0.15, 0, 1)[:, None] * away
    target = Target(place, 0.06)
    truth = nearest(points + off, place)
    assert truth > 0.15
    judged = judge(filmed(path, off=off), target, sure)
    assert judged is not None
    assert judged.probability < 0.01
    assert judged.miss == pytest.approx(truth, abs=0.05)


def test_where_no_frame_tells_the_judgement_is_in_doubt(sure, path):
    """A whip that was 5 cm off until the tip was lost may well be so afterwards."""
    t, _ = path
    off = 0.05 * np.stack([np.sin(9 * t), np.cos(7 * t)], axis=1) * np.clip(t / 0.3, 0, 1)[:, None]
    recording = filmed(path, off=off)
    lost = recording.without(recording.t > 0.6)
    target = Target(passing(path, 0.0), 0.03)
    judged = judge(lost, target, sure)
    assert judged is not None
    assert 0.1 < judged.probability < CLAIMED
    assert judged.error > 0.01


def test_noise_counts(sure, path):
    """No frames of 5 mm noise say that a target of half a millimetre was hit."""
    target = Target(passing(path, 0.0), 0.0005)
    for belief in (sure, None):
        judged = judge(filmed(path), target, belief)
        assert judged is not None
        assert judged.miss < 0.01
        assert not judged.hit
    sharp, blurred = (judge(filmed(path, noise=x), Target(passing(path, 0.05)), None) for x in (0.001, 0.02))
    assert sharp is not None
    assert blurred is not None
    assert sharp.error < blurred.error


def test_frames_alone(path):
    place = passing(path, 0.04)
    judged = judge(filmed(path), Target(place, 0.06))
    assert judged is not None
    assert abs(judged.miss - nearest(path[1], place)) < 3 * judged.error
    few = filmed(path)
    few = few.without(few.t > 0.04)
    assert judge(few, Target(place, 0.06)) is None


def test_what_came_after_the_target_was_met_is_not_looked_at(sure, path):
    """A real target stops the tip; until then the frames agree with the whip."""
    t, points = path
    place = passing(path, 0.01)
    met = t > 0.76
    stopped = np.where(met[:, None], points[np.searchsorted(t, 0.76)] - points, 0)
    recording = filmed((t, points), off=stopped)
    judged = judge(recording, Target(place, 0.03), sure, until=0.74)
    assert judged is not None
    assert judged.error < 0.005
    assert judged.hit


def test_a_distance_alone_claims_no_hit_of_a_direction():
    """Where the tip passed is known, and how it moved is not: undecided, or missed where it was far."""
    point, aimed = Target((1.2, 0.1), 0.06), Target((1.2, 0.1), 0.06, direction=(0, 1))
    assert [judge_seen(0.01, target).verdict for target in (point, aimed)] == ["hit", "undecided"]
    assert [judge_seen(0.5, target).verdict for target in (point, aimed)] == ["missed", "missed"]


PLAN = Plan((-1.0, 0.5, 2.0, 0.8, 0.8), 0.304, 0.01, 0.0, None, "a strike", 0.1)
LOOK = Step(0, dataclasses.replace(PLAN, probability=None), Seen(None, None), None, None)
UNSEEN = Step(1, PLAN, Seen(None, None), None, None)
MISSED = Step(2, PLAN, Seen(None, None), None, Judgement(0.1124, 0.0052, 0.01))
HIT = Step(3, dataclasses.replace(PLAN, probability=0.97), Seen(None, None), None, Judgement(0.0081, 0.0043, 0.99))


def test_an_adaptation_tells_strikes_hits_misses_and_probabilities() -> None:
    steps = Steps([LOOK, UNSEEN, MISSED, HIT])
    assert repr(steps) == (
        "Steps(3 strikes, 1 hit; misses: not seen, 112 ± 5 mm, 8 ± 4 mm; "
        "probability of a hit as planned: 30 %, 30 %, 97 %)"
    )
    assert steps.strikes == [UNSEEN, MISSED, HIT]
    assert HIT.strike == Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
    assert repr(Steps([LOOK])) == "Steps(0 strikes)"


def test_of_many_strikes_the_last_ones_are_told() -> None:
    told = repr(Steps([LOOK, *[MISSED] * 40, HIT]))
    assert told.startswith("Steps(41 strikes, 1 hit; misses of the last 5: 112 ± 5 mm, ")
    assert "8 ± 4 mm; probability" in told
    assert len(told) < 200


def test_a_step_tells_its_verdict() -> None:
    assert repr(HIT) == "Step(strike 3: hit, 8 ± 4 mm; probability of a hit as planned 97 %)"
    assert repr(MISSED) == "Step(strike 2: missed, 112 ± 5 mm; probability of a hit as planned 30 %)"
    assert repr(UNSEEN) == "Step(strike 1: not seen; probability of a hit as planned 30 %)"
    assert repr(LOOK) == "Step(first look at the whip)"


@pytest.mark.parametrize(
    ("probability", "said"), [(0, "0 %"), (0.004, "< 1 %"), (0.304, "30 %"), (0.9951, "> 99 %"), (1, "100 %")]
)
def test_a_probability_is_never_rounded_to_a_certainty(probability: float, said: str) -> None:
    assert percent(probability) == said
