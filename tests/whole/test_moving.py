"""Moving targets: tracks against closed forms and simulated motion, interceptions against the true motion."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
from interceptions import intercept, plan, refresh
from repository import ROOT
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.interception.interceptor import Interception, TargetCamera
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import PendulumMotion, TargetTrack, find_motion, fit_track
from whiptool.limits.arm_limits import XM430
from whiptool.models import preset
from whiptool.models.strike import Strike, StrikeBounds
from whiptool.models.trajectory import closest_on_segments
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.strike_map.striker import Striker

SIGMA = 0.005
FRAMES = np.arange(31) / 60 - 0.5
G = np.array([0.0, -9.81])
MODEL = preset("lemon2024")


def noisy(points: np.ndarray, seed: int) -> np.ndarray:
    return points + SIGMA * np.random.default_rng(seed).standard_normal(points.shape)


@pytest.mark.parametrize(("name", "acceleration"), [("straight", np.zeros(2)), ("ballistic", G)])
def test_linear_motions_are_a_fitted_line(name, acceleration):
    """numpy.polyfit with its own covariance; frames 8 to 14 and one more are missing."""
    points = noisy([1.2, 0.1] + FRAMES[:, None] * [-0.4, 0.3] + 0.5 * FRAMES[:, None] ** 2 * acceleration, 1)
    points[8:15] = points[20] = np.nan
    seen = np.isfinite(points[:, 0])
    track = fit_track(FRAMES, points, sigma=SIGMA, motion=name)
    later, chi2_of_axes, unscaled = np.array([0.0, 0.7]), [], []
    for axis in range(2):
        reduced = points[seen, axis] - 0.5 * FRAMES[seen] ** 2 * acceleration[axis]
        w = np.full(seen.sum(), 1 / SIGMA)
        line, covariance = np.polyfit(FRAMES[seen], reduced, 1, w=w, cov="unscaled")
        residuals = (reduced - np.polyval(line, FRAMES[seen])) / SIGMA
        chi2_of_axes.append(residuals @ residuals)
        unscaled.append(np.array([np.array([t, 1]) @ covariance @ np.array([t, 1]) for t in later]))
        expected = np.polyval(line, later) + 0.5 * later**2 * acceleration[axis]
        np.testing.assert_allclose(track.position(later)[:, axis], expected, atol=1e-9)
        np.testing.assert_allclose(track.velocity(0.7)[0, axis], line[0] + 0.7 * acceleration[axis], atol=1e-6)
    misfit = max(1.0, sum(chi2_of_axes) / (2 * seen.sum() - 4))
    for axis in range(2):
        expected = misfit * unscaled[axis]
        np.testing.assert_allclose(track.covariance_at(later)[:, axis, axis], expected, rtol=1e-6)
    np.testing.assert_allclose(track.covariance_at(later)[:, 0, 1], 0, atol=1e-12)


def test_a_ballistic_track_is_what_a_kalman_filter_ends_with():
    points = noisy(np.array([2.0, 0.5]) + FRAMES[:, None] * [-2.0, 3.0] + 0.5 * FRAMES[:, None] ** 2 * G, 2)
    x, P = np.zeros(4), np.eye(4) * 1e8
    H, before = np.eye(2, 4), FRAMES[0]
    for t, z in zip(FRAMES, points, strict=True):
        dt = t - before
        F = np.eye(4) + dt * np.eye(4, k=2)
        x = F @ x + np.r_[0.5 * G * dt**2, G * dt]
        P = F @ P @ F.T
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + SIGMA**2 * np.eye(2))
        x, P, before = x + K @ (z - H @ x), (np.eye(4) - K @ H) @ P, t
    track = fit_track(FRAMES, points, sigma=SIGMA, motion="ballistic")
    np.testing.assert_allclose(track.position(0.0)[0], x[:2], atol=1e-6)
    np.testing.assert_allclose(track.velocity(0.0)[0], x[2:], atol=1e-5)
    np.testing.assert_allclose(track.covariance_at(0.0)[0], track.misfit * P[:2, :2], rtol=1e-3, atol=1e-12)


@pytest.mark.parametrize(
    ("theta", "rate", "L"), [(0.3, 0.2, 1.0), (2.5, 0.5, 0.7), (-1.5, -2.0, 0.5), (0.0, 3.0, 1.0), (0.0, 0.0, 1.0)]
)
def test_a_pendulum_solves_its_equation(theta, rate, L):
    solved = solve_ivp(
        lambda t, x: [x[1], -9.81 / L * np.sin(x[0])], (0, 3), [theta, rate], rtol=1e-10, atol=1e-12, dense_output=True
    )
    t = np.linspace(0, 3, 40)
    angle = solved.sol(t)[0]
    expected = np.stack([0.1 + L * np.sin(angle), 0.2 - L * np.cos(angle)], axis=1)
    np.testing.assert_allclose(
        PendulumMotion().positions(np.array([0.1, 0.2, np.log(L), theta, rate]), t), expected, atol=1e-8
    )
    np.testing.assert_allclose(
        PendulumMotion((0.1, 0.2)).positions(np.array([np.log(L), theta, rate]), t), expected, atol=1e-8
    )


TRUTHS = {
    "still": (find_motion("still"), [1.2, 0.1]),
    "straight": (find_motion("straight"), [1.2, 0.1, -0.3, 0.4]),
    "ballistic": (find_motion("ballistic"), [1.4, 0.1, -2.0, -1.5]),
    "pendulum": (PendulumMotion(), [1.2, 0.9, 0.0, 0.5, 1.0]),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_the_motion_is_recognised_and_a_wrong_one_has_no_chance(name):
    motion, numbers = TRUTHS[name]
    for seed in range(5):
        points = noisy(motion.positions(np.array(numbers), FRAMES), seed)
        track = fit_track(FRAMES, points, sigma=SIGMA)
        assert track.motion.name == name
        assert track.p_value > 1e-3
    if name != "still":
        assert fit_track(FRAMES, points, sigma=SIGMA, motion="still").p_value < 1e-6


@pytest.mark.parametrize(
    ("motion", "numbers", "pivot"),
    [
        (*TRUTHS["straight"], None),
        (*TRUTHS["ballistic"], None),
        (PendulumMotion((1.2, 0.9)), [0.0, 0.5, 1.0], (1.2, 0.9)),
    ],
    ids=["straight", "ballistic", "pendulum of known pivot"],
)
def test_the_covariance_covers(motion, numbers, pivot):
    """The 95 % ellipse of the position 0.8 s ahead holds the truth in 95 % of 200 tracks, +- 3 standard errors."""
    held, samples = 0, 0
    truth = motion.positions(np.array(numbers), np.array([0.8]))[0]
    for seed in range(200):
        points = noisy(motion.positions(np.array(numbers), FRAMES), seed)
        track = fit_track(FRAMES, points, sigma=SIGMA, motion=motion.name, pivot=pivot)
        error, covariance = track.position(0.8)[0] - truth, track.covariance_at(0.8)[0]
        held += error @ np.linalg.solve(covariance, error) < chi2.ppf(0.95, 2)
        if seed == 0:
            drawn = track.positions(track.sample(np.random.default_rng(0), 4000), 0.8)[:, 0]
            samples = np.diag(np.cov(drawn.T)) / np.diag(covariance)
    assert 0.95 - 0.046 < held / 200 < 0.95 + 0.046
    np.testing.assert_allclose(samples, 1, atol=0.1)


@pytest.mark.parametrize("stated", [SIGMA, SIGMA / 5])
def test_frames_to_come_are_foreseen(stated):
    """To first order, what a track of 60 frames knows is what one of 30 knows about 30 more, of the same quality."""
    t = np.arange(60) / 60
    points = noisy(t[:, None] * [0.5, 0.1], 3)
    half, whole = (fit_track(t[:n], points[:n], sigma=stated, motion="straight") for n in (30, 60))
    np.testing.assert_allclose(
        half.after(t[30:], stated).covariance_at(1.5) / half.misfit,
        whole.covariance_at(1.5) / whole.misfit,
        rtol=1e-5,
        atol=1e-12,
    )


def test_understated_noise_still_covers():
    """Noise of ten times sigma: the 95 % ellipse holds the truth as often as with the right one, and it is told."""
    motion, numbers = TRUTHS["straight"]
    truth, held = motion.positions(np.array(numbers), np.array([0.8]))[0], 0
    for seed in range(200):
        points = noisy(motion.positions(np.array(numbers), FRAMES), seed)
        track = fit_track(FRAMES, points, sigma=SIGMA / 10, motion="straight")
        error = track.position(0.8)[0] - truth
        held += error @ np.linalg.solve(track.covariance_at(0.8)[0], error) < chi2.ppf(0.95, 2)
        assert "times as far from a straight motion" in track.warning
    assert 0.95 - 0.046 < held / 200 < 0.95 + 0.046
    assert fit_track(FRAMES, points, sigma=SIGMA, motion="straight").warning == ""


def test_bad_tracks_are_refused():
    points = np.zeros((3, 2))
    with pytest.raises(InputError, match="at least 3 for auto"):
        fit_track(FRAMES[:2], points[:2], sigma=SIGMA)
    with pytest.raises(InputError, match="got '1 frames"):
        fit_track(FRAMES[:3], np.array([[0, 0], [np.nan, 0], [np.nan, np.nan]]), sigma=SIGMA, motion="straight")
    with pytest.raises(InputError, match="increasing"):
        fit_track(np.array([0.0, 0.1, 0.1]), points, sigma=SIGMA)
    with pytest.raises(InputError, match="auto, still, straight, ballistic, pendulum"):
        fit_track(FRAMES[:3], points, sigma=SIGMA, motion="circle")
    with pytest.raises(InputError, match="positions"):
        fit_track(FRAMES[:4], points, sigma=SIGMA)
    with pytest.raises(InputError, match="sigma"):
        fit_track(FRAMES[:3], points, sigma=0.0)


def test_closest_approach_of_two_movers():
    """Past each other at 1 m: between instants 0 and 1, and never before the NaN."""
    relative = np.array([[-1.0, 1.0], [3.0, 1.0], [np.nan, np.nan]])
    assert closest_on_segments(relative, np.zeros(2)).distance == pytest.approx(1.0)
    assert closest_on_segments(np.array([[1.0, 1.0], [3.0, 1.0]]), np.zeros(2)).distance == pytest.approx(np.sqrt(2))


@pytest.fixture(scope="module")
def rollout():
    return CompiledRollout(MODEL, Controller(), timestep=5e-4)


@pytest.fixture(scope="module")
def library(rollout):
    return Library.build(Striker(rollout), size=600, q_i=(-1.4, 0.1))


@pytest.fixture(scope="module")
def truth():
    return CompiledRollout(MODEL, Controller(), timestep=2.5e-4)


def miss(truth, chosen: Interception, motion, numbers) -> float:
    """What comes of it, at half the planner's timestep."""
    t, path, _ = truth.tip_path(chosen.strike.vector[None], t_stay=0.3, rate=4000)
    return float(
        closest_on_segments(path[0] - motion.positions(np.array(numbers), chosen.start + t), np.zeros(2)).distance
    )


