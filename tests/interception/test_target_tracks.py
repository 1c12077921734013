"""Motions of targets against their differential equations, solved by SciPy, and against derivatives by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from scipy.special import ellipk
from scipy.stats import chi2

from whiptool.errors import InputError
from whiptool.interception.target_tracks import (
    DOUBTFUL,
    GRAVITY,
    LENGTHS,
    PendulumMotion,
    Polynomial,
    TargetTrack,
    derivatives,
    find_motion,
    fit_track,
)

T = np.linspace(-0.7, 1.1, 19)


def swing(L: float, theta: float, rate: float, g: float = 9.81) -> tuple[np.ndarray, np.ndarray]:
    """Angle and rate over `T` of a pendulum that is at (theta, rate) at time 0."""

    def solved(times: np.ndarray) -> np.ndarray:
        ends = (0.0, times[-1])
        found = solve_ivp(
            lambda t, x: [x[1], -g / L * np.sin(x[0])], ends, [theta, rate], t_eval=times, rtol=1e-11, atol=1e-13
        )
        return found.y

    before, after = T[T < 0][::-1], T[T >= 0]
    both = np.hstack([solved(np.r_[0.0, before])[:, :0:-1], solved(np.r_[0.0, after])[:, 1:]])
    return both[0], both[1]


@pytest.mark.parametrize("g", [9.81, 1.62])
@pytest.mark.parametrize(
    ("L", "theta", "rate"), [(1.0, 0.3, 0.2), (0.7, 2.5, 0.5), (0.5, -1.5, -2.0), (1.3, 0.4, -1.0), (2.0, -0.2, 1.5)]
)
def test_a_pendulum_solves_its_equation_backward_and_forward(L, theta, rate, g):
    angle, _ = swing(L, theta, rate, g)
    expected = np.stack([0.1 + L * np.sin(angle), 0.9 - L * np.cos(angle)], axis=1)
    free = PendulumMotion(gravity=g).positions(np.array([0.1, 0.9, np.log(L), theta, rate]), T)
    held = PendulumMotion((0.1, 0.9), g).positions(np.array([np.log(L), theta, rate]), T)
    np.testing.assert_allclose(free, expected, atol=1e-8)
    np.testing.assert_allclose(held, expected, atol=1e-8)


def test_a_pendulums_period_is_that_of_the_elliptic_integral():
    """From rest at 2 rad it is back after `4 K(sin(1)) sqrt(L / g)`, and opposite after half of that."""
    L = 0.8
    period = 4 * ellipk(np.sin(1.0) ** 2) * np.sqrt(L / GRAVITY)
    at = PendulumMotion((0.0, 0.0)).positions(np.array([np.log(L), 2.0, 0.0]), period * np.array([0.0, 0.25, 0.5, 1.0]))
    start = L * np.array([np.sin(2.0), -np.cos(2.0)])
    np.testing.assert_allclose(at, [start, [0, -L], start * [-1, 1], start], atol=1e-9)


def test_many_pendulums_at_once_are_each_as_alone():
    numbers = np.array([[[0.1, 0.9, 0.0, 0.3, 1.0], [0.2, 0.8, -0.5, -1.0, 0.5]], [[0.0] * 5, [1.0] * 5]])
    together = PendulumMotion().positions(numbers, T)
    assert together.shape == (2, 2, len(T), 2)
    for index in np.ndindex(2, 2):
        np.testing.assert_allclose(together[index], PendulumMotion().positions(numbers[index], T), atol=1e-14)


def test_a_bob_with_too_much_energy_stays_on_its_string():
    """It has energy to go over the top, which a string does not let it: finite, and one string's length away."""
    at = PendulumMotion((0.3, 1.0)).positions(np.array([np.log(0.5), 1.0, 30.0]), T)
    np.testing.assert_allclose(np.linalg.norm(at - [0.3, 1.0], axis=1), 0.5, rtol=1e-12)


