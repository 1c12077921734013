"""Which simulator, and how finely it steps."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.commands.options.simulator_options import SimulatorOptions, StepOptions
from whiptool.errors import InputError
from whiptool.impedance import Controller, oiac_preset
from whiptool.models import Strike, preset
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
