"""What is told of an adaptation: on the terminal after each strike, and in the report."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from whiptool.adaptation.adapter import Options
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.model_error import ModelError
from whiptool.adaptation.plan_search import Plan, PlanningEffort
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.prior import Belief, Learned, default_prior, fresh_terms
from whiptool.adaptation.run_report import PANELS, SHOWN, _Number, lines, sections
from whiptool.adaptation.steps import Seen, Step
from whiptool.adaptation.twins import draw_twin
from whiptool.goals.target import Target
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.filmed_approach import Judgement
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout
from whiptool.viz.report import Picture, Section, Table, Text, to_html

pytestmark = pytest.mark.figures

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
TARGET = Target((1.2, 0.1), 0.06)
STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
PLAN = Plan(tuple(map(float, STRIKE.vector)), 0.42, 0.05, 0.03, None, "the one that was chosen", 2.0)
WIGGLE = dataclasses.replace(PLAN, probability=None, expected_miss=None, mean_miss=None, reason="it tells much")


@pytest.fixture(scope="module")
def prior() -> Belief:
    return default_prior(MODEL, CONTROLLER)


def filmed(source: str) -> StrikeRecording:
    """The tip of the nominal whip, at 60 frames a second."""
    t, path, _ = CompiledRollout(MODEL, CONTROLLER).tip_path(STRIKE.vector[None], t_stay=0.3, rate=60.0)
    return StrikeRecording(t, path[0][:, None], ("tip",), strike=STRIKE, target=TARGET.position, source=source)


def narrowed(prior: Belief, factors: dict[str, float], moves: dict[str, float] | None = None) -> Belief:
    """The prior with some errors multiplied, and some means moved by so many of its standard errors."""
    size = np.array([factors.get(name, 1.0) for name in prior.names])
    move = np.array([(moves or {}).get(name, 0.0) for name in prior.names]) * np.sqrt(np.diag(prior.covariance))
    return Belief(prior.plant, prior.names, prior.z + move, prior.covariance * np.outer(size, size), ModelError(0.0123))


def step_of(number: int, belief: Belief | None = None, *, refused=None, fault: str = "", seen=True) -> Step:
    recording = filmed(f"camera, strike {number}") if seen else None
    used = {} if recording is None or refused else {recording.source: 0.004}
    learned = None if belief is None else Learned(belief, used, refused or {}, 3.5)
    outcome = Seen(recording, 0.071 if seen else None, 0.0345 if seen else None, fault)
    judged = Judgement(0.0333, 0.0021, 0.9999) if learned and used else Judgement(0.071, 0.01, 0.05) if seen else None
    return Step(number, PLAN if number else WIGGLE, outcome, learned, judged)


def parts(found: list[Section], kind: type) -> list:
    return [part for section in found for part in section.parts if isinstance(part, kind)]


def words(found: list[Section]) -> str:
    return to_html("Adaptation", "", {}, found)


def test_an_error_that_shows_no_change_is_as_before():
    """0.812 and 0.808 are both 81 %; 0.81 and 0.77 are not; what is not relative has its unit."""
    number = _Number("whip.k", True, 1.0, 0.812, 1.0, 0.808, 0.0, (), "N m/rad")
    assert number.narrowing == "81 %, as before"
    assert dataclasses.replace(number, after=0.77).narrowing == "81 % -> 77 %"
    delay = _Number("delay", False, 0.0, 0.0061, 0.0, 0.0058, 0.0, (), "s")
    assert delay.narrowing == "0.0061 s -> 0.0058 s"


def test_lines_tell_the_outcome_and_where_each_number_comes_from(prior):
    said = "\n".join(lines(step_of(2, narrowed(prior, {"profile.length": 0.02})), prior))
    assert said.startswith("strike 2: the one that was chosen\n")
    assert "hit: estimated miss 3.33 ± 0.21 cm from the learned whip and the camera, hit probability > 99 %; " in said
    assert "7.10 cm in the camera's frames; true miss 3.45 cm, known to the twin only; " in said
    assert "predicted hit probability 42%" in said
    assert "model error    1.23 cm" in said
    assert "2.0 s planned, 3.5 s learned" in said
    refused = "\n".join(lines(step_of(1, prior, refused={"camera, strike 1": "the tip was lost"}), prior))
    assert "missed: estimated miss 7.10 ± 1.00 cm from the camera, hit probability 5 %; 7.10 cm in the" in refused
    assert "learned whip" not in refused
    doubtful = dataclasses.replace(step_of(1, prior), judged=Judgement(0.05, 0.02, 0.6))
    assert "undecided: estimated miss 5.00 ± 2.00 cm" in "\n".join(lines(doubtful, prior))
    assert "not used       camera, strike 1: the tip was lost" in refused
    assert "learned        nothing" in refused


def test_numbers_that_narrowed_most_come_first_with_their_units(prior):
    belief = narrowed(prior, {"profile.length": 0.02, "delay": 0.1, "profile.drag": 0.5})
    shown = [x for x in lines(step_of(1, belief), prior) if x.startswith("    ")]
    assert f"{SHOWN} of {len(prior.names)} parameters, those that narrowed most" in lines(step_of(1, belief), prior)[2]
    assert len(shown) == SHOWN
    assert [x.split()[0] for x in shown[:3]] == ["profile.length", "delay", "profile.drag"]
    assert "error 13 % -> 0.26 %" in shown[0]  # relative
    assert "error 0.006 s -> 0.0006 s" in shown[1]
    assert "error 0.001 N s^2/m^3 -> 0.00051 N s^2/m^3" in shown[2]
    assert re.search(r"profile\.length +0?\.\d+ m|profile\.length +1\.?\d* m", shown[0])


def test_bounds_and_contradictions_are_marked(prior):
    """The prior's mass of a bead is one standard error above zero."""
    at = {"profile.bead_mass": -1.0, "profile.length": 2.9, "delay": -3.1}
    said = {x.split()[0]: x for x in lines(step_of(1, narrowed(prior, {}, at)), prior) if x.startswith("    ")}
    assert "at its bound" in said["profile.bead_mass"]
    assert "contradicts the estimate before" in said["delay"]
    assert "contradicts" not in said.get("profile.length", "")
    sharp = narrowed(prior, {"profile.length": 0.1})
    second = "\n".join(lines(step_of(2, narrowed(prior, {}, {"profile.length": 0.4})), prior, sharp))
    assert re.search(r"profile\.length .*contradicts", second)  # 4 standard errors of the belief before
    rows = parts(sections([step_of(1, narrowed(prior, {}, at))], prior, TARGET), Table)[1].rows
    assert {row[0]: row[-1] for row in rows}["profile.bead_mass"] == "at its bound"


