"""Compiled against reference: two simulators that share parameters and no formulas."""

from __future__ import annotations

import copy
import dataclasses
import pickle

import mujoco
import numpy as np
import pytest
from rich_model import everything
from robot_files import WEIGHTLESS
from shared_by_threads import check_shared

from whiptool.errors import InputError
from whiptool.impedance import OIAC, OIAC_PRESETS, ConstantImpedance, Controller, PositionControl
from whiptool.models import ArmLink, ArmParameters, Model, preset
from whiptool.models.files import load_model
from whiptool.models.presets import rope
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.mujoco_model import export_xml
from whiptool.rollout.reference import replay

TARGET = np.array([1.3, 0.0])
LEMON = preset("lemon2024")
DRAWN = default_bounds(LEMON.arm).sample(np.random.default_rng(11), 6)
STRIKES, T_STAY = DRAWN[np.argsort(DRAWN[:, -1])], 0.1  # the shortest first: MuJoCo takes its time
UNKNOWN = np.array([0, 0.9, -1.9, -0.6, -1.7, 1.4, -1.0, 0.3, 0.2, -0.1, 0.6, 1.6, 0.8])  # a strike of `unknown_arm`
LAWS = {"constant": ConstantImpedance(), **OIAC_PRESETS}


def misses(rollout, strikes=STRIKES, t_stay=T_STAY) -> np.ndarray:
    paths = [rollout.trajectory(Strike.from_vector(s), t_stay=t_stay) for s in strikes]
    assert not any(path.diverged for path in paths)
    return np.array([path.approach(TARGET).distance[0] for path in paths])


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_compiled_against_mujoco(law):
    """Two strikes at the default step; benchmarks/accuracy.py has 200 of them, and the reference's convergence."""
    controller = Controller(law)
    strikes = STRIKES[:2]
    reference = misses(ReferenceRollout(LEMON, controller, timestep=5e-5), strikes)
    default = CompiledRollout(LEMON, controller).approach(strikes, TARGET, t_stay=T_STAY).distance
    fine = CompiledRollout(LEMON, controller, timestep=2e-5).approach(strikes, TARGET, t_stay=T_STAY).distance
    assert np.abs(default - reference).max() < 3e-4
    assert np.abs(fine - reference).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    "controller",
    [
        Controller(ConstantImpedance(), feedforward=True, torque_limit=4.0),
        Controller(ConstantImpedance(), control_period=0.002),
        Controller(ConstantImpedance(), compensated=(0.3, 0.2, 0.1)),
    ],
    ids=["feedforward and limit", "held", "compensated"],
)
def test_options_and_every_term_against_mujoco(controller):
    """Drag, dry friction, rest angles, hinge mass: in MuJoCo applied at joints and bodies."""
    model = everything()
    reference = misses(ReferenceRollout(model, controller, timestep=4e-5), STRIKES[:1])
    fine = CompiledRollout(model, controller, timestep=1e-5).approach(STRIKES[:1], TARGET, t_stay=T_STAY).distance
    assert np.abs(fine - reference).max() < 2e-6


@pytest.mark.parametrize("name", ["nah2020-n10", "nah2020-fitted"])
def test_other_presets_against_mujoco(name):
    model, controller = preset(name), Controller(ConstantImpedance())
    reference = misses(ReferenceRollout(model, controller), DRAWN[:1], t_stay=0.3)
    compiled = CompiledRollout(model, controller, timestep=2e-5).approach(DRAWN[:1], TARGET, t_stay=0.3).distance
    assert np.abs(compiled - reference).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    "joints",
    [
        pytest.param(1, marks=pytest.mark.slow),
        pytest.param(2, marks=pytest.mark.slow),
        pytest.param(3, marks=pytest.mark.slow),
    ],
)
def test_arms_of_any_number_of_joints_against_mujoco(joints):
    """With every term of the whip; the law is OIAC, which is of no number of joints."""
    arm = ArmParameters(tuple(ArmLink(mass=0.3 - 0.05 * i, length=0.3, friction=0.02) for i in range(joints)))
    model = dataclasses.replace(everything(), arm=arm)
    strike = Strike.from_vector([*([-0.8] + [0.4] * (joints - 1)), *([1.0] + [0.2] * (joints - 1)), 0.7])
    controller = Controller(OIAC(a=0.01), feedforward=True)
    point = np.array([0.9, 0.1])
    path = ReferenceRollout(model, controller, timestep=5e-5).trajectory(strike, t_stay=0.1)
    near = CompiledRollout(model, controller, timestep=2e-5).approach(strike.vector[None], point, t_stay=0.1)
    assert not path.diverged
    assert path.approach(point).distance[0] == pytest.approx(near.distance[0], abs=2e-6)


@pytest.mark.slow
def test_a_replay_is_repeated_until_it_agrees_or_cannot():
    strike, controller = Strike((-1.0, 0.4), (1.0, 0.6), 0.3), Controller(ConstantImpedance())
    expected = CompiledRollout(LEMON, controller).approach(strike.vector[None], TARGET, t_stay=0.1).distance[0]
    seen = replay(LEMON, controller, strike, TARGET, t_stay=0.1, expected=expected)
    assert seen.confirmed
    assert seen.miss_distance == pytest.approx(expected, abs=1e-4)
    wrong = replay(LEMON, controller, strike, TARGET, t_stay=0.0, expected=expected + 0.1)
    assert not wrong.confirmed
    assert wrong.timestep == pytest.approx(seen.timestep / 8)


