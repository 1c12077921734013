"""Aimed strikes at whips that are not known: within the robot's limits, and as probable as they are said to be."""

from __future__ import annotations

import dataclasses
import math
import types

import numpy as np
import pytest
from scipy.stats import norm

from papers.aim.published import CONTROLLER, MODEL
from papers.unknown.study import pool
from whiptool.adaptation import aimed_search
from whiptool.adaptation.adapter import Adapter, Options
from whiptool.adaptation.aimed_search import AimedSearch
from whiptool.adaptation.first_look import FASTEST, choose_wiggle, hanging
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.model_error import ModelError
from whiptool.adaptation.plan_search import Demands, Passes, PlanningEffort
from whiptool.adaptation.planner import plan
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.posterior import update
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.adaptation.twins import FAMILIES, NODES, draw_twin
from whiptool.errors import InputError
from whiptool.goals.goals import PACE
from whiptool.goals.target import Target
from whiptool.identification.plant import Plant
from whiptool.limits.all_limits import AllLimits, limits_given
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.models import preset
from whiptool.models.profile import WhipProfile
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout import CompiledRollout
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.striker import Striker

STOCK = stock_of_material("cotton")
LIMITS = (ArmLimits.of(MODEL.arm, prescribed=True), Clearance(MODEL, -1.7))
FEW = PlanningEffort(pool=64, polished=4, steps=20, whips=4, population=4, rounds=1)


@pytest.fixture(scope="module")
def prior() -> Belief:
    return default_prior(MODEL, CONTROLLER, stock=STOCK)


def test_the_probability_is_that_of_draws():
    """A point that is missed by a Student's t, a direction that is off by as much over what the tip moves on."""
    rng, error = np.random.default_rng(0), ModelError(0.02, 4.0)
    goal = Target.arriving((1.6, 0.2, 0.3), 0.5, hit_radius=0.05, speed=1.0).goals
    miss, angle, speed = 0.03, math.radians(6), 3.0
    assert goal.directions is not None
    assert goal.sights is not None
    along, across = goal.directions[0], np.cross(goal.sights[0], goal.directions[0])
    velocity = speed * (math.cos(angle) * along + math.sin(angle) * across)
    found = Passes(np.array([[miss]]), velocity[None, None]).probability(goal, error)
    passed = np.abs(miss + error.scale * rng.standard_t(error.freedom, 400_000)) <= goal.hit_radius
    turned = np.abs(angle + error.scale / (speed * PACE) * rng.standard_normal(400_000)) <= goal.cone
    assert found[0] == pytest.approx((passed & turned).mean(), abs=0.01)
    slow = Passes(np.array([[miss]]), 0.3 * velocity[None, None])
    assert slow.probability(goal, error)[0] == 0.0
    lost = Passes(np.array([[miss, np.inf]]), np.array([[velocity, np.zeros(3)]]))
    assert lost.probability(goal, error)[0] == pytest.approx(found[0] / 2)


def test_a_strike_that_passes_every_whip_by_a_quarter_of_what_is_allowed_is_good_enough():
    for target in (
        Target.arriving((1.6, 0.2, 0.3), 0.5, hit_radius=0.06, cone=0.4),
        Target((1.6, 0.2, 0.3), 0.06, direction=(0, 0, 1), cone=0.4, speed=20.0),
        Target((1.6, 0.2, 0.3), 0.06),
    ):
        search = types.SimpleNamespace(goal=target.goals, error=ModelError())
        within = norm.cdf((0.06 - 0.015) / 0.005) - norm.cdf((-0.06 - 0.015) / 0.005)
        enough = within - 0.2 * 0.015
        if target.direction is not None:
            turned = np.arctan(0.005 / (max(10.0, 2 * (target.speed or 0)) * PACE))
            enough = within * (norm.cdf(0.3 / turned) - norm.cdf(-0.5 / turned)) - 0.2 * 0.015 - 0.2 * 0.1 / np.pi
        assert AimedSearch.sure(search, enough + 1e-9)
        assert not AimedSearch.sure(search, enough - 1e-9)


