"""Control laws: NumPy against CasADi, gains by hand, presets."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from whiptool.commands.options.controller_options import ControllerOptions
from whiptool.commands.options.rig_options import ArmOptions
from whiptool.errors import InputError
from whiptool.impedance import (
    CONSTANT_PRESETS,
    OIAC,
    OIAC_PRESETS,
    ConstantImpedance,
    Controller,
    PositionControl,
    constant_preset,
    oiac_preset,
)
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import controller_from_table, controller_to_table
from whiptool.models import PRESETS, preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout

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


every_preset = pytest.mark.parametrize("name", CONSTANT_PRESETS)


def test_eq_22_is_the_default_and_nah2020s():
    law = ConstantImpedance()
    np.testing.assert_array_equal(law.K, [[29.5, 14.3], [14.3, 39.3]])
    np.testing.assert_array_equal(law.B, [[2.95, 1.43], [1.43, 3.93]])
    assert constant_preset("nah2020") == law


def test_nah_2023s_stiffness_is_as_published():
    """17.4, 33, 27.7 and 23.2 N m/rad of shoulder and elbow, damped by a twentieth of the stiffness."""
    law = constant_preset("nah2023")
    np.testing.assert_array_equal(np.diag(law.K), [17.4, 33.0, 27.7, 23.2])
    np.testing.assert_array_equal(law.K[0], [17.4, 6.85, -7.75, 8.4])
    np.testing.assert_allclose(law.B, 0.05 * np.array(law.K), atol=1e-15)


@every_preset
def test_matrices_of_presets_are_symmetric_and_positive_definite(name):
    """By Cholesky's factors, which no other matrix has."""
    law = constant_preset(name)
    for matrix in (np.array(law.K), np.array(law.B)):
        np.testing.assert_array_equal(matrix, matrix.T)
        factor = np.linalg.cholesky(matrix)
        np.testing.assert_allclose(factor @ factor.T, matrix, rtol=1e-12, atol=1e-12)


@every_preset
def test_a_preset_of_a_models_name_fits_its_arm(name):
    if name in PRESETS:
        assert len(constant_preset(name).K) == preset(name).arm.n
    else:
        assert name == "nah2020"
        assert {len(constant_preset(name).K)} == {model.arm.n for model in PRESETS.values() if model.dimension == 2}


def test_every_model_in_space_has_an_impedance_of_its_own():
    assert {name for name, model in PRESETS.items() if model.dimension == 3} <= set(CONSTANT_PRESETS)


def test_a_preset_of_no_such_name_is_refused_with_all_names():
    with pytest.raises(InputError) as caught:
        constant_preset("ur10")
    assert (caught.value.name, caught.value.given) == ("constant impedance", "ur10")
    assert caught.value.allowed == "nah2020, nah2023, ur5e, panda, fr3"


def test_torques_are_springs_and_dampers_summed_joint_by_joint():
    """Of matrices that are not symmetric, so that rows are not taken for columns."""
    rng = np.random.default_rng(0)
    K, B = rng.normal(size=(2, 3, 3)) + 5 * np.eye(3)
    e, de = rng.normal(size=(2, 3))
    law = ConstantImpedance(K, B)
    torque = [sum(K[i, j] * e[j] + B[i, j] * de[j] for j in range(3)) for i in range(3)]
    gains = law.gains(e, de)
    np.testing.assert_allclose(gains[0] @ e + gains[1] @ de, torque, rtol=1e-13)
    parameters = {name: ca.DM(value) for name, value in law.parameters().items()}
    np.testing.assert_allclose(law.expression(parameters, ca.DM(e), ca.DM(de)).full()[:, 0], torque, rtol=1e-13)


@every_preset
def test_a_preset_holds_and_brakes(name):
    """A spring that pulls back at any error, a damper that takes energy at any speed."""
    law = constant_preset(name)
    x = np.random.default_rng(1).normal(size=(500, len(law.K)))
    K, B = law.gains(x, x)
    for gain in (K, B):
        assert (np.einsum("si,sij,sj->s", x, gain, x) > 0).all()


