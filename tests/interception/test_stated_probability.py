"""What an aimed strike promises, against closed forms and Monte Carlo, on paths that need no whip."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import erf

from whiptool.interception.interceptor import Aim, Interceptor
from whiptool.interception.target_tracks import TargetTrack, find_motion
from whiptool.models import preset
from whiptool.strike_map.striker import Striker

SPREAD, RADIUS, SPEED, TAU = 0.05, 0.035, 10.0, 0.3  # [m], [m], [m/s], [s]
POINT = np.array([1.0, 0.0])


class Rollout:
    """A tip that flies straight along an angle, the strike's first number, past a point at a distance, its second."""

    model, prescribed, space = preset("lemon2024"), False, SimpleNamespace(kind="joint")
    diverged = staticmethod(lambda x: np.zeros(len(x), bool))

    def peaks_and_path(self, x, *, t_stay, rate):
        t = np.arange(int((x[:, -1].max() + t_stay) * rate) + 1) / rate
        along = np.stack([np.cos(x[:, 0]), np.sin(x[:, 0])], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        aside = POINT + x[:, 1:2] * across
        path = aside[:, None] + SPEED * (t - TAU)[:, None] * along[:, None]
        return SimpleNamespace(diverged=self.diverged(x)), path


def aim(spread: float = SPREAD) -> Aim:
    """A target at rest near the point, its place known to `spread` in each coordinate."""
    track = TargetTrack(find_motion("still"), POINT, spread**2 * np.eye(2))
    striker = Striker(Rollout(), limits=None, t_stay=0.3)
    library: Any = SimpleNamespace(striker=striker, points=POINT[None])
    return Aim(Interceptor(library, RADIUS), track, 0.0, 0.0, 2.0)


def best(strikes: np.ndarray, *, seed: int, samples: int):
    """The best of strikes (B, 5) that start at once."""
    B = len(strikes)
    return aim().best(
        strikes,
        np.zeros(B),
        np.full(B, TAU),
        rng=np.random.default_rng(seed),
        samples=samples,
        began=time.perf_counter(),
    )


def strikes(angles: np.ndarray, aside: float | np.ndarray = 0.0) -> np.ndarray:
    x = np.zeros((len(angles), 5))
    x[:, 0], x[:, 1], x[:, -1] = angles, aside, 0.5
    return x


@pytest.mark.parametrize("samples", [32, 128])
def test_the_probability_of_the_best_is_not_the_luck_of_the_draw(samples):
    """Twelve strikes that all hit with one probability, in closed form: which one is chosen is chance."""
    hits = erf(RADIUS / (SPREAD * np.sqrt(2)))
    alike = strikes(np.arange(12) * np.pi / 12)
    stated = [best(alike, seed=seed, samples=samples).probability for seed in range(50)]
    assert 0.4 < hits < 0.6
    assert np.mean(stated) == pytest.approx(hits, abs=4 * np.sqrt(hits * (1 - hits) / 512 / 50))
    assert np.std(stated) < 1.3 * np.sqrt(hits * (1 - hits) / 512)


def test_the_expected_miss_is_that_of_monte_carlo():
    """Strikes that pass at several distances: the nearest is taken; misses of 200,000 other targets, by hand."""
    chosen = best(strikes(np.full(4, 0.3), np.array([0.1, -0.01, 0.15, 0.2])), seed=0, samples=64)
    across = np.array([-np.sin(0.3), np.cos(0.3)])
    miss = np.abs(-0.01 - SPREAD * np.random.default_rng(1).standard_normal((200_000, 2)) @ across)
    assert chosen.strike.vector[1] == -0.01
    assert chosen.mean_miss == pytest.approx(0.01, abs=1e-9)
    stated = [best(strikes(np.full(1, 0.3), -0.01), seed=seed, samples=64) for seed in range(100)]
    scale = np.std(miss) / np.sqrt(512 * 100)
    assert np.mean([one.expected_miss for one in stated]) == pytest.approx(miss.mean(), abs=4 * scale)
    share = np.mean(miss <= RADIUS)
    assert np.mean([one.probability for one in stated]) == pytest.approx(share, abs=4 * 0.5 / np.sqrt(512 * 100))


def test_a_strike_that_cannot_be_made_is_not_chosen():
    """However probable its hit."""
    judge = aim()
    judge.library.striker.rollout.diverged = lambda strikes: strikes[:, 1] == 0
    chosen = judge.best(
        strikes(np.zeros(2), np.array([0.0, 0.2])),
        np.zeros(2),
        np.full(2, TAU),
        rng=np.random.default_rng(0),
        samples=64,
        began=time.perf_counter(),
    )
    assert chosen.strike.vector[1] == 0.2
