"""Changes of torques: of what is known, and of steps."""

from __future__ import annotations

import numpy as np

from whiptool.models.torque_rate import torque_rates


def test_even_changes_have_their_rate_at_any_step():
    for step in (2.5e-4, 1e-3, 1.5e-3):
        t = np.arange(0, 0.3, step)
        at, rates = torque_rates(t, np.stack([40 * t, 3 - 700 * t], axis=1))
        np.testing.assert_allclose(rates, np.tile([40, -700], (len(at), 1)), rtol=1e-9)
        np.testing.assert_allclose(np.diff(at), 1e-3)
        assert at[-1] <= t[-1] + 1e-12


def test_a_step_is_one_change_within_a_millisecond():
    t = np.arange(0, 0.02, 2.5e-4)
    _, rates = torque_rates(t, np.where(t < 0.0101, 1.0, 3.0)[:, None])
    assert np.count_nonzero(rates) == 1
    np.testing.assert_allclose(rates.max(), 2000)


def test_a_strike_that_broke_off_at_once_has_none():
    assert torque_rates(np.zeros(1), np.zeros((1, 2)))[1].shape == (0, 2)
