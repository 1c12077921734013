"""When interceptions are planned and started, on a toy rollout of straight flights."""

from __future__ import annotations

import numpy as np
import pytest
from interceptions import intercept, plan, refresh
from straight_tip import HOME, LOWER, MIDDLE, PUSH, SPEED, UPPER, known, library

from whiptool.errors import InputError
from whiptool.interception import interceptor
from whiptool.interception.interceptor import (
    HORIZON,
    LATENCY,
    LONGEST,
    PLAN_TIME,
    REFRESH_TIME,
    Interception,
    Interceptor,
    TargetCamera,
)
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import fit_track
from whiptool.models.strike import Strike

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def many() -> Library:
    return library(RNG(0).uniform(LOWER, UPPER, (60, 5)))


def tip(chosen: Interception) -> np.ndarray:
    return PUSH @ chosen.strike.vector + SPEED * (chosen.contact - chosen.start - 0.5)


def believed(strike: np.ndarray, start: float, contact: float) -> Interception:
    return Interception(Strike.from_vector(strike), start, contact, (0.0, 0.0), 1.0, 1.0, 0.0, 0.0, "", 0.0)


def test_a_plan_meets_the_target_within_its_times(many):
    velocity = np.array([0.4, -0.3])
    track = known(*(HOME - 2.6 * velocity), *velocity)
    chosen = plan(track, many, now=1.0, rng=RNG(0), latency=0.3, horizon=2.0)
    assert chosen is not None
    assert chosen.start >= 1.3
    assert chosen.contact <= 3.0 + 1e-9
    np.testing.assert_allclose(tip(chosen), track.position(chosen.contact)[0], atol=2e-3)
    np.testing.assert_allclose(chosen.point, tip(chosen), atol=1e-6)
    assert chosen.probability == 1
    assert chosen.expected_miss == pytest.approx(chosen.mean_miss)
    assert chosen.tip_speed == pytest.approx(np.linalg.norm(SPEED))
    assert plan(track, many, now=1.0, rng=RNG(0), latency=0.3, horizon=0.3) is None
    assert plan(track, many, now=1.0, rng=RNG(0), latency=2.0, horizon=1.9) is None


def test_defaults_of_times(many):
    still = known(*HOME)
    chosen = plan(still, many, now=5.0, rng=RNG(0))
    assert chosen is not None
    assert 5.0 + LATENCY <= chosen.start < chosen.contact <= 5.0 + HORIZON
    assert (LATENCY, HORIZON, LONGEST, PLAN_TIME, REFRESH_TIME) == (0.02, 2.5, 60.0, 0.25, 0.1)
    for name, bad in (("horizon", 60.1), ("horizon", 0), ("latency", -0.1), ("hit_radius", 0)):
        with pytest.raises(InputError):
            plan(still, many, now=5.0, rng=RNG(0), **{name: bad})
    waited = Interceptor(many).plan(still, now=5.0, rng=RNG(0))
    assert waited is not None
    assert waited.start >= 5.0 + PLAN_TIME + LATENCY
    assert plan(still, library(MIDDLE), now=5.0, rng=RNG(0), horizon=60.0, latency=0.0) is not None


def test_a_plan_is_not_older_than_its_track(many):
    seen = fit_track(np.arange(4.0), np.tile(HOME, (4, 1)), sigma=0.01, motion="still")
    assert plan(seen, many, now=3.0, rng=RNG(0)) is not None
    with pytest.raises(InputError, match="last frame on, 3 s"):
        plan(seen, many, now=2.99, rng=RNG(0))


def test_a_track_in_space_is_refused_where_strikes_are_in_the_plane(many):
    seen = fit_track(np.arange(4.0), np.tile([*HOME, 0.5], (4, 1)), sigma=0.01, motion="still")
    message = "track: got 'a target in 3 dimensions'; allowed: a target in 2 dimensions, as the library's strikes"
    with pytest.raises(InputError, match=message):
        plan(seen, many, now=3.0, rng=RNG(0))