def test_polynomials_are_what_their_names_say():
    t = np.array([-0.5, 0.0, 2.0])
    still = Polynomial("still", 0).positions(np.array([1.0, 2.0]), t)
    np.testing.assert_array_equal(still, [[1.0, 2.0]] * 3)
    straight = find_motion("straight").positions(np.array([1.0, 2.0, 3.0, -4.0]), t)
    np.testing.assert_allclose(straight, [[-0.5, 4.0], [1.0, 2.0], [7.0, -6.0]])
    thrown = find_motion("ballistic", gravity=2.0).positions(np.array([1.0, 2.0, 3.0, -4.0]), t)
    np.testing.assert_allclose(thrown, [[-0.5, 3.75], [1.0, 2.0], [7.0, -10.0]])
    pushed = Polynomial("pushed", 1, (0.6, -1.0)).positions(np.zeros((2, 4)), np.array([2.0]))
    np.testing.assert_allclose(pushed, [[[1.2, -2.0]]] * 2)
    assert find_motion("still").names == ("x", "y")
    assert find_motion("ballistic").names == ("x", "y", "vx", "vy")
    assert find_motion("ballistic").starts(t, still).shape == (1, 4)
    assert not np.any(find_motion("straight").loosely)


def test_motions_have_the_gravity_and_pivot_that_are_asked_for():
    moon = find_motion("pendulum", pivot=(0.1, 0.2), gravity=1.62)
    assert (moon.pivot, moon.gravity, moon.name) == ((0.1, 0.2), 1.62, "pendulum")
    assert moon.names == ("log L", "theta", "rate")
    assert find_motion("pendulum").names == ("pivot x", "pivot y", "log L", "theta", "rate")
    fall = find_motion("ballistic").positions(np.zeros(4), np.array([1.0]))
    np.testing.assert_allclose(fall, [[0.0, -9.81 / 2]])
    with pytest.raises(InputError, match="auto, still, straight, ballistic, pendulum"):
        find_motion("circle")


def test_what_is_known_of_a_pendulum_beforehand():
    """Weights are 1 / standard error: 10 m of the pivot, 1 of log L, 3 rad, 10 rad/s."""
    mean, weight = PendulumMotion().loosely
    np.testing.assert_array_equal(mean, np.zeros(5))
    np.testing.assert_allclose(weight, [0.1, 0.1, 1.0, 1 / 3, 0.1])
    np.testing.assert_allclose(PendulumMotion((0.0, 0.0)).loosely[1], [1.0, 1 / 3, 0.1])


@pytest.mark.parametrize(("theta", "rate"), [(0.3, 1.0), (-0.6, 0.5), (0.1, -2.0)])
def test_a_search_for_a_pendulum_starts_near_it(theta, rate):
    """Frames of 0.1 s around time 0: one of the starts has the true string, all are at the bob and move with it."""
    t = np.linspace(-0.05, 0.05, 7)
    truth = np.array([1.2, 0.9, np.log(LENGTHS[1]), theta, rate])
    points = PendulumMotion().positions(truth, t)
    starts = PendulumMotion().starts(t, points)
    assert starts.shape == (len(LENGTHS), 5)
    assert LENGTHS == (0.4, 1.0, 2.5)
    np.testing.assert_allclose(np.exp(starts[:, 2]), LENGTHS)
    np.testing.assert_allclose(starts[1], truth, atol=0.02)
    at = PendulumMotion().positions(starts, np.array([-1e-4, 0.0, 1e-4]))
    np.testing.assert_allclose(at[:, 1], np.tile(points[3], (3, 1)), atol=2e-3)
    velocity = (at[:, 2] - at[:, 0]) / 2e-4
    np.testing.assert_allclose(velocity, np.tile((points[4] - points[2]) / (t[4] - t[2]), (3, 1)), atol=0.03)
    held = PendulumMotion((1.2, 0.9)).starts(t, points)
    np.testing.assert_allclose(held, truth[None, 2:], atol=0.02)


def test_a_search_from_two_frames_takes_the_string_to_be_upright():
    """No acceleration is seen: only gravity pulls, and the bob is right below its pivot."""
    starts = PendulumMotion().starts(np.array([-0.1, 0.1]), np.array([[0.9, 0.2], [1.1, 0.2]]))
    np.testing.assert_allclose(starts[:, 0], 1.0)
    np.testing.assert_allclose(starts[:, 1], 0.2 + np.array(LENGTHS))
    np.testing.assert_allclose(starts[:, 3], 0, atol=1e-12)
    np.testing.assert_allclose(starts[:, 4], 1.0 / np.array(LENGTHS))