def test_known_strikes_of_the_arm_are_candidates(prior, monkeypatch):
    """A strike whose tip passes the goal comes first; it is known for another direction, to which the arm is turned."""
    goal, rng = Target.arriving((1.6, 0.2, 0.3), 0.5, hit_radius=0.05), np.random.default_rng(0)
    search = AimedSearch(prior, goal, Demands(limits=()))
    strike = search.starts(rng, FEW)[:1]  # the best of some
    t, paths, _ = search.rollout.tip_path(strike, rate=200.0)
    nearest = int(np.nanargmin(np.linalg.norm(paths[0] - goal.position, axis=1)))
    tip, velocity = paths[0, nearest], np.gradient(paths[0], t, axis=0)[nearest]
    target = Target(tuple(tip), 0.05, direction=tuple(velocity), speed=0.1)
    slopes = np.zeros((1, 3, strike.shape[1] + 1))
    known = Answers(strike, tip[None], velocity[None], slopes, slopes)
    search = AimedSearch(prior, target, Demands(limits=()))
    ahead = search.front.answers(known, -search.front.angles(tip[None]))
    known_map = types.SimpleNamespace(answers=ahead)
    monkeypatch.setattr(aimed_search, "map_of_arm", lambda arm: known_map if arm == MODEL.arm else None)
    found = search.starts(rng, FEW)[0]
    np.testing.assert_allclose(np.delete(found, [0, 6]), np.delete(strike[0], [0, 6]), atol=1e-12)
    np.testing.assert_allclose(found[[0, 6]], strike[0, [0, 6]], atol=0.02)


@pytest.mark.slow
def test_where_no_candidate_hits_a_strike_of_the_map_is_followed_to_the_whip():
    """A goal that none of a few random strikes hit with this rope within the limits."""
    model, target, effort = preset("ur5e"), Target.of(pool("ur5e"), 3), PlanningEffort(pool=8, polished=2, steps=2)
    nylon = WhipProfile(0.95, 0.045382, 0.0012339, 1.6392e-5, drag=0.005831)
    belief = default_prior(dataclasses.replace(model, whip=nylon.lump(model.whip.N, joints="rod")), CONTROLLER)
    search = AimedSearch(belief, target, Demands(limits=limits_given("default", model, prescribed=True)))
    drawn = search.refined(search.starts(np.random.default_rng(0), effort), effort.steps)
    assert not (search.judge.keep(drawn) & search.striker.land(drawn, search.goals(len(drawn))).hit).any()
    (*_, found), _ = search.candidates(np.random.default_rng(0), (), effort)
    near = CompiledRollout(search.rollout.model, CONTROLLER, timestep=1e-4).approach(found[None], target.position)
    assert target.goals.hit_by(near)[0]
    assert search.judge.keep(found[None])[0]


def test_limits_judge_the_whip_that_was_identified():
    """A whip of 0.7 m keeps clear of arm and floor where the whip of 1 m, for which the limits were given, does not."""
    model = preset("ur5e")
    nylon = WhipProfile(0.70, 0.045382, 0.0012339, 1.6392e-5, drag=0.005831)
    short = dataclasses.replace(model, whip=nylon.lump(model.whip.N, joints="rod"))
    target = Target((1.29049, 1.62954, 0.189824), 0.05, direction=(0.785, -0.609, -0.114), speed=1.0)
    of_model, of_short = (limits_given("default", of, prescribed=True) for of in (model, short))
    search = AimedSearch(default_prior(short, CONTROLLER), target, Demands(limits=of_model))
    strikes = search.starts(np.random.default_rng(0), PlanningEffort(pool=128, polished=4))
    paths = search.rollout.trajectories(strikes)
    by_short, by_model = ([AllLimits(of).violation(x) <= 0 for x in paths] for of in (of_short, of_model))
    assert search.judge.keep(strikes).tolist() == by_short
    assert by_short != by_model


def test_strikes_to_learn_from_are_within_the_limits_first(prior):
    """However near to the goal others pass."""
    search = AimedSearch(prior, Target((1.6, 0.2, 0.3), 0.05), Demands(limits=Clearance(MODEL, 0.0)))
    effort = PlanningEffort(pool=64, polished=4)
    near, spare = (way(np.random.default_rng(0), effort) for way in (search.starts, search.spare))
    assert not search.striker.paths(near, rate=100.0)[0].all()
    assert search.striker.paths(spare, rate=100.0)[0].all()


@pytest.mark.parametrize("family", FAMILIES)
def test_twins_in_space_have_the_robots_arm(family):
    twin = draw_twin(family, 3, MODEL, CONTROLLER, STOCK)
    assert twin.model.arm == MODEL.arm
    assert twin.controller == CONTROLLER
    assert twin.model.whip.joints == "rod"
    assert (MODEL.whip.N if family == "kin" else NODES) == twin.model.whip.N
    assert twin == draw_twin(family, 3, MODEL, CONTROLLER, STOCK)


