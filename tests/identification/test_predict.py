"""Predicted readings: exact derivatives, and what is held out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from films import film
from pendulum_swing import pendulum, swing

from whiptool.dynamics.structure import PROFILE
from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, predict
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller, PositionControl, oiac_preset
from whiptool.models import preset
from whiptool.models.parameters import ArmLink
from whiptool.models.profile import WhipProfile
from whiptool.models.strike import Strike, default_bounds
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout import CompiledRollout

LEMON, CONTROLLER = preset("lemon2024"), Controller()
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 8)
TRUE = {"whip.k": 0.242, "whip.b": 0.092, "whip.m": 0.012}
FREE = tuple(TRUE)
AWAY = LEMON.with_parameters({"whip.k": 0.3, "whip.b": 0.07, "whip.m": 0.015})
PLANT = Plant(AWAY, CONTROLLER)
PROFILED = Plant(LEMON, CONTROLLER, WhipProfile(0.9, 0.2, 0.02, 0.007, 0.3, 0.4, 0.5, 0.1, 0.01))
PENDULUM = pendulum((ArmLink(mass=0.2, length=0.2, friction=1e-4), ArmLink(mass=0.1, length=0.3)), (2e-4, 1e-4))

CASES = {
    "command": (
        PLANT,
        [
            *FREE, "whip.l", "whip.drag", "whip.drag_ratio", "whip.rest_angle", "whip.cubic_stiffness", "law.a",
            "arm.mass[0]", "whip.node_inertia", "delay",
        ],
        ("start", "scale", "rotation", "shift_x", "shift_y"),
    ),
    "profile": (PROFILED, [*(f"profile.{name}" for name in PROFILE), "whip.dry_friction"], ()),
    "joints": (PLANT, ["whip.k", "whip.b", "whip.rest_angle", "whip.node_inertia", "delay"], ("scale",)),
    "handle": (PLANT, ["whip.k", "whip.m", "whip.dry_friction"], ("start",)),
    "free": (
        PENDULUM,
        ["link.com[0]", "link.inertia[1]", "link.length[0]", "link.dry_friction[1]", "link.drag[0]"],
        ("start",),
    ),
}  # fmt: skip


HARD = {  # strikes of which equal steps of 0.25 ms, of the robot 1 ms, are 4.5 and 89 mm off
    "impedance": (LEMON, Controller(oiac_preset("table4")), [-0.48, 0.64, 2.85, 2.47, 0.42]),
    "held": (LEMON, Controller(control_period=2e-4), [-0.48, 0.64, 2.85, 2.47, 0.42]),
    "position": (
        preset("ur5e"),
        Controller(PositionControl()),
        [-1.9, 0.99, -1.95, -0.8, -2.92, -2.7, -2.15, -2.0, 2.13, -1.61, 2.04, -3.1, 0.46],
    ),
}


@pytest.mark.parametrize("case", HARD)
def test_commanded_strikes_are_predicted_to_the_default_tolerance_or_a_tenth_of_the_noise(case):
    """Against the path of a rollout a hundred times as precise."""
    model, controller, vector = HARD[case]
    t, path, _ = CompiledRollout(model, controller, tolerance=1e-6).tip_path(vector, t_stay=0.5, rate=100)
    plant, strike = Plant(model, controller), Strike.from_vector(vector)
    for noise, tolerance in ((0.0001, 1e-4), (0.001, 1e-4), (0.005, 5e-4)):
        film = StrikeRecording(t, path[0][:, None], ("tip",), np.array(noise), strike=strike)
        predictor = Predictor([film], plant, drive="command", shared=["gravity"])
        (found,) = predictor(plant, {}, predictor.start, derivatives=False)
        assert np.abs(found.value - predictor.measured[0]).max() < 3 * tolerance


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_derivatives_are_those_of_differences(case):
    plant, shared, own = CASES[case]
    kind = "command" if case == "profile" else case
    if case == "free":
        recordings = [swing(PENDULUM, np.array([[1.0, 0.5], [0.0, 2.0]]))]
    else:
        recordings = [film(LEMON, STRIKES[0], markers=("tip", "handle", "node3"), exposure=0.004)]
    predictor = Predictor(recordings, plant, drive=kind, shared=shared, own=own)
    values, nuisance = plant.values(), {"delay": 0.007} if "delay" in shared else {}
    # joints bend by a few hundredths of a radian: less is lost in rounding
    usual = {"whip.cubic_stiffness": 5.0, "whip.node_inertia": 2e-5}
    plant = plant.changed({x: usual.get(x, 1e-3) for x in shared if x in values and values[x] == 0})
    values, rng = plant.values(), np.random.default_rng(1)
    unknowns = [x + 1e-4 * rng.standard_normal(len(x)) for x in predictor.start]
    exact = predictor(plant, nuisance, unknowns, derivatives=True)[0]

    def value(change: dict, own: np.ndarray) -> np.ndarray:
        moved = plant.changed({k: values[k] + d for k, d in change.items() if k in values})
        late = {k: x + change.get(k, 0.0) for k, x in nuisance.items()}
        return predictor(moved, late, [own], derivatives=False)[0].value

    for j, name in enumerate(shared):
        step = 1e-5 * max(abs(values.get(name, 0.0)), 1e-2)
        slope = (value({name: step}, unknowns[0]) - value({name: -step}, unknowns[0])) / (2 * step)
        assert np.abs(slope).max() > 0
        np.testing.assert_allclose(exact.by_shared[:, j], slope, atol=2e-5 * np.abs(slope).max())
    size = len(unknowns[0])
    for j in rng.choice(size, min(size, 12), replace=False):
        step = np.zeros(size)
        step[j] = 1e-5
        slope = (value({}, unknowns[0] + step) - value({}, unknowns[0] - step)) / 2e-5
        np.testing.assert_allclose(exact.by_own[:, j], slope, atol=1e-5 * max(np.abs(slope).max(), 0.01))


@pytest.mark.parametrize(("drive", "own"), [("joints", ()), ("handle", ()), ("joints", ("shift_x",))])
def test_a_held_out_recording_is_predicted_without_a_look_at_what_is_judged(drive, own):
    """Tips that are moved aside leave the prediction where it was; from joints it errs hardly more than the camera."""
    seen = film(LEMON, STRIKES[0], np.random.default_rng(5), markers=("tip", "handle"), sigma=1e-3)
    points, second = seen.points.copy(), len(seen.t) // 2 + 1
    points[second if own else 0 :, 0] += np.random.default_rng(6).normal(0, 0.1, 2)
    moved = dataclasses.replace(seen, points=points)
    options = FitOptions(drive=drive, per_recording=own, knots=0.05)
    before, after = (predict([r], Plant(LEMON), {}, options)[0] for r in (seen, moved))
    for marker, path in before.path.items():
        np.testing.assert_allclose(after.path[marker], path, atol=1e-9)
    assert (before.predicted_from is None) == (not own)
    tip = before.channels[:, 1] == 0
    assert tip.all() == (drive == "handle")  # readings that drive the whip are not judged
    chi = np.sqrt(np.mean((before.residuals / before.sigma)[tip] ** 2))
    assert chi < (1.5 if drive == "joints" else 3)
    unseen = seen.without(np.array([[True, False]] * len(seen.t)))
    with pytest.raises(InputError, match="show the whip"):
        predict([unseen], Plant(LEMON), {}, FitOptions(drive="handle"))
