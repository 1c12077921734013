"""Verdicts follow the data."""

from __future__ import annotations

import numpy as np
import pytest

from papers.nah2023 import claims, published
from whiptool.viz import report


def _searched(counts: tuple[int, ...], hits: tuple[bool, ...] = (True,) * 5 + (False,)) -> list[dict]:
    return [{"evaluations": n, "hit": h, "best": 0.1} for n, h in zip(counts, hits, strict=True)]


def test_published_evaluations_reproduce_themselves():
    found = claims.evaluations(_searched(published.EVALUATIONS))
    assert [claim.verdict for claim in found] == [report.REPRODUCED] * 2


def test_evaluations_half_as_many_again_are_not_reproduced_and_too_many_not_few():
    found = claims.evaluations(_searched((60, 120, 60, 260, 400, 600)))
    assert found[0].verdict == f"{report.ONLY_WITH} target 1 or target 2 or target 3"
    assert found[1].verdict == f"{report.ONLY_WITH} target 6"


@pytest.mark.parametrize(("outside", "verdict"), [(0.002, report.REPRODUCED), (0.05, report.NOT_REPRODUCED)])
def test_planarity_is_decided_by_the_variance_outside(outside, verdict):
    assert claims.planar([{"outside": np.full(24, outside)}] * 6).verdict == verdict


def test_a_target_without_a_clear_majority_does_not_show_a_claim():
    clear, unclear = np.array([0.9] * 20 + [0.3] * 4), np.array([0.9] * 13 + [0.3] * 11)
    values = [{"task": clear, "joint": unclear}] * 5 + [{"task": unclear, "joint": unclear}]
    task, joint = claims.compliant(values)
    assert task.verdict == f"{report.ONLY_WITH} " + " or ".join(f"target {i}" for i in range(1, 6))
    assert joint.verdict == report.NOT_REPRODUCED
    assert "20 of 24 (64 to 93 %)" in task.ours


def test_sensitivity_is_judged_in_three_ways():
    """The last parameter moves the path most as it is, but not where each is taken per width of its bounds."""
    raw = [np.tile([1.0, 2.0, 3.0], (24, 1))] * 6
    scaled = [np.tile([3.0, 2.0, 1.0], (24, 1))] * 6
    noise = [{name: np.full(24, x) for name, x in (("initial", 0.1), ("final", 0.3), ("D", 0.2))}] * 6
    claim = claims.sensitive(scaled, raw, noise)
    assert claim.verdict == f"{report.ONLY_WITH} parameter by parameter, per rad and per s"