@pytest.mark.slow
def test_a_wiggle_keeps_the_limits_of_the_robot(prior):
    strike, told = choose_wiggle(prior, rng=np.random.default_rng(0), keeps=LIMITS, candidates=8, t_stay=0.1)
    assert told > 1
    rollout = CompiledRollout(prior.at().model, CONTROLLER)
    striker = Striker(rollout, limits=LIMITS, t_stay=0.1)
    assert striker.keep(strike.vector[None]).all()
    path = rollout.trajectory(strike, t_stay=0.1).tip
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < FASTEST  # a sample is far shorter than a second
    over_floor = (LIMITS[0], Clearance(MODEL, 0.0))
    striker = Striker(rollout, limits=over_floor, t_stay=0.1)
    for keeps, there in (
        ((), False),
        (over_floor, True),
    ):  # in the middle of the start postures the whip is in the floor
        still = hanging(prior, rng=np.random.default_rng(0), t_stay=0.1, keeps=keeps)
        assert still.q_i == still.q_f
        assert striker.keep(still.vector[None])[0] == there
    rare, _ = choose_wiggle(prior, rng=np.random.default_rng(0), keeps=over_floor, candidates=4, t_stay=0.1)
    assert striker.keep(rare.vector[None]).all()  # of the first four movements none keeps the limits
    with pytest.raises(InputError, match="above the floor"):  # in no posture does the whip hang free
        choose_wiggle(prior, rng=np.random.default_rng(0), keeps=(Clearance(MODEL, 5.0),), candidates=2, t_stay=0.1)


@pytest.fixture(scope="module")
def reachable(prior) -> tuple[Target, np.ndarray]:
    """A target as a strike of the mean within all limits passes it at its fastest, and that strike."""
    striker = Striker(CompiledRollout(prior.at().model, CONTROLLER, timestep=1e-3), limits=LIMITS)
    rng = np.random.default_rng(1)
    strikes = striker.admissible(rng.uniform(striker.lower, striker.upper, (32, len(striker.lower))))
    strike = strikes[striker.keep(strikes)][0]
    path = striker.rollout.trajectory(strike)
    velocity = np.gradient(path.tip, path.t, axis=0)
    fastest = int(np.linalg.norm(velocity, axis=1).argmax())
    return Target(tuple(path.tip[fastest]), 0.05, tuple(velocity[fastest]), speed=1.0), strike


@pytest.mark.slow
def test_an_aimed_strike_hits_within_the_limits(prior, reachable):
    """From a strike nearby; judged by a rollout of the belief's mean alone, and the limits over its whole length."""
    target, strike = reachable
    sure = dataclasses.replace(prior, covariance=1e-6 * prior.covariance, model_error=ModelError(1e-3, 10.0))
    past = [strike + 0.01 * np.random.default_rng(2).standard_normal(len(strike))]
    chosen = plan(sure, target, rng=np.random.default_rng(0), demands=Demands(limits=LIMITS), past=past, effort=FEW)
    assert chosen.allowed
    assert chosen.probability is not None
    assert chosen.probability > 0.9
    rollout = CompiledRollout(sure.at().model, CONTROLLER, timestep=2.5e-4)
    path = rollout.trajectory(Strike.from_vector(chosen.strike))
    near = path.approach(np.array(target.position))
    assert near.distance[0] < 0.02
    assert target.goals.arrives(near.velocity)[0]
    assert all(limits.violation(path) <= 0 for limits in LIMITS)


@pytest.mark.slow
def test_a_rope_in_space_is_hit_as_aimed_after_one_wiggle(prior, reachable):
    """Motion capture at 100/s with 2 mm; the strike that was known for the mean alone would miss this rope."""
    target, strike = reachable
    twin = dataclasses.replace(draw_twin("kin", 0, MODEL, CONTROLLER, STOCK), noise=0.002)
    truth = CompiledRollout(twin.model, CONTROLLER, timestep=2.5e-4)
    port = TipPort(twin, target, fps=100.0)
    assert truth.approach(strike[None], np.array(target.position)).distance[0] > 0.05
    effort = PlanningEffort(pool=256, polished=8, steps=20, whips=8, population=4, rounds=2)
    options = Options(max_strikes=1, wiggle=True, limits=LIMITS, first=effort, later=effort)
    adapter = Adapter(prior, target, options)
    while (asked := adapter.ask()) is not None:
        step = adapter.tell(port.strike(asked, adapter.number, None))
    near = truth.approach(np.array([step.plan.strike]), np.array(target.position))
    assert near.distance[0] < 0.05
    assert target.goals.arrives(near.velocity)[0]
    assert step.judged is not None
    assert step.judged.miss == pytest.approx(near.distance[0], abs=0.005)
    assert step.hit


