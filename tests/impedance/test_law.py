"""Control laws: NumPy against CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from whiptool.impedance import OIAC, ConstantImpedance

errors = arrays(float, 2, elements=st.floats(-2, 2))
laws = st.one_of(
    st.builds(OIAC, a=st.floats(1e-4, 1), beta=st.floats(0, 1), C=st.floats(0, 10)),
    st.builds(
        lambda K, B: ConstantImpedance().changed({"K": K, "B": B}),
        *[arrays(float, (2, 2), elements=st.floats(-50, 50))] * 2,
    ),
)


@given(laws, errors, errors)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_numpy_and_casadi_agree(law, e, de):
    K, B = law.gains(e, de)
    numpy = K @ e + B @ de  # Eq. 2
    casadi = law.expression({k: ca.DM(v) for k, v in law.parameters().items()}, ca.DM(e), ca.DM(de))
    np.testing.assert_allclose(casadi.full()[:, 0], numpy, rtol=1e-12, atol=1e-12 * (1 + np.abs(numpy).max()))


def test_gains_broadcast_over_time():
    rng = np.random.default_rng(0)
    e, de = rng.normal(size=(2, 7, 2))
    for law in (OIAC(), ConstantImpedance()):
        K, B = law.gains(e, de)
        assert K.shape == B.shape == (7, 2, 2)
        np.testing.assert_allclose(K[3], law.gains(e[3], de[3])[0])
