"""The planner on a toy whip, whose tip passes where two linear maps say: probabilities and scores in closed form."""

from __future__ import annotations

import dataclasses
import types

import numpy as np
import pytest
from scipy.stats import norm

from whiptool.adaptation import plan_search, planner
from whiptool.adaptation.plan_search import Demands, Plan, PlanningEffort
from whiptool.adaptation.planner import FIRST, NEXT, UNSURE, PlanarSearch, plan
from whiptool.adaptation.prior import Belief
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.identification.plant import Plant
from whiptool.impedance import OIAC, Controller
from whiptool.limits.arm_limits import MotorLimits
from whiptool.limits.limits import Limits
from whiptool.models import preset
from whiptool.models.excess import Excess
from whiptool.models.strike import Strike, StrikeBounds
from whiptool.models.trajectory import Approach

PUSH = np.array([[0.3, -0.1, 0.4, 0.2, 0.0], [0.0, 0.2, -0.1, 0.5, 0.0]])  # of a strike's numbers on the tip [m]
LONGER = np.array([0.3, 0.4])  # of the logarithm of the whip's length [m]
BOUNDS = StrikeBounds((-1.0, 0.0, 0.0, 0.0, 0.5), (0.0, 1.0, 2.0, 1.0, 1.5))
WIDTH = np.array([1.0, 1.0, 2.0, 1.0, 1.0])
MODEL = preset("lemon2024")
LENGTH = MODEL.whip.length
MIDDLE = np.array([-0.5, 0.5, 1.0, 0.5, 1.0])
AT = PUSH @ MIDDLE
MOTOR = MotorLimits("toy", stall_torque=2.0, no_load_speed=10.0, stall_current=1.0)


class Toy:
    """`tip = PUSH u + LONGER log(length)`; torques `2 |q_i|`, none of them in motion; the tip at `4 D`."""

    rough = 0.0  # part of the tolerance by which the tip is off
    lost = np.inf  # length over the mean's, from which a whip diverges
    space, prescribed = types.SimpleNamespace(kind="joint"), False

    def __init__(self, model, controller, *, free, sag=None, tolerance=None) -> None:
        self.model, self.off = model, self.rough * (tolerance or 0.0)

    def approach(self, strikes, target, *, t_stay, models=None, controllers=None) -> Approach:
        models = [self.model] * len(strikes) if models is None else models
        stretch = np.array([m.whip.length for m in models]) / LENGTH
        tip = strikes @ PUSH.T + LONGER * np.log(stretch)[:, None] + [self.off, 0.0]
        B = len(strikes)
        return Approach(
            distance=np.linalg.norm(tip - target, axis=1),
            time=np.ones(B),
            velocity=np.outer(4 * strikes[:, 4], [0.6, 0.8]),
            tip=tip,
            max_joint_speed=np.zeros((B, 2)),
            max_torque=2 * np.abs(strikes[:, :2]),
            diverged=stretch > self.lost,
        )

    def trajectory(self, strike, *, t_stay):
        torque = 2 * np.abs(np.asarray(getattr(strike, "vector", strike))[None, :2])
        return types.SimpleNamespace(t=np.zeros(1), v=np.zeros((1, 2)), tau=torque, diverged=False)

    def trajectories(self, strikes, *, t_stay):
        return [self.trajectory(strike, t_stay=t_stay) for strike in strikes]

    def gradient(self, strikes, target, *, t_stay):
        near = self.approach(strikes, target, t_stay=t_stay)
        unit = (near.tip - target) / np.maximum(near.distance, 1e-12)[:, None]
        return near, unit @ PUSH


@pytest.fixture(autouse=True)
def toy(monkeypatch):
    monkeypatch.setattr(plan_search, "CompiledRollout", Toy)
    monkeypatch.setattr(Toy, "lost", np.inf)


def belief(error: float) -> Belief:
    plant = Plant(MODEL, Controller(OIAC()))
    return Belief(plant, ("whip.l",), np.log([plant.values()["whip.l"]]), np.array([[error**2]]))


def planned(
    error: float = 0.1, target: Target | None = None, seed: int = 0, effort: PlanningEffort = NEXT, past=(), **asked
) -> Plan:
    goal = target or Target(tuple(AT), 0.06, speed=asked.pop("speed", None))
    demands = Demands(**{"bounds": BOUNDS, **asked})
    return plan(belief(error), goal, rng=np.random.default_rng(seed), past=past, demands=demands, effort=effort)


def search(error: float = 0.1, limits=(), speed: float | None = None, radius: float = 0.06) -> PlanarSearch:
    return PlanarSearch(belief(error), Target(tuple(AT), radius, speed=speed), Demands(BOUNDS, limits))