def wiggles(count: int) -> list[Strike]:
    """Movements of the robot within its speeds, from one posture."""
    rng, q = np.random.default_rng(3), np.array([0.0, -1.8, 1.2, -1.0, -1.5, 0.0])
    return [Strike(tuple(q), tuple(q + rng.uniform(-0.5, 0.5, 6)), 0.6) for _ in range(count)]


def captured(plant: Plant, strike: Strike) -> StrikeRecording:
    """The tip of a rope by motion capture, 100 times a second with 2 mm."""
    rollout = CompiledRollout(plant.model, CONTROLLER, timestep=5e-4)
    t, paths, _ = rollout.tip_path(strike.vector[None], t_stay=0.3, rate=1000.0)
    at = np.arange(0, strike.D + 0.29, 0.01)
    points = np.stack([np.interp(at, t, x) for x in paths[0].T], axis=1)
    points += 0.002 * np.random.default_rng(0).standard_normal(points.shape)
    return StrikeRecording(at, points[:, None], ("tip",), sigma=np.array(0.002), strike=strike)


@pytest.mark.slow
@pytest.mark.parametrize("bead", [0.0, 0.008])
def test_a_bead_that_nobody_told_of_is_found_where_it_is(prior, bead):
    """8 g at 0.8 of the rope, from one movement, where it is expected at 0.6; of a rope without one none is found."""
    numbers = {"profile.bead_mass": bead, "profile.bead_place": 0.8, "whip.drag_ratio": 0.3}
    rope = prior.at().changed(numbers | {"profile.linear_density": 0.08})
    learned = update(prior, [captured(rope, wiggles(1)[0])])
    found, errors = learned.belief.values(), learned.belief.errors()
    assert next(iter(learned.rmse.values())) < 0.0025
    assert found["profile.bead_mass"] == pytest.approx(bead, abs=2 * errors["profile.bead_mass"])
    assert errors["profile.bead_mass"] < 0.003
    if bead:
        assert found["profile.bead_place"] == pytest.approx(0.8, abs=0.03)


@pytest.mark.slow
def test_a_rope_that_was_exchanged_and_labels_that_were_are_refused_and_do_no_harm():
    """What is believed afterwards, and so the next strike, is as if they had never been told."""
    belief = default_prior(MODEL, CONTROLLER, whip="uniform", stock=STOCK)
    first, other = (
        TipPort(dataclasses.replace(draw_twin("kin", seed, MODEL, CONTROLLER, STOCK), noise=0.002), (1.6, 0.0, 0.0))
        for seed in (0, 1)
    )
    seen = [port.strike(w, i, None).recording for i, (port, w) in enumerate(zip((first, first, other), wiggles(3)))]
    good, exchanged = [dataclasses.replace(x, target=None) for x in seen[:2] if x], seen[2]
    assert exchanged is not None
    handle = np.tile(np.array([0.9, 0.0, 0.5]), (len(good[1].t), 1))
    handle = handle + 0.002 * np.random.default_rng(1).standard_normal(handle.shape)
    points = np.stack([good[1].points[:, 0], handle], axis=1)
    points[30:] = points[30:, ::-1]
    swapped = StrikeRecording(
        good[1].t, points, ("tip", "handle"), sigma=np.array(0.002), strike=good[1].strike, source="swapped"
    )
    alone = update(belief, good, starts=1)
    both = update(belief, [*good, dataclasses.replace(exchanged, target=None), swapped], guess=alone.belief, starts=1)
    assert set(alone.rmse) == set(both.rmse) == {x.source for x in good}
    assert "a whip other than that of the other recordings" in both.refused[exchanged.source]
    assert "the label of the tip left its marker" in both.refused["swapped"]
    errors = np.array(list(alone.belief.errors().values()))
    np.testing.assert_allclose(both.belief.z, alone.belief.z, atol=0.2 * errors.min())