SIGMA = 0.01
FRAMES = 2.0 + np.arange(12) / 30
FALL = np.array([0.0, -9.81])


def design(t: np.ndarray, order: int) -> np.ndarray:
    """Of x and y alike: columns 1, and t if of order 1, (T, order + 1)."""
    return np.vander(t, order + 1, increasing=True)


def by_hand(t: np.ndarray, points: np.ndarray, order: int, acceleration: np.ndarray) -> tuple:
    """Coefficients (order + 1, 2), chi squared and BIC of a polynomial around the mean time."""
    s = t - t.mean()
    A, y = design(s, order), points - 0.5 * s[:, None] ** 2 * acceleration
    c = np.linalg.lstsq(A, y, rcond=None)[0]
    misfit = (((y - A @ c) / SIGMA) ** 2).sum()
    return c, misfit, misfit + c.size * np.log(2 * len(t))


LINEAR = {"still": (0, np.zeros(2)), "straight": (1, np.zeros(2)), "ballistic": (1, FALL)}


@pytest.mark.parametrize("name", LINEAR)
def test_a_linear_track_is_linear_least_squares(name):
    order, acceleration = LINEAR[name]
    rng = np.random.default_rng(3)
    points = rng.normal(0, SIGMA, (12, 2)) + [1.0, 0.2] + 0.5 * (FRAMES - 2.2)[:, None] ** 2 * acceleration
    track = fit_track(FRAMES, points, sigma=SIGMA, motion=name)
    c, misfit, bic = by_hand(FRAMES, points, order, acceleration)
    np.testing.assert_allclose(track.numbers, c.ravel(), rtol=1e-7, atol=1e-9)
    assert track.chi2 == pytest.approx(misfit)
    assert track.bic == pytest.approx(bic)
    assert track.dof == 24 - c.size
    assert track.epoch == pytest.approx(FRAMES.mean())
    assert track.last == FRAMES[-1]
    assert track.p_value == pytest.approx(1 - chi2.cdf(misfit, 24 - c.size))
    A = design(FRAMES - FRAMES.mean(), order)
    one = np.linalg.inv(A.T @ A) * SIGMA**2 * max(1.0, misfit / (24 - c.size))
    np.testing.assert_allclose(track.covariance, np.kron(one, np.eye(2)), rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("motion", ["straight", "ballistic", "pendulum"])
def test_a_track_does_not_depend_on_when_the_clock_began(motion):
    """The same frames a quarter of an hour later."""
    swing = PendulumMotion(pivot=(1.0, 0.9))
    points = swing.positions(np.array([np.log(0.6), 0.5, 0.3]), FRAMES - 2.0)
    points = points + np.random.default_rng(1).normal(0, SIGMA, points.shape)
    pivot = (1.0, 0.9) if motion == "pendulum" else None
    early, late = (fit_track(FRAMES + x, points, sigma=SIGMA, motion=motion, pivot=pivot) for x in (0.0, 900.0))
    np.testing.assert_allclose(late.numbers, early.numbers, rtol=1e-5, atol=1e-7)
    assert late.chi2 == pytest.approx(early.chi2, rel=1e-6)


def test_the_motion_of_the_smallest_bic_is_chosen():
    """Drifts from none to a clear one, each of many noises: still and straight are told apart where BIC says so."""
    chosen = []
    for seed in range(40):
        drift = 0.0025 * (seed % 10)
        points = np.random.default_rng(seed).normal(0, SIGMA, (12, 2)) + [1.0, 0.2] + drift * (FRAMES - 2)[:, None] * 10
        bic = {name: by_hand(FRAMES, points, *LINEAR[name])[2] for name in LINEAR}
        track = fit_track(FRAMES, points, sigma=SIGMA, pivot=(5.0, 5.0))
        assert track.motion.name == min(bic, key=lambda name: bic[name])
        assert track.bic == pytest.approx(min(bic.values()))
        chosen.append(track.motion.name)
    assert min(chosen.count("still"), chosen.count("straight")) > 5


def test_a_pendulum_is_chosen_where_its_bic_is_smaller():
    rng = np.random.default_rng(0)
    points = PendulumMotion().positions(np.array([1.0, 1.0, 0.0, 0.6, 1.0]), FRAMES - 2.2) + rng.normal(
        0, SIGMA, (12, 2)
    )
    alone = {name: fit_track(FRAMES, points, sigma=SIGMA, motion=name) for name in (*LINEAR, "pendulum")}
    assert fit_track(FRAMES, points, sigma=SIGMA).motion.name == "pendulum"
    assert min(alone, key=lambda name: alone[name].bic) == "pendulum"
    swing = alone["pendulum"]
    assert swing.dof == 24 - 5
    assert swing.bic == pytest.approx(swing.chi2 + 5 * np.log(24))


def test_a_pendulum_is_the_most_probable_one_and_its_covariance_the_inverse_curvature():
    """The negative logarithm of the posterior, minimised and differentiated twice by other means."""
    rng, pivot = np.random.default_rng(1), (1.0, 1.0)
    points = PendulumMotion(pivot).positions(np.array([-0.2, 0.6, 1.0]), FRAMES - 2.2) + rng.normal(0, SIGMA, (12, 2))
    track = fit_track(FRAMES, points, sigma=SIGMA, motion="pendulum", pivot=pivot)
    s = FRAMES - FRAMES.mean()

    def surprise(x: np.ndarray, scale: float = 1.0) -> float:
        L, theta, rate = np.exp(x[0]), x[1], x[2]
        angle, speed, path = theta, rate, []
        for ends in (s[s <= 0][::-1], s[s > 0]):  # leapfrog in small steps, from time 0 either way
            angle, speed, now, here = theta, rate, 0.0, []
            for end in ends:
                h = (end - now) / 200
                for _ in range(200):
                    speed -= h / 2 * 9.81 / L * np.sin(angle)
                    angle += h * speed
                    speed -= h / 2 * 9.81 / L * np.sin(angle)
                now = end
                here.append((pivot[0] + L * np.sin(angle), pivot[1] - L * np.cos(angle)))
            path += here[::-1] if end <= 0 else here
        misfit = ((np.array(path) - points) ** 2).sum() / SIGMA**2
        return 0.5 * misfit / scale + 0.5 * (x[0] ** 2 + (x[1] / 3) ** 2 + (x[2] / 10) ** 2)

    found = minimize(surprise, [-0.1, 0.5, 1.2], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9})
    np.testing.assert_allclose(track.numbers, found.x, atol=2e-5)
    step, curvature = np.diag([1e-3, 1e-3, 1e-2]), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            corners = [
                a * b * surprise(found.x + a * step[i] + b * step[j], track.misfit) for a in (1, -1) for b in (1, -1)
            ]
            curvature[i, j] = sum(corners) / (4 * step[i, i] * step[j, j])
    expected = np.linalg.inv(curvature)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(track.covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.05)


