"""A robot's lag behind its command: closed form beside SciPy's filter, derivatives beside differences, a fit of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim
from space_films import ROBOT, STRIKES

from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.lagged_motion import LaggedReference, _lagging
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording


@pytest.mark.parametrize("lag", [1e-4, 0.02, 0.3])
def test_what_lags_is_what_a_filter_leaves(lag):
    """And its rates are those of differences, before and after the reference's end."""
    t, D = np.linspace(0, 1.2, 120_001), 0.6
    reference = Strike((0.0,), (1.0,), D).reference(t)[0][:, 0]
    found = _lagging(t, D, lag)
    filtered = lsim(([1.0], [lag, 1.0]), reference, t)[1]
    np.testing.assert_allclose(found[0], filtered, atol=2e-8)
    smooth = np.abs(t - D) > 2e-5
    for i in (0, 1):
        rate = np.gradient(found[i], t)
        np.testing.assert_allclose(found[i + 1][smooth], rate[smooth], atol=2e-4 * np.abs(found[i + 1]).max())


def test_the_hand_moves_with_the_lag_as_differences_say():
    motion = LaggedReference(STRIKES[0], ROBOT.arm, np.linspace(0, 0.9, 901))
    for lag in (0.03, -0.03):
        moved = motion.at(np.array([lag]))
        up, down = motion.at(np.array([lag + 1e-6])), motion.at(np.array([lag - 1e-6]))
        for name in ("inputs", "place"):
            slope = (getattr(up, name) - getattr(down, name)) / 2e-6
            found = getattr(moved, f"d_{name}")[0]
            np.testing.assert_allclose(found, slope, atol=1e-5 * np.abs(slope).max())
    np.testing.assert_allclose(motion.at(np.array([0.03])).inputs, motion.at(np.array([-0.03])).inputs)


def test_a_whip_and_its_robots_lag_come_back_from_the_command_alone():
    """No log of the joints: 1 mm at the tip, 120 frames a second, a lag of 35 ms; the command alone would not do."""
    plant, rng = Plant(ROBOT, Controller()), np.random.default_rng(0)
    t = np.arange(0, 1.1, 1 / 120)
    empty = [StrikeRecording(t, np.zeros((len(t), 1, 3)), ("tip",), strike=s) for s in STRIKES]
    simulated = Predictor(empty, plant, drive="robot", shared=["whip.k"])
    paths = simulated(plant, {}, [np.array([0.035])] * 2, derivatives=False)
    films = [
        StrikeRecording(t, p.value.reshape(-1, 1, 3) + 1e-3 * rng.standard_normal((len(t), 1, 3)), ("tip",), strike=s)
        for p, s in zip(paths, STRIKES, strict=True)
    ]
    found = fit(films, plant.changed({"whip.k": 0.06, "whip.b": 0.005}), ["k", "b"], options=FitOptions(drive="robot"))
    for name, true in {"whip.k": 0.05, "whip.b": 0.004}.items():
        low, high = found[name].interval
        assert low <= true <= high
        assert high - low < 0.3 * true
    lags = [r.own["lag[0]"] for r in found.recordings]
    np.testing.assert_allclose(lags, 0.035, atol=1e-3)
    assert found.misfit == pytest.approx(1, abs=0.1)


def test_a_robot_in_space_has_a_command():
    t = np.arange(0, 1, 0.02)
    nothing = StrikeRecording(t, np.zeros((len(t), 1, 3)), ("tip",))
    with pytest.raises(InputError, match="one with its strike's command"):
        Predictor([nothing], Plant(ROBOT, Controller()), drive="robot", shared=["whip.k"])
    with pytest.raises(InputError, match="for a model in the plane"):
        Predictor([nothing], Plant(preset("lemon2024"), Controller()), drive="robot", shared=["whip.k"])
