"""Motions of targets against their differential equations, solved by SciPy, and against derivatives by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from whiptool.errors import InputError
from whiptool.interception.motions import GRAVITY, LENGTHS, PendulumMotion, Polynomial, find_motion

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
