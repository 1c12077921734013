"""How straight a chain is, and which strikes count as the nearest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from papers.nah2023 import published
from papers.nah2023.nearest import REACH, link_angles
from papers.nah2023.report import nearest_strikes
from whiptool.models.kinematics import joint_points
from whiptool.models.presets import NAH2023


def _bent(q: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(t=np.array([0.0, 1.0]), q=np.stack([np.ones(54), q]))


def test_a_straight_chain_has_no_angles_and_all_its_length():
    """The arm's first joint raises it to the horizontal, towards target 4."""
    q = np.zeros(54)
    q[0] = np.pi / 2
    lengths, angles = link_angles(_bent(q), 1.0, np.array(published.TARGETS[3]))
    assert len(lengths) == 2 + 25
    assert lengths.sum() == pytest.approx(REACH)
    assert np.abs(angles).max() < 1e-7


def test_a_miss_is_no_less_than_what_the_angles_say():
    """The tip of a random chain is short of full reach by the sum of l (1 - cos theta) along the target's direction."""
    rng, target = np.random.default_rng(0), np.array(published.TARGETS[5])
    for scale in (0.01, 0.1, 1.0):
        q = scale * rng.normal(size=54)
        lengths, angles = link_angles(_bent(q), 1.0, target)
        tip = joint_points(NAH2023, q[None])[0, -1]
        short = (lengths * (1 - np.cos(angles))).sum() - (REACH - np.linalg.norm(target))
        assert short == pytest.approx(np.linalg.norm(target) - tip @ target / np.linalg.norm(target))
        assert np.linalg.norm(tip - target) >= short - 1e-12


def test_the_nearest_of_all_searches_counts():
    def ended(miss: float) -> dict:
        return {"ends": [miss, 1.0], "strikes": [[miss] * 9, [1.0] * 9], "misses": [miss, 1.0]}

    found = [ended(0.01 * (i + 1)) for i in range(6)]
    tried = [[ended(0.5), ended(0.02)], [ended(0.5)], [ended(0.5)]]
    evolved = [[ended(0.5)], [ended(0.03)], [ended(0.9)]]
    nearest = nearest_strikes(found, tried, evolved)
    assert [x[0] for x in nearest] == [0.01, 0.02, 0.03, 0.02, 0.03, 0.06]
