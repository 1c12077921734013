"""How a duration is cut into steps: what the steps add up to, and how long they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whiptool.dynamics.swing import SwingStructure
from whiptool.errors import InputError
from whiptool.rollout.batch import MOST_STEPS, Batch, time_grid
from whiptool.rollout.engine import RUNGS, find_engine

durations = st.lists(st.floats(1e-3, 5.0), min_size=1, max_size=6).map(np.array)
timesteps = st.floats(1e-4, 1e-2)


@given(durations, timesteps)
def test_a_continuous_controller_takes_the_fewest_equal_steps(duration, timestep):
    h, h_last, steps, hold = time_grid(duration, timestep=timestep, control_period=None)
    np.testing.assert_array_equal(h, h_last)
    np.testing.assert_allclose(h * steps, duration, rtol=1e-12)
    assert (h <= timestep * (1 + 1e-6)).all()
    fewer = steps[steps > 1] - 1
    assert (duration[steps > 1] / fewer > timestep * (1 - 1e-6)).all()
    assert hold == 1


@given(durations, timesteps, st.floats(1e-3, 5e-2))
def test_a_held_torque_has_whole_steps_and_only_the_last_is_shorter(duration, timestep, period):
    h, h_last, steps, hold = time_grid(duration, timestep=timestep, control_period=period)
    np.testing.assert_allclose(h * hold, period, rtol=1e-12)
    assert (h <= timestep * (1 + 1e-6)).all()
    assert hold == 1 or period / (hold - 1) > timestep * (1 - 1e-6)
    np.testing.assert_allclose((steps - 1) * h + h_last, duration, rtol=1e-12)
    assert (h_last > 0).all()
    assert (h_last <= h * (1 + 1e-6)).all()


def test_steps_by_hand():
    """0.6 s and 0.25 s at 0.1 s, and under a torque held for 0.04 s, which makes steps of 0.04 s."""
    h, h_last, steps, hold = time_grid(np.array([0.6, 0.25]), timestep=0.1, control_period=None)
    assert steps.tolist() == [6, 3]
    assert h == pytest.approx([0.1, 0.25 / 3])
    h, h_last, steps, hold = time_grid(np.array([0.6, 0.25]), timestep=0.1, control_period=0.04)
    assert (steps.tolist(), hold) == ([15, 7], 1)
    assert h_last == pytest.approx([0.04, 0.01])
    assert time_grid(np.array([0.6]), timestep=0.015, control_period=0.04)[3] == 3


def test_too_many_steps_are_refused():
    """The longest strike decides, and the message names its duration."""
    longest = MOST_STEPS * 1e-6
    assert time_grid(np.array([0.1, longest]), timestep=1e-6, control_period=None)[2][1] == MOST_STEPS
    with pytest.raises(InputError, match=r"timestep: got 1e-06.*this strike lasts 2\.1 s"):
        time_grid(np.array([0.1, 1.05 * longest]), timestep=1e-6, control_period=None)
    assert len(time_grid(np.array([]), timestep=1e-6, control_period=None)[2]) == 0


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
