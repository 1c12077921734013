"""Whips in space come back from three strikes that two cameras saw: the quick form of `benchmarks/cameras.py`."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
from repository import ROOT

_SPEC = importlib.util.spec_from_file_location("cameras_benchmark", ROOT / "benchmarks" / "cameras.py")
assert _SPEC is not None
assert _SPEC.loader is not None
cameras = importlib.util.module_from_spec(_SPEC)
sys.modules["cameras_benchmark"] = cameras
_SPEC.loader.exec_module(cameras)


@pytest.fixture(scope="module")
def bench():
    """A whip on universal joints, and its strikes in MuJoCo."""
    return cameras.Bench.make("universal")


@pytest.mark.slow
def test_k_b_m_come_back_within_their_intervals(bench):
    """Errors of 5 mm at the tip, 60 frames a second, cameras that are not synchronous; one strike is only foreseen."""
    films = [
        film
        for i, (path, vector) in enumerate(zip(bench.paths[:3], cameras.STRIKES[:3], strict=True))
        for film in cameras.seen(path, vector, np.random.default_rng(i))
    ]
    assert len(films) == 6
    found = bench.judge(bench.fit(films))
    for name, number in found["numbers"].items():
        assert number["covered"], (name, number)
        assert number["width"] < 0.15
    assert found["held_out_rmse"] < 4e-3
    assert 0.8 < found["misfit"] < 1.2


@pytest.mark.slow
def test_a_camera_that_was_moved_by_a_hand_is_told(bench):
    """Before any fit, from the tracks of a real strike: its pole was pushed by 10 cm, and it turned by 2 degrees."""
    from dataclasses import replace

    from scipy.spatial.transform import Rotation

    from whiptool.vision.multi_view import disagreements

    left, right = cameras.seen(bench.paths[0], cameras.STRIKES[0], np.random.default_rng(0))
    assert disagreements([left, right]) == []
    turned = Rotation.from_euler("x", 2, degrees=True).as_matrix() @ right.view.rotation
    pushed = replace(right.view, rotation=turned, position=right.view.position + np.array([0.1, 0.0, 0.0]))
    assert disagreements([left, replace(right, view=pushed)])