def test_a_target_at_rest_is_an_ordinary_plan(library, rollout):
    track = TargetTrack.known(find_motion("still"), np.array([1.2, 0.1]))
    chosen = plan(track, library, now=3.0, rng=np.random.default_rng(0))
    assert chosen is not None
    assert chosen.probability == 1
    near = rollout.approach(chosen.strike.vector[None], np.array([1.2, 0.1]), t_stay=0.3)
    assert near.distance[0] < 1e-3  # what searches for targets at rest reach with exact derivatives
    assert near.time[0] == pytest.approx(chosen.contact - chosen.start, abs=2e-3)
    assert 3.02 <= chosen.start < chosen.contact < 5.5
    assert np.hypot(*(np.array(chosen.point) - [1.2, 0.1])) < 2e-3


@pytest.mark.parametrize("name", ["straight", "ballistic", "pendulum"])
def test_the_tip_is_where_the_target_will_be(library, name):
    """Known motions, judged on MuJoCo's rollout, which shares no formula with the planner's."""
    motion, numbers = TRUTHS[name] if name != "ballistic" else (find_motion("ballistic"), [3.5, 0.6, -2.6, 3.2])
    chosen = plan(TargetTrack.known(motion, np.array(numbers)), library, now=0.0, rng=np.random.default_rng(0))
    assert chosen is not None
    path = ReferenceRollout(MODEL, Controller()).trajectory(chosen.strike, t_stay=0.3)
    relative = path.tip - motion.positions(np.array(numbers), chosen.start + path.t)
    assert closest_on_segments(relative, np.zeros(2)).distance < 3e-3


