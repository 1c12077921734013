"""Arguments of a wrong kind, at every public call: each is refused under the name that it has there.

`CALLS` holds a right call of every public callable. One argument at a time is replaced by whatever its kind, which its
name tells (`KINDS`), is not.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import whiptool
from whiptool.comparison.plan import Comparison
from whiptool.errors import InputError
from whiptool.models.strike import HandStrike
from whiptool.rl.settings import TrainingPlan

MODEL, LAW = whiptool.preset("lemon2024"), whiptool.ConstantImpedance()
CONTROLLER = whiptool.Controller(LAW)
STRIKE, TARGET = whiptool.Strike((-1.0, 0.4), (1.0, 0.6), 0.3), whiptool.Target((1.2, 0.1))
BOUNDS, PROFILE = whiptool.default_bounds(MODEL.arm), whiptool.WhipProfile(1.0, 0.1, 0.1, 0.1)
FAST = {"timestep": 2e-3, "engine": "interpreter"}
COMPILED = whiptool.CompiledRollout(MODEL, CONTROLLER, **FAST)
REFERENCE = whiptool.ReferenceRollout(MODEL, CONTROLLER)
OBJECTIVE = whiptool.Objective(COMPILED, TARGET)
Z2, Zn, Zm = np.zeros((3, 2)), np.zeros((3, MODEL.n)), np.zeros((3, 2, 2))
TRAJECTORY = whiptool.Trajectory(np.arange(3.0), Zn, Zn, Z2, Z2, Z2, Zm, Zm, Z2, Z2)
RECORDING = whiptool.StrikeRecording(t=np.arange(3) / 60, points=np.ones((3, 1, 2)), markers=("tip",), strike=STRIKE)
PRIOR = whiptool.default_prior(MODEL, CONTROLLER)
TWIN = whiptool.draw_twin("kin", 0, MODEL, CONTROLLER)
RNG = np.random.default_rng(0)

VALUES: dict[str, Any] = {
    "nothing": None, "text": "text", "a number as text": "1.5", "a complex number": 1j, "a truth value": True,
    "any object": object(), "ragged rows": [[1.0], [1.0, 2.0]], "texts": ["1", "2"], "not a number": np.nan,
    "a class": whiptool.Model, "a model": MODEL, "a whip": MODEL.whip, "an arm": MODEL.arm, "a law": LAW,
    "a controller": CONTROLLER, "a strike": STRIKE, "a target": TARGET, "bounds": BOUNDS, "a rollout": COMPILED,
    "an objective": OBJECTIVE, "a trajectory": TRAJECTORY, "a profile": PROFILE, "a recording": RECORDING,
    "a twin": TWIN,
}  # fmt: skip
AS_ARRAYS = {"a strike", "a target", "bounds"}  # judged by their shape
WORDS = {"text", "a number as text"}
BY_NAMES = {
    "name path run_folder method family quantity joints engine": WORDS,
    "free names markers methods": {"texts"},
    "strike strikes vector target position direction centre place": AS_ARRAYS,
    "q q_i q_f x_i x_f lower upper K B compensated points": AS_ARRAYS,
}
KINDS = {  # which of the values an argument of a name may be
    "model": {"a model"}, "whip": {"a whip"}, "arm": {"an arm"}, "law": {"a law"}, "controller": {"a controller"},
    "rollout": {"a rollout"}, "objective": {"an objective"}, "trajectory": {"a trajectory"}, "profile": {"a profile"},
    "plant": {"a model"}, "bounds": {"bounds"}, "stop_at_hit": {"a truth value"}, "feedforward": {"a truth value"},
    "recordings": {"a recording"}, "twin": {"a twin"},
    **{name: kinds for names, kinds in BY_NAMES.items() for name in names.split()},
}  # fmt: skip

ALSO = {"position": "target"}  # names that messages have for arguments

ARM_LINK = {"mass": 0.3, "length": 0.2, "com": 0.1, "inertia": 0.1, "friction": 0.1}
LUMPED = {"N": 3, "l": 0.1, "m": 0.1, "k": 0.1, "b": 0.1, "joints": "hinge"}
CALLS: list[tuple[Callable, dict[str, Any]]] = [
    (whiptool.ArmLink, ARM_LINK),
    (whiptool.ArmParameters, {"links": MODEL.arm.links}),
    (MODEL.arm.per_link, {"name": "mass"}),
    (MODEL.arm.with_parameters, {"changes": {"mass[0]": 0.1}}),
    (whiptool.Model, {"whip": MODEL.whip, "arm": MODEL.arm, "gravity": 9.81, "name": "it"}),
    (MODEL.farthest_miss, {"place": (1.0, 0.0)}),
    (MODEL.with_parameters, {"changes": {"gravity": 9.8}}),
    (whiptool.MotorLimits, {"name": "it", "stall_torque": 1.0, "no_load_speed": 1.0, "stall_current": 1.0}),
    (whiptool.Strike, {"q_i": (0.1, 0.2), "q_f": (0.1, 0.2), "D": 0.3}),
    (HandStrike, {"x_i": (0.1, 0.2), "x_f": (0.1, 0.2), "D": 0.3}),
    (whiptool.Strike.from_vector, {"vector": (0.1, 0.2, 0.3)}),
    (whiptool.StrikeBounds, {"lower": (0.1, 0.2, 0.3), "upper": (1.1, 1.2, 1.3)}),
    (BOUNDS.sample, {"rng": RNG, "size": 3}),
    (whiptool.WhipParameters, LUMPED),
    (MODEL.whip.per_node, {"name": "k"}),
    (whiptool.WhipProfile, {"length": 1.0, "linear_density": 1.0, "bending_stiffness": 1.0, "bending_damping": 1.0}),
    (PROFILE.lump, {"N": 3, "joints": "hinge", "node_inertia": 0.0}),
    (PROFILE.changed, {"changes": {"length": 1.1}}),
    (PROFILE.at, {"quantity": "linear_density", "place": np.array(0.5)}),
    (whiptool.default_bounds, {"arm": MODEL.arm}),
    (whiptool.load_model, {"name": "lemon2024"}),
    (whiptool.limits_preset, {"name": "xm430"}),
    (whiptool.preset, {"name": "lemon2024"}),
    (whiptool.read_model, {"path": "none.toml"}),
    (whiptool.write_model, {"model": MODEL, "path": "none/x.toml"}),
    (whiptool.ConstantImpedance, {"K": ((1.0,),), "B": ((1.0,),)}),
    (whiptool.OIAC, {"a": 0.1, "beta": 0.1, "C": 0.1}),
    (whiptool.oiac_preset, {"name": "table4"}),
    (whiptool.Controller, {"law": LAW, "feedforward": False, "torque_limit": 1.0, "control_period": 0.1,
                           "compensated": (0.1, 0.1, 0.1), "hand": None}),
    (CONTROLLER.strike_space, {"arm": MODEL.arm}),
    (CONTROLLER.check_fits, {"arm": MODEL.arm}),
    (CONTROLLER.reckoning_with, {"model": MODEL}),
    (whiptool.impedance_cost, {"trajectory": TRAJECTORY, "model": MODEL, "D": 0.3, "beta": 0.3}),
    (whiptool.CompiledRollout, {"model": MODEL, "controller": CONTROLLER, "free": (), "threads": 1, **FAST}),
    (COMPILED.approach, {"strikes": STRIKE, "target": TARGET, "t_stay": 0.0, "models": None, "controllers": None}),
    (COMPILED.nearest_node, {"strikes": STRIKE, "target": TARGET, "nodes": [1], "t_stay": 0.0}),
    (COMPILED.gradient, {"strikes": STRIKE, "target": TARGET, "t_stay": 0.0, "names": ["D"]}),
    (COMPILED.tip_path, {"strikes": STRIKE, "t_stay": 0.0, "rate": 100.0, "names": ()}),
    (COMPILED.trajectory, {"strike": STRIKE, "t_stay": 0.0}),
    (COMPILED.directions, {"names": ("D",)}),
    (whiptool.ReferenceRollout, {"model": MODEL, "controller": CONTROLLER, "timestep": 1e-4, "integrator": "RK4"}),
    (REFERENCE.trajectory, {"strike": STRIKE, "t_stay": 0.0}),
    (REFERENCE.hang, {"q": np.zeros(2)}),
    (TRAJECTORY.approach, {"target": TARGET}),
    (TRAJECTORY.distance, {"target": TARGET}),
    (TRAJECTORY.miss, {"target": TARGET}),
    (TRAJECTORY.since, {"begin": 0.0}),
    (whiptool.Objective, {"rollout": COMPILED, "target": TARGET, "t_stay": 0.1, "bounds": BOUNDS, "max_trials": 1,
                          "max_time": 1.0, "stop_at_hit": False, "limits": None, "criteria": ()}),
    (OBJECTIVE.__call__, {"strike": STRIKE}),
    (OBJECTIVE.batch, {"strikes": STRIKE.vector}),
    (OBJECTIVE.gradient, {"strike": STRIKE.vector}),
    (OBJECTIVE.admissible, {"strikes": STRIKE.vector[None]}),
    (OBJECTIVE.judge, {"trajectory": TRAJECTORY}),
    (whiptool.Target, {"position": (1.0, 0.0), "hit_radius": 0.1, "direction": (1.0, 0.0), "cone": 0.1, "speed": 1.0}),
    (whiptool.Target.arriving, {"position": (1.0, 0.0), "angle": 0.1, "hit_radius": 0.1}),
    (TARGET.check_reach, {"model": MODEL}),
    (whiptool.Disc, {"centre": (1.0, 0.0), "radius": 0.1}),
    (whiptool.search, {"objective": OBJECTIVE, "method": "random", "seed": 0}),
    (whiptool.plot_distance, {"trajectory": TRAJECTORY, "target": TARGET, "ax": None}),
    (whiptool.plot_tracking, {"trajectory": TRAJECTORY, "model": MODEL}),
    (whiptool.plot_torque, {"trajectory": TRAJECTORY, "model": MODEL, "ax": None}),
    (whiptool.plot_tip_speed, {"trajectory": TRAJECTORY, "ax": None}),
    (whiptool.compare, {"rollout": COMPILED, "methods": ["random"], "targets": 1, "max_trials": 1, "seeds": 1}),
    (whiptool.train, {"rollout": COMPILED, "method": "sac", "episodes": 1, "plan": TrainingPlan(1, 2), "seed": 0}),
    (whiptool.plot_strike, {"trajectory": TRAJECTORY, "model": MODEL, "target": TARGET, "ax": None}),
    (whiptool.StrikeRecording, {"t": np.arange(3) / 60, "points": np.ones((3, 1, 2)), "markers": ("tip",)}),
    (whiptool.read_recording, {"path": "none.csv"}),
    (whiptool.Plant, {"model": MODEL, "controller": CONTROLLER, "profile": None}),
    (whiptool.fit, {"recordings": [RECORDING], "plant": MODEL, "free": ("whip.k",)}),
    (whiptool.default_prior, {"model": MODEL, "controller": CONTROLLER, "whip": "profile"}),
    (whiptool.draw_twin, {"family": "kin", "seed": 0, "model": MODEL, "controller": CONTROLLER}),
    (whiptool.TipPort, {"twin": TWIN, "target": TARGET}),
    (whiptool.Adaptation, {"prior": PRIOR, "port": whiptool.TipPort(TWIN, TARGET), "target": TARGET}),
    (whiptool.load_map, {"run_folder": "none"}),
    (whiptool.load_policy, {"run_folder": "none"}),
]  # fmt: skip


# where further arguments go
FURTHER = {whiptool.compare: Comparison}


def may_be(call: Callable, name: str) -> set[str]:
    """Which of `VALUES` may be right: those of the argument's kind, and nothing where that is allowed."""
    passed_on = FURTHER.get(call, call)
    parameter = (inspect.signature(call).parameters | inspect.signature(passed_on).parameters)[name]
    own_name = (whiptool.default_prior, "whip")
    kinds = WORDS if (call, name) == own_name else KINDS.get(name, set())
    if (call, name) == (whiptool.search, "objective"):
        kinds = kinds | {"a rollout"}
    if call is whiptool.default_bounds:
        kinds = kinds | {"a model"}
    if call is whiptool.Adaptation:
        kinds = {"target": {"a target"}, "port": {"any port"}}.get(name, set())
    return kinds | ({"nothing"} if "None" in str(parameter.annotation) else set())


ARGUMENTS = [(call, given, name) for call, given in CALLS for name in given]


def called(argument) -> str:
    return getattr(argument, "__qualname__", argument if isinstance(argument, str) else "")


@pytest.mark.parametrize(("call", "given", "name"), ARGUMENTS, ids=called)
def test_an_argument_of_a_wrong_kind_is_refused_by_its_name(call, given, name, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for what in sorted(VALUES.keys() - may_be(call, name)):
        with pytest.raises(InputError) as refused:
            call(**{**given, name: VALUES[what]})
        said = refused.value.name.replace(" ", "_")
        assert any(x in said for x in (name, name.rstrip("s"), ALSO.get(name, name))), what


ROWS = [
    (call, given, name)
    for call, given, name in ARGUMENTS
    if name in KINDS and KINDS[name] is AS_ARRAYS and name not in ("K", "B", "points", "place")
]


@pytest.mark.parametrize(("call", "given", "name"), ROWS, ids=called)
@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e308, "1.0", 1j, None], ids=repr)
def test_one_wrong_number_in_a_row_is_refused(call, given, name, wrong):
    row = [*np.ravel(given[name])[:-1].tolist(), wrong]
    with pytest.raises(InputError):
        call(**{**given, name: row})
