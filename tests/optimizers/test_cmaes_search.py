"""CMA-ES: its first generation by mean and spread, convergence on a slanted valley, restarts, NumPy's own generator."""

from __future__ import annotations

import numpy as np
import pytest
from toy_objectives import LOWER, UPPER, Enough, Recorder

from whiptool.optimizers.cmaes_search import cmaes_search

MINIMUM = np.array([0.3, 0.6, 0.4, 0.7, 0.55])


def valley(x: np.ndarray) -> np.ndarray:
    """Ten times as steep along the diagonal as across."""
    offset = x - MINIMUM
    along = offset.sum(axis=1)
    return np.sqrt((offset**2).sum(axis=1) + 99 * along**2 / 5)


def search(generations: int, miss, seed: int) -> list[np.ndarray]:
    recorder = Recorder(generations, miss)
    with pytest.raises(Enough):
        cmaes_search(recorder, seed=seed)
    return recorder.seen


def test_it_begins_with_a_random_strike_and_a_generation_about_it():
    begun = [search(2, valley, seed) for seed in range(60)]
    starts = np.array([first[0] for first, _ in begun])
    assert starts.min() >= 0.2
    assert starts.max() <= 0.8
    np.testing.assert_allclose(starts.mean(axis=0), 0.5, atol=4 * 0.173 / np.sqrt(60))
    np.testing.assert_allclose(starts.std(), 0.6 / np.sqrt(12), rtol=0.1)
    offsets = np.concatenate([second - first for first, second in begun])
    assert 0.22 < offsets.std() < 0.33  # 0.3, less what the box cuts off


def test_it_converges_and_begins_again():
    state = repr(np.random.get_state())  # noqa: NPY002
    seen = search(400, valley, 3)
    assert repr(np.random.get_state()) == state  # noqa: NPY002
    best = [valley(x).min() for x in seen]
    assert min(best[:200]) < 1e-6
    middles = np.array([x.mean(axis=0) for x in seen])
    jumps = np.abs(np.diff(middles, axis=0)).max(axis=1)
    restarts = np.flatnonzero((jumps > 0.05) & (np.array(best[:-1]) < 1e-6))
    assert len(restarts) >= 1  # converged, and somewhere else again
    assert all(np.array_equal(a, b) for a, b in zip(search(9, valley, 3), seen, strict=False))
    assert not np.array_equal(search(1, valley, 4)[0], seen[0])


def test_strikes_are_those_of_the_box_and_nothing_is_printed(capsys):
    (first, _) = search(2, valley, 0)
    assert capsys.readouterr() == ("", "")
    assert ((first >= 0) & (first <= 1)).all()
    assert (UPPER > LOWER).all()