@pytest.mark.parametrize("case", ["50 mm of noise", "no motion of these"])
def test_a_misfit_lowers_the_stated_probability_and_is_told(library, case):
    rng = np.random.default_rng(0)
    if case == "50 mm of noise":
        truth = np.array([1.15, -0.1]) + FRAMES[:, None] * [0.0, 0.3]
        points = truth + 0.05 * rng.standard_normal(truth.shape)
    else:
        points = np.stack([1.0 + 0.15 * np.sin(8 * FRAMES), np.zeros(len(FRAMES))], axis=1)
        points += SIGMA * rng.standard_normal(points.shape)
    track = fit_track(FRAMES, points, sigma=SIGMA)
    chosen = plan(track, library, now=0.0, rng=np.random.default_rng(0))
    assert chosen is not None
    assert chosen.warning == track.warning != ""
    assert chosen.probability < 0.97
    frames = zip(FRAMES, points, strict=True)
    (followed,) = intercept(frames, library, decide=0.0, rng=np.random.default_rng(0))
    assert followed is not None
    assert followed.warning == track.warning


def test_a_plan_is_repeatable_and_keeps_its_bounds(library, rollout):
    motion, numbers = TRUTHS["straight"]
    points = noisy(motion.positions(np.array(numbers), FRAMES), 7)
    track = fit_track(FRAMES, points, sigma=SIGMA)
    first, again = (plan(track, library, now=0.0, rng=np.random.default_rng(5)) for _ in range(2))
    assert first == again
    assert first is not None
    lower, upper = library.striker.bounds.box
    assert first.warning == ""
    assert (first.strike.vector >= lower).all()
    assert (first.strike.vector <= upper).all()
    assert first.strike.q_i == (-1.4, 0.1)
    bounds = StrikeBounds((-1.5, 0.0, 0.3, 0.0, 1.2), (-0.3, 2.8, 3.1, 2.8, 2.5))
    slow = Library.build(Striker(rollout, bounds=bounds, limits=XM430), size=300)
    assert len(slow.strikes) == 300
    assert slow.striker.keep(slow.strikes).all()