def test_what_is_stated_is_simulated_finer_than_what_is_searched(monkeypatch):
    """The search ends where its own tip passes the target, which is a millimetre from where the tip passes."""
    monkeypatch.setattr(Toy, "rough", 1.0)
    found = planned(0.001)
    tip = PUSH @ found.strike
    assert found.mean_miss == pytest.approx(np.linalg.norm(tip - AT), abs=1e-12)
    assert found.mean_miss == pytest.approx(plan_search._SEARCHED, rel=0.1)


@pytest.mark.parametrize("error", [0.08, 0.16])
def test_probability_and_expected_miss_are_those_of_the_belief(error, monkeypatch):
    """The tip scatters along a line, 0.5 m for a factor of e in length, and the best strike is in its middle."""
    monkeypatch.setattr(planner, "JUDGED", 600)
    found = planned(error)
    assert found.probability is not None
    assert found.expected_miss is not None
    s = 0.5 * error
    assert found.probability == pytest.approx(norm.cdf(0.06, 0, s) - norm.cdf(-0.06, 0, s), abs=0.06)
    assert found.expected_miss == pytest.approx(s * np.sqrt(2 / np.pi), rel=0.1)
    assert found.mean_miss < 0.02
    assert found.allowed
    assert found.usage is None
    assert f"{found.probability:.0%} over 600 posterior samples" in found.reason
    assert f"expected miss {100 * found.expected_miss:.1f} cm, tip speed" in found.reason
    assert (np.array(found.strike) >= BOUNDS.lower).all()
    assert (np.array(found.strike) <= BOUNDS.upper).all()


def test_a_strike_that_arrives_along_another_direction_hits_with_no_probability():
    """The toy's tip moves along (0.6, 0.8) at 4 D; the point alone is hit almost surely."""
    sure = {"error": 0.02, "effort": PlanningEffort(whips=4, rounds=2)}
    along, across, fast = (
        planned(**sure, target=Target(tuple(AT), 0.06, **asked))
        for asked in ({"direction": (0.6, 0.8)}, {"direction": (-0.8, 0.6)}, {"direction": (0.6, 0.8), "speed": 5.0})
    )
    assert (along.probability, across.probability, fast.probability) == pytest.approx((1, 0, 1), abs=0.02)
    assert "0.0 degrees off the direction" in along.reason
    assert "90.0 degrees off the direction" in across.reason
    assert 4 * fast.strike[4] >= 5.0


def test_the_probability_is_stated_over_other_whips_than_those_that_chose(monkeypatch):
    drawn = []
    sample = Belief.sample
    monkeypatch.setattr(Belief, "sample", lambda self, rng, size: drawn.append(size) or sample(self, rng, size))
    planned(effort=PlanningEffort(whips=12))
    assert drawn == [12, 64]


def test_a_score_is_the_probability_less_a_fifth_per_metre_up_to_half_a_metre():
    s = search()
    whips = belief(0.1).sample(np.random.default_rng(0), 40)
    aside = MIDDLE + np.array([[0.02, 0.0], [0.3, 0.1], [3.0, 0.0]]) @ np.linalg.pinv(PUSH).T
    stretch = np.log([w.model.whip.length / LENGTH for w in whips])
    tips = aside @ PUSH.T
    miss = np.linalg.norm(tips[:, None] + stretch[:, None] * LONGER - AT, axis=2)
    np.testing.assert_allclose(s.each(aside, whips, s.rollout).distance, miss, atol=1e-9)
    hits = norm.cdf((0.06 - miss) / 0.005) - norm.cdf((-0.06 - miss) / 0.005)  # smoothed by 5 mm
    probability = s.each(aside, whips, s.rollout).probability(s.goal, s.error, blur=0.005)
    np.testing.assert_allclose(probability, hits.mean(axis=1), atol=1e-9)
    expected = hits.mean(axis=1) - 0.2 * np.minimum(miss, 0.5).mean(axis=1)
    np.testing.assert_allclose(s.score(aside, whips), expected, atol=1e-9)
    assert s.score(aside, whips)[2] == pytest.approx(-0.1)


