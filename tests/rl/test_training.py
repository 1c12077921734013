"""Algorithm 1 on a tip that flies straight: what a learner is shown, when it explores, and what an episode tells."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from arrivals_by_hand import cost_by_hand, hit_by_hand
from fake_rollout import SPEED, StraightFlight, StraightFlightInSpace

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.zone import Disc
from whiptool.models.strike import StrikeBounds
from whiptool.rl.actor_critic import make_learner
from whiptool.rl.settings import TrainingPlan, settings_for
from whiptool.rl.task import StrikeTask, reward
from whiptool.rl.training import Training, load_checkpoint

BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 1.0), (1.0, 1.0, 0.3, 0.8, 2.0))
ZONE = Disc((1.0, 0.0), 0.5)


def training(plan: TrainingPlan, *, observation: str = "goal", strikes: int = 2, seed: int = 0) -> Training:
    task = StrikeTask(StraightFlight(), ZONE, bounds=BOUNDS, observation=observation, strikes=strikes)
    generator = torch.Generator().manual_seed(seed)
    settings = settings_for("ddpg", hidden=(4,), batch_size=4)
    return Training(make_learner("ddpg", settings, task, generator), task, plan)


class Watch:
    """Keeps what the learner is shown, and lets it learn nothing."""

    def __init__(self, run: Training) -> None:
        self.shown, self.updates, self.acted = [], [], []
        act = run.learner.act
        run.learner.learn = self.learn
        run.learner.act = lambda obs: self.acted.append(obs) or act(obs)

    def learn(self, new, *, update=True):
        self.shown.append(new)
        self.updates.append(update)
        return {"critic": 1.5}


def test_episodes_show_their_strikes_and_keep_their_targets():
    run = training(TrainingPlan(episodes=5, trials=30, random_episodes=2))
    watch, task, previous = Watch(run), run.task, None
    for number in range(1, 6):
        targets, obs = task.targets.copy(), run.obs.copy()
        diverged = task.n_diverged
        (episode,) = run.run(episodes=1)
        new = watch.shown[-1]
        strikes = task.to_strikes(new.action.numpy().astype(float))
        near = StraightFlight().approach(strikes, targets, t_stay=task.t_stay)
        distance = np.where(near.diverged, task.penalty, near.distance)
        hit = distance <= 0.06
        np.testing.assert_allclose(new.obs, task.normalise(obs), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(new.reward, reward(distance, distance <= 0.06), rtol=1e-5)
        np.testing.assert_array_equal(new.terminated, hit)
        seen = task.look(task.judge(strikes, task.as_goals(targets)), targets)
        np.testing.assert_allclose(new.next_obs, task.normalise(seen), rtol=1e-5, atol=1e-6)
        assert (episode.number, episode.strikes) == (number, 30 * number)
        assert episode.mean_reward == pytest.approx(reward(distance, distance <= 0.06).mean())
        assert episode.share_hit == hit.mean()
        assert episode.diverged == diverged + near.diverged.sum()
        assert episode.losses == {"critic": 1.5}
        truncated = ~hit & (np.zeros(30) if previous is None else previous).astype(bool)
        over = hit | truncated
        kept = np.all(task.targets == targets, axis=1)
        np.testing.assert_array_equal(kept, ~over)
        assert ZONE.contains(task.targets).all()
        np.testing.assert_allclose(run.obs[over], task.first_look(task.targets[over]))
        previous = ~over  # these lanes have one strike behind them
    assert watch.updates == [False, False, True, True, True]
    assert len(watch.acted) == 3
    explored = np.concatenate([new.action.numpy() for new in watch.shown[:2]])
    assert explored.min() < -0.9
    assert explored.max() > 0.9
    assert abs(explored.mean()) < 0.15
    assert run.run() == []


def test_runs_end_with_the_plan_the_number_or_the_time():
    run = training(TrainingPlan(episodes=6, trials=3, random_episodes=6))
    numbers = []
    run.run(lambda episode: numbers.append(episode.number), episodes=2)
    assert numbers == [1, 2]
    assert run.run(max_seconds=0.0) == []
    assert len(run.run(episodes=9)) == 4


def test_a_plan_says_what_it_allows():
    """The least of each number, and one less."""
    least = {"episodes": 1, "trials": 2, "random_episodes": 0, "hindsight": 0}
    for name, low in least.items():
        assert getattr(TrainingPlan(**{name: low}), name) == low
        with pytest.raises(InputError, match=name):
            TrainingPlan(**{name: low - 1})


def test_the_discount_is_that_of_the_observation():
    for observation, discount in (("goal", 0.0), ("tip", 0.99), ("relative", 0.99)):
        learner = training(TrainingPlan(), observation=observation).learner
        assert (learner.discount, learner.n_obs, learner.n_act) == (discount, 6 if discount == 0 else 4, 5)


def test_relabelled_strikes_are_those_of_the_straight_line():
    run = training(TrainingPlan(episodes=3, trials=40, random_episodes=3, hindsight=2))
    run.task.rollout.wild_above = 9.0
    before = run.task.reset(run.task.targets)
    added = []
    run.learner.replay.add = added.append
    run.run(episodes=1)
    *relabelled, struck = added
    assert len(relabelled) == 2
    strikes = run.task.to_strikes(struck.action.double().numpy())
    direction = StraightFlight().directions(strikes)
    hits = 0
    for new in relabelled:
        assert torch.equal(new.action, struck.action)
        targets = np.array(ZONE.centre) + ZONE.radius * new.obs[:, 4:].double().numpy()
        near = StraightFlight().approach(strikes, targets, t_stay=run.task.t_stay)
        distance = np.linalg.norm(near.tip - targets, axis=1)
        np.testing.assert_allclose(new.reward, reward(distance, distance <= 0.06), rtol=1e-3, atol=1e-3)
        np.testing.assert_array_equal(new.terminated, distance <= 0.06)
        after = np.hstack([near.tip, SPEED * direction, targets])
        np.testing.assert_allclose(new.next_obs, run.task.normalise(after), atol=2e-4)
        seen = np.hstack([before[:, :4], targets])
        np.testing.assert_allclose(new.obs, run.task.normalise(seen), atol=1e-5)
        hits += int(new.terminated.sum())
    assert hits > 20
    assert math.isfinite(float(struck.reward.mean()))


ASKED = [
    ArrivalRule(angle=(-1.2, 1.2), cone=0.2),
    ArrivalRule(direction=(2.0, 0.5), cone=0.5, speed=1.9),
    ArrivalRule(speed=2.5),
]


@pytest.mark.parametrize("rule", ASKED)
def test_relabelled_strikes_at_directions_are_judged_as_struck_ones(rule):
    """Their goals are read from what the learner is shown; hits, rewards and what is seen are computed by hand."""
    task = StrikeTask(StraightFlight(9.0), GoalRegion(ZONE, rule), bounds=BOUNDS)
    settings = settings_for("ddpg", hidden=(4,), batch_size=4)
    learner = make_learner("ddpg", settings, task, torch.Generator().manual_seed(0))
    run = Training(learner, task, TrainingPlan(episodes=3, trials=60, random_episodes=3, hindsight=2))
    before, added = run.obs.copy(), []
    run.learner.replay.add = added.append
    run.run(episodes=1)
    assert task.n_strikes == 60  # strikes at other goals are none
    *relabelled, struck = added
    strikes = task.to_strikes(struck.action.double().numpy())
    hits, places = 0, []
    for new in relabelled:
        assert torch.equal(new.action, struck.action)
        targets = np.array(ZONE.centre) + ZONE.radius * new.obs[:, 4:6].double().numpy()
        wanted = new.obs[:, 6:].double().numpy()
        assert wanted.shape[1] == (2 if rule.directed else 0)
        near = StraightFlight().approach(strikes, targets, t_stay=task.t_stay)
        flights = SPEED * StraightFlight().directions(strikes)
        for i in range(60):
            miss, direction = math.dist(near.tip[i], targets[i]), wanted[i] if rule.directed else None
            asked = (miss, flights[i], direction, 0.06, rule.cone, rule.speed)
            hit, cost = hit_by_hand(*asked), cost_by_hand(*asked)
            assert bool(new.terminated[i]) == hit
            gained = 50 if hit else (-5 if cost <= 0.1 else -10) * cost
            assert float(new.reward[i]) == pytest.approx(gained, rel=1e-3, abs=2e-3)
            hits += hit
        after = np.hstack([near.tip, flights, targets, wanted])
        np.testing.assert_allclose(new.next_obs, task.normalise(after), atol=2e-4)
        np.testing.assert_allclose(new.obs, task.normalise(np.hstack([before[:, :4], targets, wanted])), atol=1e-5)
        places.append(targets)
    assert not np.allclose(places[0], places[1])
    assert hits > 10 if rule.speed != 2.5 else hits == 0  # no flight is as fast as that


def test_a_training_at_directions_goes_on_from_its_checkpoint(tmp_path):
    def fresh(rule: ArrivalRule, seed: int = 1) -> Training:
        task = StrikeTask(StraightFlight(), GoalRegion(ZONE, rule), bounds=BOUNDS)
        settings = settings_for("sac", hidden=(8,), batch_size=8)
        learner = make_learner("sac", settings, task, torch.Generator().manual_seed(seed))
        return Training(learner, task, TrainingPlan(episodes=6, trials=10, random_episodes=2, hindsight=1))

    rule = ArrivalRule(angle=(-1.0, 1.0), speed=1.0)
    whole, first, second = fresh(rule), fresh(rule), fresh(rule, seed=7)
    episodes = whole.run()
    first.run(episodes=3)
    first.save(tmp_path / "checkpoint.pt")
    second.load(tmp_path / "checkpoint.pt")
    assert second.run() == episodes[3:]
    for name in ("positions", "directions"):
        np.testing.assert_array_equal(getattr(second.task.goals, name), getattr(whole.task.goals, name))
    np.testing.assert_array_equal(second.obs, whole.obs)
    with pytest.raises(InputError, match="arrival"):
        fresh(ArrivalRule(angle=(-1.0, 1.1), speed=1.0)).load(tmp_path / "checkpoint.pt")


def test_checkpoints_of_points_hold_what_they_always_held(tmp_path):
    run = training(TrainingPlan(episodes=2, trials=4, random_episodes=1))
    run.run()
    run.save(tmp_path / "checkpoint.pt")
    state = load_checkpoint(tmp_path / "checkpoint.pt")
    identity = {"plan", "learner_kind", "settings", "sizes"}
    assert set(state) == {*identity, "learner", "done", "obs", "targets", "counts", "strikes"}


def in_space(plan: TrainingPlan) -> Training:
    box = StrikeBounds((-0.5, 0.0, -0.5, *(0.1,) * 5, 0.4), (0.5, 1.0, 0.5, *(0.3,) * 5, 1.0))
    task = StrikeTask(StraightFlightInSpace(), Disc((1.0, 0.0, 0.2), 0.3), bounds=box, observation="goal")
    learner = make_learner("sac", settings_for("sac", hidden=(16,)), task, torch.Generator().manual_seed(4))
    return Training(learner, task, plan)


def test_a_training_in_space_goes_on_from_its_checkpoint(tmp_path):
    """With relabelled strikes: from the middle on the same episodes, and the same weights at the end."""
    plan = TrainingPlan(episodes=6, trials=20, random_episodes=2, hindsight=1)
    whole = in_space(plan)
    episodes = whole.run()
    first = in_space(plan)
    first.run(episodes=3)
    first.save(tmp_path / "checkpoint.pt")
    second = in_space(plan)
    second.load(tmp_path / "checkpoint.pt")
    assert second.run() == episodes[3:]
    for a, b in zip(whole.learner.actor.parameters(), second.learner.actor.parameters(), strict=True):
        assert torch.equal(a, b)
    assert (whole.learner.n_obs, whole.learner.n_act) == (9, 9)
    assert whole.task.zone.contains(whole.task.targets).all()
    plane = StrikeTask(StraightFlight(), ZONE, observation="goal")
    learner = make_learner("sac", settings_for("sac", hidden=(16,)), plane, torch.Generator().manual_seed(4))
    with pytest.raises(InputError, match="sizes"):
        Training(learner, plane, plan).load(tmp_path / "checkpoint.pt")