def test_what_cannot_be_met_has_no_plan(library):
    away = TargetTrack.known(find_motion("straight"), np.array([1.8, 0.0, 0.5, 0.0]))
    assert plan(away, library, now=0.0, rng=np.random.default_rng(0)) is None
    gone = TargetTrack.known(
        find_motion("ballistic"), np.array([0.5, 0.0, 3.0, 2.0])
    )  # out of reach before a tip arrives
    assert plan(gone, library, now=0.0, rng=np.random.default_rng(0)) is None


def test_bad_plans_are_refused(library, rollout):
    track = TargetTrack.known(find_motion("still"), np.array([1.2, 0.1]))
    for horizon in (0.0, np.nan, np.inf, 1e6):
        with pytest.raises(InputError, match=r"horizon.*> 0 and <= 60"):
            plan(track, library, now=0.0, rng=np.random.default_rng(0), horizon=horizon)
    assert plan(track, library, now=0.0, rng=np.random.default_rng(0), horizon=0.01) is None  # less than the latency
    for now in (np.nan, np.inf):
        with pytest.raises(InputError, match=r"now.*finite"):
            plan(track, library, now=now, rng=np.random.default_rng(0))
    seen = fit_track(FRAMES + 5.0, np.tile([1.2, 0.1], (len(FRAMES), 1)), sigma=SIGMA)
    with pytest.raises(InputError, match=r"now: got 4.9; .* last frame on, 5 s"):
        plan(seen, library, now=4.9, rng=np.random.default_rng(0))
    for bad in ((0.1,), (-1.4, 3.5), (-1.4, np.nan)):
        with pytest.raises(InputError, match="q_i"):
            Library.build(Striker(rollout), size=50, q_i=bad)
    with pytest.raises(InputError, match=r"speed: got 1000.0; allowed: at most [0-9.]+ m/s"):
        Library.build(Striker(rollout), size=50, speed=1000.0)
    with pytest.raises(InputError, match="update"):
        next(intercept([], library, decide=0.0, rng=np.random.default_rng(0), update="always"))
    chosen = plan(track, library, now=0.0, rng=np.random.default_rng(0))
    assert chosen is not None
    with pytest.raises(InputError, match="has started"):
        refresh(chosen, track, library, now=chosen.start, rng=np.random.default_rng(0))
    with pytest.raises(InputError, match=r"now.*finite"):
        refresh(chosen, track, library, now=np.nan, rng=np.random.default_rng(0))
    with pytest.raises(InputError, match="last frame"):
        refresh(chosen, seen, library, now=0.0, rng=np.random.default_rng(0))


@pytest.mark.parametrize(("true", "enough"), [([1.2, -0.4, 0.0, 0.4], True), ([1.24, -0.4, 0.0, 0.4], False)])
def test_a_newer_track_moves_the_strike_and_its_start(library, truth, true, enough):
    """The target turns out slower: the same strike later is enough; it is 4 cm aside, too: the strike has to move."""
    motion = find_motion("straight")
    believed = TargetTrack.known(motion, np.array([1.2, -0.4, 0.0, 0.5]))
    chosen = plan(believed, library, now=0.0, rng=np.random.default_rng(0), latency=0.3)
    assert chosen is not None
    newer = TargetTrack.known(motion, np.array(true))
    timed, aimed = (
        refresh(chosen, newer, library, now=0.1, rng=np.random.default_rng(0), aim=aim) for aim in (False, True)
    )
    assert miss(truth, chosen, motion, true) > 0.015
    assert timed.strike == chosen.strike
    assert (miss(truth, timed, motion, true) < 3e-3) is enough
    assert miss(truth, aimed, motion, true) < 3e-3
    assert aimed.strike.q_i == chosen.strike.q_i
    assert min(timed.start, aimed.start) >= 0.12


