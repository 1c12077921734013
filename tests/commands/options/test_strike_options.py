"""Which simulator, and how finely it steps."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import yaml

from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.strike_options import LimitOptions, SimulatorOptions, StepOptions, TrajectoryOptions
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller, oiac_preset
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.models import preset
from whiptool.models.hand_space import HandSpace
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.reference import ReferenceRollout

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))


@pytest.mark.parametrize("timestep", [None, 1e-6, 0.01])
def test_steps_that_resolve_a_strike_pass(timestep):
    StepOptions(timestep=timestep).check()


@pytest.mark.parametrize("timestep", [0.0, 0.9e-6, 0.011, -1.0, float("nan"), float("inf")])
def test_other_steps_are_refused(timestep):
    with pytest.raises(InputError) as caught:
        StepOptions(timestep=timestep).check()
    assert caught.value.name == "--timestep"
    assert caught.value.allowed == "a finite number >= 1e-06 and <= 0.01"


def test_a_tolerance_stands_alone():
    assert StepOptions(tolerance=1e-5).build_compiled(MODEL, CONTROLLER).tolerance == 1e-5
    assert StepOptions().build_compiled(MODEL, CONTROLLER).tolerance == 1e-4
    assert StepOptions(timestep=0.001).build_compiled(MODEL, CONTROLLER).tolerance is None
    for options in (
        StepOptions(tolerance=1e-5, timestep=1e-3),
        SimulatorOptions(tolerance=1e-5, simulator="reference"),
    ):
        with pytest.raises(InputError, match=r"^--tolerance: got 1e-05; allowed: only without --"):
            options.check()
    with pytest.raises(InputError, match=r"^--tolerance: got 0; allowed: a finite number >= 1e-09"):
        StepOptions(tolerance=0).check()


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicit", "implicitfast"])
def test_an_integrator_is_the_references(integrator):
    SimulatorOptions(simulator="reference", integrator=integrator).check()
    with pytest.raises(InputError, match=rf"^--integrator: got '{integrator}'; allowed: only with --simulator"):
        SimulatorOptions(integrator=integrator).check()


def test_a_simulator_s_step_is_checked_too():
    with pytest.raises(InputError, match=r"^--timestep: got 1"):
        SimulatorOptions(simulator="reference", timestep=1.0).check()


def test_the_simulator_is_the_one_named():
    compiled = SimulatorOptions(timestep=5e-4).build_rollout(MODEL, CONTROLLER)
    assert isinstance(compiled, CompiledRollout)
    assert compiled.timestep == 5e-4
    assert SimulatorOptions().build_rollout(MODEL, CONTROLLER).timestep == 2.5e-4
    reference = SimulatorOptions(simulator="reference", timestep=5e-5, integrator="implicitfast")
    rollout = reference.build_rollout(MODEL, CONTROLLER)
    assert isinstance(rollout, ReferenceRollout)
    assert rollout.timestep == 5e-5
    assert rollout.model == compiled.model == MODEL
    usual = SimulatorOptions(simulator="reference").build_rollout(MODEL, CONTROLLER)
    assert usual.timestep <= 1e-4


def test_both_simulators_make_the_same_strike():
    """As built from options alone: to 0.1 mm all along."""
    strike = Strike((-0.6, 0.2), (0.7, 1.1), 0.5)
    options = (SimulatorOptions(), SimulatorOptions(simulator="reference"))
    ours, its = (x.build_rollout(MODEL, CONTROLLER).trajectory(strike, t_stay=0.1) for x in options)
    t = np.linspace(0, 0.6, 50)
    ours, its = (np.column_stack([np.interp(t, path.t, x) for x in path.tip.T]) for path in (ours, its))
    np.testing.assert_allclose(ours, its, atol=1e-4)
    assert np.ptp(its, axis=0).max() > 0.5  # it does move


def test_a_coarse_step_is_said_to_be_and_a_fine_one_not(capsys):
    StepOptions(timestep=0.01).warn_if_coarse(MODEL, CONTROLLER, (1.2, 0.1), 0.3)
    said = capsys.readouterr()
    assert said.err.startswith("whiptool: --timestep 0.01 is too coarse: ")
    assert said.err.endswith(" of random strikes miss by other distances where steps have small errors\n")
    assert said.out == ""
    for fine in (None, 5e-4):
        StepOptions(timestep=fine).warn_if_coarse(MODEL, CONTROLLER, (1.2, 0.1), 0.3)
    assert capsys.readouterr().err == ""


@dataclass(frozen=True, kw_only=True)
class Options(LimitOptions, SimulatedControllerOptions, ModelOptions):
    """A command that judges strikes."""

    in_space: ClassVar[bool] = True

    def built(self):
        return self.build_limits(self.find_model(), self.build_controller())


@pytest.mark.parametrize(
    ("given", "floor"),
    [
        ({}, 0.0),
        ({"floor": "none"}, None),
        ({"floor": "-0.8"}, -0.8),
        ({"mount": ("ceiling",)}, None),
        ({"mount": ("wall",)}, None),
        ({"mount": ("ceiling",), "floor": "-1.5"}, -1.5),
        ({"mount": ("ceiling", "2.4")}, -2.4),
        ({"mount": ("pedestal", "0.8")}, -0.8),
    ],
)
@pytest.mark.parametrize("model", ["ur5e", "panda"])
def test_a_robot_has_the_floor_on_which_it_stands_or_that_is_told(model, given, floor):
    options = Options(model=model, **given)
    options.check()
    model = options.find_model()
    assert options.built() == [ArmLimits.of(model.arm, prescribed=True), Clearance(model, floor)]


def test_others_have_none_unless_it_is_told():
    for name in ("lemon2024", "nah2023"):
        assert Options(model=name).built() == []
        assert [limits.floor for limits in Options(model=name, floor="-2").built()] == [-2.0]


def test_nothing_is_kept_where_that_is_said():
    assert Options(model="ur5e", limits="none").built() == []
    assert [type(x) for x in Options(model="ur5e", ignore_collisions=True).built()] == [ArmLimits]
    for given in ("high", "", "nan"):
        with pytest.raises(InputError, match=r"--floor: got .*; allowed: a (finite )?number"):
            Options(model="ur5e", floor=given).check()


LEMON = preset("lemon2024")
OF_HAND = HandSpace(LEMON.arm).path(np.array([0.45, -0.1, 0.4, 0.0, 0.5]))
OF_JOINTS = Strike((-1.2, 0.9), (1.2, 0.3), 0.7)


def written(path: Path, strike) -> tuple[list[str], JointTrajectory]:
    options = TrajectoryOptions(export_trajectory=path, rest=0.1, trajectory_rate=50)
    found = options.build_trajectory(LEMON, strike, 0.1)
    assert found is not None
    options.write_trajectory(found, Controller(OIAC()))
    return sorted((file.name for file in path.parent.iterdir()), key=len), found


@pytest.mark.parametrize(
    ("strike", "name", "files"),
    [
        (OF_HAND, "strike.csv", ["strike.csv"]),
        (OF_HAND, "strike.yaml", ["strike.yaml", "strike-hand.yaml"]),
        (OF_HAND, "strike.mcap", ["strike.mcap"]),
        (OF_JOINTS, "strike.csv", ["strike.csv"]),
        (OF_JOINTS, "strike.yml", ["strike.yml"]),
    ],
)
def test_the_poses_of_a_strike_of_the_hand_stand_beside_a_goal(strike, name, files, tmp_path):
    names, found = written(tmp_path / name, strike)
    assert names == files
    assert (found.hand is None) == (strike is OF_JOINTS)


def test_the_files_of_one_strike_say_the_same(tmp_path):
    found = written(tmp_path / "strike.csv", OF_HAND)[1]
    written(tmp_path / "strike.yaml", OF_HAND)
    read = JointTrajectory.load_csv(tmp_path / "strike.csv")
    goal = yaml.safe_load((tmp_path / "strike.yaml").read_text())["trajectory"]["points"]
    hand = yaml.safe_load((tmp_path / "strike-hand.yaml").read_text())["points"]
    assert len(hand) == len(read.t)
    np.testing.assert_array_equal([p["positions"] for p in goal], read.for_splines().q)
    places = [list(p["transforms"][0]["translation"].values()) for p in hand]
    assert read.hand is not None
    np.testing.assert_array_equal(places, read.hand[:, :3])
    np.testing.assert_array_equal(read.q, found.q)


@pytest.mark.parametrize(("place", "why"), [("none/way.csv", "none is not an existing folder"), ("way.csv", "folder")])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_computed(place, why, tmp_path):
    (tmp_path / "way.csv").mkdir()
    with pytest.raises(InputError, match=f"--export-trajectory.*can be written.*{why}"):
        TrajectoryOptions(export_trajectory=tmp_path / place).check()
    TrajectoryOptions(export_trajectory=tmp_path / "new.csv").check()
