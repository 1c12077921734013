"""OIAC: the closed form of Eqs. 8-10, its presets, and how it tracks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from whiptool.errors import InputError
from whiptool.impedance import OIAC, OIAC_PRESETS, ConstantImpedance, Controller, oiac_preset
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout

errors = arrays(float, 2, elements=st.floats(-2, 2))


@given(st.floats(1e-4, 1), errors, errors)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_oiac_has_rank_one_and_its_closed_form(a, e, de):
    """Eqs. 2 and 8-10 reduce to tau = eps (|e|^2 + |de|^2)(1 + C |eps|^2) / a."""
    law = OIAC(a=a, beta=0.6, C=5.0)
    K, B = law.gains(e, de)
    epsilon = e + 0.6 * de
    tau = epsilon * (e @ e + de @ de) * (1 + 5 * epsilon @ epsilon) / a
    np.testing.assert_allclose(K @ e + B @ de, tau, rtol=1e-12, atol=1e-300)
    assert np.linalg.matrix_rank(K) <= 1
    assert np.linalg.matrix_rank(B) <= 1


def test_presets():
    assert (oiac_preset("printed").a, oiac_preset("printed").beta, oiac_preset("printed").C) == (0.2, 0.6, 5.0)
    assert oiac_preset("table4").a < 1e-3
    with pytest.raises(InputError, match="printed, table4"):
        oiac_preset("table5")
    assert ConstantImpedance().K == ((29.5, 14.3), (14.3, 39.3))  # Eq. 22
    for wrong in ({"a": 0}, {"a": -1}, {"beta": -1}, {"C": -0.5}, {"C": float("nan")}):
        with pytest.raises(InputError):
            OIAC(**wrong)


def test_table4_tracks_better_than_constant_and_printed_worse():
    """What the presets are for; benchmarks/table4_sweep.py has the whole sweep."""
    model = preset("lemon2024")
    rng = np.random.default_rng(3)
    from whiptool.models.strike import default_bounds

    largest = {}
    laws = {"constant": ConstantImpedance(), **OIAC_PRESETS}
    strikes = default_bounds(model.arm).sample(rng, 10)
    for name, law in laws.items():
        rollout = CompiledRollout(model, Controller(law), timestep=2e-4)
        paths = [rollout.trajectory(Strike.from_vector(s), t_stay=0.3) for s in strikes]
        largest[name] = np.mean([np.abs(p.q_d - p.q[:, :2]).max(axis=0)[0] for p in paths])
    assert largest["table4"] < 0.5 * largest["constant"]
    assert largest["printed"] > largest["constant"]
