"""The compiled rollout: its two engines, its parameters, its cache, its trajectories."""

from __future__ import annotations

import dataclasses
import logging
import os
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from processes import HANG
from rich_model import COMPUTED, LEMON, everything

from whiptool.dynamics.closed_loop import Structure, closed_loop
from whiptool.dynamics.posture import _settle, hinge_is_free, start_posture
from whiptool.dynamics.swing import SwingStructure, swing
from whiptool.dynamics.system import along
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models.parameters import Model, WhipParameters
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout
from whiptool.rollout import compiler as compiler_module
from whiptool.rollout.trajectory import Trajectory

TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)

CONTROLLERS = {
    "constant": Controller(ConstantImpedance()),
    "oiac": Controller(OIAC(a=2e-4)),
    "all options": Controller(OIAC(), feedforward=True, torque_limit=5.0),
    "held": Controller(ConstantImpedance(), control_period=0.001, torque_limit=20.0),
}


@pytest.mark.parametrize("controller", CONTROLLERS.values(), ids=CONTROLLERS)
@pytest.mark.parametrize("model", [LEMON, everything()], ids=["lemon2024", "everything"])
def test_interpreter_and_compiled_code_agree(model, controller):
    native, slow = (CompiledRollout(model, controller, engine=name) for name in ("scalar", "interpreter"))
    assert (native.engine, slow.engine) == ("scalar", "interpreter")
    a, b = (r.approach(STRIKES[:4], TARGET, t_stay=0.3) for r in (native, slow))
    for name in COMPUTED:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("controller", CONTROLLERS.values(), ids=CONTROLLERS)
def test_trajectory_and_outcome_tell_the_same(controller):
    rollout = CompiledRollout(LEMON, controller)
    near = rollout.approach(STRIKES[:5], TARGET, t_stay=0.3)
    for i, (vector, path) in enumerate(zip(STRIKES, rollout.trajectories(STRIKES[:5], t_stay=0.3), strict=False)):
        single = rollout.trajectory(Strike.from_vector(vector), t_stay=0.3)
        np.testing.assert_array_equal(path.q, single.q)
        again = path.approach(TARGET)
        assert path.t[-1] == pytest.approx(vector[-1] + 0.3)
        for name in COMPUTED:
            np.testing.assert_allclose(getattr(again, name)[0], getattr(near, name)[i], atol=1e-9)
        np.testing.assert_allclose(np.gradient(path.tip, path.t, axis=0)[1:-1], path.tip_velocity[1:-1], atol=0.5)


def test_every_free_parameter_changes_the_compiled_model():
    """Models and controllers, one number at a time; a change that leaves all strikes as they were is a lost one."""
    model = everything()
    controller = Controller(ConstantImpedance(), torque_limit=2.0, feedforward=True)
    strikes = STRIKES[:3]

    def outcome(model: Model, controller: Controller, strikes: np.ndarray = strikes) -> np.ndarray:
        assert Structure.of(model, controller) == structure  # the same code, other numbers
        near = CompiledRollout(model, controller, timestep=1e-3).approach(strikes, TARGET, t_stay=0.3)
        return np.concatenate([near.tip.ravel(), near.max_torque.ravel()])

    structure = Structure.of(model, controller)
    base = outcome(model, controller)
    parameters = model.parameters()
    no_effect = {"whip.rest_angle[0]"}  # the hinge has no spring ...
    model_with_hinge = model.with_parameters({"whip.k[0]": 0.2})
    base_with_hinge = outcome(model_with_hinge, controller)
    for name, value in parameters.items():
        origin, before = (model_with_hinge, base_with_hinge) if name in no_effect else (model, base)  # ... unless given
        more = 1.0 if "cubic" in name else 1e-3  # joints bend little, those near the tip by some thousandths
        changed = outcome(origin.with_parameters({name: value * 1.05 + more}), controller)
        assert np.abs(changed - before).max() > 1e-9, name
    law = controller.law
    for name in ("K", "B"):
        for i in range(2):
            for j in range(2):
                matrix = np.array(getattr(law, name))
                matrix[i, j] *= 1.05
                other = dataclasses.replace(controller, law=dataclasses.replace(law, **{name: matrix}))
                assert np.abs(outcome(model, other) - base).max() > 1e-9, (name, i, j)
    assert np.abs(outcome(model, dataclasses.replace(controller, torque_limit=2.1)) - base).max() > 1e-9
    for i in range(5):
        shifted = strikes + 0.01 * np.eye(5)[i]
        assert np.abs(outcome(model, controller, shifted) - base).max() > 1e-9, i
    adaptive = Controller(OIAC(a=1e-3))
    structure = Structure.of(model, adaptive)
    base = outcome(model, adaptive)
    for name in ("a", "beta", "C"):
        other = Controller(dataclasses.replace(adaptive.law, **{name: getattr(adaptive.law, name) * 1.05}))
        assert np.abs(outcome(model, other) - base).max() > 1e-9, name