def test_whips_that_diverge_miss_by_all_and_are_told():
    s, whips = search(), belief(0.1).sample(np.random.default_rng(0), 40)
    Toy.lost = 1.05
    lengths = np.array([w.model.whip.length / LENGTH for w in whips])
    miss = s.each(MIDDLE[None], whips, s.rollout).distance[0]
    np.testing.assert_array_equal(np.isinf(miss), lengths > 1.05)
    found = planned()
    share = 1 - norm.cdf(np.log(1.05) / 0.1)
    assert "of the samples that diverge" in found.reason
    told = float(found.reason.split(" of the samples that diverge")[0].split("the ")[-1].rstrip("%")) / 100
    assert told == pytest.approx(share, abs=0.12)
    assert found.expected_miss is not None
    assert found.expected_miss < 0.06
    Toy.lost = 0.0
    lost = planned()
    assert lost.expected_miss is None
    assert lost.probability == 0
    assert "all samples diverge" in lost.reason


def test_what_the_integration_does_not_resolve_hits_nothing(monkeypatch):
    """However near the tip seems to come, with the mean and with every whip."""
    sound = Toy.approach

    def unresolved(self, strikes, target, **options):
        return dataclasses.replace(
            sound(self, strikes, target, **options), integration_error=np.full(len(strikes), np.inf)
        )

    monkeypatch.setattr(Toy, "approach", unresolved)
    found = planned()
    assert (found.probability, found.expected_miss, found.misses) == (0, None, (None,) * len(found.misses))
    assert (search().rank(search().mean(MIDDLE[None])) == 1e3).all()


def test_what_the_motors_cannot_do_is_excess():
    """Torques of 2 |q_i| N m: the larger of them over 2 N m, less what is kept free, is beyond."""
    s = search(limits=(MOTOR,))
    strikes = MIDDLE + np.array([[0, 0, 0, 0, 0], [-0.5, 0, 0, 0, 0], [0.45, 0.5, 0, 0, 0]])
    near = s.mean(strikes)
    for margin, beyond in ((0.1, [0.0, 0.1, 0.1]), (0.6, [0.1, 0.6, 0.6])):
        s.margin = margin
        np.testing.assert_allclose(s.excess(near), beyond, atol=1e-12)
        distance = np.linalg.norm(strikes @ PUSH.T - AT, axis=1)
        behind = np.where(np.array(beyond) > 0, 10 + np.array(beyond), 0)
        np.testing.assert_allclose(s.rank(near), distance + behind, atol=1e-9)
        whips = belief(0.1).sample(np.random.default_rng(0), 4)
        np.testing.assert_allclose(s.score(strikes, whips), search().score(strikes, whips) - behind, atol=1e-9)
    assert not search().excess(near).any()


def test_what_is_too_slow_is_excess_by_its_share():
    s = search(speed=5.0)
    strikes = MIDDLE + np.array([[0, 0, 0, 0, -0.2], [0, 0, 0, 0, 0.25], [0, 0, 0, 0, 0.5]])  # 3.2, 5, 6 m/s
    np.testing.assert_allclose(s.excess(s.mean(strikes)), [1 - 3.2 / 5, 0, 0], atol=1e-12)
    both = search(limits=(MOTOR,), speed=5.0)
    strong = strikes + np.array([-0.5, 0, 0, 0, 0])
    np.testing.assert_allclose(both.excess(both.mean(strong)), [0.1 + 1 - 3.2 / 5, 0.1, 0.1], atol=1e-12)
    nowhere = np.full((1, 2), np.nan)
    lost = Approach(*(np.full(1, np.nan),) * 2, *(nowhere,) * 4, np.ones(1, bool))
    assert both.excess(lost)[0] == pytest.approx(1.0 + 10.0)
    assert search().rank(lost)[0] == 1e3


def test_a_polished_strike_goes_along_the_derivative_in_units_of_ranges():
    """One Gauss-Newton step `-d g / |g|^2` for small misses; at most a tenth of a range; never worse than before."""
    s = search()
    for offset in (np.array([0.02, 0.01]), np.array([-0.5, 0.6])):
        start = (MIDDLE + np.linalg.pinv(PUSH) @ offset)[None]
        (found,) = s.polish(start, 1)
        d = np.linalg.norm(offset)
        g = (offset / d) @ PUSH * WIDTH
        move = -d * g / (g @ g)
        move *= min(1.0, 0.1 / np.linalg.norm(move))
        stepped = np.clip(start[0] + move * WIDTH, BOUNDS.lower, BOUNDS.upper)
        before, after = (np.linalg.norm(PUSH @ x - AT) for x in (start[0], stepped))
        np.testing.assert_allclose(found, stepped if after < before else start[0], atol=1e-9)
    np.testing.assert_array_equal(s.polish(start, 0), start)
    (arrived,) = s.polish(start, 40)
    assert np.linalg.norm(PUSH @ arrived - AT) < 1e-3