def test_polishing_improves_on_the_library(many, monkeypatch):
    off = HOME + np.array([0.013, 0.021])
    fine = plan(known(*off), many, now=0.0, rng=RNG(0))
    monkeypatch.setattr(interceptor, "_STEPS", 0)
    rough = plan(known(*off), many, now=0.0, rng=RNG(0))
    assert rough is not None
    assert fine is not None
    assert fine.mean_miss < 1e-6 < rough.mean_miss


def test_a_refreshed_plan_keeps_the_posture_that_the_arm_waits_in(many):
    """The target turns out 4 cm aside of the tip's path: t0 alone cannot help, the strike's end and D can."""
    aside = 0.04 * np.array([-SPEED[1], SPEED[0]]) / np.linalg.norm(SPEED)
    old, newer = believed(MIDDLE[0], 1.0, 1.5), known(*(HOME + aside))
    aimed = refresh(old, newer, many, now=0.5, rng=RNG(0))
    timed = refresh(old, newer, many, now=0.5, rng=RNG(0), aim=False)
    assert aimed.strike.q_i == old.strike.q_i
    assert aimed.mean_miss < 1e-6
    assert timed.strike == old.strike
    assert timed.mean_miss == pytest.approx(0.04, abs=1e-6)


def test_a_refreshed_plan_starts_later_for_a_late_target(many):
    """The target comes along the same way 0.2 s later: the same strike, started later."""
    velocity = np.array([-0.6, 0.5])
    late = known(*(HOME - 1.7 * velocity), *velocity)
    timed = refresh(believed(MIDDLE[0], 1.0, 1.5), late, many, now=0.5, rng=RNG(0), aim=False)
    assert timed.start == pytest.approx(1.2, abs=0.01)
    assert timed.contact == pytest.approx(1.7, abs=0.01)
    assert timed.mean_miss < 1e-3
    early = known(*(HOME - 1.28 * velocity), *velocity)
    timed = refresh(believed(MIDDLE[0], 1.0, 1.5), early, many, now=0.7, rng=RNG(0), aim=False, latency=0.1)
    assert 0.8 <= timed.start < 0.83


def test_what_is_as_good_is_kept(many):
    """Exactly on the target already: neither t0 nor the strike is moved to something worse."""
    chosen = refresh(believed(MIDDLE[0], 1.0, 1.5), known(*HOME), many, now=0.5, rng=RNG(0))
    np.testing.assert_allclose(chosen.strike.vector, MIDDLE[0], atol=1e-9)
    assert (chosen.start, chosen.contact) == (pytest.approx(1.0), pytest.approx(1.5))


def test_a_strike_that_has_started_is_not_refreshed(many):
    old = believed(MIDDLE[0], 1.0, 1.5)
    refresh(old, known(*HOME), many, now=0.9, rng=RNG(0), latency=0.1)
    with pytest.raises(InputError, match=r"before 0.900 s; this strike has started"):
        refresh(old, known(*HOME), many, now=0.91, rng=RNG(0), latency=0.1)


VELOCITY = np.array([0.2, -0.3])
T = np.arange(-30, 120) / 60


@pytest.fixture(scope="module")
def few() -> Library:
    """Strikes much alike: they all meet the watched target at about 1.5 s."""
    return library(MIDDLE + 0.03 * RNG(0).standard_normal((10, 5)))


def frames(last: int = 150, hidden: int = -1):
    """(t, position) of a target that is at HOME after 1.5 s, seen without noise; up to a frame it is not seen."""
    for i, t in enumerate(T[:last]):
        yield t, np.full(2, np.nan) if i < hidden else HOME + VELOCITY * (t - 1.5)


@pytest.mark.parametrize("update", ["time", "aim"])
def test_later_frames_change_the_strike_only_where_it_is_aimed_again(few, update):
    """The target turns aside after the plan: t0 alone cannot follow it, and nothing but t0 may change with `time`."""
    aside = 0.08 * np.array([-VELOCITY[1], VELOCITY[0]]) / np.linalg.norm(VELOCITY)
    turning = [(t, point + max(t, 0.0) * aside) for t, point in frames()]
    plans = list(
        intercept(turning, few, decide=0.0, rng=RNG(0), update=update, motion="straight", camera=TargetCamera(60, 1e-3))
    )
    changed = [plan.strike != plans[0].strike for plan in plans[1:]]
    assert len(changed) >= 2
    assert any(changed) == (update == "aim")


