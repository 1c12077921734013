"""Eq. 23 and what is printed beside it, against values worked out by hand or by another way."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.identification.similarity import frechet, similarity

T = np.linspace(0, 1.2, 73)


def curve(t: np.ndarray) -> np.ndarray:
    """A path with no zero coordinate."""
    return np.stack([2 + np.sin(4 * t) + 0.3 * t**2, -1.5 - np.cos(5 * t) * t], axis=1)


def test_eq_23_by_hand():
    P, S = (
        np.array([[1.0, 2], [2, -4], [4, 1], [5, 2], [1, 1]]),
        np.array([[1.5, 2], [2, -3], [3, 1], [5, 4], [1, 1.0]]),
    )
    s = similarity(np.arange(5.0), P, S)
    assert s.rho == pytest.approx([(0.5 + 1 + 0.75 + 1 + 1) / 5, (1 + 0.75 + 1 + 0 + 1) / 5])
    assert s.rho_mean == pytest.approx(np.mean(s.rho))
    assert s.rmse == pytest.approx(np.sqrt((0.25 + 1 + 1 + 4) / 5))
    assert s.largest == pytest.approx(2)
    assert s.nrmse == pytest.approx(s.rmse / np.hypot(4, 6))


def test_the_same_path_is_the_same():
    s = similarity(T, curve(T), curve(T), target=(2.5, -1.0))
    assert (s.rho_mean, s.rmse, s.largest, s.frechet, s.hit_point, s.hit_time, s.hit_speed) == (1, 0, 0, 0, 0, 0, 0)
    assert abs(s.delay) < 1e-9


def test_eq_23_depends_on_the_origin_and_the_others_do_not():
    P, S, shift = curve(T), curve(T) + 0.05, np.array([3.0, -2.0])
    a, b = similarity(T, P, S), similarity(T, P + shift, S + shift)
    assert abs(a.rho_mean - b.rho_mean) > 0.01
    for name in ("rmse", "nrmse", "largest", "delay", "frechet"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), abs=1e-9)


def test_a_zero_coordinate_is_left_out_and_counted():
    P = curve(T)
    P[7, 0] = 0
    s = similarity(T, P, P.copy())
    assert s.left_out == 1
    assert s.rho_mean == 1


@pytest.mark.parametrize("late", [-0.031, 0.0123, 0.05])
def test_delay_of_a_late_copy(late):
    s = similarity(T, curve(T), curve(T - late))
    assert s.delay == pytest.approx(late, abs=1e-4)


def test_hit_errors_of_a_straight_flight():
    """Both fly straight by the target; one is later and slower by a known amount."""
    P = np.stack([2 * T, np.full_like(T, 0.1)], axis=1)
    S = np.stack([1.5 * (T - 0.1), np.full_like(T, 0.3)], axis=1)
    s = similarity(T, P, S, target=(1.0, 0.0))
    assert s.hit_point == pytest.approx(0.2, abs=1e-6)
    assert s.hit_time == pytest.approx((1 / 1.5 + 0.1) - 0.5, abs=1e-6)
    assert s.hit_speed == pytest.approx(-0.5, abs=1e-6)


def test_frechet_against_all_couplings():
    """The smallest longest leash over every monotone coupling, listed one by one."""
    rng = np.random.default_rng(2)
    for _ in range(5):
        P, S = rng.normal(size=(4, 2)), rng.normal(size=(3, 2))
        steps = [(1, 0), (0, 1), (1, 1)]
        best = np.inf
        for length in range(3, 6):
            for moves in itertools.product(steps, repeat=length):
                places = np.cumsum([(0, 0), *moves], axis=0)
                if tuple(places[-1]) == (3, 2) and (places <= (3, 2)).all():
                    best = min(best, max(np.linalg.norm(P[i] - S[j]) for i, j in places))
        assert frechet(P, S) == pytest.approx(best)


def test_missing_frames_are_left_out():
    P, S = curve(T), curve(T) + 0.01
    P[3], S[9, 1] = np.nan, np.nan
    assert similarity(T, P, S).rmse == pytest.approx(0.01 * np.sqrt(2))


def test_bad_input_is_named():
    with pytest.raises(InputError, match="paths"):
        similarity(T, curve(T), curve(T)[:-1])
    with pytest.raises(InputError, match="five or more"):
        similarity(T[:4], curve(T)[:4], curve(T)[:4])


def test_a_path_that_rests_has_no_size_to_measure_by():
    P = np.tile([1.0, 2.0], (6, 1))
    assert similarity(np.arange(6.0), P, P.copy()).nrmse == 0.0
    off = similarity(np.arange(6.0), P, P + 0.1)
    assert off.nrmse == np.inf
    assert off.rmse == pytest.approx(0.1 * np.sqrt(2))