def test_the_other_integrators_converge_to_the_same():
    controller = Controller(ConstantImpedance())
    truth = CompiledRollout(LEMON, controller, timestep=5e-5).approach(STRIKES[:1], TARGET, t_stay=T_STAY).distance
    for integrator in ("Euler", "implicit", "implicitfast"):
        coarse, fine = (
            abs(misses(ReferenceRollout(LEMON, controller, timestep=h, integrator=integrator), STRIKES[:1]) - truth)[0]
            for h in (8e-4, 2e-4)
        )
        assert fine < coarse / 2.5, integrator  # first order: four times less
    with pytest.raises(InputError, match="RK4, Euler"):
        ReferenceRollout(LEMON, controller, integrator="RK5")


def test_divergence_of_the_reference_is_reported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = ReferenceRollout(LEMON, Controller(), timestep=1e-3).trajectory(Strike.from_vector(STRIKES[0]), t_stay=0.3)
    assert path.diverged
    assert not list(tmp_path.iterdir())  # MuJoCo leaves no log file behind


def test_export_loads_in_mujoco_and_moves_alike():
    xml, missing = export_xml(everything(), target=TARGET)
    assert "drag" in " ".join(missing)
    assert "friction" in " ".join(missing)
    assert "Not in this file" in xml
    model = mujoco.MjModel.from_xml_string(xml)
    assert (model.nv, model.nu) == (14, 2)
    plain, nothing = export_xml(LEMON)
    assert len(nothing) == 1  # the controller only
    model = mujoco.MjModel.from_xml_string(plain)
    ours = ReferenceRollout(LEMON, Controller())._mj
    for array in ("body_mass", "body_inertia", "body_ipos", "jnt_stiffness", "dof_damping"):
        np.testing.assert_allclose(getattr(model, array), getattr(ours, array), rtol=1e-5, atol=1e-14)


@pytest.mark.parametrize("law", [ConstantImpedance(), PositionControl()], ids=["constant", "position"])
def test_threads_that_share_a_reference_get_what_each_gets_alone(law):
    """MuJoCo's state and the controller's arm are one for all of them."""
    rollout = ReferenceRollout(LEMON, Controller(law))
    strikes = DRAWN[:3].copy()
    strikes[:, -1] = 0.05

    def judged(strike):
        path = rollout.trajectory(strike, t_stay=0.0)
        return path.t, path.q, path.v, path.tau, path.tip

    check_shared(judged, strikes)


def unknown_arm(tmp_path, joints: str, **changes) -> Model:
    """A robot whose file tells no inertia, with a rope of five links."""
    (tmp_path / "arm.urdf").write_text(WEIGHTLESS)
    whip = dataclasses.replace(rope(5, joints=joints), **changes)
    return dataclasses.replace(load_model(tmp_path / "arm.urdf"), whip=whip)


@pytest.mark.parametrize("changes", [{}, {"hinge_mass": 0.0}])
@pytest.mark.parametrize("joints", ["rod", "universal"])
def test_an_arm_of_unknown_inertia_has_a_reference(joints, changes, tmp_path):
    """Also where nothing has mass before the whip: MuJoCo has no bodies without, and none with seven joints."""
    rollout = ReferenceRollout(unknown_arm(tmp_path, joints, **changes))
    path = rollout.trajectory(UNKNOWN, t_stay=0.0)
    assert not path.diverged
    np.testing.assert_allclose(path.q[-1, :6], UNKNOWN[6:12], atol=1e-12)  # as commanded


@pytest.mark.slow
@pytest.mark.parametrize("joints", ["rod", "universal"])
def test_an_arm_of_unknown_inertia_is_simulated_as_by_the_compiled_engine(joints, tmp_path):
    model, target = unknown_arm(tmp_path, joints, hinge_mass=0.0), np.array([1.2, 0.2, 0.8])
    ours = CompiledRollout(model).approach(UNKNOWN[None], target, t_stay=0.1).distance[0]
    path = ReferenceRollout(model).trajectory(UNKNOWN, t_stay=0.1)
    assert path.approach(target).distance[0] == pytest.approx(ours, abs=1e-4)


@pytest.mark.parametrize("integrator", [None, "implicitfast"])
def test_a_reference_can_be_sent_to_another_process(integrator):
    """It is made again there from its arguments."""
    rollout = ReferenceRollout(LEMON, Controller(ConstantImpedance()), timestep=2e-4, integrator=integrator)
    strike = DRAWN[0].copy()
    strike[-1] = 0.05
    path = rollout.trajectory(strike, t_stay=0.0)
    for other in (pickle.loads(pickle.dumps(rollout)), copy.deepcopy(rollout)):
        again = other.trajectory(strike, t_stay=0.0)
        for name in ("t", "q", "v", "tau", "tip"):
            np.testing.assert_array_equal(getattr(again, name), getattr(path, name))


def test_callbacks_of_a_user_of_mujoco_are_put_back():
    def mine(*_: object) -> None:
        pass

    rollout = ReferenceRollout(LEMON, Controller(ConstantImpedance()), timestep=1e-4)
    mujoco.set_mjcb_control(mine)
    try:
        rollout.trajectory([-1, 0.5, -1, 0.5, 0.01], t_stay=0.0)
        assert mujoco.get_mjcb_control() is mine
    finally:
        mujoco.set_mjcb_control(None)
