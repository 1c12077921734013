"""Batches that engines are given."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.dynamics.swing import SwingStructure
from whiptool.rollout.batch import Batch
from whiptool.rollout.engine import RUNGS, find_engine


@pytest.mark.slow
@pytest.mark.parametrize("moving", [True, False])
def test_every_engine_gives_the_same_paths(moving):
    structure = SwingStructure(3, moving, False, ("stiffness", "dry_friction", "drag", "cubic_stiffness", "drag_ratio"))
    rng, L, steps = np.random.default_rng(4), 11, np.arange(40, 51)
    h = np.full(L, 1e-3)
    lanes = Batch(
        p=rng.uniform(0.1, 1, (L, structure.n_parameters)),
        x0=rng.normal(size=(L, 6)),
        target=np.zeros((L, 2)),
        h=h,
        h_last=h,
        dh=np.zeros(L),
        dh_last=np.zeros(L),
        steps=steps,
        hold=1,
        columns=np.array([4, 5, 8]),
        dp=rng.normal(size=(L, structure.n_parameters)),
        dx0=rng.normal(size=(L, 6)),
        stride=3,
    )
    if moving:
        lanes.u, lanes.u_row = rng.normal(size=(600, 7)), 50 * np.arange(L)
        lanes.du, lanes.du_row = rng.normal(size=(600, 7)), np.where(np.arange(L) % 2, 50 * np.arange(L), -1)
    paths = {name: find_engine(structure, forward=True, rung=name)(lanes).observed() for name in RUNGS}
    for name in ("simd", "scalar"):
        for mine, theirs in zip(paths[name], paths["interpreter"], strict=True):
            for a, b, n in zip(mine, theirs, steps, strict=True):
                assert a.shape == (n // 3 + 1, 3)
                np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)


def test_equal_steps_between_observed_instants_are_as_short_as_the_tolerance_asks_for():
    """0.05 s m^-0.5 times the root of 1e-6 m is 50 us: twenty steps in each millisecond."""
    h, steps = np.full(2, 1e-3), np.array([30, 45])
    batch = Batch(np.zeros((2, 1)), np.zeros((2, 2)), np.zeros((2, 2)), h, h, steps, 1, columns=np.array([0]), stride=5)
    assert batch.in_equal_steps() is batch
    batch.tolerance = np.full(2, 1e-6)
    finer = batch.in_equal_steps()
    np.testing.assert_allclose(finer.h, 5e-5, rtol=1e-12)
    np.testing.assert_allclose(finer.h_last, 5e-5, rtol=1e-6)
    assert (finer.steps.tolist(), finer.stride, finer.hold, finer.tolerance) == ([600, 900], 100, 20, None)
