"""Readings of a sampled path against the polynomial that it is, integrated by SciPy, and against its convergence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

from whiptool.identification.readings import NEUTRAL, PLACED, POINTS, Reading, Samples, by_placement, carried, placed

START, INTERVAL, COUNT = 0.3, 0.05, 21
GRID = START + INTERVAL * np.arange(COUNT)
QUINTIC = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.7, -3.0, 1.1], domain=[0, 1], window=[0, 1])
AT = np.array([0.3, 0.312, 0.35, 0.4777, 0.801, 1.2, 1.263, 1.3])


def read(at: np.ndarray, exposure: float = 0.0) -> Samples:
    return Samples(at, exposure=exposure, start=START, interval=INTERVAL, count=COUNT)


PATH = np.stack([QUINTIC(GRID), np.ones(COUNT)], axis=1)[:, None, :]  # one marker, (S, 1, 2)
FIRST = np.zeros(len(AT), int)


def test_a_polynomial_of_the_fifth_degree_is_read_exactly():
    value, velocity = read(AT).value(PATH, FIRST), read(AT).velocity(PATH, FIRST)
    np.testing.assert_allclose(value[:, 0], QUINTIC(AT), atol=1e-11)
    np.testing.assert_allclose(velocity[:, 0], QUINTIC.deriv()(AT), atol=1e-9)
    np.testing.assert_allclose(value[:, 1], 1.0)
    np.testing.assert_allclose(velocity[:, 1], 0.0, atol=1e-11)


def test_an_exposure_is_a_mean():
    inside, e = np.array([0.45, 0.8, 1.2499]), 0.1
    readings = read(inside, e)
    mean = [quad(QUINTIC, t - e / 2, t + e / 2)[0] / e for t in inside]
    rate = [(QUINTIC(t + e / 2) - QUINTIC(t - e / 2)) / e for t in inside]
    np.testing.assert_allclose(readings.value(PATH, np.zeros(3, int))[:, 0], mean, atol=1e-10)
    np.testing.assert_allclose(readings.velocity(PATH, np.zeros(3, int))[:, 0], rate, atol=1e-9)


def test_before_and_after_the_path_it_stands_still():
    outside = np.array([-5.0, 0.2999, 1.3001, 9.0])
    value = read(outside).value(PATH, np.zeros(4, int))
    np.testing.assert_allclose(value[:, 0], QUINTIC([0.3, 0.3, 1.3, 1.3]), atol=1e-11)
    np.testing.assert_allclose(read(outside).velocity(PATH, np.zeros(4, int)), 0, atol=1e-14)
    half = read(np.array([START]), 0.1)  # a Gauss node counts as inside or outside as a whole
    nodes, weights = np.polynomial.legendre.leggauss(4)
    at = START + 0.05 * nodes
    expected = weights / 2 @ QUINTIC(np.maximum(at, START))
    np.testing.assert_allclose(half.value(PATH, np.zeros(1, int))[0, 0], expected, atol=1e-11)
    moving = weights / 2 @ (QUINTIC.deriv()(at) * (at >= START))
    np.testing.assert_allclose(half.velocity(PATH, np.zeros(1, int))[0, 0], moving, atol=1e-9)


def test_errors_fall_with_the_sixth_power_of_the_interval():
    errors = []
    for count in (41, 81):
        grid = np.linspace(0, 2, count)
        at = np.linspace(0.31, 1.77, 50)
        readings = Samples(at, exposure=0.0, start=0.0, interval=2 / (count - 1), count=count)
        errors.append(np.abs(readings.value(np.sin(5 * grid)[:, None, None], np.zeros(50, int))[:, 0] - np.sin(5 * at)))
    assert 5.5 < np.log2(errors[0].max() / errors[1].max()) < 6.8
    assert POINTS == 6


def test_each_reading_is_of_its_own_quantity_and_direction():
    rng = np.random.default_rng(0)
    path = rng.normal(size=(4, COUNT, 3, 2))  # four directions, three markers
    at, which = GRID[[2, 7, 11, 20, 0]], np.array([2, 0, 1, 1, 2])
    found = read(at).value(path, which)
    assert found.shape == (4, 5, 2)
    for k, (i, marker) in enumerate(zip([2, 7, 11, 20, 0], which)):
        np.testing.assert_allclose(found[:, k], path[:, i, marker], atol=1e-10)


@pytest.mark.parametrize("t", [0.4321, 1.1])
def test_the_derivative_by_time_is_that_of_differences(t):
    h = 1e-6
    rng = np.random.default_rng(1)
    path = rng.normal(size=(COUNT, 1, 2))
    ahead, behind = (read(np.array([x]), 0.02).value(path, np.zeros(1, int)) for x in (t + h, t - h))
    np.testing.assert_allclose(
        read(np.array([t]), 0.02).velocity(path, np.zeros(1, int)), (ahead - behind) / (2 * h), rtol=1e-5
    )


X = np.random.default_rng(0).normal(size=(7, 3))
GIVEN = dict(zip(NEUTRAL, [0.02, 0.99, 1.1, 0.3, -0.2, 0.4, 0.1, 0.05, 0.7, -0.6], strict=True))


def test_the_neutral_placement_leaves_places_alone():
    for d in PLACED:
        np.testing.assert_array_equal(placed(X[:, :d], NEUTRAL), X[:, :d])


def test_in_space_it_turns_about_x_then_y_then_z():
    turn = Rotation.from_euler("xyz", [GIVEN[f"rotation_{axis}"] for axis in "xyz"])
    shift = [GIVEN[f"shift_{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(placed(X, GIVEN), GIVEN["scale"] * turn.apply(X) + shift, atol=1e-12)
    np.testing.assert_allclose(carried(X, GIVEN), GIVEN["scale"] * turn.apply(X), atol=1e-12)


@pytest.mark.parametrize("d", PLACED)
def test_derivatives_are_differences(d):
    slopes, h = by_placement(X[:, :d], GIVEN), 1e-6
    assert set(slopes) == set(PLACED[d])
    for name in PLACED[d]:
        up, down = (placed(X[:, :d], {**GIVEN, name: GIVEN[name] + step}) for step in (h, -h))
        np.testing.assert_allclose(slopes[name], (up - down) / (2 * h), atol=1e-8)


def test_smoothed_readings_are_those_of_scipys_filter_with_exact_derivatives():
    """Predicted, then smoothed, as the tracks were; derivatives against differences."""
    t, rate = np.arange(120) / 90, 90.0
    path = np.stack([np.sin(5 * np.arange(0, 1.6, 1e-3)), np.cos(7 * np.arange(0, 1.6, 1e-3))], axis=1)[:, None]
    of_read = Reading(["tip"], [0], t[:, None], np.zeros((120, 1, 2)), np.ones((120, 1, 2)), 0.0)

    def read(given):
        return of_read.read(path, path[None], given, start=0.0, interval=1e-3)

    plain, smooth = read(NEUTRAL), read({**NEUTRAL, "smoothing": 1 / 4})
    expected = filtfilt(*butter(2, 4, fs=rate), plain[0].reshape(120, 2), axis=0).ravel()
    np.testing.assert_allclose(smooth[0], expected, atol=1e-9)
    np.testing.assert_allclose(smooth[1][0], expected, atol=1e-9)  # the path changes by itself
    h = 1e-3
    ends = [read({**NEUTRAL, "smoothing": 0.25 + step})[0] for step in (h, -h)]
    by_difference = (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(smooth[2]["smoothing"], by_difference, atol=1e-3)
    np.testing.assert_array_equal(read({**NEUTRAL, "smoothing": 0.0})[0], plain[0])