def test_a_pendulum_is_found_on_any_clock():
    truth = np.array([1.0, 1.0, 0.0, 0.6, 1.0])
    track = fit_track(
        1e5 + FRAMES, PendulumMotion().positions(truth, FRAMES - FRAMES.mean()), sigma=1e-4, motion="pendulum"
    )
    np.testing.assert_allclose(track.numbers, truth, atol=1e-3)
    assert track.epoch == pytest.approx(1e5 + FRAMES.mean())


def test_what_is_known_beforehand_speaks_where_frames_are_silent():
    """A bob at rest, seen for a moment: string, angle and rate are only known as they were before."""
    points = np.tile([1.0, 0.0], (3, 1))
    track = fit_track(np.array([0.0, 0.01, 0.02]), points, sigma=SIGMA, motion="pendulum")
    errors = np.sqrt(np.diag(track.covariance))
    np.testing.assert_allclose(errors[2:4], [1.0, 3.0], rtol=0.1)
    np.testing.assert_allclose(track.position(0.01), [[1.0, 0.0]], atol=1e-4)

    def surprise(x: np.ndarray) -> float:
        off = (PendulumMotion().positions(x, np.array([-0.01, 0.0, 0.01])) - points) / SIGMA
        return (off**2).sum() + ((x / [10, 10, 1, 3, 10]) ** 2).sum()

    found = minimize(surprise, [0.9, 1.0, 0.0, 0.0, 0.0], method="BFGS", options={"gtol": 1e-7})
    np.testing.assert_allclose(track.numbers, found.x, atol=5e-3)
    for dof in (0, -1):
        alone = TargetTrack(find_motion("still"), np.zeros(2), np.eye(2), chi2=5.0, dof=dof)
        assert (alone.p_value, alone.misfit) == (1.0, 1.0)


