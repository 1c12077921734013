"""One user's session: numbers change the path as a fresh simulation does, targets are hit where the map hits them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import whiptool as wt
from whiptool.errors import InputError
from whiptool.impedance.controller import controller_from_table, controller_to_table
from whiptool.live_page import aim
from whiptool.live_page.export import exported, python_code, settings_toml
from whiptool.live_page.heat_map import Sampled
from whiptool.live_page.knobs import law_knobs, strike_knobs, whip_knobs
from whiptool.live_page.saved import read_saved
from whiptool.live_page.session import Session
from whiptool.models.files import read_model
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.map_files import shipped_map
from whiptool.strike_map.strike_map import REFINED, StrikeMap

LEMON = wt.preset("lemon2024")


@pytest.fixture
def session():
    return Session(LEMON)


def fresh(session: Session) -> wt.Trajectory:
    """The path of the session's strike, simulated anew without anything that the session keeps."""
    return wt.CompiledRollout(session.settings.model, session.settings.controller).trajectory(
        wt.Strike(session.settings.strike)
    )


def test_each_slider_changes_the_path_as_a_fresh_simulation_does(session):
    knobs = [("whip", knob) for knob in whip_knobs(LEMON, {})]
    knobs += [("law", knob) for knob in law_knobs(session.usual_law, session.usual_law, LEMON)]
    strike = np.array(session.settings.strike)
    knobs += [("strike", knob) for knob in strike_knobs(LEMON, strike, session.striker.bounds)]
    assert {knob.name for _, knob in knobs} >= {"length", "taper", "mass", "k", "b", "drag", "a", "beta", "C", "D"}
    before = session.shown().trajectory.tip
    for group, knob in knobs:
        turn = {"whip": session.turn_whip, "law": session.turn_law, "strike": session.turn_strike}[group]
        turn(knob.name, knob.value + 0.1 * (knob.high - knob.value))
        tip = session.shown().trajectory.tip
        np.testing.assert_allclose(tip, fresh(session).tip, rtol=0, atol=1e-9, err_msg=knob.name)
        same = len(tip) == len(before) and np.abs(tip - before).max() < 1e-6
        assert not same, f"{knob.name} has no effect"
        before = tip


def test_gains_of_a_constant_law_are_sliders(session):
    session.choose_law("constant")
    names = [knob.name for knob in law_knobs(session.settings.controller.law, session.usual_law, LEMON)]
    assert names == ["K[0]", "K[1]", "B[0]", "B[1]"]
    session.turn_law("K[1]", 60.0)
    law = session.settings.controller.law
    np.testing.assert_allclose(law.K, [[29.5, 14.3], [14.3, 60.0]])  # what is aside of the diagonal stays
    np.testing.assert_allclose(session.shown().trajectory.tip, fresh(session).tip, rtol=0, atol=1e-9)


def test_a_number_that_is_not_allowed_leaves_everything_as_it_was(session):
    session.choose_law("constant")
    kept = session.settings
    for change in (
        lambda: session.turn_law("K[2]", 5.0),  # of an arm with more joints
        lambda: session.turn_law("a", 0.25),  # of the law before, whose slider was moved as the law was chosen
        lambda: session.turn_law("K[0]", -5.0),
        lambda: session.turn_whip("length", -1.0),
        lambda: session.turn_strike("D", 0.0),
        lambda: session.turn_strike("q_x", 0.0),
        lambda: session.move_target(wt.Target((1.0, 0.0, 0.0))),
    ):
        with pytest.raises(InputError):
            change()
        assert session.settings == kept
    assert session.shown().settings == kept


def test_a_trajectory_that_limits_asked_for_is_not_computed_again(monkeypatch):
    session, computed = Session(wt.preset("ur5e")), []
    plain = CompiledRollout.trajectories

    def counted(self, strikes, **options):
        for path in plain(self, strikes, **options):
            computed.append(path)
            yield path

    monkeypatch.setattr(CompiledRollout, "trajectories", counted)
    session.move_target(wt.Target((1.0, 0.4, 0.6)))
    shown = session.shown()
    assert shown.hit
    assert [path is shown.trajectory for path in computed] == [True]
    np.testing.assert_allclose(fresh(session).tip, shown.trajectory.tip, rtol=0, atol=1e-9)


