"""What `whiptool` itself exports, used as a first notebook would use it."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
from matplotlib.figure import Figure

import whiptool as wt
from whiptool import identification
from whiptool.adaptation import Belief
from whiptool.errors import InputError
from whiptool.impedance.controller import controller_to_table

MODEL, CONTROLLER = wt.preset("lemon2024"), wt.Controller(wt.ConstantImpedance())
STRIKE = wt.Strike((-1.3, 0.5), (1.6, 1.2), 0.5)


@pytest.fixture(scope="module")
def rollout() -> wt.CompiledRollout:
    return wt.CompiledRollout(MODEL, CONTROLLER, timestep=1e-3)


@pytest.mark.parametrize("name", wt.__all__)
def test_every_public_name_is_there(name):
    """Also the second time, when modules of the same name have been imported."""
    first = getattr(wt, name)
    assert getattr(wt, name) is first
    assert not isinstance(first, type(wt))


@pytest.mark.parametrize("package", ["adaptation", "dynamics", "identification", "models", "recording", "rollout"])
def test_names_of_packages_are_there_and_listed(package):
    module = import_module(f"whiptool.{package}")
    for name in module.__all__:
        assert getattr(module, name) is getattr(module, name)
    assert dir(module) == sorted(module.__all__)


def test_a_name_that_a_package_has_not_is_an_attribute_error():
    assert dir(wt) == sorted(wt.__all__)
    for module in (wt, identification):
        with pytest.raises(AttributeError, match=f"module '{module.__name__}' has no attribute 'colour'"):
            module.colour  # noqa: B018


def test_a_function_is_not_replaced_by_the_module_of_its_name():
    """Nor the module by the function, where that is asked for."""
    module = import_module("whiptool.identification.fit")
    assert wt.fit is module.fit
    assert identification.fit is module


def test_there_are_about_fifty_and_they_cost_nothing():
    assert 45 <= len(wt.__all__) <= 55
    program = "import sys, whiptool; print(any(x in sys.modules for x in ('casadi', 'mujoco', 'matplotlib', 'torch')))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout.strip() == "False"


def test_a_hit_is_a_result(rollout):
    """Also where a search would stop at it."""
    place = tuple(rollout.approach(STRIKE, (1.2, 0.1)).tip[0])
    objective = wt.Objective(rollout, place, stop_at_hit=True)
    assert objective.target == wt.Target(place)
    for strike in (STRIKE, STRIKE.vector):
        outcome = objective(strike)
        assert outcome.hit
        assert outcome.miss_distance == pytest.approx(0, abs=1e-3)
    assert len(objective.trials) == 2


def test_strikes_are_drawn_into_a_figure_of_their_own_or_a_given_one(rollout):
    path = rollout.trajectory(STRIKE)
    given = Figure().subplots()
    for target in (wt.Target((1.2, 0.1), 0.05), (1.2, 0.1)):
        assert wt.plot_strike(path, MODEL, target, ax=given) is given
    own = wt.plot_distance(path, wt.Target((1.2, 0.1), 0.05))
    assert own is not given
    assert "0.05 m" in own.get_legend().get_texts()[0].get_text()


def recordings(rollout: wt.CompiledRollout, *, controller: bool) -> list[wt.StrikeRecording]:
    """Two strikes seen 60 times a second with an error of 1 mm."""
    rng, found = np.random.default_rng(0), []
    for strike in (STRIKE, wt.Strike((-1.0, 0.5), (1.4, 0.6), 0.8)):
        t, paths, _ = rollout.tip_path(strike, rate=60)
        points = paths[0][:, None] + 1e-3 * rng.standard_normal((len(t), 1, 2))
        table = controller_to_table(CONTROLLER) if controller else None
        found.append(wt.StrikeRecording(t, points, ("tip",), strike=strike, controller=table))
    return found


def test_a_model_is_fitted_to_recordings_by_short_names(rollout):
    """The controller is the recordings' own."""
    truth = MODEL.parameters()["whip.k"]
    guess = MODEL.with_parameters({"whip.k": 1.3 * truth})
    found = wt.fit(recordings(rollout, controller=True), guess, ["k", "b"])
    assert found["k"] is found["whip.k"]
    low, high = found["k"].interval
    assert low <= truth <= high
    assert "whip.k = " in repr(found)
    with pytest.raises(KeyError, match=r"free were whip\.k, whip\.b"):
        found["m"]
    with pytest.raises(InputError, match="controller"):
        wt.fit(recordings(rollout, controller=False), MODEL, ["k"])


def test_objects_introduce_themselves_in_one_line(rollout):
    near, path, seen = (
        rollout.approach(STRIKE, (1.2, 0.1)),
        rollout.trajectory(STRIKE),
        recordings(rollout, controller=True),
    )
    assert repr(near) == f"Approach({near.distance[0]:.4f} m at {near.time[0]:.3f} s, {near.speed[0]:.1f} m/s)"
    both = rollout.approach([STRIKE, STRIKE], np.array([[1.2, 0.1], path.tip[-1]]))
    assert repr(both) == f"Approach(2 strikes, the nearest {both.distance.min():.4f} m)"
    fastest = np.linalg.norm(path.tip_velocity, axis=1).max()
    assert repr(path) == f"Trajectory({len(path.t)} instants, ended at 0.800 s, tip at most {fastest:.1f} m/s)"
    assert repr(seen[0]) == f"StrikeRecording(tip: 49 frames from 0.000 to 0.800 s, {STRIKE})"
    result = wt.search(wt.Objective(rollout, (1.2, 0.1), max_trials=3), "random", seed=0)
    best = f"best miss {result.outcome.miss_distance:.4f} m: {result.outcome.status}"
    assert repr(result) == f"Result(random: max_trials, 3 trials, {best})"
    prior = wt.default_prior(MODEL, CONTROLLER)
    assert isinstance(prior, Belief)
    assert all(len(repr(x)) < 200 for x in (near, both, path, seen[0], result))