def test_a_squeeze_finds_what_is_allowed():
    s = search(limits=(MOTOR,))
    s.margin = 0.6
    start = np.random.default_rng(0).uniform(BOUNDS.lower, BOUNDS.upper, (8, 5))
    start[:, 0] = -0.95
    found = s.squeeze(start, np.random.default_rng(1))
    rank = s.rank(s.mean(found))
    assert len(found) == 8
    assert (np.diff(rank) >= 0).all()
    assert rank[0] < 0.1
    done = np.tile(MIDDLE, (3, 1))
    s.margin = 0.1
    np.testing.assert_array_equal(s.squeeze(done, np.random.default_rng(1)), done)  # nothing to mend


def test_a_strike_that_misses_all_whips_by_a_quarter_of_the_radius_is_good_enough():
    s = search()
    enough = norm.cdf((0.06 - 0.015) / 0.005) - norm.cdf((-0.06 - 0.015) / 0.005) - 0.2 * 0.015
    assert s.sure(enough + 1e-9)
    assert not s.sure(enough - 1e-9)


def test_past_strikes_and_their_neighbours_are_candidates():
    effort = PlanningEffort(pool=1, polished=1, steps=0, whips=2, population=2, rounds=0)
    found = planned(1e-6, past=[tuple(MIDDLE)], effort=effort)
    np.testing.assert_allclose(found.strike, MIDDLE)
    assert found.reason.startswith("best of 10 candidates")
    assert planned(1e-6, effort=effort).reason.startswith("best of 1 candidates")


def test_neighbours_and_draws_scatter_by_parts_of_the_ranges():
    """Around past strikes 0.05 of a range, around the best 0.04."""
    s, whips = search(1e-6), belief(1e-6).sample(np.random.default_rng(0), 2)
    everything = PlanningEffort(pool=1, polished=999, steps=0, whips=2, population=2, rounds=0)
    strikes, _, number = s.look(np.random.default_rng(0), [tuple(MIDDLE)] * 60, everything, whips)
    assert number == 60 * 9 + 1
    around = (strikes[:number] - MIDDLE) / WIDTH
    around = around[np.abs(around).max(axis=1) > 0]
    np.testing.assert_allclose(np.sqrt((around[:-1] ** 2).mean(axis=0)), 0.05, rtol=0.15)
    one = PlanningEffort(pool=1, polished=1, steps=0, whips=2, population=300, rounds=1)
    strikes, scores, _ = s.look(np.random.default_rng(24), [], one, whips)
    draws = (strikes[-300:] - strikes[0]) / WIDTH
    np.testing.assert_allclose(draws.std(axis=0), 0.04, rtol=0.15)
    np.testing.assert_allclose(scores, s.score(strikes, whips))


def test_rounds_refine_over_the_samples():
    one = {"pool": 30, "polished": 1, "steps": 0, "whips": 8, "population": 16}
    misses = [planned(1e-6, effort=PlanningEffort(**one, rounds=rounds)).mean_miss for rounds in (0, 12)]
    assert misses[1] < min(0.02, misses[0])


def test_limits_speed_and_checks_are_obeyed_where_they_can_be():
    weak = MotorLimits("weak", stall_torque=1.2, no_load_speed=10.0, stall_current=1.0)  # |q_i| <= 0.54
    found = planned(0.05, limits=(weak,))
    assert planned(0.05, limits=weak).strike == found.strike  # one, or several
    assert found.usage is not None
    assert found.usage <= 0.9 + 1e-9
    assert found.usage == pytest.approx(2 * np.abs(found.strike[:2]).max() / 1.2)
    assert f"using {found.usage:.0%} of the motors' limits" in found.reason
    fast = planned(0.05, speed=5.5)
    assert 4 * fast.strike[4] >= 5.5
    assert fast.allowed
    beyond = planned(0.05, speed=7.0)  # 6 m/s is the most
    assert beyond.allowed  # it may be made, and teaches
    assert "no faster strike was found, although 7 m/s is required" in beyond.reason
    feeble = MotorLimits("feeble", stall_torque=0.1, no_load_speed=10.0, stall_current=1.0)
    none = planned(0.05, limits=(feeble,), bounds=StrikeBounds((-1.0, 0.2, 0.0, 0.0, 0.5), (-0.2, 1.0, 2.0, 1.0, 1.5)))
    assert not none.allowed
    assert none.usage is not None
    assert none.usage > 1
    said = f"using {none.usage:.0%} of the motors' limits; it must not be made, and none was found that may: "
    assert said in none.reason