def test_a_first_look_is_no_strike(prior):
    steps = [step_of(0, narrowed(prior, {"delay": 0.5})), step_of(1, narrowed(prior, {"delay": 0.2}))]
    assert lines(steps[0], prior)[0] == "first look: it tells much"
    assert "outcome" not in "\n".join(lines(steps[0], prior))
    table = parts(sections(steps, prior, TARGET), Table)[0]
    assert list(table.rows[1][:7]) == ["0, first look", "–", "–", "–", "–", "–", "not to hit"]
    assert list(table.rows[2][:7]) == ["1", "42%", "3.33 ± 0.21", "> 99 %", "7.10", "3.45", "hit"]
    assert "First hit: strike 1" in words(sections(steps, prior, TARGET))


def test_the_first_look_shows_the_arm_and_the_hanging_whip(prior):
    steps = [step_of(0, narrowed(prior, {"delay": 0.5})), step_of(1, narrowed(prior, {"delay": 0.2}))]
    figure = parts(sections(steps, prior, TARGET), Picture)[0].figure
    first, second = ({line.get_label(): line.get_xydata() for line in ax.lines} for ax in figure.axes)
    np.testing.assert_allclose(first["arm"][0], 0, atol=1e-9)
    along = first["arm"][1] / np.linalg.norm(first["arm"][1])  # the upper arm, at -1 rad from hanging
    np.testing.assert_allclose(along, [np.sin(-1.0), -np.cos(-1.0)], atol=0.03)
    hanging = first["whip"]
    assert np.ptp(hanging[:, 1]) > 5 * np.ptp(hanging[:, 0])
    assert "its closest approach" not in first  # which a first look does not aim at
    near = second["its closest approach"][0]
    np.testing.assert_allclose(second["whip"][-1], near, atol=0.01)
    said = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"arm", "whip", "shoulder", "its closest approach", "target, hit radius 6 cm"} <= set(said)
    assert figure.axes[0].get_ylabel() == "y, up [cm]"
    figure.draw_without_rendering()
    assert "50" in [label.get_text() for label in figure.axes[1].get_xticklabels()]


