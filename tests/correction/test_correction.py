"""Corrections within a strike, against differences of the engine and least squares over all readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

import whiptool as wt
from whiptool.correction import AnyStart, Begun, Corrector, Disturbances, LinearStrike, Sensing, Submovements
from whiptool.correction.corrector import _COST
from whiptool.correction.disturbances import PULSES, kick_directions, moved, pulses, swing_directions
from whiptool.correction.linear import KICKS, Estimate, Estimator, across
from whiptool.correction.rolled import INTERVAL, NUMBERS, SLOTS
from whiptool.errors import InputError
from whiptool.models.kinematics import joint_points

MODEL = wt.preset("lemon2024")
STRIKE = wt.Strike((-0.5446, 0.01044), (2.743, 0.09765), 1.201)
TARGET = (1.3, 0.0)
STEP = 1e-3


@pytest.fixture(scope="module")
def simulator() -> AnyStart:
    return AnyStart(MODEL)


@pytest.fixture(scope="module")
def linear(simulator) -> LinearStrike:
    return LinearStrike(simulator, STRIKE, TARGET)


@pytest.fixture(scope="module")
def corrector(linear) -> Corrector:
    return Corrector(linear, start=0.4)


def some(rng: np.random.Generator, at: float = 0.3, size: float = 0.1) -> Submovements:
    return Submovements(np.array([[at]]), np.array([[0.4]]), size * rng.standard_normal((1, 1, 2)))


def test_a_strike_without_submovements_is_the_strike(simulator, linear):
    theirs = wt.CompiledRollout(MODEL, timestep=5e-4).trajectory(STRIKE)
    np.testing.assert_allclose(linear.planned.tip[0], theirs.tip[::2][: len(linear.planned.tip[0])], atol=1e-12)
    np.testing.assert_allclose(
        linear.planned.arm[0], joint_points(MODEL, linear.states[:, : MODEL.n])[:, 1:3], atol=1e-12
    )


def test_submovements_are_added_to_the_reference_by_eq_1(simulator):
    """The law's torque at the start of a rollout says where the reference is."""
    added = some(np.random.default_rng(0))
    for since in (0.2, 0.45, 0.9):
        x0 = simulator.rest(STRIKE)
        x0[:2] = STRIKE.reference(since)[0]
        x0[MODEL.n : MODEL.n + 2] = STRIKE.reference(since)[1]
        tau = simulator.rows(Begun(STRIKE, x0[None], added, INTERVAL, since), "tau")[0, 0]
        s = np.clip((since - 0.3) / 0.4, 0, 1)
        share, rate = 10 * s**3 - 15 * s**4 + 6 * s**5, (30 * s**2 - 60 * s**3 + 30 * s**4) / 0.4
        wanted, controller = added.by[0, 0], wt.default_controller(MODEL)
        still = simulator.rows(Begun(STRIKE, x0[None], Submovements.none(1, 2), INTERVAL, since), "tau")[0, 0]
        K, B = controller.law.gains(wanted * share, wanted * rate)
        np.testing.assert_allclose(tau - still, K @ (wanted * share) + B @ (wanted * rate), atol=1e-9)


def test_a_strike_goes_on_from_any_instant(simulator, linear):
    first = 400
    begun = Begun(STRIKE, linear.states[first : first + 1], linear.none, 0.3, first * INTERVAL)
    later = simulator.paths(begun, np.array(TARGET))
    np.testing.assert_allclose(later.tip[0], linear.planned.tip[0, first : first + 301], atol=1e-9)


def test_a_trajectory_has_the_reference_that_the_engine_follows(simulator):
    """The law's torque from the stated reference is the engine's."""
    added = some(np.random.default_rng(4))
    path = simulator.trajectory(Begun(STRIKE, simulator.rest(STRIKE)[None], added, 0.8))
    controller = wt.default_controller(MODEL)
    still = simulator.trajectory(Begun(STRIKE, simulator.rest(STRIKE)[None], Submovements.none(1, 2), 0.8))
    law = [np.einsum("tij,tj->ti", x.K, x.q_d - x.q[:, :2]) for x in (path, still)]
    law = [f + np.einsum("tij,tj->ti", x.B, x.v_d - x.v[:, :2]) for f, x in zip(law, (path, still), strict=True)]
    weights = [x.tau - f for x, f in zip((path, still), law, strict=True)]
    np.testing.assert_allclose(weights[0][:300], weights[1][:300], atol=1e-9)  # the arm's weight, the same at first
    assert controller.law.kind == "oiac"
    at = np.array([0.5])
    s = (0.5 - 0.3) / 0.4
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    np.testing.assert_allclose(path.q_d[500], STRIKE.reference(at)[0][0] + added.by[0, 0] * share, atol=1e-12)


