"""Control laws: NumPy against CasADi, the closed form of Eqs. 8-10, the cost of Eqs. 5-7."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from whiptool.dynamics.closed_loop import Structure, closed_loop
from whiptool.errors import InputError
from whiptool.impedance import OIAC, OIAC_PRESETS, ConstantImpedance, Controller, impedance_cost, oiac_preset
from whiptool.impedance.arm import Arm
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout

errors = arrays(float, 2, elements=st.floats(-2, 2))
laws = st.one_of(
    st.builds(OIAC, a=st.floats(1e-4, 1), beta=st.floats(0, 1), C=st.floats(0, 10)),
    st.builds(lambda K, B: ConstantImpedance(K=K, B=B), *[arrays(float, (2, 2), elements=st.floats(-50, 50))] * 2),
)


@given(laws, errors, errors)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_numpy_and_casadi_agree(law, e, de):
    K, B = law.gains(e, de)
    numpy = K @ e + B @ de  # Eq. 2
    casadi = law.expression({k: ca.DM(v) for k, v in law.parameters().items()}, ca.DM(e), ca.DM(de))
    np.testing.assert_allclose(casadi.full()[:, 0], numpy, rtol=1e-12, atol=1e-12 * (1 + np.abs(numpy).max()))


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


def test_gains_broadcast_over_time():
    rng = np.random.default_rng(0)
    e, de = rng.normal(size=(2, 7, 2))
    for law in (OIAC(), ConstantImpedance()):
        K, B = law.gains(e, de)
        assert K.shape == B.shape == (7, 2, 2)
        np.testing.assert_allclose(K[3], law.gains(e[3], de[3])[0])


def test_presets():
    assert (oiac_preset("printed").a, oiac_preset("printed").beta, oiac_preset("printed").C) == (0.2, 0.6, 5.0)
    assert oiac_preset("table4").a < 1e-3
    with pytest.raises(InputError, match="printed, table4"):
        oiac_preset("table5")
    assert ConstantImpedance().K == ((29.5, 14.3), (14.3, 39.3))  # Eq. 22
    for wrong in ({"a": 0}, {"a": -1}, {"beta": -1}, {"C": -0.5}, {"C": float("nan")}):
        with pytest.raises(InputError):
            OIAC(**wrong)


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
    matrices = Controller(ConstantImpedance(((1.0, 2.0), (3.0, 4.0)), ((5.0, 6.0), (7.0, 8.0)))).parameters()
    expected = {f"law.{name}[{i}]": float(4 * j + i + 1) for j, name in enumerate("KB") for i in range(4)}
    assert matrices == expected
    for wrong in ({"torque_limit": 0.0}, {"torque_limit": -1.0}, {"control_period": 0.0}, {"control_period": np.inf}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            Controller(**wrong)
    with pytest.raises(InputError, match="feedforward"):
        Controller(feedforward="yes")  # type: ignore[arg-type]


def test_cost_of_a_strike_against_its_definition():
    """Eq. 6 by Riemann sum on the trajectory's own steps, Eq. 7 by integrating dV/dt with finite differences."""
    model, law = preset("lemon2024"), ConstantImpedance()
    strike = Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
    path = CompiledRollout(model, Controller(law), timestep=1e-4).trajectory(strike, t_stay=0.0)
    cost = impedance_cost(path, model, D=strike.D, beta=0.6)
    K, B = np.array(law.K), np.array(law.B)
    assert cost.J_c == pytest.approx(0.5 * strike.D * ((K**2).sum() + (B**2).sum()), rel=1e-9)
    arm = Arm(model)
    epsilon = (path.q_d - path.q[:, :2]) + 0.6 * (path.v_d - path.v[:, :2])
    V = np.array([0.5 * x @ arm.inertia(q) @ x for x, q in zip(epsilon, path.q[:, :2], strict=True)])
    assert cost.J_p == pytest.approx(np.trapezoid(np.gradient(V, path.t), path.t), rel=1e-3)
    assert pytest.approx(cost.J_c + cost.J_p) == cost.J
    heavier = impedance_cost(path, model, D=strike.D, beta=0.6, Q_K=2 * np.eye(4), Q_B=2 * np.eye(4))
    assert heavier.J_c == pytest.approx(2 * cost.J_c)
    with pytest.raises(InputError, match="Q_K"):
        impedance_cost(path, model, D=strike.D, beta=0.6, Q_K=np.eye(2))
    with pytest.raises(InputError, match="trajectory"):
        impedance_cost(path, model, D=2.0, beta=0.6)


def test_stored_error_is_counted_from_the_first_instant():
    """Eq. 7 at D less Eq. 7 at 0, of a coarse path that begins off its reference."""
    model, law = preset("lemon2024"), ConstantImpedance()
    strike = Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
    path = CompiledRollout(model, Controller(law), timestep=1e-3).trajectory(strike, t_stay=0.0)
    some = np.linspace(0, len(path.t) - 1, 6).astype(int)
    names = ("t", "q", "v", "q_d", "v_d", "K", "B")
    coarse = SimpleNamespace(**{name: np.array(getattr(path, name))[some] for name in names})
    coarse.q[:, :2] += np.array([0.3, -0.2])
    arm = Arm(model)
    ends = []
    for i in (0, -1):
        epsilon = coarse.q_d[i] - coarse.q[i, :2] + 0.6 * (coarse.v_d[i] - coarse.v[i, :2])
        ends.append(0.5 * epsilon @ arm.inertia(coarse.q[i, :2]) @ epsilon)
    cost = impedance_cost(coarse, model, D=float(coarse.t[-1]), beta=0.6)  # type: ignore[arg-type]
    assert cost.J_p == pytest.approx(ends[1] - ends[0], rel=1e-9)


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
