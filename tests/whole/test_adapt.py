"""Learning an unknown whip: the belief narrows and covers, strikes hit, bad recordings do no harm, a run resumes."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from whiptool.adaptation import adapter, plan_search, planner, posterior
from whiptool.adaptation.adapter import OUTCOME, PLAN, POSTERIOR, Options
from whiptool.adaptation.first_look import FASTEST, choose_wiggle, information
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.model_error import NONE
from whiptool.adaptation.plan_search import Demands, Passes, Plan, PlanningEffort
from whiptool.adaptation.planner import plan
from whiptool.adaptation.ports import TipPort, truth_of
from whiptool.adaptation.posterior import update, usable
from whiptool.adaptation.prior import UNSEEN, Belief, default_prior, read_belief
from whiptool.adaptation.steps import Seen
from whiptool.adaptation.twins import FAMILIES, NODES, draw_twin
from whiptool.commands import adapt
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import ConstantImpedance, Controller, oiac_preset
from whiptool.impedance.controller import controller_to_table
from whiptool.limits.arm_limits import XM430
from whiptool.models.kinematics import joint_points
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
TARGET = (1.2, 0.1)
STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
QUICK = PlanningEffort(pool=96, polished=4, steps=4, whips=12, population=6, rounds=2)


@pytest.fixture(scope="module")
def prior() -> Belief:
    return default_prior(MODEL, CONTROLLER, whip="uniform")


@pytest.fixture(scope="module")
def first(prior):
    """A strike that is robust to the prior."""
    return plan(prior, Target(TARGET), rng=np.random.default_rng(0), effort=QUICK)


def sure() -> Belief:
    """That the whip is the model."""
    uniform = default_prior(MODEL, CONTROLLER, whip="uniform")
    return dataclasses.replace(uniform, covariance=1e-8 * uniform.covariance, model_error=NONE)


def port_of(seed: int, family: str = "kin") -> TipPort:
    return TipPort(draw_twin(family, seed, MODEL, CONTROLLER), TARGET)


def filmed(port: TipPort, strike: Strike, number: int = 1) -> StrikeRecording:
    recording = port.strike(strike, number, None).recording
    assert recording is not None
    return recording


def test_twins_are_drawn_by_seed():
    for family in FAMILIES:
        one, same, other = (draw_twin(family, seed, MODEL, CONTROLLER) for seed in (3, 3, 4))
        assert one == same
        assert one.model.whip != other.model.whip
        assert truth_of(one).model == one.model
    strange = draw_twin("strange", 0, MODEL, CONTROLLER)
    assert strange.model.whip.N == NODES
    assert 0.5 <= strange.model.whip.drag_ratio <= 0.8
    for name in ("m", "k", "b", "dry_friction", "drag", "cubic_stiffness"):
        assert len(set(np.round(strange.model.whip.per_node(name)[1:], 12))) > 1
        assert (strange.model.whip.per_node(name)[1:] > 0).all()
    assert strange.controller != CONTROLLER
    assert draw_twin("strange", 1, MODEL, Controller(ConstantImpedance())).controller.law != ConstantImpedance()


def test_stranger_deviates_twice_as_much():
    for seed in range(5):
        strange, stranger = (draw_twin(family, seed, MODEL, CONTROLLER) for family in ("strange", "stranger"))
        one, two = (1 - x.model.whip.drag_ratio for x in (strange, stranger))
        assert two == pytest.approx(2 * one)
        assert stranger.clock_offset == pytest.approx(2 * strange.clock_offset)
        assert abs(strange.clock_offset) <= 0.008


def test_belief_in_and_out_of_a_table_and_a_file(prior, tmp_path):
    again = Belief.from_table(prior.plant, json.loads(json.dumps(prior.to_table())))
    assert again.names == prior.names
    np.testing.assert_array_equal(again.z, prior.z)
    file = tmp_path / "prior.toml"
    file.write_text('"profile.length" = {value = 0.9, error = 0.05}\n"profile.drag" = {value = 0.002, error = 0}\n')
    given = read_belief(str(file), MODEL, CONTROLLER)
    assert given.values()["profile.length"] == pytest.approx(0.9)
    assert given.errors()["profile.length"] == pytest.approx(0.05)
    assert "profile.drag" not in given.names
    assert given.plant.values()["profile.drag"] == 0.002
    lengths = [np.log(p.model.whip.length) for p in given.sample(np.random.default_rng(0), 200)]
    assert np.std(lengths) == pytest.approx(0.05, rel=0.2)
    assert np.mean(lengths) == pytest.approx(np.log(0.9), abs=1e-6)


def test_belief_narrows_and_covers(prior, first):
    """Errors of what was learned, in standard errors: no larger than they should be."""
    strikes = (Strike.from_vector(first.strike), STRIKE)
    squares = []
    for seed in range(4):
        port = port_of(seed)
        found = [filmed(port, strike, number) for number, strike in enumerate(strikes, 1)]
        learned = update(prior, found, starts=2)
        truth = port.twin.model.parameters() | {"delay": 0.0}
        belief = learned.belief
        assert not learned.refused
        assert np.linalg.slogdet(belief.covariance)[1] < np.linalg.slogdet(prior.covariance)[1] - 5
        before, after = prior.errors(), belief.errors()
        assert all(after[name] <= 1.01 * before[name] for name in belief.names)
        assert after["whip.l"] < 0.01
        z = np.array([v.z(max(truth[v.name], 1e-12)) for v in belief.variables])
        off = z - belief.z
        squares.append(off @ np.linalg.solve(belief.covariance, off) / len(off))
    assert np.mean(squares) < 2.5


@pytest.mark.parametrize("seed", [0, 1, 2, 5])
def test_a_kin_whip_is_hit(prior, first, seed):
    options = Options(max_strikes=3, starts=2, still=False, first=QUICK, later=QUICK)
    steps = Adaptation(prior, port_of(seed), Target(TARGET), options).run()
    assert steps[-1].hit
    assert all(0 <= step.plan.probability <= 1 for step in steps)


def handle_path(recording, twin):
    path = CompiledRollout(twin.model, twin.controller).trajectory(recording.strike, t_stay=0.3)
    at = joint_points(twin.model, path.q)[:, twin.model.arm.n]
    return np.stack([np.interp(recording.t, path.t, at[:, i]) for i in range(2)], axis=1)


def spoilt(recording, twin, how: str):
    points = recording.points.copy()
    if how == "lost":
        points[::2] = points[1::4] = np.nan
    elif how == "marker":
        points[:, 0] = handle_path(recording, twin)
    else:
        c, s = np.cos(0.2), np.sin(0.2)
        points = points @ np.array([[c, s], [-s, c]]) + [0.05, -0.1]
    return dataclasses.replace(recording, points=points, source="spoilt")


@pytest.mark.slow
@pytest.mark.parametrize(("how", "said"), [("lost", "lost in"), ("marker", "marker"), ("pose", "camera was turned")])
def test_bad_recordings_do_not_send_the_next_strike_astray(prior, first, how, said):
    port = port_of(1)
    good = filmed(port, Strike.from_vector(first.strike))
    bad = spoilt(filmed(port, STRIKE, 2), port.twin, how)
    alone, both = update(prior, [bad], starts=2), update(prior, [good, bad], starts=2)
    assert said in alone.refused["spoilt"]
    np.testing.assert_array_equal(alone.belief.z, prior.z)
    assert set(both.refused) == {"spoilt"}
    chosen = plan(both.belief, Target(TARGET), rng=np.random.default_rng(1), effort=QUICK)
    miss = port.strike(Strike.from_vector(chosen.strike), 3, None).true_miss
    assert miss is not None
    assert miss < 0.06


@pytest.mark.slow
def test_a_recording_of_another_whip_is_refused(prior, first):
    strike = Strike.from_vector(first.strike)
    good = [filmed(port_of(1), strike), filmed(port_of(1), STRIKE, 2)]
    other = dataclasses.replace(filmed(port_of(3), STRIKE, 3), source="another")
    learned = update(prior, [*good, other], starts=2)
    assert set(learned.refused) == {"another"}
    assert "a whip other than" in learned.refused["another"]


def test_only_the_tip_until_shortly_after_the_closest_approach_is_used(first):
    recording = filmed(port_of(0), Strike.from_vector(first.strike))
    cut, reason = usable(recording)
    assert cut is not None
    assert not reason
    last = recording.t[np.flatnonzero(cut.seen[:, 0])[-1]]
    nearest = recording.t[np.hypot(*(recording.points[:, 0] - TARGET).T).argmin()]
    assert nearest <= last <= nearest + 0.1
    planned, _ = usable(recording, nearest + 0.15)
    earlier, _ = usable(recording, nearest - 0.15)
    assert planned is not None
    assert earlier is not None
    assert recording.t[np.flatnonzero(planned.seen[:, 0])[-1]] == pytest.approx(
        nearest + 0.15 + posterior.AFTER, abs=0.02
    )
    np.testing.assert_array_equal(earlier.seen, cut.seen)
    with pytest.raises(InputError, match="tip"):
        usable(dataclasses.replace(recording, markers=("handle",)))


def test_at_rest_all_frames_are_one():
    """Their median, nearly as sure as what no model explains allows; a target that noise comes near to cuts nothing."""
    resting = filmed(port_of(0), Strike((-0.9, 1.4), (-0.9, 1.4), 0.5))
    points = resting.points.copy()
    points[7] += 1.0  # tracked elsewhere
    for target in (None, tuple(resting.points[0, 0])):
        cut, _ = usable(dataclasses.replace(resting, points=points, target=target))
        assert cut is not None
        [[x, y]] = cut.points[cut.seen[:, 0], 0]
        np.testing.assert_allclose([x, y], resting.points[:, 0].mean(axis=0), atol=0.002)
        assert posterior.UNMODELLED < cut.sigma.max() < 1.1 * posterior.UNMODELLED
    lost = points.copy()
    lost[5:] = np.nan
    assert usable(dataclasses.replace(resting, points=lost))[0] is None


@pytest.mark.slow
def test_a_whip_at_rest_is_no_measure_for_one_that_moves():
    """A uniform whip explains how a stranger hangs to the millimetre, and how it moves to some centimetres."""
    uniform, port = default_prior(MODEL, CONTROLLER, whip="uniform"), port_of(1, "stranger")
    resting = filmed(port, Strike((-0.9, 1.4), (-0.9, 1.4), 0.5), 0)
    moving = filmed(port, STRIKE)
    alone, both = update(uniform, [moving], starts=1), update(uniform, [resting, moving], starts=1)
    assert alone.rmse[moving.source] > posterior.TOO_FAR / 2
    assert set(both.rmse) == {resting.source, moving.source}
    assert both.belief.model_error.scale == pytest.approx(alone.belief.model_error.scale, rel=0.5)
    assert update(uniform, [resting]).belief.model_error == UNSEEN


def test_perfect_frames_do_not_make_sure(prior):
    """Residuals say when stated errors are too small, never that they are too large."""
    port = port_of(1)
    noisy = filmed(port, STRIKE)
    port.twin = dataclasses.replace(port.twin, noise=1e-6)
    perfect = dataclasses.replace(filmed(port, STRIKE), sigma=noisy.sigma)
    one, two = (update(prior, [recording], starts=1).belief.errors() for recording in (noisy, perfect))
    ratio = [two[name] / one[name] for name in prior.names]
    assert min(ratio) > 0.7


def test_limits_are_kept_where_they_can_be(prior):
    """Slow strikes only: the motors are weak."""
    kinder = dataclasses.replace(XM430, stall_torque=12.0, no_load_speed=30.0)
    rng = np.random.default_rng(0)
    chosen = plan(prior, Target(TARGET), rng=rng, effort=QUICK, demands=Demands(limits=(kinder,)))
    near = CompiledRollout(MODEL, CONTROLLER).approach(np.array([chosen.strike]), np.array(TARGET), t_stay=0.3)
    assert chosen.usage is not None
    assert chosen.usage <= 1
    assert kinder.violation_of_peaks(near)[0] < 0.1  # of the nominal whip, nearly the mean
    assert "of the motors' limits" in chosen.reason


@pytest.mark.slow
def test_where_every_strike_is_refused_more_of_the_motors_is_kept_free(prior):
    """As by a rehearsal that sees more of a strike than its largest speed and torque."""
    kinder = dataclasses.replace(XM430, stall_torque=6.0, no_load_speed=8.0)
    rollout, asked = CompiledRollout(MODEL, CONTROLLER), []

    def usage_of(strike: Strike) -> float:
        near = rollout.approach(strike.vector[None], np.array(TARGET), t_stay=0.3)
        return 1 + float(kinder.violation_of_peaks(near)[0])

    def check(strike: Strike) -> str | None:
        asked.append(usage_of(strike))
        return None if asked[-1] < 0.75 else "too much"

    known = sure()
    plans = [
        plan(known, Target(TARGET), rng=np.random.default_rng(0), effort=QUICK, demands=asked)
        for asked in (Demands(limits=(kinder,)), Demands(limits=(kinder,), check=check))
    ]
    free, checked = (usage_of(Strike.from_vector(p.strike)) for p in plans)
    assert free > 0.75 > checked
    assert asked[0] > 0.75 > asked[-1]  # refused, then found with more kept free
    assert plans[1].probability == pytest.approx(1.0, abs=0.01)
    never = Demands(limits=(kinder,), check=lambda s: "never")
    refused = plan(known, Target(TARGET), rng=np.random.default_rng(0), effort=QUICK, demands=never)
    assert usage_of(Strike.from_vector(refused.strike)) == pytest.approx(free)  # then the best of all
    assert [p.allowed for p in (*plans, refused)] == [True, True, False]


def test_a_strike_that_surely_hits_is_still_aimed_at_the_middle(prior, monkeypatch):
    """Over samples that differ a little all strikes hit; the one that misses least is worth more rounds."""
    sure = dataclasses.replace(prior, covariance=0.01 * prior.covariance, model_error=NONE)
    effort = dataclasses.replace(QUICK, pool=16, polished=1, steps=0, rounds=12)

    def expected() -> float:
        found = plan(sure, Target(TARGET, 0.2), rng=np.random.default_rng(0), effort=effort)
        assert found.probability == pytest.approx(1.0)
        assert found.expected_miss is not None
        return found.expected_miss

    aimed = expected()
    monkeypatch.setattr(plan_search, "SURE", 1e9)  # content with the first that hits
    assert aimed < min(0.05, expected())


def test_an_allowed_strike_goes_before_a_surer_one(prior, monkeypatch):
    """A second, harder search follows a doubtful plan; what the rig would refuse is no gain."""
    doubtful = Plan(tuple(STRIKE.vector), 0.4, 0.1, 0.1, 1.2, "", 1.0, allowed=False)
    found = iter([doubtful, dataclasses.replace(doubtful, probability=0.3, usage=0.8, allowed=True)])
    monkeypatch.setattr("whiptool.adaptation.planner._searched", lambda *_: next(found))
    options = Options(max_strikes=1, first=QUICK, later=dataclasses.replace(QUICK, pool=90))
    (step,) = Adaptation(prior, port_of(5), Target(TARGET), options, known=prior).run()
    assert step.plan.allowed
    assert step.plan.probability == 0.3


def test_earlier_strikes_of_another_compensation_are_refused(first, tmp_path):
    recording = filmed(port_of(5), Strike.from_vector(first.strike))
    options = adapt.AdaptOptions(target=TARGET, port="twin", camera="points", known=(str(tmp_path / "old.npz"),))
    own = adapt.prepare(dataclasses.replace(options, known=())).prior.plant.controller
    assert own is not None
    for masses in ((0.25, 0.274, 0.2), own.compensated, None):
        table = controller_to_table(dataclasses.replace(own, compensated=masses))
        dataclasses.replace(recording, controller=table).save(tmp_path / "old.npz")
        if masses in (own.compensated, None):
            assert len(adapt.prepare(options).recordings) == 1
            continue
        with pytest.raises(InputError, match=r"--known .*0.2.*model and --controller that it was struck with"):
            adapt.prepare(options)


class Rehearsed:
    """A port that keeps what it is told of the whip, and refuses the first strike."""

    def __init__(self, port: TipPort) -> None:
        self.port, self.believed = port, []

    def strike(self, strike: Strike, number: int, folder, believed=None) -> Seen:
        self.believed.append(believed)
        if number == 1:
            return Seen(None, None, refused="too fast")
        return self.port.strike(strike, number, folder)


@pytest.mark.slow
def test_a_rig_rehearses_with_the_whip_that_is_believed(prior):
    port, checked = Rehearsed(port_of(6)), []
    options = Options(
        max_strikes=3,
        stop_at=0.0,
        still=False,
        starts=1,
        first=QUICK,
        later=QUICK,
        check=lambda s, b: checked.append(b),
    )
    steps = Adaptation(prior, port, Target(TARGET), options).run()
    assert port.believed == checked
    assert port.believed[:2] == [prior.at().model] * 2
    assert steps[1].learned is not None
    assert port.believed[2] == steps[1].learned.belief.at().model
    truth, nominal = port.port.twin.model.whip.length, MODEL.whip.length
    assert abs(port.believed[2].whip.length - truth) < 0.1 * abs(nominal - truth)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_a_whip_that_hangs_shows_its_length(family):
    """Which is what a first strike misses by; it is planned as by default."""
    belief, options = default_prior(MODEL, CONTROLLER), Options(max_strikes=1, still=True)
    hits, stated = 0, 0.0
    for seed in range(3):
        look, strike = Adaptation(belief, port_of(seed, family), Target(TARGET), options).run()
        assert look.number == 0
        assert look.learned is not None
        assert look.outcome.recording is not None
        assert look.outcome.recording.target is None  # lest only the frames before the closest approach count
        frames = np.ptp(look.outcome.recording.points, axis=0)
        assert frames.max() < 0.05  # noise alone
        truth = draw_twin(family, seed, MODEL, CONTROLLER).model.whip.length
        learned, error = (x["profile.length"] for x in (look.learned.belief.values(), look.learned.belief.errors()))
        assert learned == pytest.approx(truth, abs=3 * error)
        assert error < 0.1 * belief.errors()["profile.length"]
        assert strike.outcome.true_miss is not None
        assert strike.plan.probability is not None
        hits, stated = hits + (strike.outcome.true_miss < 0.06), stated + strike.plan.probability
    assert stated > 2.5
    assert hits >= (stated - 1 if family == "stranger" else 3)


@pytest.mark.slow
def test_when_a_look_is_taken(prior):
    """Before a first strike; a movement instead where it is asked for; none where there is nothing to learn."""
    port, target = port_of(3), Target(TARGET)

    def numbers(**changes) -> tuple[int, ...]:
        known = changes.pop("recordings", [])
        options = Options(max_strikes=1, first=QUICK, later=QUICK, **changes)
        return tuple(s.number for s in Adaptation(prior, port, target, options, recordings=known).run())

    assert numbers() == numbers(still=False, wiggle=True) == numbers(wiggle=True) == (0, 1)
    assert numbers(still=False) == numbers(adapt=False) == (1,)
    assert numbers(recordings=[filmed(port, STRIKE)]) == (1,)


@pytest.mark.slow
def test_a_look_alone_does_not_count_as_having_struck(prior, monkeypatch):
    """Where the first strike is refused, the second is planned as hard as the first; then one has taught."""
    efforts, port, target = [], port_of(3), Target(TARGET)
    sought = adapter.plan

    def counted(*args, **named):
        efforts.append(named["effort"])
        return sought(*args, **named)

    monkeypatch.setattr(adapter, "plan", counted)

    class Refuses:
        def strike(self, strike, number: int, folder, believed=None) -> Seen:
            return Seen(None, None, refused="no") if number == 1 else port.strike(strike, number, folder)

    later = dataclasses.replace(QUICK, rounds=1)
    options = Options(max_strikes=3, stop_at=0.0, still=True, first=QUICK, later=later)
    steps = Adaptation(prior, Refuses(), target, options).run()
    assert [step.number for step in steps] == [0, 1, 2, 3]
    assert efforts == [QUICK, QUICK, later]


def test_the_wiggle_is_slow_and_tells_much(prior):
    rng = np.random.default_rng(0)
    chosen, told = choose_wiggle(prior, rng=rng, candidates=16)
    some, fastest, _ = information(prior, np.array([chosen.vector, [-1.0, 1.0, -0.9, 1.0, 0.8]]))
    assert fastest[0] <= FASTEST
    assert told == pytest.approx(some[0])
    assert some[0] > some[1] > 0


class Struck(Exception):
    """The run is killed here."""


class Killed:
    """A port that is killed before its second strike."""

    def __init__(self, port: TipPort) -> None:
        self.port = port

    def strike(self, strike: Strike, number: int, folder, believed=None) -> Seen:
        if number == 2:
            raise Struck
        return self.port.strike(strike, number, folder)


def test_a_killed_run_goes_on_as_if_it_had_not_been(prior, tmp_path):
    options = Options(max_strikes=2, stop_at=0.0, starts=1, still=False, first=QUICK, later=QUICK)
    target, port = Target(TARGET), port_of(6)
    whole = Adaptation(prior, port, target, options, tmp_path / "whole").run()
    with pytest.raises(Struck):
        Adaptation(prior, Killed(port), target, options, tmp_path / "killed").run()
    resumed = Adaptation(prior, port, target, options, tmp_path / "killed").run()
    assert [s.plan.strike for s in resumed] == [s.plan.strike for s in whole]
    assert [s.judged for s in resumed] == [s.judged for s in whole]
    one, two = resumed[-1].learned, whole[-1].learned
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.belief.z, two.belief.z)
    for name in (PLAN, OUTCOME, POSTERIOR, "recording.npz"):
        assert (tmp_path / "killed/strike-0002" / name).exists()
    (tmp_path / "killed/strike-0001" / PLAN).write_text("{")
    with pytest.raises(InputError, match=PLAN.replace(".", r"\.")):
        Adaptation(prior, port, target, options, tmp_path / "killed").run()


class Liar:
    """A port whose twin claims to have missed by 9 m, and whose camera by 1 m."""

    def __init__(self, port: TipPort, *, films: bool) -> None:
        self.port, self.films = port, films

    def strike(self, strike: Strike, number: int, folder, believed=None) -> Seen:
        seen = self.port.strike(strike, number, folder)
        return Seen(seen.recording if self.films else None, 1.0, 9.0)


def test_a_hit_is_judged_from_what_was_seen(prior):
    """By the learned whip and the frames, or by what the camera tells alone; never by a twin's truth."""
    options = Options(max_strikes=1, still=False, first=QUICK)
    (honest,) = Adaptation(prior, port_of(5), Target(TARGET), options).run()
    (filmed_,) = Adaptation(prior, Liar(port_of(5), films=True), Target(TARGET), options).run()
    (blind,) = Adaptation(prior, Liar(port_of(5), films=False), Target(TARGET), options).run()
    assert honest.judged is not None
    assert filmed_.judged == honest.judged
    assert honest.judged.miss == pytest.approx(honest.outcome.true_miss, abs=0.01)
    assert honest.judged.error < 0.01
    assert blind.judged is not None
    assert (blind.judged.miss, blind.judged.probability, blind.hit) == (1.0, 0.0, False)


