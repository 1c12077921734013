"""Controllers: torques by hand, control of the hand, the default of a model, files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robot_files import WEIGHTLESS
from scipy.linalg import eigvalsh
from spatial_arms import of_universal_nodes

from whiptool import CompiledRollout, ReferenceRollout, default_controller
from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure
from whiptool.errors import InputError
from whiptool.impedance import (
    OIAC,
    ConstantImpedance,
    Controller,
    HandControl,
    PositionControl,
    constant_preset,
    hand_impedance,
)
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import (
    controller_from_table,
    controller_to_table,
    read_controller,
    write_controller,
)
from whiptool.models import Model, in_space, preset
from whiptool.models.files import load_model
from whiptool.models.strike import JointSpace, Strike
from whiptool.rl.environment import make_task

LEMON = preset("lemon2024")


def test_its_controller_reads_back_from_a_file(tmp_path):
    for hand in (HandControl(orientation=True), HandControl(posture=(0.4, 1.2), null_damping=0.5)):
        for law in (OIAC(a=0.01), PositionControl()):
            write_controller(Controller(law, hand=hand), tmp_path / "c.toml")
            assert read_controller(tmp_path / "c.toml") == Controller(law, hand=hand)


def test_a_controller_of_the_joints_has_the_table_that_it_had():
    assert set(controller_to_table(Controller())) == {"law", "a", "beta", "C", "feedforward"}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"magic": 1}, "controller.hand.magic"),
        (3, "controller.hand: got 3"),
        ({"null_damping": -1}, "controller.hand.null_damping"),
        ({"orientation": 1}, "controller.hand.orientation"),
        ({"posture": [0.1, "a"]}, r"controller.hand.posture\[1\]"),
        ({"posture": 3}, "controller.hand.posture"),
    ],
)
def test_bad_tables_are_refused(table, said):
    with pytest.raises(InputError, match=said):
        controller_from_table({"law": "oiac", "hand": table})


def test_feedforward_has_no_meaning_there():
    with pytest.raises(InputError, match="only in joint space"):
        Controller(feedforward=True, hand=HandControl())


def test_the_space_of_strikes_follows_from_the_controller():
    assert isinstance(Controller().strike_space(LEMON.arm), JointSpace)
    space = Controller(hand=HandControl()).strike_space(LEMON.arm)
    assert space.kind == "hand"
    assert Controller(hand=HandControl()).strike_space(LEMON.arm) is space
    assert Controller(OIAC(), hand=HandControl(null_damping=0.7)).parameters()["null_damping"] == 0.7
    assert "null_damping" not in Controller(PositionControl(), hand=HandControl()).parameters()


@pytest.mark.parametrize(("name", "pose"), [("lemon2024", False), ("ur5e", False), ("ur5e", True), ("panda", True)])
def test_usual_gains_give_the_hand_its_frequency_where_it_is_the_heaviest(name, pose):
    """Generalised eigenvalues of the joints' stiffness and inertia, the whip's mass fixed to the hand."""
    model, hand = preset(name), HandControl(orientation=pose)
    law = hand_impedance(model, hand, frequency=2.0)
    kinematics = Controller(hand=hand).strike_space(model.arm).kinematics
    q, K = kinematics.posture, np.array(law.K)
    J, arm = kinematics.jacobian(q), Arm(model)
    moving = J[: model.dimension]
    inertia = arm.inertia(q) + model.whip.mass * moving.T @ moving
    squares = eigvalsh(J.T @ K @ J, inertia)
    lowest = squares[squares > 1e-6 * squares.max()][0]
    assert np.sqrt(lowest) / (2 * np.pi) == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(np.array(law.B), 2 * K / (2 * np.pi * 2.0), rtol=1e-12)  # critical
    if pose:  # in all its motions
        np.testing.assert_allclose(squares[-6:], (2 * np.pi * 2.0) ** 2, rtol=1e-6)
        np.testing.assert_allclose(K, K.T)


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


LEMON_DEFAULT, UR5E = preset("lemon2024"), preset("ur5e")
OF_MODELS = [
    (LEMON_DEFAULT, Controller(OIAC(a=1.3e-4))),  # fitted to Table 4
    (preset("nah2020-n10"), Controller(OIAC(a=1.3e-4))),
    (preset("nah2023"), Controller(constant_preset("nah2023"))),
    (UR5E, Controller(PositionControl())),
    (preset("panda"), Controller(PositionControl())),
    (of_universal_nodes("ur5e"), Controller(PositionControl())),
    (Model(UR5E.whip, in_space(LEMON_DEFAULT.arm), name="a file's"), Controller(PositionControl())),
]


@pytest.mark.slow
@pytest.mark.parametrize(("model", "controller"), OF_MODELS, ids=lambda x: getattr(x, "name", ""))
def test_each_kind_of_arm_has_a_controller(model, controller):
    assert default_controller(model) == controller
    assert CompiledRollout(model, engine="interpreter").controller == controller
    assert ReferenceRollout(model).controller == controller


def test_the_environment_has_it_too():
    assert make_task(model=LEMON_DEFAULT).rollout.controller == default_controller(LEMON_DEFAULT)


def test_ropes_of_robots_bend_alike_all_around():
    for name in ("ur5e", "panda"):
        assert (preset(name).whip.joints, preset(name).whip.N) == ("rod", 20)
    assert preset("nah2023").whip.joints == "universal"  # as published
    universal = of_universal_nodes("ur5e").whip
    assert replace(universal, joints="rod", node_inertia=0.0) == UR5E.whip
    assert universal.per_node("node_inertia")[0] == pytest.approx(universal.per_node("m")[0] * 6.35e-3**2 / 2)


def test_an_arm_is_no_model():
    with pytest.raises(InputError, match="model"):
        default_controller(UR5E.arm)


CONTROLLERS = (
    Controller(),
    Controller(law=ConstantImpedance(), torque_limit=20.0),
    Controller(control_period=1e-3, compensated=(0.25, 0.274, 0.144)),
    Controller(law=ConstantImpedance(((3.0,),), ((0.3,),)), feedforward=True),
)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_controllers_come_back_from_tables_and_files(controller, tmp_path):
    assert controller_from_table(controller_to_table(controller)) == controller
    file = tmp_path / "controller.toml"
    write_controller(controller, file)
    assert read_controller(file) == controller


def test_a_table_is_what_a_person_would_write():
    assert controller_from_table({"law": "oiac", "a": 0.1, "feedforward": True}) == Controller(
        OIAC(a=0.1), feedforward=True
    )
    constant = controller_from_table({"law": "constant", "K": [[1.0, 0.0], [0.0, 2.0]], "torque_limit": 3.0})
    assert constant.torque_limit == 3.0
    assert isinstance(constant.law, ConstantImpedance)
    assert constant.law.K == ((1.0, 0.0), (0.0, 2.0))


def test_a_file_may_hold_other_tables(tmp_path):
    """The config.toml of a run folder is one."""
    file = tmp_path / "config.toml"
    file.write_text('command = "optimize"\n[model]\nname = "x"\n[controller]\nlaw = "oiac"\na = 0.3\n')
    assert read_controller(file) == Controller(OIAC(a=0.3))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", r"\[controller\]"),
        ("controller = 3", r"\[controller\]"),
        ("[controller]", "controller.law"),
        ('[controller]\nlaw = "magic"', "controller.law"),
        ('[controller]\nlaw = "oiac"\nb = 1', "controller.b"),
        ('[controller]\nlaw = "oiac"\na = -1', "controller.a"),
        ('[controller]\nlaw = "oiac"\na = "x"', "controller.a"),
        ('[controller]\nlaw = "oiac"\nfeedforward = "yes"', "controller.feedforward"),
        ('[controller]\nlaw = "oiac"\ntorque_limit = 0', "controller.torque_limit"),
        ('[controller]\nlaw = "oiac"\ncompensated = [1, nan, 1]', "controller.compensated"),
        ('[controller]\nlaw = "constant"\nK = "x"', "controller"),
        ('[controller]\nlaw = "constant"\nK = [[1, 2]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nK = [[1]]', "controller.B"),
        ('[controller]\nlaw = "constant"\nK = [[1, 2], [3]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nK = [["a", 2], [3, 4]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nK = [[1e7, 0], [0, 1]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nB = [[-1, 0], [0, 1]]', "controller.B"),
        ('[controller]\nlaw = "constant"\nK = [[1, 2], [2, 1]]', "controller.K: .*no eigenvalue below 0"),
        ('torque_limit = 4.0\n[controller]\nlaw = "oiac"', "torque_limit"),
        ('a = 0.3\n[controller]\nlaw = "oiac"', "a: got 0.3; allowed: a below the line"),
        ("[controller", "valid TOML"),
    ],
)
def test_what_is_wrong_is_named(text, named, tmp_path):
    file = tmp_path / "controller.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=named) as refused:
        read_controller(file)
    assert str(file) in str(refused.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="readable TOML file"):
        read_controller(tmp_path / "nothing.toml")


def test_the_hand_of_an_arm_of_unknown_inertia_has_no_impedance(tmp_path):
    """Its mass matrix is singular; position control of the hand needs none."""
    (tmp_path / "arm.urdf").write_text(WEIGHTLESS)
    model = load_model(tmp_path / "arm.urdf")
    with pytest.raises(InputError, match=r"arm: got 'unknown inertia of the links of j1, .*position control"):
        hand_impedance(model)
    Controller(PositionControl(), hand=HandControl()).check_fits(model.arm)