def test_numbers_go_there_and_back():
    law = constant_preset("nah2023")
    numbers = law.parameters()
    assert {name: len(value) for name, value in numbers.items()} == law.sizes(4) == {"K": 16, "B": 16}
    assert law.changed(numbers) == law
    numbers["K"] = numbers["K"] + np.arange(16)
    changed = law.changed(numbers)
    assert changed.K[1][2] == pytest.approx(law.K[1][2] + 6)  # row by row
    assert changed.B == law.B


@pytest.mark.parametrize(
    ("matrices", "name"),
    [
        ({"K": ((1.0, 2.0),)}, "K"), ({"K": ((1.0,), (1.0, 2.0))}, "K"), ({"K": "stiff"}, "K"),
        ({"K": np.zeros((0, 0)), "B": np.zeros((0, 0))}, "K"),
        ({"B": ((1.0, math.nan), (0.0, 1.0))}, "B"), ({"B": ((math.inf, 0.0), (0.0, 1.0))}, "B"),
    ],
)  # fmt: skip
def test_what_is_no_square_matrix_is_refused(matrices, name):
    rule = "a square matrix of finite numbers, its diagonal, or one number for all joints"
    with pytest.raises(InputError, match=rf"^{name}: got .*; allowed: {rule}$"):
        ConstantImpedance(**matrices)


@pytest.mark.parametrize(
    "matrix",
    [((-1.0, 0.0), (0.0, 1.0)), ((1.0, 2.0), (2.0, 1.0)), ((1.0, 3.0), (0.0, 1.0)), ((0.0, 1.0), (0.0, 5.0))],
)
@pytest.mark.parametrize("name", ["K", "B"])
def test_gains_that_push_away_are_refused(name, matrix):
    """There is an error that the gain makes larger: the least of `x (g11 x + g12 + g21) + g22` over x is below 0."""
    x = np.linspace(-10, 10, 2001)
    (a, b), (c, d) = matrix
    assert (a * x**2 + (b + c) * x + d).min() < 0
    with pytest.raises(InputError, match=rf"^{name}: got .*; allowed: a matrix that acts against any error"):
        ConstantImpedance(**{name: matrix})


@pytest.mark.parametrize("matrix", [((0.0, 0.0), (0.0, 0.0)), ((1.0, 1.0), (1.0, 1.0)), ((1.0, 1.9), (0.0, 1.0))])
def test_gains_may_be_zero_of_one_direction_or_without_symmetry(matrix):
    law = ConstantImpedance(K=matrix, B=matrix)
    assert law.K == law.B == matrix


def test_a_fit_may_pass_through_gains_that_push_away():
    numbers = {"K": np.array([-1.0, 0.0, 0.0, 2.0]), "B": np.zeros(4)}
    assert ConstantImpedance().changed(numbers).K == ((-1.0, 0.0), (0.0, 2.0))
    with pytest.raises(InputError, match=r"^K: got .*finite numbers"):
        ConstantImpedance().changed(numbers | {"K": np.full(4, np.nan)})


def test_stiffness_and_damping_are_of_the_same_joints():
    with pytest.raises(InputError, match=r"^B: got .*; allowed: 3 rows, as many as K$"):
        ConstantImpedance(K=tuple(map(tuple, np.eye(3))))


@pytest.mark.parametrize("name", ["ur5e", "panda", "fr3"])
def test_gains_of_robots_are_of_3_hz_or_more_and_well_damped(name):
    """At the heaviest of many postures, with the rope's mass at the hand."""
    model, law = preset(name), constant_preset(name)
    arm, a = Arm(model), model.arm.n
    postures = np.random.default_rng(4).uniform(-3, 3, (1000, a))
    hand = np.array([arm.gravity_jacobians(q)[-1] for q in postures])  # (P, 3, a)
    inertia = np.array([np.diag(arm.inertia(q)) for q in postures]) + model.whip.mass * (hand**2).sum(axis=1)
    heaviest = inertia.max(axis=0)
    K, B = np.diag(law.K), np.diag(law.B)
    assert (np.sqrt(K / heaviest) / (2 * np.pi) > 2.9).all()
    assert (B / (2 * np.sqrt(K * heaviest)) > 0.9).all()