def test_slopes_are_those_of_differences(simulator, linear):
    """Swings, kicks, pulses of the hand and the whip's numbers, each by central differences of the engine."""
    c, a = linear._columns, 2
    numbers = len(c.x0) - len(NUMBERS)
    for column in (0, 4, 8, 8 + a * KICKS, numbers - 2, numbers, numbers + 1, numbers + 2):
        ends = []
        for side in (-STEP, STEP):
            off = 0.05 * side * np.eye(3)[column - numbers] if column >= numbers else np.zeros(3)
            x0, noise = moved(MODEL, c.x0, side * c.dx0)[column], pulses(side * c.by, linear.hit_at)
            added = Submovements(*(x[column : column + 1] for x in (noise.since, noise.lasts, noise.by)))
            begun = Begun(STRIKE, x0[None], added, linear.lasts, c.since[column], off[None])
            ends.append(simulator.paths(begun, np.array(TARGET)))
        first = round(c.since[column] / INTERVAL)
        by_differences = (ends[1].tip - ends[0].tip)[0] / (2 * STEP)
        exact = linear.tip[first:, :, column]
        np.testing.assert_allclose(
            exact[:700], by_differences[: len(exact)][:700], atol=2e-4 * np.abs(exact).max() + 1e-9
        )


def test_numbers_that_are_off_are_those_of_another_model(simulator):
    off, whip = np.array([0.05, -0.1, 0.2]), MODEL.whip
    now = {path: whip.common(path[5:]) * (1 + x) for path, x in zip(NUMBERS.values(), off, strict=True)}
    begun = Begun(STRIKE, simulator.rest(STRIKE)[None], Submovements.none(1, 2), 0.9)
    other = AnyStart(MODEL.with_parameters(now), simulator.controller).paths(begun, np.array(TARGET))
    ours = simulator.paths(replace(begun, off=off[None]), np.array(TARGET))
    np.testing.assert_allclose(ours.tip, other.tip, atol=1e-9)


def test_the_estimate_is_that_of_least_squares_over_all_readings(linear):
    """The whip swings by 15 cm, and SciPy looks for the best z by differences of its own."""
    rng, sensing, lasts = np.random.default_rng(1), Sensing(rate=60, joint_rate=50, delay=0.05), 0.5
    estimator = Estimator(linear, sensing, lasts)
    assert estimator.frames.max() * INTERVAL <= 0.45 < (estimator.frames.max() + 17) * INTERVAL
    some, m, none = np.r_[0:6, 38:41], linear.tip.shape[2], Submovements.none(1, 2)
    z = np.zeros((1, m))
    z[0, [0, 4, -3]] = 1.5, -0.5, 1.0
    true = linear.paths(z, none, lasts)
    tip, arm = true.tip + 0.005 * rng.normal(size=true.tip.shape), true.arm.reshape(1, -1, 4)
    found = estimator.estimate(tip, arm, none, 0 * z, lasts, 6)

    def left(x):
        trial = found.z.copy()
        trial[0, some] = x
        paths = linear.paths(trial, none, lasts)
        y = [
            (tip - paths.tip)[0, estimator.frames].ravel(),
            (arm[0] - paths.arm.reshape(-1, 4))[estimator.samples].ravel(),
        ]
        return np.r_[np.concatenate(y) / np.sqrt(estimator.variance), trial[0]]

    best = least_squares(left, z[0, some], x_scale=0.1)
    np.testing.assert_allclose(found.z[0, some], best.x, atol=0.05)
    assert abs(found.z[0, 0] - 1.5) < 0.2
    np.testing.assert_allclose(found.tip[0, -1], linear.paths(found.z, none, lasts).tip[0, -1], atol=1e-12)


def test_a_rehearsal_says_how_far_the_true_strike_is_from_the_models(simulator, linear):
    other = replace(linear.planned, tip=linear.planned.tip + 1e-4, arm=linear.planned.arm - 0.02)
    found, z = LinearStrike(simulator, STRIKE, TARGET, rehearsed=other), np.eye(linear.tip.shape[2])[:1]
    ours, theirs = (x.paths(z, Submovements.none(1, 2), 0.5) for x in (linear, found))
    np.testing.assert_allclose(theirs.tip - ours.tip, 1e-4, atol=1e-12)
    np.testing.assert_allclose(theirs.arm - ours.arm, -0.02, atol=1e-12)
    doubts = [Corrector(x, count=1).decisions[0].doubt for x in (linear, found)]
    np.testing.assert_allclose(*doubts, atol=1e-9)