def test_the_whole_map_is_tried_before_a_target_is_given_up(monkeypatch):
    """Of a target in the map's region that neither its best entries nor random strikes hit; of others it is not."""
    asked, plain = list[int](), StrikeMap.refined

    def refined(self, goals, *, tried):
        asked.append(tried)
        found = plain(self, goals, tried=1)
        return replace(found, struck=replace(found.struck, hit=np.array([tried > aim.TRIED])))

    monkeypatch.setattr(StrikeMap, "refined", refined)
    monkeypatch.setattr(aim, "refine", lambda *_, **__: pytest.fail("no random strikes are needed"))
    nothing = Sampled(np.empty((0, 5)), np.empty((0, 2, 2)))
    session = Session(LEMON, strike=(-1.36, 0.47, 1.73, 1.41, 0.95))
    for place, hit, asks in (((1.2, 0.1), True, [aim.TRIED, REFINED]), ((5.0, 5.0), False, [aim.TRIED])):
        asked.clear()
        found = aim.aimed(session.striker, wt.Target(place), of_map="lemon2024", others=lambda: nothing, present=None)
        assert (found.hit, asked) == (hit, asks)


def test_targets_are_hit_where_the_map_says_so(session):
    plan = shipped_map("lemon2024")
    goals = plan.region.draw(8, np.random.default_rng(3))
    said = [bool(plan.refined(goals.rows(np.array([i]))).struck.hit[0]) for i in range(8)]
    hit = []
    for place in goals.positions:
        session.move_target(wt.Target(tuple(place)))
        shown = session.shown()
        hit.append(shown.hit)
        path = fresh(session)
        assert shown.hit == (path.miss(place) <= 0.06)
    assert hit == said
    assert all(hit)


def test_a_direction_and_a_speed_that_are_asked_for_are_met(session):
    session.move_target(wt.Target((1.2, 0.1), direction=(0.5, 1.0), speed=4.0))
    shown = session.shown()
    velocity = shown.near.velocity[0]
    along = velocity @ np.array([0.5, 1.0]) / np.hypot(0.5, 1.0)
    assert shown.hit
    assert along >= 4.0
    assert along >= np.cos(np.radians(10)) * np.linalg.norm(velocity)


def test_what_is_out_of_reach_is_a_miss_and_ends_nothing(session):
    session.move_target(wt.Target((5.0, 5.0)))
    assert not session.shown().hit
    session.move_target(wt.Target((1.2, 0.1)))
    assert session.shown().hit


def test_the_strike_stays_or_follows(session):
    strike = session.settings.strike
    session.turn_whip("length", 1.0)
    assert session.settings.strike == strike
    assert not session.shown().hit
    assert session.shown().source.startswith("the map of lemon2024, refined; found for the whip or control law before")
    session.reset_whip()
    assert session.shown().source == "the map of lemon2024, refined"
    session.turn_whip("length", 1.0)
    session.set_follows(True)
    assert session.shown().hit
    assert "before" not in session.shown().source
    followed = session.settings.strike
    session.turn_whip("length", 1.1)
    assert session.settings.strike != followed
    assert session.shown().hit
    session.reset_whip()
    assert session.model == LEMON


def test_a_changed_strike_that_breaks_a_limit_is_no_hit():
    session = Session(wt.preset("ur5e"))
    assert session.shown().hit
    session.turn_strike("D", 0.5)
    shown = session.shown()
    assert not shown.hit
    assert shown.beyond is not None


def test_errors_of_the_arm_spread_the_tip_as_random_errors_do(session):
    session.set_noise(0.002)
    found = session.spread()
    rng = np.random.default_rng(1)
    strikes = np.array(session.settings.strike) + 0.002 * rng.standard_normal((2000, 5))
    near = session.striker.rollout.approach(strikes, session.settings.target)
    np.testing.assert_allclose(found.covariance, np.cov(near.tip.T), rtol=0.15, atol=0.1 * found.covariance.max())
    assert found.hits == 1.0
    assert found.scale(0.95) == pytest.approx(2.4477, abs=1e-3)  # of two degrees of freedom


