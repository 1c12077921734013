"""The loop's own decisions: how hard it plans, and what it keeps; nothing is rolled out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.adaptation.loop import RECORDING, UNSURE, Adaptation, Options
from whiptool.adaptation.planner import FIRST, NEXT, Effort, Plan
from whiptool.adaptation.ports import Seen
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.target import Target

STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
PLAN = Plan(tuple(map(float, STRIKE.vector)), 0.9, 0.01, 0.0, None, "a strike", 0.1)


@pytest.fixture(scope="module")
def prior() -> Belief:
    return default_prior(preset("lemon2024"), Controller(oiac_preset("table4")), whip="uniform")


class Port:
    """Films a tip that stands still."""

    def strike(self, strike, number, folder, believed=None) -> Seen:
        t = np.arange(60) / 60
        points = np.full((60, 1, 2), 0.5)
        return Seen(StrikeRecording(t, points, ("tip",), strike=strike, source=f"strike {number}"), 0.01)


class Told(Adaptation):
    """Plans of a stated probability, their efforts written down."""

    probability = 0.9

    def _sought(self, belief, rng, past, effort: Effort, sag):
        self.__dict__.setdefault("efforts", []).append(effort)
        return dataclasses.replace(PLAN, probability=self.probability)


def run(prior: Belief, probability: float = 0.9, **changes) -> list[Effort]:
    told = Told(prior, Port(), Target((0.5, 0.5)), Options(max_strikes=1, adapt=False, still=False), **changes)
    told.probability = probability
    told.run()
    return told.__dict__["efforts"]


def test_a_whip_that_is_known_needs_no_first_plan(prior):
    assert run(prior) == [FIRST]
    assert run(prior, known=prior) == [NEXT]


def test_a_plan_that_is_less_than_half_sure_is_looked_for_again(prior):
    assert run(prior, UNSURE, known=prior) == [NEXT]
    assert run(prior, UNSURE - 0.01, known=prior) == [NEXT, FIRST]
    assert run(prior, UNSURE - 0.01) == [FIRST]  # it was sought as hard as can be


def test_a_recording_is_kept_where_there_is_a_folder(prior, tmp_path):
    run(prior, folder=tmp_path)
    kept = StrikeRecording.load(tmp_path / "strike-0001" / RECORDING)
    assert kept.strike is not None
    np.testing.assert_allclose(kept.strike.vector, STRIKE.vector)
    run(prior)  # and nothing is written where there is none
    assert len(list(tmp_path.iterdir())) == 1
