"""The nearest of a whip's last nodes: on trajectories, by a derivation in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from papers.nah2023 import published
from papers.nah2023.last_nodes import LastNodes
from papers.nah2023.units import simulator
from whiptool.errors import InputError
from whiptool.models.kinematics import joint_points
from whiptool.models.presets import NAH2023
from whiptool.models.strike import default_bounds

STRIKES = default_bounds(NAH2023.arm).sample(np.random.default_rng(0), 3)
TARGET = np.array([0.9, 0.6, -0.4])  # in reach of nodes in the middle of the whip


def _nearest(points: np.ndarray) -> tuple[float, int]:
    """Smallest distance of the segments between successive places (T, nodes, 3), and of which node."""
    best, which = np.inf, -1
    for node in range(points.shape[1]):
        for a, b in zip(points[:-1, node], points[1:, node], strict=True):
            if min(np.linalg.norm(a - TARGET), np.linalg.norm(b - TARGET)) > best + 0.05:
                continue
            along = np.clip((TARGET - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
            distance = float(np.linalg.norm(a + along * (b - a) - TARGET))
            best, which = (distance, node) if distance < best else (best, which)
    return best, which


def test_nearest_of_the_last_nodes_is_that_of_the_whole_trajectory():
    """Until the same instant whatever D is; the places are those of forward kinematics, not the engine's own."""
    rule = LastNodes(simulator(1), 15, 1.6)
    near = rule.approach(STRIKES, TARGET)
    which = set()
    for i, strike in enumerate(STRIKES):
        path = rule.trajectory(strike)
        assert path.t[-1] == pytest.approx(1.6)
        expected, node = _nearest(joint_points(NAH2023, path.q)[:, -15:])
        assert near.distance[i] == pytest.approx(expected, abs=1e-9)
        assert np.linalg.norm(near.tip[i] - TARGET) == pytest.approx(expected, abs=1e-9)
        which.add(node)
    assert which != {14}  # not the tip each time


def test_one_node_is_the_tip():
    rollout = simulator(1)
    stay = 1.6 - STRIKES[:1, -1]
    tip = rollout.approach(STRIKES[:1], TARGET, t_stay=float(stay[0]))
    one = rollout.nearest_node(STRIKES[:1], TARGET, nodes=[24], t_stay=stay)
    assert one.distance == pytest.approx(tip.distance, abs=1e-12)
    assert one.time == pytest.approx(tip.time, abs=1e-9)
    assert one.max_torque == pytest.approx(tip.max_torque)


@pytest.mark.parametrize("nodes", [[], [25], [-1]])
def test_nodes_that_are_not_there_are_refused(nodes):
    with pytest.raises(InputError, match="0 to 24"):
        simulator(1).nearest_node(STRIKES[:1], TARGET, nodes=nodes)


def test_published_strikes_come_as_near_as_published():
    """Within 1 mm of a hit at targets 1 to 5, 2 mm from the published distance at target 6."""
    rule = LastNodes(simulator(None), published.LAST_NODES, published.UNTIL)
    found = [
        float(rule.approach(strike[None], np.array(place)).distance[0])
        for strike, place in zip(published.STRIKES, published.TARGETS, strict=True)
    ]
    assert max(found[:5]) < published.HIT_RADIUS + 1e-3
    assert found[5] == pytest.approx(published.BEST[5], abs=2e-3)