def test_what_is_refused_leaves_more_of_the_motors_free():
    asked: list[float] = []

    def check(strike: Strike) -> str | None:
        asked.append(float(np.abs(strike.q_i).max()))
        return None if asked[-1] <= 0.72 else "too much"

    strong = Target(tuple(PUSH @ np.array([-0.85, 0.5, 1.0, 0.5, 1.0])), 0.06)
    found = planned(0.02, strong, limits=(MOTOR,), check=check)
    assert found.allowed
    assert np.abs(found.strike[:2]).max() <= 0.72
    never = planned(0.02, strong, limits=(MOTOR,), check=lambda strike: "never")
    assert not never.allowed
    without: list[Strike] = []
    planned(0.02, strong, check=lambda strike: without.append(strike) or "no")
    assert len(without) == planner.CHECKED + 3 * NEXT.polished  # the best, and others


class Reach(Limits):
    """The start of no joint is farther from 0 than this: known of a whole trajectory, not of peak values."""

    judges, by_peaks, words = "reach", False, "the reach"

    def __init__(self, farthest: float) -> None:
        self.farthest = farthest

    def violation_of_peaks(self, near: Approach) -> np.ndarray:
        return np.full(len(near.distance), -1.0)

    def violation(self, trajectory) -> float:
        return float(trajectory.tau.max()) / 2 - self.farthest

    def explain(self, trajectory, joints) -> Excess:
        return Excess("too far")


def test_a_strike_is_chosen_within_limits_of_whole_trajectories_too():
    """As where `check` refuses the same strikes, the next best aimed one is made and not a random one."""
    farthest = np.abs(planned(0.02, limits=(MOTOR,)).strike[:2]).max() - 1e-3  # less than the best one
    check = {"check": lambda strike: None if np.abs(strike.q_i).max() <= farthest else "too far"}
    checked, found = planned(0.02, limits=(MOTOR,), **check), planned(0.02, limits=(MOTOR, Reach(farthest)))
    assert found.allowed
    assert np.abs(found.strike[:2]).max() <= farthest
    assert "random" not in found.reason
    assert found.strike == checked.strike
    assert planned(0.02, limits=Reach(1.0)).usage is None  # of motors, which have no limits


def test_where_no_aimed_strike_may_be_made_a_random_one_is():
    """It is far from a hit, and keeps what the check asks."""

    def check(strike: Strike) -> str | None:
        return None if strike.q_i[0] > -0.3 else "too far back"

    aimed, found = planned(0.02), planned(0.02, limits=(MOTOR,), check=check)
    assert check(Strike.from_vector(aimed.strike)) is not None
    assert found.allowed
    assert check(Strike.from_vector(found.strike)) is None
    assert "must not be made" not in found.reason
    asked: list[Strike] = []

    def reluctant(strike: Strike) -> str | None:
        asked.append(strike)
        return "no" if len(asked) <= planner.CHECKED else None

    spared = planned(0.02, check=reluctant)
    assert spared.allowed
    assert spared.reason.endswith("a random strike, to learn from, because the best aimed one must not be made: no")


@pytest.mark.parametrize(
    ("looks", "best", "number"),
    [
        ([(0.4, True), (UNSURE, True), (0.9, True)], 1, 2),  # half sure is enough
        ([(0.4, True), (0.2, True), (0.3, True)], 0, 3),
        ([(0.2, True), (0.9, False), (None, True)], 0, 3),  # what is not allowed comes behind all else
        ([(None, True), (0.1, True), (0.3, True)], 2, 3),
    ],
)
def test_the_surest_of_several_searches_is_taken(looks, best, number, monkeypatch):
    asked = []

    def search(one: object, believed: object, rng: object, past: object, effort: PlanningEffort) -> Plan:
        asked.append((one, effort))
        probability, allowed = looks[len(asked) - 1]
        return Plan((float(len(asked)),), probability, None, None, None, "a strike", 100.0, allowed)

    monkeypatch.setattr("whiptool.adaptation.planner._searched", search)
    rng = np.random.default_rng(0)
    found = plan(belief(0.02), Target(1.2, 0.1), rng=rng, effort=NEXT, retries=[FIRST, FIRST], enough=UNSURE)
    assert found.strike == (best + 1.0,)
    assert [effort for _, effort in asked] == [NEXT, FIRST, FIRST][:number]
    assert len({id(one) for one, _ in asked}) == 1  # what does not depend on the effort is worked out once
    assert found.wall_time < 100.0  # of all searches, here of none


def test_efforts_are_checked():
    for name in ("pool", "polished", "whips"):
        with pytest.raises(InputError, match=name):
            PlanningEffort(**{name: 0})
        PlanningEffort(**{name: 1})
