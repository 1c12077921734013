"""An adaptation as its folder shows it: nothing is rolled out but the strike that is played."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from whiptool.adaptation.adapter import PLAN, Adapter, Options, strike_folder
from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.prior import Belief, Learned, default_prior
from whiptool.following.adaptation import SHOWN, FollowedAdaptation
from whiptool.goals.target import Target
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.recording.strike_recording import StrikeRecording

PLANNED = Plan((-1.0, 0.5, 2.0, 0.8, 0.8), 0.9, 0.01, 0.0, None, "a strike", 0.1)
TARGET = Target((0.5, 0.5), 0.001)


class Narrowing(Adapter):
    """An adapter whose belief halves its errors with each strike, without a simulation."""

    def _searched(self, o):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("whiptool.adaptation.planner._searched", lambda *_: PLANNED)
            return super()._searched(o)

    def _update(self, recordings, contacts) -> Learned:
        covariance = self.prior.covariance / 4.0 ** len(recordings)
        return Learned(dataclasses.replace(self.prior, covariance=covariance), {"a film": 0.01}, {}, 0.1)


@pytest.fixture(scope="module")
def prior() -> Belief:
    return default_prior(preset("lemon2024"), Controller(oiac_preset("table4")), whip="uniform")


def passing(number: int) -> StrikeRecording:
    """A tip that passes the target at 1 cm for each strike's number."""
    t = np.arange(60) / 60
    points = np.stack([0.5 + 2 * (t - 0.5), np.full(60, 0.5 + 0.01 * number)], axis=-1)[:, None]
    return StrikeRecording(t, points, ("tip",), source=f"strike {number}")


def test_misses_and_the_narrowing_belief_are_shown_by_strike(prior: Belief, tmp_path: Path) -> None:
    adapter = Narrowing(prior, TARGET, Options(max_strikes=3, still=False), tmp_path)
    run = FollowedAdaptation(tmp_path, "an adaptation", prior, TARGET, t_stay=0.3, budget=3)
    nothing = run.look()
    assert nothing is not None
    assert (nothing.chosen, nothing.charts) == (None, ())
    adapter.ask()
    planned = run.look()
    assert planned is not None
    assert planned.chosen is not None
    assert (planned.chosen.number, planned.chosen.vector) == (1, PLANNED.strike)
    assert planned.facts["planned chance to hit"] == "90%"
    steps = [adapter.tell(passing(1))]
    adapter.ask()
    steps.append(adapter.tell(passing(2)))
    view = run.look()
    assert view is not None
    assert run.look() is None
    charts = {chart.title: chart for chart in view.charts}
    estimated = charts["miss distance"].curves[0]
    np.testing.assert_array_equal(estimated.x, [1, 2])
    np.testing.assert_array_equal(estimated.y, [step.judged.miss for step in steps if step.judged])
    np.testing.assert_allclose(estimated.y, [0.01, 0.02], rtol=0.1)
    narrowing = charts["standard error, prior = 100 %"].curves
    for curve in narrowing:
        np.testing.assert_array_equal(curve.x, [0, 1, 2])
        np.testing.assert_allclose(curve.y, [100, 50, 25])
    assert len(narrowing) == SHOWN
    np.testing.assert_array_equal(view.points["tip, as recorded"], passing(2).points[:, 0])


def test_what_a_strikes_folder_lacks_is_awaited(prior: Belief, tmp_path: Path) -> None:
    adapter = Narrowing(prior, TARGET, Options(max_strikes=3, still=False), tmp_path)
    adapter.ask()
    adapter.tell(passing(1))
    place = strike_folder(tmp_path, 1)
    judged = place / "judged.json"
    later = judged.read_text()
    judged.unlink()
    run = FollowedAdaptation(tmp_path, "an adaptation", prior, TARGET, t_stay=0.3, budget=3)
    first = run.look()
    assert first is not None
    assert "last miss" not in first.facts
    judged.write_text(later)
    second = run.look()
    assert second is not None
    assert second.facts["last miss"].startswith("10 ±")


def test_a_folder_from_before_judgements_were_stored_shows_what_it_has(prior: Belief, tmp_path: Path) -> None:
    adapter = Narrowing(prior, TARGET, Options(max_strikes=3, still=False), tmp_path)
    for number in (1, 2, 3):
        if adapter.ask() is not None:
            adapter.tell(passing(number))
    for path in tmp_path.rglob("judged.json"):
        path.unlink()
    run = FollowedAdaptation(tmp_path, "an adaptation", prior, TARGET, t_stay=0.3, budget=3)
    view = run.look()
    assert view is not None
    seen = next(chart for chart in view.charts if chart.title == "miss distance").curves
    assert [curve.name for curve in seen] == ["in the camera's frames"]
    assert len(seen[0].x) == 3
    assert run.look() is None
    assert (strike_folder(tmp_path, 1) / PLAN).exists()