def test_the_covariance_is_scaled_by_the_misfit_and_never_down():
    rng = np.random.default_rng(5)
    noise = rng.normal(0, 1, (12, 2))
    noise -= noise.mean(axis=0)
    track = {}
    for size in (0.5, 1.0, 3.0):
        points = np.array([1.0, 0.0]) + noise * size * SIGMA * np.sqrt(22 / (noise**2).sum())
        track[size] = fit_track(FRAMES, points, sigma=SIGMA, motion="still")
        assert track[size].chi2 == pytest.approx(22 * size**2)
        assert track[size].misfit == pytest.approx(max(1.0, size**2))
    np.testing.assert_allclose(track[0.5].covariance, np.eye(2) * SIGMA**2 / 12, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(track[3.0].covariance, np.eye(2) * 9 * SIGMA**2 / 12, rtol=1e-6, atol=1e-15)
    assert track[1.0].warning == ""
    assert "3.0 times as far from a still motion" in track[3.0].warning


def test_the_warning_begins_at_four_times_the_variance():
    still, numbers = find_motion("still"), np.zeros(2)
    assert TargetTrack(still, numbers, np.eye(2), chi2=DOUBTFUL * 10, dof=10).warning == ""
    assert TargetTrack(still, numbers, np.eye(2), chi2=DOUBTFUL * 10 + 0.1, dof=10).warning != ""
    assert DOUBTFUL == 4.0


def test_covariances_cover_the_scatter_of_refits():
    """300 noises of the same pendulum: what is said of 0.5 s ahead scatters with the covariance stated, +- 25 %."""
    motion, truth = PendulumMotion((1.0, 1.0)), np.array([0.0, 0.5, 0.8])
    ahead, said, stated = FRAMES[-1] + 0.5, [], []
    exact = motion.positions(truth, FRAMES - FRAMES.mean())
    for seed in range(300):
        points = exact + np.random.default_rng(seed).normal(0, SIGMA, exact.shape)
        track = fit_track(FRAMES, points, sigma=SIGMA, motion="pendulum", pivot=(1.0, 1.0))
        said.append(track.position(ahead)[0])
        stated.append(track.covariance_at(ahead)[0] / track.misfit)
    scatter, mean = np.cov(np.array(said).T), np.mean(stated, axis=0)
    whitened = np.linalg.eigvals(np.linalg.solve(mean, scatter)).real
    assert (np.abs(whitened - 1) < 0.25).all()


def test_derivatives_in_closed_form():
    """Of a ballistic motion at any time; of a pendulum at time 0, and by its angle and rate along the swing."""
    t = np.array([0.0, 0.7])
    by_numbers = derivatives(find_motion("ballistic"), np.array([1.0, 2.0, -3.0, 40.0]), t)
    expected = np.stack([np.hstack([np.eye(2), s * np.eye(2)]) for s in t])
    np.testing.assert_allclose(by_numbers, expected, atol=1e-9)
    L, theta = 0.8, 0.4
    by_numbers = derivatives(PendulumMotion(), np.array([1.0, 1.0, np.log(L), theta, 2.0]), np.array([0.0]))[0]
    s, c = np.sin(theta), np.cos(theta)
    np.testing.assert_allclose(by_numbers, [[1, 0, L * s, L * c, 0], [0, 1, -L * c, L * s, 0]], atol=1e-9)


def test_positions_and_velocities_are_on_the_clock_of_the_frames():
    track = TargetTrack.known(find_motion("ballistic"), np.array([1.0, 2.0, 3.0, 4.0]), epoch=10.0)
    t = np.array([10.0, 10.5])
    np.testing.assert_allclose(track.position(t), [[1, 2], [2.5, 2 + 2 - 9.81 / 8]])
    np.testing.assert_allclose(track.velocity(t), [[3, 4], [3, 4 - 9.81 / 2]], atol=1e-7)
    np.testing.assert_allclose(track.derivatives(10.5)[0], np.hstack([np.eye(2), 0.5 * np.eye(2)]), atol=1e-9)
    assert not track.covariance_at(11.0).any()
    assert track.positions(np.zeros((3, 4)), t).shape == (3, 2, 2)
    assert (track.last, track.misfit, track.warning) == (-np.inf, 1.0, "")


def test_samples_scatter_as_the_covariance_says():
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]]) * 1e-4
    track = TargetTrack(find_motion("still"), np.array([1.0, 2.0]), covariance)
    drawn = track.sample(np.random.default_rng(0), 20_000)
    assert drawn.shape == (20_000, 2)
    np.testing.assert_allclose(drawn.mean(axis=0), [1.0, 2.0], atol=5e-4)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=0.05)