def test_gains_are_those_of_a_least_squares_problem(corrector):
    """What the readings leave unknown of a miss is not corrected, and corrections of doubtful effect cost as much."""
    k, linear = 2, corrector.linear
    window = linear.planned.tip[:, corrector.window] + 0.03 * linear.across[0]
    left = corrector.decisions[k:]
    effects = np.stack([x.tip[corrector.window] for x in left], axis=2)
    spreads = 0.1 * np.eye(linear.tip.shape[2])
    known = Estimate(np.zeros((1, len(spreads))), spreads[None], np.zeros(1), linear.planned.tip, linear.tip[None])
    found = corrector.solved(k, window, effects, np.zeros((1, len(left), 2)), known)[0]
    at = int(np.linalg.norm(window[0] - TARGET, axis=1).argmin())
    sideways = across(window, np.array([at]))[0]
    slope = np.hstack([sideways @ x.tip[corrector.window][at] for x in left])
    cost = np.diag(np.sqrt(np.concatenate([x.doubt for x in left]) ** 2 + _COST**2))
    spread = sideways @ linear.tip[corrector.window][at]
    miss = float((sideways @ (window[0, at] - linear.target))[0])
    known = 1 - float((spread @ spreads @ spread.T)[0, 0]) / miss**2
    wanted = np.r_[-known * miss, np.zeros(len(cost))]
    best = lsq_linear(np.vstack([slope, cost]), wanted).x.reshape(-1, 2)
    assert 0.5 < known < 1
    np.testing.assert_allclose(found, best, atol=1e-8)


def test_what_is_not_known_is_not_corrected(corrector):
    linear, m = corrector.linear, corrector.linear.tip.shape[2]
    window = linear.planned.tip[:, corrector.window] + 0.002 * linear.across[0]
    effects = np.stack([x.tip[corrector.window] for x in corrector.decisions], axis=2)
    for spread, doubt in ((1e-6, 1e9), (1.0, 1.0)):
        estimate = Estimate(np.zeros((1, m)), spread * np.eye(m)[None], np.full(1, doubt), window, linear.tip[None])
        assert not corrector.solved(0, window, effects, np.zeros((1, len(corrector.decisions), 2)), estimate).any()


def test_a_swinging_whip_hits_better_with_corrections(simulator, linear):
    rng, corrector, B = np.random.default_rng(2), Corrector(linear, start=0.5, count=4), 8
    swings = swing_directions(MODEL, STRIKE)
    x0 = moved(MODEL, np.repeat(linear.states[:1], B, axis=0), 0.1 * rng.normal(size=(B, len(swings))) @ swings)

    def truth(added):
        return simulator.paths(Begun(STRIKE, x0, added, linear.lasts), linear.target)

    S = linear.planned.tip.shape[1]
    noise = 0.005 * rng.normal(size=(B, S, 2)), 0.001 * rng.normal(size=(B, S, 2, 2))
    without, (corrected, added) = truth(Submovements.none(B, 2)), corrector.struck(truth, noise)
    assert corrected.miss.mean() < 0.4 * without.miss.mean()
    assert not (corrected.miss > np.maximum(1.05 * without.miss, without.miss + 0.005)).any()
    assert added.since.shape == (B, len(corrector.decisions))


def test_before_the_first_reading_nothing_is_corrected(linear):
    corrector = Corrector(linear, sensing=Sensing(delay=0.5), start=0.3, count=1)
    planned, none = linear.planned, np.zeros((1, 0, 2))
    estimate = corrector.estimate(0, planned.tip, planned.arm, none)
    assert not estimate.z.any()
    assert estimate.doubt == 0
    assert not corrector.correction(0, estimate, none).any()


