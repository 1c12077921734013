"""Strikes on the twin: what is seen of them, and a search that has the rig as its objective."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pretended_rig import Pretend

import whiptool as wt
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, Controller
from whiptool.impedance.controller import controller_to_table
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rig.emulator.physics import TwinTruth
from whiptool.rig.loop_options import LoopOptions
from whiptool.rig.rehearsal import rehearse
from whiptool.rig.session import RigRollout, TwinRig

pytest.importorskip("dynamixel_sdk")
pytest.importorskip("cv2")


STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])  # within the XM430's line, hits (1.2, 0.1)
MODEL, CONTROLLER = wt.preset("lemon2024"), Controller(OIAC())


def test_an_ideal_twin_is_seen_to_do_what_the_model_says() -> None:
    rig = TwinRig(MODEL, CONTROLLER, camera="points", at_once=True, target=(1.2, 0.1))
    struck = rig.strike(STRIKE)
    held = Controller(OIAC(), control_period=0.002)
    model = wt.CompiledRollout(MODEL, held).approach(STRIKE.vector[None], (1.2, 0.1), t_stay=0.3)
    seen = struck.approach(np.array([1.2, 0.1]))
    assert struck.truth is not None
    assert seen.distance == pytest.approx(model.distance, abs=0.01)  # encoders count in steps of 1.5 mrad
    assert seen.tip[0] == pytest.approx(model.tip[0], abs=0.01)


@pytest.mark.slow
def test_a_rig_compensates_the_weights_that_its_owner_knows_of() -> None:
    """A heavier whip: rig, rehearsal and compiled model agree once the model's controller reckons as the rig's does."""
    heavy = MODEL.with_parameters({"whip.m": 0.016})
    struck = TwinRig(MODEL, CONTROLLER, truth=TwinTruth(heavy), camera="points", at_once=True).strike(
        STRIKE, believed=heavy
    )
    assert struck.truth is not None
    assert struck.recording is not None
    held = Controller(OIAC(), control_period=0.002)
    assert struck.recording.controller == controller_to_table(CONTROLLER.reckoning_with(MODEL))
    own, rigs = (
        wt.CompiledRollout(heavy, c).approach(STRIKE.vector[None], (1.2, 0.1), t_stay=0.3)
        for c in (held, held.reckoning_with(MODEL))
    )
    true = struck.truth.approach(np.array([1.2, 0.1]))
    assert true.tip[0] == pytest.approx(rigs.tip[0], abs=0.01)
    assert np.hypot(*(true.tip[0] - own.tip[0])) > 0.03
    played = rehearse(MODEL, CONTROLLER, STRIKE, believed=heavy).trajectory
    q = np.array([np.interp(played.t, struck.truth.t, x) for x in struck.truth.q[:, :2].T])
    np.testing.assert_allclose(played.q[:, :2].T, q, atol=0.005)
    with pytest.raises(InputError, match="XM430-W350 gives"):
        TwinRig(MODEL, CONTROLLER, camera="none", at_once=True).strike(
            STRIKE, believed=MODEL.with_parameters({"whip.m": 0.03})
        )


def test_the_camera_clock_and_the_true_whip_are_the_twins_own() -> None:
    heavy = MODEL.with_parameters({"whip.m": 0.02})
    truth = TwinTruth(heavy, clock_offset=0.004)
    plain = TwinRig(MODEL, CONTROLLER, camera="points", at_once=True).strike(STRIKE)
    other = TwinRig(MODEL, CONTROLLER, truth=truth, camera="points", at_once=True).strike(STRIKE)
    assert plain.recording is not None
    assert other.recording is not None
    assert other.recording.t[0] == pytest.approx(0.004)
    last = min(len(plain.recording.t), len(other.recording.t)) - 1
    assert np.hypot(*(plain.recording.points[last, 0] - other.recording.points[last, 0])) > 0.01


def test_a_search_has_the_rig_as_its_objective(tmp_path: Path) -> None:
    rig = Pretend()
    rollout = RigRollout(lambda number: rig, MODEL, folder=tmp_path)
    result = search(Objective(rollout, Target(), max_trials=20, stop_at_hit=True), "random", seed=1)
    assert result.first_hit == 10  # 0.5 / 9 < 0.06, but not for certain enough: the camera's error is 4 mm
    assert result.outcome is not None
    assert result.outcome.miss_error == 0.004
    assert result.outcome.hit_time == 0.7
    assert result.outcome.tip_speed == 5.0
    assert len(list(tmp_path.glob("strike-*"))) == rig.calls
    refused = RigRollout(lambda number: Pretend(refuse=True), MODEL)
    lost = search(Objective(refused, Target(), max_trials=3), "random", seed=1)
    assert [trial.outcome.status for trial in lost.trace] == ["refused"] * 3
    assert lost.n_diverged == 0


def test_loop_options_of_the_twin() -> None:
    rig = TwinRig(MODEL, CONTROLLER, camera="none", at_once=True, options=LoopOptions(rate=1000.0))
    assert rig.options.settle == 0
    assert rig.strike(STRIKE).run.fault is None
