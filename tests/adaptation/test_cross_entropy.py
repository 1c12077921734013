"""The search around a good strike: each round by hand from the draws of a generator that repeats, and where it ends."""

from __future__ import annotations

import numpy as np

from whiptool.adaptation.plan_search import CrossEntropy

WIDTH, START = np.array([2.0, 0.5]), np.array([0.3, -0.2])


class Given:
    """A generator whose normal draws are given, round by round."""

    def __init__(self, *rounds: np.ndarray) -> None:
        self.rounds = list(rounds)

    def standard_normal(self, size: tuple[int, int]) -> np.ndarray:
        draws = self.rounds.pop(0)
        assert draws.shape == size
        return draws


def search(worth, rng, *, rounds: int, population: int = 8, value: float = 0.0, sure=lambda top: False, within=None):
    around = CrossEntropy(WIDTH, 0.1, population, rounds, within or (lambda x: x), sure)
    return around.around(START, value, worth, rng)


def test_a_better_round_moves_and_has_the_spread_of_its_best_quarter():
    first, second = np.random.default_rng(0).standard_normal((2, 8, 2))
    first[1] = 0.5 * first[4]
    given = np.array([0.1, 0.7, -1.0, 0.2, 0.9, -3.0, 0.0, 0.3])
    strikes, values = search(lambda x: given[: len(x)], Given(first, second), rounds=2)
    drawn = START + 0.1 * WIDTH * first
    np.testing.assert_allclose(strikes[:8], drawn)
    away = np.abs(drawn[1] - drawn[4])  # the best quarter is two strikes, one of them the best
    spread = (0.1 + away / 2 / WIDTH) / 2
    np.testing.assert_allclose(strikes[8:], drawn[4] + spread * WIDTH * second)
    np.testing.assert_array_equal(values, np.r_[given, given])


def test_a_worse_round_stays_and_looks_closer():
    ones = np.ones((8, 2))
    strikes, _ = search(lambda x: np.zeros(len(x)), Given(ones, ones, ones), rounds=3)
    for i in range(3):
        np.testing.assert_allclose(strikes[8 * i : 8 * i + 8], START + 0.1 * 0.6**i * WIDTH * ones)


def test_a_small_round_learns_from_two():
    draws = np.array([[1.0, 0.0], [3.0, 0.0], [9.0, 0.0]])
    strikes, _ = search(lambda x: -x[:, 0] + 1.0, Given(draws, draws), rounds=2, population=3)
    spread = (0.1 + 0.1 * (3 - 1) / 2) / 2
    np.testing.assert_allclose(strikes[3:, 0], strikes[0, 0] + spread * WIDTH[0] * draws[:, 0])


def test_what_is_sure_ends_the_search_and_draws_keep_within():
    rng = np.random.default_rng(0)
    strikes, values = search(lambda x: np.ones(len(x)), rng, rounds=5, sure=lambda top: top >= 1.0)
    assert strikes.shape == (8, 2)
    strikes, values = search(lambda x: np.ones(len(x)), rng, rounds=5, value=1.0, sure=lambda top: top >= 1.0)
    assert (strikes.shape, values.shape) == ((0, 2), (0,))
    strikes, _ = search(lambda x: np.ones(len(x)), rng, rounds=3, within=lambda x: np.clip(x, 0.0, 0.3))
    assert strikes.min() == 0.0
    assert strikes.max() == 0.3


def test_it_finds_the_top_of_a_hill():
    """From 1.6 standard deviations of the first draws away to a twentieth of one."""
    top = START + WIDTH * [0.1, -0.12]
    rng = np.random.default_rng(3)
    strikes, values = search(
        lambda x: -np.sum(((x - top) / WIDTH) ** 2, axis=1), rng, rounds=20, population=16, value=-1.0
    )
    assert np.linalg.norm((strikes[values.argmax()] - top) / WIDTH) < 0.005