def test_what_the_pictures_show(prior):
    steps = [step_of(n, narrowed(prior, {"delay": 0.5**n, "profile.length": 0.3**n})) for n in range(1, 9)]
    plane, sizes = parts(sections(steps, prior, TARGET), Picture)
    panels = plane.figure.axes
    assert len(panels) == PANELS
    assert [ax.get_title(loc="left").split(":")[0] for ax in panels] == [f"strike {n}" for n in (1, 4, 5, 6, 7, 8)]
    drawn = {line.get_label(): line.get_xydata() for line in panels[0].get_lines()}
    tip = filmed("").points[:, 0]
    nearest = int(np.hypot(*(tip - TARGET.position).T).argmin())
    used = drawn["recorded tip, learned from"]
    assert len(used) + len(drawn["recorded tip, not learned from"]) == len(tip)
    assert nearest < len(used) < len(tip)
    np.testing.assert_allclose(used, tip[: len(used)])
    np.testing.assert_allclose(panels[0].patches[0].center, TARGET.position)
    assert panels[0].patches[0].radius == TARGET.hit_radius
    curves = [line.get_ydata() for line in sizes.figure.axes[0].get_lines()]
    assert len(curves) == len(prior.names)
    assert sum(np.allclose(y, 0.3 ** np.arange(9)) for y in curves) == 1
    assert {"profile.length", "delay"} < {text.get_text() for text in sizes.figure.axes[0].texts}


def test_the_speed_is_the_learned_whips_or_about_that_between_frames(prior):
    seen = parts(sections([step_of(1)], prior, TARGET), Table)[0].rows[1][7]
    tip = filmed("").points[:, 0]
    k = int(np.hypot(*(tip - TARGET.position).T).argmin())
    expected = np.hypot(*(tip[k + 1] - tip[k - 1])) * 30
    assert float(seen.removeprefix("about ")) == pytest.approx(expected, abs=0.06)
    model = parts(sections([step_of(1, prior)], prior, TARGET), Table)[0].rows[1][7]
    plant = prior.at()
    assert plant.controller is not None
    rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(prior))
    _, path, _ = rollout.tip_path(STRIKE.vector[None], t_stay=0.3, rate=2000.0)
    k = int(np.hypot(*(path[0] - TARGET.position).T).argmin())
    assert float(model) == pytest.approx(np.hypot(*(path[0, k + 1] - path[0, k - 1])) * 1000, rel=0.03)


def test_nothing_learned_nothing_seen(prior):
    assert "No strike" in words(sections([], prior, TARGET))
    unseen = step_of(1, seen=False, fault="motor 2 is hot")
    told = lines(unseen, prior)
    assert "  fault          motor 2 is hot" in told
    assert "  outcome        not seen: predicted hit probability 42%" in told
    refused = {"camera, strike 2": "the tip was lost"}
    steps = [unseen, step_of(2, prior, refused=refused), step_of(3, prior, refused=refused)]
    found = sections(steps, prior, TARGET)
    assert len(parts(found, Picture)) == 1
    assert [t.get_text() for t in parts(found, Picture)[0].figure.axes[0].texts] == ["nothing recorded"]
    said = words(found)
    assert "Strike 1, fault: motor 2 is hot" in said
    assert "nothing was learned" in said
    assert "No recording of the tip: strike 1." in said
    last = parts(found, Table)[-1].rows
    assert list(last[1]) == ["camera, strike 2", "the tip was lost", "strike 2, strike 3"]
    assert parts(found, Table)[0].rows[1][6] == "fault, not seen"
    off = sections([step_of(1), step_of(2)], prior, TARGET)
    assert "No recording was learned from." in [part.text for part in parts(off, Text)]


def test_a_whip_that_diverges_has_no_path(prior):
    """Steps of a strike so fast that no integrator follows."""
    far = Strike((-12.0, 12.0), (12.0, -12.0), 0.002)
    wild = dataclasses.replace(PLAN, strike=tuple(map(float, far.vector)))
    step = dataclasses.replace(step_of(1, prior, seen=False), plan=wild)
    found = sections([step], prior, TARGET)
    assert "diverges" in parts(found, Picture)[0].figure.axes[0].texts[0].get_text()
    assert parts(found, Table)[0].rows[1][2] == "–"


def test_a_real_adaptation(prior):
    quick = PlanningEffort(pool=32, polished=2, steps=2, whips=4, population=4, rounds=1)
    port = TipPort(draw_twin("kin", 0, MODEL, CONTROLLER), TARGET.position)
    uniform = default_prior(MODEL, CONTROLLER, whip="uniform")
    told: list[str] = []
    options = Options(max_strikes=1, starts=1, still=False, first=quick, later=quick)
    steps = Adaptation(uniform, port, TARGET, options).run(lambda step: told.extend(lines(step, uniform)))
    found = sections(steps, uniform, TARGET)
    assert f"{SHOWN} of {len(uniform.names)}" in "\n".join(told)
    assert len(parts(found, Picture)) == 2
    assert "every recording was used" in words(found)
    judged = float(parts(found, Table)[0].rows[1][2].split()[0])
    assert steps[0].judged is not None
    assert judged == pytest.approx(100 * steps[0].judged.miss, abs=0.006)