def test_one_number_is_a_gain_of_every_joint_of_any_arm():
    """As the matrices that it stands for, in both simulators, and its derivative is that of the whole diagonal."""
    model, strike = preset("lemon2024"), Strike((-1.3, 0.5), (1.6, 1.2), 0.4)
    number = Controller(ConstantImpedance(30, 3))
    matrix = Controller(ConstantImpedance(((30, 0), (0, 30)), ((3, 0), (0, 3))))
    one, all_ = (CompiledRollout(model, x, timestep=1e-3, engine="interpreter") for x in (number, matrix))
    target = (1.2, 0.1)
    misses = [x.approach(strike, target).distance[0] for x in (one, all_)]
    assert misses[0] == pytest.approx(misses[1], abs=1e-12)
    slope = one.gradient(strike, target, names=["law.K"])[1][0, 0]
    diagonal = all_.gradient(strike, target, names=["law.K[0]", "law.K[3]"])[1][0].sum()
    assert slope == pytest.approx(diagonal, rel=1e-9)
    for e in (np.zeros(2), np.zeros((5, 4))):
        assert number.law.gains(e, e)[0].shape == (*e.shape, e.shape[-1])
    number.check_fits(preset("ur5e").arm)
    assert controller_from_table(controller_to_table(number)) == number
    changed = number.law.changed({"K": np.array([31.0]), "B": np.array([3.0])})
    assert changed == ConstantImpedance(31, 3)


def test_a_row_of_numbers_is_a_diagonal_and_no_number_may_push():
    assert ConstantImpedance([1, 2], [3, 4]) == ConstantImpedance(((1, 0), (0, 2)), ((3, 0), (0, 4)))
    for K in (-1.0, [1.0, -1.0]):
        with pytest.raises(InputError, match=r"K: got .*; allowed: a matrix that acts against any error"):
            ConstantImpedance(K, 1.0)


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


CONTROLLER = Controller(PositionControl())


def test_a_table_holds_its_name_alone():
    assert controller_to_table(CONTROLLER)["law"] == "position"
    assert controller_from_table({"law": "position"}) == CONTROLLER
    assert CONTROLLER.parameters() == {}
    with pytest.raises(InputError, match=r"^controller\.K: "):
        controller_from_table({"law": "position", "K": [[1.0]]})


@pytest.mark.parametrize(
    ("option", "value"),
    [("feedforward", True), ("torque_limit", 3.0), ("control_period", 0.002), ("compensated", (1.0, 1.0, 1.0))],
)
def test_it_has_no_options(option, value):
    with pytest.raises(InputError, match=rf"^{option}: .*only without position control"):
        Controller(PositionControl(), **{option: value})


def test_it_gives_no_torques_to_a_rig():
    model = preset("lemon2024")
    with pytest.raises(InputError, match=r"^controller: got 'position'; allowed: a law that gives torques"):
        CONTROLLER.bind(Arm(model), Strike((0.0, 0.1), (0.5, 0.6), 0.5))


@pytest.mark.parametrize("port", ["twin", "/dev/ttyUSB0"])
def test_a_rigs_options_refuse_it(port):
    with pytest.raises(InputError, match=r"^--controller: got 'position'; allowed: a law that gives torques"):
        ArmOptions(controller="position", port=port, target=(1.3, 0.0)).build_controller()


def test_it_fits_every_arm_and_has_no_impedance():
    for name in ("lemon2024", "ur5e"):
        model = preset(name)
        CONTROLLER.check_fits(model.arm)
        assert CONTROLLER.reckoning_with(model) == CONTROLLER
    K, B = CONTROLLER.law.gains(np.ones((5, 3)), np.ones((5, 3)))
    assert K.shape == B.shape == (5, 3, 3)
    assert not K.any()
    assert not B.any()


def test_the_option_takes_it_without_a_preset():
    assert ControllerOptions(controller="position").build_controller() == CONTROLLER
    assert ControllerOptions(controller="position").controller_label() == "position control"
    for option, value in (("preset", "nah2020"), ("feedforward", True), ("torque_limit", 2.0)):
        with pytest.raises(InputError, match="only without"):
            ControllerOptions(controller="position", **{option: value}).check()
