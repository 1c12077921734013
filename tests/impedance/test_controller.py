"""The controller: NumPy against CasADi, its numbers, what it compensates."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.dynamics.closed_loop import Structure, closed_loop
from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.impedance.arm import Arm
from whiptool.models import preset
from whiptool.models.strike import Strike


@pytest.mark.parametrize("feedforward", [False, True])
@pytest.mark.parametrize("limit", [None, 3.0])
@pytest.mark.parametrize("masses", [None, (0.3, 0.2, 0.1)])
@pytest.mark.parametrize("law", [OIAC(a=1e-2), ConstantImpedance()])
def test_the_whole_controller_agrees_between_numpy_and_casadi(law, masses, feedforward, limit):
    """Law, gravity (Eq. 3), feedforward and limit: Pinocchio and NumPy against the expression that is compiled."""
    rng = np.random.default_rng(1)
    for name in ("lemon2024", "nah2020-n10"):
        model = preset(name)
        controller = Controller(law, feedforward=feedforward, torque_limit=limit, compensated=masses)
        structure = Structure.of(model, controller)
        control = closed_loop(structure).control
        for _ in range(20):
            strike = Strike.from_vector([*rng.uniform(-1, 1, 4), rng.uniform(0.4, 1.5)])
            p = structure.pack(model, controller, strike.vector[None])[0]
            x, t = rng.normal(0, 0.5, 2 * model.n), rng.uniform(0, 2)
            q, v = x[:2], x[model.n : model.n + 2]
            expected = controller.bind(Arm(model), strike).torque(t, q, v)
            np.testing.assert_allclose(control(x, t, p).full()[:, 0], expected, rtol=1e-10, atol=1e-10)


def test_compensated_masses_are_checked_and_those_of_a_model_are_the_default():
    model = preset("lemon2024")
    plain = Controller(ConstantImpedance())
    own = plain.reckoning_with(model)
    assert own.compensated == (0.25, 0.274, pytest.approx(12 * 0.012))
    q, strike = np.array([0.3, -0.8]), Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
    torques = [c.bind(Arm(model), strike).torque(0.2, q, 0 * q) for c in (plain, own)]
    np.testing.assert_allclose(*torques, rtol=1e-12)
    with pytest.raises(InputError, match="compensated"):
        Controller(compensated=(0.1, -0.1, 0.1))
    with pytest.raises(InputError, match="3 masses"):
        Controller(compensated=(0.1, 0.1)).check_fits(model.arm)


def test_numbers_of_a_controller_have_names_and_are_checked():
    """A law's single numbers by name, its matrices row by row, the torque limit where there is one."""
    law = OIAC(a=0.1, beta=0.5, C=4.0)
    assert Controller(law).parameters() == {"law.a": 0.1, "law.beta": 0.5, "law.C": 4.0}
    assert Controller(law, torque_limit=9.0).parameters()["torque_limit"] == 9.0
    matrices = Controller(ConstantImpedance(((4.0, 1.0), (2.0, 3.0)), ((8.0, 5.0), (6.0, 7.0)))).parameters()
    expected = {f"law.K[{i}]": x for i, x in enumerate((4.0, 1.0, 2.0, 3.0))}
    expected |= {f"law.B[{i}]": x for i, x in enumerate((8.0, 5.0, 6.0, 7.0))}
    assert matrices == expected
    for wrong in ({"torque_limit": 0.0}, {"torque_limit": -1.0}, {"control_period": 0.0}, {"control_period": np.inf}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            Controller(**wrong)
    with pytest.raises(InputError, match="law: got 'oiac'"):
        Controller("oiac")
    with pytest.raises(InputError, match="feedforward"):
        Controller(feedforward="yes")
