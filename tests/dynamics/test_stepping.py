"""How a duration is cut into steps: what the steps add up to, and how long they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whiptool.dynamics.stepping import MOST_STEPS, time_grid
from whiptool.errors import InputError

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
