"""What is asked for and what is kept of what was told; nothing is rolled out."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from films import film

from whiptool.adaptation.adapter import PLAN as PLANNED
from whiptool.adaptation.adapter import RECORDING, Adapter, Options
from whiptool.adaptation.plan_search import Plan, PlanningEffort
from whiptool.adaptation.planner import FIRST, NEXT, UNSURE
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.adaptation.steps import Seen
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording

STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
PLAN = Plan(tuple(map(float, STRIKE.vector)), 0.9, 0.01, 0.0, None, "a strike", 0.1)


@pytest.fixture(scope="module")
def prior() -> Belief:
    return default_prior(preset("lemon2024"), Controller(oiac_preset("table4")), whip="uniform")


def still(number: int) -> StrikeRecording:
    """A tip that stands still, each time elsewhere."""
    t = np.arange(60) / 60
    points = np.full((60, 1, 2), 0.5) + 0.01 * number
    return StrikeRecording(t, points, ("tip",), source=f"strike {number}")


class Told(Adapter):
    """Plans of a stated probability, their efforts written down."""

    probability = 0.9
    efforts: list[PlanningEffort]

    def _searched(self, o):
        def search(one, believed, rng, past, effort: PlanningEffort) -> Plan:
            self.__dict__.setdefault("efforts", []).append(effort)
            return dataclasses.replace(PLAN, probability=self.probability)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("whiptool.adaptation.planner._searched", search)
            return super()._searched(o)


def told(
    prior: Belief, folder: Path | None = None, probability: float = 0.9, strikes: int = 1, retries: int = 1, **changes
) -> Told:
    options = Options(max_strikes=strikes, adapt=False, still=False, retries=retries)
    adapter = Told(prior, Target((0.5, 0.5), 0.001), options, folder, **changes)
    adapter.probability = probability
    return adapter


def run(prior: Belief, probability: float = 0.9, **changes) -> list[PlanningEffort]:
    adapter = told(prior, probability=probability, **changes)
    adapter.ask()
    adapter.tell(still(1))
    return adapter.efforts


def test_a_whip_that_is_known_needs_no_first_plan(prior):
    assert run(prior) == [FIRST]
    assert run(prior, known=prior) == [NEXT]


def test_a_plan_that_is_less_than_half_sure_is_looked_for_again(prior):
    assert run(prior, UNSURE, known=prior) == [NEXT]
    assert run(prior, UNSURE - 0.01, known=prior) == [NEXT, FIRST]
    assert run(prior, UNSURE - 0.01, known=prior, retries=3) == [NEXT, FIRST, FIRST, FIRST]
    assert run(prior, UNSURE - 0.01, known=prior, retries=0) == [NEXT]
    assert run(prior, UNSURE - 0.01) == [FIRST]  # it was sought as hard as can be


def test_a_recording_is_kept_where_there_is_a_folder(prior, tmp_path):
    run(prior, folder=tmp_path)
    kept = StrikeRecording.load(tmp_path / "strike-0001" / RECORDING)
    assert kept.strike is not None
    np.testing.assert_allclose(kept.strike.vector, STRIKE.vector)
    run(prior)  # and nothing is written where there is none
    assert len(list(tmp_path.iterdir())) == 1


def test_a_strike_that_was_asked_for_is_asked_for_again_until_it_is_told(prior, tmp_path):
    """Killed between ask and tell, and after tell: the folder knows."""
    first = told(prior, tmp_path, strikes=2)
    strike = first.ask()
    assert (first.number, first.done, first.ask()) == (1, False, strike)
    again = told(prior, tmp_path, strikes=2)  # another day
    assert again.ask() == strike
    assert "efforts" not in again.__dict__  # nothing was planned again
    assert again.tell(still(1)).number == 1
    late = told(prior, tmp_path, strikes=2)
    late.ask()
    assert (late.number, len(late.steps)) == (2, 1)
    late.tell(still(2))
    assert late.done
    assert late.ask() is None
    assert told(prior, tmp_path, strikes=2).ask() is None
    with pytest.raises(
        InputError, match="recording: got 'one of strike 3'; allowed: the recording of a strike that was planned"
    ):
        late.tell(still(3))


def test_what_was_not_asked_for_and_what_was_told_before_is_refused(prior, tmp_path):
    adapter = told(prior, tmp_path, strikes=3)
    with pytest.raises(
        InputError, match="recording: got 'one of strike 1'; allowed: the recording of a strike that was planned"
    ):
        adapter.tell(still(1))
    adapter.ask()
    other = dataclasses.replace(still(1), strike=dataclasses.replace(STRIKE, D=0.7))
    with pytest.raises(InputError, match="the requested strike"):
        adapter.tell(other)
    adapter.tell(still(1))
    adapter.ask()
    with pytest.raises(InputError, match="another recording than that of strike 1"):
        adapter.tell(dataclasses.replace(still(1), source="the same file"))
    assert not (tmp_path / "strike-0002" / RECORDING).exists()
    assert adapter.tell(Seen(None, None, fault="the whip was lost")).hit is None
    assert adapter.number == 3


def test_what_another_controller_struck_is_neither_kept_nor_learned_from(prior, tmp_path):
    other = dataclasses.replace(still(1), strike=STRIKE, controller=Controller(oiac_preset("printed")))
    adapter = told(prior, tmp_path)
    adapter.ask()
    with pytest.raises(InputError, match=r"controller: got 'law = oiac, a = 0\.2'; allowed: .*a = 0\.00013"):
        adapter.tell(other)
    assert not list(tmp_path.rglob(RECORDING))
    with pytest.raises(InputError, match=r"controller: got 'law = oiac, a = 0\.2'"):
        Adapter(prior, Target((0.5, 0.5)), recordings=[other])
    assert adapter.tell(Seen(other, 0.3)).number == 1  # a twin whose gains are unlike those of the prior


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("plan.json", {"strike": [0.0]}), ("plan.json", {"strike": "x"}), ("plan.json", {"magic": 1}),
        ("plan.json", {"probability": "x"}), ("plan.json", {"misses": [[]]}),
        ("plan.json", {"wall_time": float("nan")}),
        ("outcome.json", {"filmed": 1}), ("outcome.json", {"seen_miss": []}), ("outcome.json", {"magic": 1}),
    ],
    ids=str,
)  # fmt: skip
def test_a_stored_file_with_another_content_is_refused_by_name_and_kept(name, damage, prior, tmp_path):
    run(prior, folder=tmp_path)
    path = sorted(tmp_path.glob("strike-*"))[0] / name
    path.write_text(text := json.dumps(json.loads(path.read_text()) | damage))
    with pytest.raises(InputError, match=rf"{name}.*delete "):
        told(prior, tmp_path).ask()
    assert path.read_text() == text


def test_a_damaged_folder_is_named(prior, tmp_path):
    told(prior, tmp_path).ask()
    plan = tmp_path / "strike-0001" / PLANNED
    assert json.loads(plan.read_text())["probability"] == 0.9
    plan.write_text("{")
    with pytest.raises(InputError, match=r"plan\.json"):
        told(prior, tmp_path).ask()


def test_a_recording_in_wrong_units_or_axes_is_not_learned_from(tmp_path):
    """It is refused with its cause, nothing is kept, and the same strike is still to be told."""
    model, controller = preset("lemon2024"), Controller()
    options = Options(max_strikes=2, still=False)
    adapter = Told(default_prior(model, controller), Target((0.5, 0.5), 0.001), options, tmp_path)
    strike = adapter.ask()
    right = dataclasses.replace(film(model, strike.vector, np.random.default_rng(0)), source="s.csv")
    for points, said in ((right.points / 1000, "they were m, read as mm"), (right.points[..., ::-1], "axes should be")):
        with pytest.raises(InputError, match=f"s.csv.*points.*{said}"):
            adapter.tell(dataclasses.replace(right, points=points), must_teach=True)
    assert not list(tmp_path.rglob(RECORDING))
    assert adapter.ask() == strike
    assert adapter.number == 1