def test_a_correction_is_made_only_as_far_as_the_simulation_hits_better(corrector):
    """The best of 0, 1/4, 1/2 and all of a correction to the one side; none of one to the other side."""
    linear, m = corrector.linear, corrector.linear.tip.shape[2]
    z, none, k = np.zeros((2, m)), np.zeros((2, 0, 2)), 0
    z[:, 0] = 1.5
    nothing = np.zeros(0)
    estimate = Estimate(z, nothing, nothing, nothing, nothing)
    by = np.zeros((2, len(corrector.decisions), 2))
    by[:, k, 1] = 0.15, -0.15
    found = corrector.tried(k, by, estimate, none)
    shares = np.array([0, 0.25, 0.5, 1])
    missed = []
    for share in shares:
        added = Submovements(
            *(np.tile(x, (2, 1)) for x in (corrector.decisions[k].at, corrector.decisions[k].lasts)), share * by[:, :1]
        )
        tips = linear.paths(z, added).tip[:, corrector.window]
        missed.append(np.linalg.norm(tips - TARGET, axis=2).min(axis=1))
    best = np.argmin(missed, axis=0)
    np.testing.assert_allclose(found, shares[best][:, None] * by[:, k], atol=1e-12)
    assert min(best) == 0 < max(best)


def test_corrections_keep_the_joints_limits(corrector):
    low, high, now = corrector._low.copy(), corrector._high.copy(), corrector._now
    a, by = 2, np.array([[0.3, -0.2]])
    try:
        corrector._high[a] = now[:, a].max() + 0.05  # the shoulder's velocity [rad/s]
        corrector._low[a] = now[:, a].min() - 0.05
        share = corrector.allowed(0, by, np.zeros((1, 0, a)))[0]
        x = corrector.decisions[0]
        t = INTERVAL * np.arange(len(now))
        s = np.clip((t - x.at) / x.lasts, 0, 1)
        v = now[:, a] + share * 0.3 * 30 * s**2 * (1 - s) ** 2 / x.lasts
        assert 0 < share < 1
        assert np.isclose(v.max(), corrector._high[a]) or np.isclose(v.min(), corrector._low[a])
    finally:
        corrector._low[:], corrector._high[:] = low, high


def test_a_kick_turns_every_link_across_itself():
    q = np.zeros((1, 2 * MODEL.n))
    q[0, 2] = np.pi / 2  # the whip points forward
    kicks = kick_directions(MODEL, q)[0]
    step = 1e-6
    moves = [(joint_points(MODEL, q[:, : MODEL.n] + side * kicks[:, MODEL.n :])[:, -1]) for side in (-step, step)]
    np.testing.assert_allclose((moves[1] - moves[0]) / (2 * step), [[0, 0], [0, 1]], atol=1e-8)


def test_rods_stay_of_unit_length():
    ur5e, rng = wt.preset("ur5e"), np.random.default_rng(3)
    strike = wt.Strike((0.1, -1.5, 1.0, -0.5, 0.2, 0.0), (0.4, -1.0, 0.8, -0.2, 0.4, 0.0), 0.6)
    rest = AnyStart(ur5e).rest(strike)[None]
    state = moved(ur5e, rest, 0.1 * rng.normal(size=(1, 12)) @ swing_directions(ur5e, strike))
    n = ur5e.coordinates
    rods, rates = (state[0, i : i + n - 6].reshape(-1, 3) for i in (6, n + 6))
    np.testing.assert_allclose(np.linalg.norm(rods, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose((rods * rates).sum(axis=1), 0, atol=1e-12)
    kicks = kick_directions(ur5e, state)[0][:, n + 6 :].reshape(3, -1, 3)
    np.testing.assert_allclose(np.einsum("kij,ij->ki", kicks, rods), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Disturbances(swing=-1), "swing"),
        (lambda: Disturbances().only("wind"), "kind"),
        (lambda: Sensing(rate=0), "rate"),
        (lambda: Sensing(delay=-0.1), "delay"),
        (lambda: wt.correct(MODEL, STRIKE, (1.0, 0.0, 0.0)), "target"),
        (lambda: wt.correct(MODEL, STRIKE.vector, (1.0, 0.0)), "strike"),
        (lambda: AnyStart(MODEL, steps=0), "steps"),
        (lambda: AnyStart(MODEL, wt.Controller(control_period=0.002)), "controller"),
    ],
)
def test_bad_input_is_refused_by_name(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_there_is_room_for_the_noise_and_all_corrections(simulator):
    assert SLOTS >= 2 * PULSES + 8
    many = Submovements(*(np.ones((1, SLOTS + 1)),) * 2, np.zeros((1, SLOTS + 1, 2)))
    with pytest.raises(InputError, match="submovements"):
        simulator.paths(Begun(STRIKE, simulator.rest(STRIKE)[None], many, 0.1), np.array(TARGET))