def test_python_code_does_the_same(session, tmp_path, monkeypatch):
    session.turn_whip("taper", 0.8)
    session.turn_whip("k", 0.3)
    session.turn_whip("mass", 0.2)
    session.turn_law("a", 0.25)
    session.move_target(wt.Target((1.1, 0.2), direction=(1.0, 1.0), speed=1.0))
    shown = session.shown()
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(python_code(shown), names)
    np.testing.assert_allclose(names["path"].tip, shown.trajectory.tip, rtol=0, atol=1e-9)
    assert names["target"].direction == pytest.approx(shown.settings.target.direction)
    assert names["target"].speed == 1.0
    assert (tmp_path / "strike.png").exists()


def test_exported_settings_are_read_back(session, tmp_path):
    session.turn_whip("taper", 0.8)
    shown, path = session.shown(), tmp_path / "strike.toml"
    path.write_text(settings_toml(shown))
    assert read_model(path) == shown.model
    assert wt.Controller(session.usual_law) == controller_from_table(controller_to_table(shown.settings.controller))


@pytest.mark.parametrize("kind", ["toml", "python", "npz", "csv", "html"])
def test_files_have_a_name_and_content(session, kind):
    name, content = exported(session.shown(), kind)
    assert name == {"python": "strike.py"}.get(kind, f"strike.{kind}")
    assert len(content) > 300


def test_a_taper_set_back_gives_the_whip_as_it_was_loaded(session):
    before = session.shown().trajectory.tip
    session.turn_whip("taper", 0.5)
    session.turn_whip("taper", 1.0)
    np.testing.assert_array_equal(session.shown().trajectory.tip, before)


@pytest.mark.parametrize("law", ["oiac", "constant"])
def test_no_slider_ends_at_a_number_that_is_refused(session, law):
    session.choose_law(law)
    for knob in law_knobs(session.settings.controller.law, session.usual_law, LEMON):
        low, high, _ = knob.shown
        session.turn_law(knob.name, low)
        session.turn_law(knob.name, high)
        session.turn_law(knob.name, knob.value)
    for knob in whip_knobs(LEMON, {}):
        for value in (*knob.shown[:2], knob.value):
            session.turn_whip(knob.name, value)


def saved(session: Session, folder) -> Path:
    path = folder / "strike.toml"
    path.write_text(settings_toml(session.shown()))
    return path


def test_a_saved_file_opens_as_it_was_saved(session, tmp_path):
    session.turn_whip("taper", 0.6)
    session.turn_law("a", 0.02)
    session.move_target(wt.Target((0.9, 0.6), hit_radius=0.03, direction=(1.0, 0.5), cone=0.5, speed=2.0))
    session.turn_strike("D", 0.9)
    path = saved(session, tmp_path)
    model = read_model(path)
    found = read_saved(path, model)
    assert found is not None
    again = Session(model, found.controller, target=found.target, strike=found.strike, t_stay=found.t_stay)
    assert again.settings.target == session.settings.target
    assert again.settings.controller == session.settings.controller
    np.testing.assert_allclose(again.shown().trajectory.tip, session.shown().trajectory.tip, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("hit_radius", "radius", "target.radius"),
        ("q_si", "q_x", "strike.q_x"),
        ("D = ", "D = true # ", "strike.D"),
        ("position = [", "direction = [", "target.position"),
        ("hit_radius = ", "hit_radius = -", "hit radius"),
        ("[controller]", "[control]", "controller"),
    ],
)
def test_a_saved_file_that_was_damaged_is_refused_by_name(session, tmp_path, old, new, said):
    path = saved(session, tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=said):
        read_saved(path, LEMON)


def test_a_model_alone_is_no_saved_file(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text('[model]\nname = "x"\n')
    assert read_saved(path, LEMON) is None


def test_an_arrival_angle_is_saved_with_its_line_of_sight(tmp_path):
    target = wt.Target.arriving((1.2, 0.3, 0.5), 1.0, cone=0.3)
    assert target.sight is not None
    session = Session(wt.preset("ur5e"), target=target)
    found = read_saved(saved(session, tmp_path), wt.preset("ur5e"))
    assert found is not None
    assert found.target == target
    line = next(line for line in python_code(session.shown()).splitlines() if line.startswith("target ="))
    assert eval(line.removeprefix("target ="), {"wt": wt}) == target