@pytest.mark.slow
def test_a_fast_tip_can_be_asked_for(prior):
    rng = np.random.default_rng(0)
    for speed in (5.0, 14.0):
        chosen = plan(prior, Target(TARGET, speed=speed), rng=rng, effort=QUICK)
        near = CompiledRollout(prior.at().model, CONTROLLER).approach(
            np.array([chosen.strike]), np.array(TARGET), t_stay=0.3
        )
        assert near.speed[0] >= speed * 0.999
    assert "no faster strike" in plan(prior, Target(TARGET, speed=1e3), rng=rng, effort=QUICK).reason


def test_whips_that_diverge_are_counted_not_averaged(prior, monkeypatch):
    def half(self, strikes, whips, rollout) -> Passes:
        distance = np.tile([0.1, np.inf], (len(strikes), len(whips) // 2))
        return Passes(distance, np.zeros((*distance.shape, 2)))

    monkeypatch.setattr(planner.PlanarSearch, "each", half)
    chosen = plan(prior, Target(TARGET), rng=np.random.default_rng(0), effort=QUICK)
    assert chosen.expected_miss == pytest.approx(0.1)
    assert "expected miss 10.0 cm without the 50% of the samples that diverge" in chosen.reason


def test_repeating_the_first_strike_is_the_baseline(prior):
    options = Options(max_strikes=2, stop_at=0.0, adapt=False, first=QUICK)
    steps = Adaptation(prior, port_of(1), Target(TARGET), options).run()
    assert steps[0].plan.strike == steps[1].plan.strike
    assert steps[1].learned is None


@pytest.mark.parametrize(
    "line",
    ['"odd" = {value = 1, error = 1}', '"whip.k" = 3', '"whip.k" = {value = 1, error = -1}', "odd"],
)
def test_a_bad_prior_is_refused(line, tmp_path):
    file = tmp_path / "prior.toml"
    file.write_text(line)
    with pytest.raises(InputError):
        read_belief(str(file), MODEL, CONTROLLER, whip="uniform")


@pytest.mark.slow
def test_a_fit_that_two_starts_led_to_is_not_sought_again(prior, first, monkeypatch):
    """Frames that no whip explains: the errors are said to be half of what they are."""
    fits, fit = [], posterior.fit

    def counted(*args, **more):
        fits.append(fit(*args, **more))
        return fits[-1]

    monkeypatch.setattr(posterior, "fit", counted)
    monkeypatch.setattr(posterior, "STARTS", dataclasses.replace(posterior.STARTS, near=0.0))
    monkeypatch.setattr(posterior, "UNMODELLED", 1e-5)
    recording = filmed(port_of(5), Strike.from_vector(first.strike))
    sharp = dataclasses.replace(recording, sigma=recording.sigma / 2)
    learned = update(prior, [sharp], starts=3)
    assert len(fits) == 4  # of all frames; of half of them, of three quarters, of all
    assert learned.rmse
    costs = [f.runs[0].solution.cost for f in fits]
    assert costs[3] == pytest.approx(costs[0], abs=posterior.STARTS.same)
    # then two near starts prove nothing
    monkeypatch.setattr(posterior, "STARTS", dataclasses.replace(posterior.STARTS, valley=1e-3))
    update(prior, [sharp], starts=3)
    assert len(fits) == 4 + 10
    del fits[4:]
    monkeypatch.setattr(posterior, "STARTS", dataclasses.replace(posterior.STARTS, valley=1.0))
    monkeypatch.setattr(posterior, "STARTS", dataclasses.replace(posterior.STARTS, same=-1.0))
    update(prior, [sharp], starts=3)
    assert len(fits) == 4 + 10
    monkeypatch.setattr(posterior, "STARTS", dataclasses.replace(posterior.STARTS, near=0.01))
    update(prior, [sharp], starts=3)
    assert len(fits) == 4 + 10 + 1