@pytest.mark.parametrize("misfit", [1.0, 9.0])
def test_more_frames_add_their_information(misfit):
    """A position at rest: n frames and m more have the variance of n + m, all as wrong as the first were."""
    variance = misfit * SIGMA**2 / 12
    track = TargetTrack(find_motion("still"), np.zeros(2), variance * np.eye(2), chi2=misfit * 22, dof=22)
    later = track.after(np.arange(24) / 30, SIGMA)
    np.testing.assert_allclose(later.covariance, variance / 3 * np.eye(2), rtol=1e-6, atol=1e-15)
    finer = track.after(np.arange(24) / 30, SIGMA / 2)
    np.testing.assert_allclose(finer.covariance, variance / 9 * np.eye(2), rtol=1e-6, atol=1e-15)
    np.testing.assert_array_equal(later.numbers, track.numbers)


def test_frames_that_do_not_show_it_say_nothing():
    points = np.random.default_rng(2).normal(0, SIGMA, (12, 2))
    holes = points.copy()
    holes[3, 0] = holes[7, 1] = np.nan
    seen = np.delete(np.arange(12), [3, 7])
    a = fit_track(FRAMES, holes, sigma=SIGMA, motion="straight")
    b = fit_track(FRAMES[seen], points[seen], sigma=SIGMA, motion="straight")
    np.testing.assert_array_equal(a.numbers, b.numbers)
    np.testing.assert_array_equal(a.covariance, b.covariance)
    assert (a.epoch, a.last, a.dof) == (b.epoch, b.last, b.dof)


@pytest.mark.parametrize(
    ("motion", "pivot", "least"),
    [("still", None, 1), ("straight", None, 2), ("pendulum", None, 3), ("pendulum", (1.0, 1.0), 2), ("auto", None, 3)],
)
def test_how_many_frames_a_motion_needs(motion, pivot, least):
    points = np.random.default_rng(0).normal(0, 0.1, (least, 2))
    fit_track(FRAMES[:least], points, sigma=SIGMA, motion=motion, pivot=pivot)
    if least > 1:
        with pytest.raises(InputError, match=f"got '{least - 1} frames.*at least {least} for {motion}"):
            fit_track(FRAMES[: least - 1], points[1:], sigma=SIGMA, motion=motion, pivot=pivot)


def test_gravity_reaches_the_motion():
    t = np.arange(10) / 20
    points = np.stack([0 * t, -0.5 * 1.62 * t**2], axis=1)
    assert fit_track(t, points, sigma=SIGMA, motion="ballistic", gravity=1.62).chi2 < 1e-12
    assert fit_track(t, points, sigma=SIGMA, motion="ballistic").chi2 > 1