def test_batches_do_not_depend_on_their_size():
    rollout = CompiledRollout(LEMON, CONTROLLERS["oiac"], timestep=1e-3)
    strikes = default_bounds(LEMON.arm).sample(np.random.default_rng(1), 200)  # several chunks, several threads
    together = rollout.approach(strikes, TARGET, t_stay=0.3)
    alone = [rollout.approach(s[None], TARGET, t_stay=0.3).distance[0] for s in strikes[::20]]
    np.testing.assert_array_equal(together.distance[::20], alone)
    targets = np.random.default_rng(2).normal(size=(200, 2))
    each = rollout.approach(strikes, targets, t_stay=0.3)
    one = rollout.approach(strikes[7:8], targets[7], t_stay=0.3)
    assert each.distance[7] == one.distance[0]


def test_divergence_is_reported_and_alone():
    """Gains that push away from the reference; test_engine.py has the lanes beside a diverging one."""
    wild = Controller(ConstantImpedance(K=((-1e7, 0), (0, -1e7)), B=((0, 0), (0, 0))))
    near = CompiledRollout(LEMON, wild).approach(STRIKES[:3], TARGET, t_stay=0.3)
    assert near.diverged.all()
    path = CompiledRollout(LEMON, wild).trajectory(Strike.from_vector(STRIKES[0]), t_stay=0.3)
    assert path.diverged
    assert len(path.t) < 2000
    assert np.isfinite(path.q).all()
    assert not CompiledRollout(LEMON, CONTROLLERS["oiac"]).approach(STRIKES, TARGET, t_stay=0.3).diverged.any()


def test_a_whip_with_rest_angles_starts_at_rest():
    """Held in its start posture by a stiff arm, a curved whip stays where it is."""
    model = everything()
    still = Strike((-0.5, 0.3), (-0.5, 0.3), 0.5)
    stiff = Controller(ConstantImpedance(K=((1e4, 0), (0, 1e4)), B=((1e2, 0), (0, 1e2))))
    path = CompiledRollout(model, stiff).trajectory(still, t_stay=0.0)
    assert np.abs(path.tip - path.tip[0]).max() < 2e-4  # the arm sags a little
    assert abs(path.q[0, 3:]).max() > 0.01


def test_behind_a_free_hinge_the_whips_shape_does_not_know_the_arm():
    """Each posture as found alone, from straight down; and a spring at the hinge, where it does."""
    model = everything()
    free = {name: (0.0, *model.whip.per_node(name)[1:].tolist()) for name in ("k", "cubic_stiffness")}
    whip = dataclasses.replace(model.whip, **free)
    cubic = dataclasses.replace(whip, cubic_stiffness=model.whip.cubic_stiffness)
    q_i = np.random.default_rng(3).uniform(-1.5, 1.5, (5, 2))
    for changed in (dataclasses.replace(model, whip=w) for w in (whip, cubic, model.whip)):
        q = start_posture(changed, q_i)
        for row in q:
            one = row.copy()
            one[2:] = 0.0
            one[2] = -row[:2].sum()
            _settle(changed, one[None])
            np.testing.assert_allclose(row, one, atol=1e-10)
        absolute = q[:, 2] + q[:, :2].sum(axis=1)
        bent_alike = np.ptp(q[:, 3:], axis=0).max() < 1e-10 and np.ptp(absolute) < 1e-10
        assert bent_alike == hinge_is_free(changed) == (changed.whip is whip)