@pytest.mark.parametrize(("update", "count"), [("none", 1), ("time", 3), ("aim", 3)])
def test_a_watched_target_is_planned_on_and_updated(few, update, count):
    plans = list(
        intercept(
            frames(), few, decide=0.0, rng=RNG(0), update=update, motion="straight", camera=TargetCamera(60, 1e-3)
        )
    )
    assert len(plans) >= count
    assert (len(plans) == 1) == (update == "none")
    assert all(x is not None and x.mean_miss < 1e-3 for x in plans)
    same = [x.strike == plans[0].strike for x in plans]
    assert all(same) or update == "aim"


def test_when_frames_are_computed_on(few):
    """0.3 s for a plan, 0.1 s for a refreshed one: no strike starts sooner, and frames in between wait."""
    taken: list[float] = []

    def watched():
        for t, point in frames():
            taken.append(t)
            yield t, point

    plans, at = [], []
    for chosen in intercept(
        watched(), few, decide=0.1, rng=RNG(0), motion="straight", plan_time=0.3, refresh_time=0.1, latency=0.05
    ):
        plans.append(chosen)
        at.append(taken[-1])
    assert at[0] == pytest.approx(0.1)
    assert plans[0].start >= 0.1 + 0.3 + 0.05
    np.testing.assert_allclose(np.diff(at), [0.3, *[0.1] * (len(at) - 2)], atol=1 / 60)
    assert all(x.start >= t + 0.15 - 1e-9 for x, t in zip(plans[1:], at[1:]))
    assert plans[-1].start < taken[-1] + 0.15  # the frame that came too late ended it


def test_until_something_comes_near_there_is_no_plan(many):
    away = ((t, HOME + 9.0) for t in T)
    far = list(intercept(away, many, decide=0.0, rng=RNG(0), motion="still", plan_time=0.5))
    assert far == [None] * 4  # at 0, 0.5, 1, 1.5 s
    with pytest.raises(InputError, match="at least 2 for straight"):
        next(intercept(frames(hidden=40), many, decide=0.1, rng=RNG(0), motion="straight"))
    assert list(intercept(frames(20), many, decide=0.0, rng=RNG(0))) == []
    for bad in ({"update": "always"}, {"plan_time": -1.0}, {"refresh_time": -1.0}, {"decide": np.nan}):
        with pytest.raises(InputError):
            next(intercept(frames(), many, **{"decide": 0.0, "rng": RNG(0), **bad}))


def test_the_motion_of_the_first_plan_is_kept(many):
    """Seen slow at first, then falling: a track of its own would change its mind, the plan does not."""
    t = np.arange(-30, 60) / 60
    path = HOME + np.where(t > 0.05, (t - 0.05) * 0.3, 0.0)[:, None] * [1.0, 1.0]
    plans = list(intercept(zip(t, path), many, decide=0.0, rng=RNG(0), camera=TargetCamera(60, 0.005), plan_time=0.1))
    assert fit_track(t, path, sigma=0.005).motion.name != "still"
    assert any(x is not None and "still" in x.warning for x in plans[1:])


def test_what_has_no_chance_is_no_plan(many):
    """A target that turns out to be 2 m aside is met by no change of the strike that was planned for it."""
    away = known(*(HOME + 2.0))
    lost = believed(MIDDLE[0], 1.0, 1.5)
    assert refresh(lost, known(*HOME), many, now=0.1, rng=RNG(0)).probability == 1
    assert refresh(lost, away, many, now=0.1, rng=RNG(0)) is None
    assert plan(away, many, now=0.1, rng=RNG(0)) is None


def test_a_plan_that_has_lost_its_chance_is_dropped_and_another_one_made(few, monkeypatch):
    monkeypatch.setattr(Interceptor, "refresh", lambda *_, **__: None)
    plans = list(intercept(frames(), few, decide=0.0, rng=RNG(0), motion="straight", plan_time=0.1))
    assert [x is None for x in plans[:3]] == [False, True, False]
    assert plans[2].start > plans[0].start - 1e-9
