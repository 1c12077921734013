"""Unknown whips are struck as the command strikes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from papers.unknown.report import hit_by, hits_table
from papers.unknown.study import (
    CLOCK,
    KNOT,
    MATERIALS,
    PLANE,
    ROPE,
    SPACE,
    RodPort,
    WhipUnit,
    came_of,
    drawn_profile,
    drawn_rope,
    pool,
    struck,
)
from whiptool.adaptation import TipPort
from whiptool.adaptation.adapter import Adapter, NoPlan
from whiptool.commands.adapt import prepare
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.goals.target import Target
from whiptool.impedance import Controller, PositionControl
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout
from whiptool.rollout.cosserat import hand_path

LOOK = Strike((0.0, -1.8, 1.2, -1.0, -1.5, 0.0), (0.3, -1.5, 1.0, -1.0, -1.5, 0.3), 0.6)


@pytest.mark.slow
@pytest.mark.parametrize("model", [PLANE, SPACE])
def test_a_trial_is_what_the_command_prepares(model):
    """Limits, effort, prior and first strike are the command's own with the same words."""
    unit = WhipUnit(model=model, family="strange", seed=1, way="wiggle")
    number = unit.within()[0]
    goals = pool(model)
    words = {"model": model, "camera": "tip", "family": "strange", "seed": 1, "material": MATERIALS[model][1]}
    options = AdaptOptions(**words, wiggle=True, target=tuple(goals.positions[number]), hit_radius=goals.hit_radius)
    if model == SPACE:
        sideways = Target.of(goals, number)
        options = replace(options, direction=sideways.direction, least_speed=1.0)
    own, other = unit.prepared(number), prepare(options)
    assert own.options == other.options
    assert own.prior.values() == other.prior.values()
    assert own.adapter().ask() == other.adapter().ask()
    assert own.target.position == other.target.position
    np.testing.assert_allclose(own.target.direction or (0.0,), other.target.direction or (0.0,), atol=1e-12)


@pytest.mark.slow
def test_a_whip_is_looked_at_once_and_struck_until_it_hits():
    """A goal's trial does not depend on the goals before it, whose look it reads."""
    unit = WhipUnit(model=PLANE, family="kin", seed=5, goals=2, brief=True)
    first, second = unit.run(None, None)["trials"]
    assert [x["goal"] for x in (first, second)] == unit.within()[:2]
    for trial in (first, second):
        *missed, last = trial["struck"]
        assert not any(x["hit"] for x in missed)
        assert last["hit"] == (last["miss"] <= 0.06)
        assert 0 <= last["probability"] <= 1
    alone = replace(unit, goals=1)
    assert alone.run(None, None)["trials"][0]["struck"][0]["strike"] == first["struck"][0]["strike"]


def test_where_no_strike_may_be_made_the_trial_ends_without_a_hit(monkeypatch):
    """The other goals and whips are struck nevertheless."""

    def ask(adapter):
        raise NoPlan(1, "below the floor")

    monkeypatch.setattr(Adapter, "ask", ask)
    unit = WhipUnit(model=PLANE, family="kin", seed=5, goals=2)
    assert [list(struck(unit.prepared(number))) for number in unit.within()[:2]] == [[], []]


def test_goals_are_within_the_whips_reach():
    for model in (PLANE, SPACE):
        unit = WhipUnit(model=model, family="stranger", seed=2)
        far = np.linalg.norm(pool(model).positions[unit.within()], axis=1)
        assert len(far) > 3
        assert far.max() < unit.whip.model.reach


def test_a_hit_is_of_point_and_direction():
    """The true whip's pass decides: through the point, but not along the direction."""
    model, controller = preset(SPACE), Controller(PositionControl())
    near = CompiledRollout(model, controller).approach(LOOK, np.array([1.0, 0.5, 0.0]))
    along = near.velocity[0] / np.linalg.norm(near.velocity[0])
    rope = replace(drawn_rope(0, "cotton", model, controller), model=model)
    for direction, hit in ((along, True), (-along, False), (None, True)):
        target = Target(tuple(near.tip[0]), 0.05, None if direction is None else tuple(direction))
        port = TipPort(rope, target)
        came = came_of(port, LOOK, port.strike(LOOK, 1, None), target)
        assert came["miss"] < 1e-3
        assert came["hit"] == hit
        assert (came["angle"] is None) == (direction is None)


def test_shares_of_hits_and_misses():
    row = {"miss": 0.01, "angle": None, "hit": True, "probability": 1.0, "seconds": 1.0}
    trials = [[row], [row | {"miss": 0.08, "hit": False}, row | {"seconds": 50.0}]]
    trials += [[row | {"miss": None, "hit": False, "seconds": 6.0}], []]
    assert [hit_by(trials, i) for i in (1, 2, 3)] == [0.25, 0.5, 0.5]
    head, told = hits_table(PLANE, {("still", "kin"): trials})
    table = dict(zip(head, told, strict=True))
    assert table["trials"] == "4"
    assert table["hit by 2"] == "50 %"
    assert table["first strike by distance alone"] == "25 %"
    assert table["never hit"] == "2"
    assert table["plan of the first strike: median, 90 % [s]"] == "1, 5"


def test_cosserat_ropes_are_drawn_by_seed():
    profiles = [drawn_profile(seed, "manila") for seed in (1, 1, 2)]
    assert profiles[0] == profiles[1] != profiles[2]
    assert all(KNOT[0] <= profile.tip_mass <= KNOT[1] for profile in profiles)
    rope = drawn_rope(1, "manila", preset(SPACE), Controller(PositionControl()))
    assert rope.family == ROPE
    assert rope.model.whip.length == pytest.approx(profiles[0].length)
    assert 0 < abs(rope.clock_offset) <= CLOCK


@pytest.mark.slow
def test_the_cosserat_rope_hangs_and_swings_as_long_as_it_is():
    """At rest first, straight below the hand; its tip never farther from the hand than it is long."""
    pytest.importorskip("elastica")
    model, controller = preset(SPACE), Controller(PositionControl())
    rope = drawn_rope(0, "cotton", model, controller)
    port = RodPort(rope, "cotton", model, Target((1.0, 0.5, 0.0)), t_stay=0.1)
    swing, length = port.swing(LOOK), rope.model.whip.length
    assert swing is not None
    hand = hand_path(model, CompiledRollout(model, controller).trajectory(LOOK, t_stay=0.1))
    far = np.linalg.norm(swing.tip[0] - hand(np.minimum(swing.t, hand.x[-1])), axis=1)
    assert swing.tip[0, 0] == pytest.approx(hand(0.0) - [0, 0, length], abs=2e-3)
    assert far.max() < 1.005 * length
    near, seen = port.passes(LOOK), port.strike(LOOK, 0, None)
    assert near.distance[0] == pytest.approx(np.linalg.norm(swing.tip[0] - [1.0, 0.5, 0.0], axis=1).min(), abs=1e-4)
    assert seen.recording.t[0] == rope.clock_offset
    at = np.interp(seen.recording.t - rope.clock_offset, swing.t, swing.tip[0, :, 2])
    assert np.std(seen.recording.points[:, 0, 2] - at) == pytest.approx(rope.noise, rel=0.3)