@pytest.mark.parametrize("forward", [False, True])
@pytest.mark.parametrize("driven", ["by its arm", "by its base"])
def test_no_generated_function_takes_a_power_lane_by_lane(driven, forward):
    """A power of a vector of lanes is a call for each: with one in it, a step took three times as long."""
    if driven == "by its arm":
        system = closed_loop(Structure.of(everything(), CONTROLLERS["oiac"]))
    else:
        system = swing(SwingStructure.of(n=3, moving=True, point_masses=False, used=["dry_friction"]))
    functions = [along(f) if forward else f for f in system.functions.values()]
    used = {f.instruction_id(k) for f in functions for k in range(f.n_instructions())}
    assert used & {ca.OP_SQRT}  # dry friction is in it
    assert not used & {ca.OP_POW, ca.OP_CONSTPOW}


def test_a_joint_takes_one_division():
    """CasADi writes a product with a reciprocal as a division, each as slow as five products."""
    functions = closed_loop(Structure.of(LEMON, CONTROLLERS["oiac"])).functions
    for name in ("outward", "inward", "accelerate", "predict", "advance"):
        f = functions[name]
        divisions = [f.instruction_id(k) in (ca.OP_DIV, ca.OP_INV) for k in range(f.n_instructions())]
        assert sum(divisions) == (1 if name == "inward" else 0), name


def test_generated_code_does_not_grow_with_the_whip():
    sizes = []
    for N in (5, 40):
        model = dataclasses.replace(LEMON, whip=WhipParameters(N=N, l=0.9 / N, m=0.2 / N, k=0.1, b=0.1))
        system = closed_loop(Structure.of(model, CONTROLLERS["oiac"]))
        sizes.append([f.n_instructions() for name, f in system.functions.items() if name != "react"])
    assert sizes[0] == sizes[1]


def test_trajectories_are_saved_without_pickle(tmp_path):
    path = CompiledRollout(LEMON, CONTROLLERS["oiac"]).trajectory(Strike.from_vector(STRIKES[0]), t_stay=0.1)
    path.save(tmp_path / "strike.npz")
    again = Trajectory.load(tmp_path / "strike.npz")
    for field in dataclasses.fields(path):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(path, field.name))


def test_without_a_compiler_the_interpreter_runs_and_says_so_once(monkeypatch, caplog):
    from whiptool.rollout import engine

    monkeypatch.setenv("CXX", "no-such-compiler")
    for function in (compiler_module.find_compiler, compiler_module.has_simd):
        function.cache_clear()
    engine.find_engine.cache_clear()
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        rollout = CompiledRollout(LEMON, CONTROLLERS["constant"], timestep=2e-3)
        CompiledRollout(LEMON, CONTROLLERS["constant"], timestep=1e-3)
    monkeypatch.delenv("CXX")
    for function in (compiler_module.find_compiler, compiler_module.has_simd):
        function.cache_clear()
    engine.find_engine.cache_clear()
    assert rollout.engine == "interpreter"
    assert len(caplog.records) == 1


def test_processes_that_start_at_once_share_the_cache(tmp_path):
    """Four first starts on an empty cache: all agree, one library is left, nothing half-written."""
    program = (
        "import numpy as np; from whiptool.models import preset; from whiptool.rollout import CompiledRollout;"
        "from whiptool.impedance import *;"
        "r = CompiledRollout(preset('lemon2024'), Controller(ConstantImpedance()), timestep=1e-3);"
        "assert r.engine != 'interpreter';"
        "print(repr(r.approach(np.array([[-1.2, 0.9, 1.2, 0.3, 0.7]]), np.array([1.3, 0.0]), t_stay=0.3).distance[0]))"
    )  # fmt: skip
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    runs = [
        subprocess.Popen([sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE) for _ in range(4)
    ]
    printed = {run.communicate(timeout=HANG)[0] for run in runs}
    assert all(run.returncode == 0 for run in runs)
    assert len(printed) == 1
    left = [path.name for path in (tmp_path / "whiptool" / "compiled").iterdir()]
    assert len(left) == 1
    assert left[0].endswith(".so")


def test_a_damaged_cache_is_mended(tmp_path, monkeypatch):
    from whiptool.rollout import engine

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    engine.find_engine.cache_clear()
    CompiledRollout(LEMON, CONTROLLERS["held"])
    (library,) = (tmp_path / "whiptool" / "compiled").glob("*.so")
    library.unlink()
    library.write_bytes(b"not a library")
    engine.find_engine.cache_clear()
    assert CompiledRollout(LEMON, CONTROLLERS["held"]).engine != "interpreter"
    engine.find_engine.cache_clear()