def watched(kind: str, seed: int) -> tuple[object, np.ndarray]:
    """A target through the zone, the decision at time 0."""
    rng = np.random.default_rng(seed)
    at, when = np.array([1.15, 0.0]) + rng.uniform(-0.15, 0.15, 2), rng.uniform(0.8, 1.2)
    if kind == "straight":
        velocity = 0.5 * np.array([np.cos(6.28 * seed / 6), np.sin(6.28 * seed / 6)])
        return find_motion("straight"), np.r_[at - when * velocity, velocity]
    velocity = np.array([rng.uniform(-2.5, -1.5), rng.uniform(-5.0, -4.0)])  # when it is there
    return find_motion("ballistic"), np.r_[at - when * velocity + 0.5 * G * when**2, velocity - G * when]


@pytest.mark.slow
def test_moving_targets_are_hit(library, truth):
    """A camera with 5 mm noise and dropped frames; 12 targets, at least 11 hit."""
    hits, improved = [], []
    t = np.arange(-30, 90) / 60
    for kind in ("straight", "ballistic"):
        for seed in range(6):
            motion, numbers = watched(kind, seed)
            points = noisy(motion.positions(numbers, t), seed)
            points[np.random.default_rng(seed).random(len(t)) < 0.15] = np.nan
            frames = zip(t, points, strict=True)
            plans = list(
                intercept(frames, library, decide=0.0, rng=np.random.default_rng(seed), camera=TargetCamera(60, SIGMA))
            )
            assert all(x is not None for x in plans)
            hits.append(miss(truth, plans[-1], motion, numbers) <= 0.06)
            improved.append(miss(truth, plans[-1], motion, numbers) <= miss(truth, plans[0], motion, numbers))
    assert sum(hits) >= 11
    assert sum(improved) >= 8


def test_no_strike_starts_before_it_is_computed(library):
    motion, numbers = watched("straight", 1)
    t = np.arange(-30, 120) / 60
    points = noisy(motion.positions(numbers, t), 1)
    seen: list[float] = []

    def camera():
        for now, point in zip(t, points, strict=True):
            seen.append(now)
            yield now, point

    plans = []
    times = []
    for chosen in intercept(
        camera(), library, decide=0.0, rng=np.random.default_rng(0), plan_time=0.3, refresh_time=0.1
    ):
        plans.append(chosen)
        times.append(seen[-1])
    assert plans[0].start >= 0.3 + 0.02
    assert len(plans) > 1
    assert times[1] >= 0.3 - 1e-9
    assert (np.diff(times[1:]) >= 0.1 - 1e-9).all()
    assert all(x.start >= now + 0.1 + 0.02 - 1e-9 for x, now in zip(plans[1:], times[1:], strict=True))


def test_the_table_of_the_benchmark_fits_a_terminal():
    """Lines of at most 120 columns; of what was never planned nothing is said."""
    spec = importlib.util.spec_from_file_location("moving", ROOT / "benchmarks" / "moving.py")
    assert spec is not None
    assert spec.loader is not None
    moving = importlib.util.module_from_spec(spec)
    sys.modules["moving"] = moving
    spec.loader.exec_module(moving)
    chosen = Interception(
        Strike((0.1, 0.2), (0.3, 0.4), 1.0), 0.2701, 1.2345, (1.2, 0.1), 12.345, 1.0, 0.1, 0.1, "", 0.1
    )
    some = moving.row(
        np.array([0.012345] * 19 + [np.inf]), [moving.Sent(chosen, 0.25, (0.1,))] * 19 + [moving.Sent(None, 0.0)]
    )
    lines = moving.lines("last seen, waiting", some)
    assert max(map(len, lines)) <= 120
    assert "100 (90 %: 100)" in " ".join(lines)
    assert "no plan: 1" in " ".join(lines)
    none = moving.lines("last seen, waiting", moving.row(np.full(3, np.inf), [moving.Sent(None, 0.0)] * 3))
    assert not any(word in " ".join(none) for word in ("miss", "plan ", "refresh", "believed"))
    assert "no plan: 3" in " ".join(none)
