"""Strikes on the model and on a twin that is not: what is planned, what is kept, what identification gives back."""

from __future__ import annotations

from pathlib import Path

import pytest

import whiptool as wt
from papers.lemon2024 import sim2real
from papers.lemon2024.twin_strikes import PlanUnit, TwinUnit, controller, recording, true_model
from whiptool.comparison import TargetScene
from whiptool.identification.fit import FitOptions, RecordingFit, fit
from whiptool.identification.plant import Plant
from whiptool.identification.similarity import Similarity
from whiptool.impedance import Controller
from whiptool.viz.report import NOT_REPRODUCED, REPRODUCED

pytest.importorskip("dynamixel_sdk")

MODEL = wt.preset("lemon2024")
SCENE = TargetScene(model=MODEL, controller=Controller())


@pytest.mark.slow
def test_the_whip_is_found_over_its_mass_and_the_camera_late() -> None:
    """From one strike, through servos with counts and friction, and a tip with the error of images."""
    unit = TwinUnit(scene=SCENE, number=0, strike=(-0.622, 0.221, 0.705, 2.122, 1.376), target=(1.2, 0.1), images=False)
    result = unit.run(None, 1)
    assert result["fault"] is None
    seen = recording(unit, result)
    options = FitOptions(drive="joints", knots=sim2real.KNOTS)
    found = fit([seen], Plant(MODEL, controller()), sim2real.OF_WHIP, options=options)
    twin = true_model(MODEL).parameters()
    for name in ("whip.k", "whip.b", "whip.drag"):
        expected = twin[name] * MODEL.parameters()["whip.m"] / twin["whip.m"]
        assert found[name].value == pytest.approx(expected, rel=0.03), name
    assert found["delay"].value == pytest.approx(0.002, abs=2e-4)
    assert found.recordings[0].chi == pytest.approx(1.0, abs=0.2)
    alike = sim2real._similar(seen, found.recordings[0])
    assert isinstance(found.recordings[0], RecordingFit)
    assert alike.rmse < 0.002
    assert alike.rho_mean > 0.99


def test_the_verdict_follows_the_strikes_that_nothing_was_learnt_from() -> None:
    def like(rho: float) -> Similarity:
        return Similarity((rho, rho), rho, 0, 0.01, 0.01, 0.02, 0.0, 0.02, 0.01, 0.0, 0.0)

    bad, good = [like(0.5)] * 6, [like(0.95)] * 6
    assert sim2real._claim({"model": good, "identified": good}).verdict == REPRODUCED
    assert sim2real._claim({"model": bad, "identified": bad}).verdict == NOT_REPRODUCED
    assert sim2real._claim({"model": bad, "identified": good}).verdict.endswith("the identified model")
    overfitted = [like(0.95)] * sim2real.LEARN_FROM + bad[sim2real.LEARN_FROM :]
    assert sim2real._claim({"model": bad, "identified": overfitted}).verdict == NOT_REPRODUCED


def test_too_few_strikes_are_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from papers.context import Context
    from whiptool.comparison import Store
    from whiptool.errors import WhiptoolError

    one = {"strike": [-0.6, 0.2, 0.7, 2.1, 1.4], "target": (1.2, 0.1)}
    monkeypatch.setattr(PlanUnit, "run", lambda *_: {"strikes": [one] * 4})
    monkeypatch.setattr(TwinUnit, "run", lambda *_: {"fault": "unplugged"})
    comparison = type("Comparison", (), {"scene": SCENE})()
    with pytest.raises(WhiptoolError, match=r"0 of 4 .* unplugged"):
        sim2real.sections(Context(comparison, Store(tmp_path), quick=True))
