"""A policy at work on a tip that flies straight: which strikes are asked of it, and what is counted."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import torch
from checkpoints import same
from fake_rollout import StraightFlight
from scripted import Scripted

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion, sample_goals
from whiptool.goals.target import Target
from whiptool.goals.zone import Disc
from whiptool.models.strike import StrikeBounds
from whiptool.rl import training
from whiptool.rl.actor_critic import make_learner
from whiptool.rl.policy import EVERY, GOALS, Policy, Score, held_out_goals, score, trials_to_hit
from whiptool.rl.settings import TrainingPlan, settings_for
from whiptool.rl.task import StrikeTask
from whiptool.rl.training import Training, load_checkpoint

BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 1.0), (1.0, 0.5, 0.3, 0.8, 2.0))


@pytest.mark.parametrize(
    ("convention", "means", "trials", "hit"),
    [
        ("mean-first", [True, False, False, False], [1, 3, 4], [True, True, False]),
        ("samples", [False, False, False, False], [4, 2, 4], [False, True, False]),
        ("mean", [True, True], [1, 4, 4], [True, False, False]),
    ],
)
def test_trials_until_the_first_hit(convention, means, trials, hit):
    """Targets ahead, at 0.5 rad, and at 0.9 rad, with samples at -0.3, 0.5, 0.2, -0.8 rad."""
    task = StrikeTask(StraightFlight(), GoalRegion(Disc((0.8, 0.2), 1.0), hit_radius=0.05), bounds=BOUNDS)
    targets = np.array([[1.0, 0.0], [np.cos(0.5), np.sin(0.5)], [np.cos(0.9), np.sin(0.9)]])
    learner = Scripted(task, [-0.3, 0.5, 0.2, -0.8])
    ended: list[int] = []
    found, reached = trials_to_hit(
        learner,
        task,
        targets,
        cap=4,
        convention=convention,
        on_trial=ended.append,
    )
    assert found.tolist() == trials
    assert reached.tolist() == hit
    assert [deterministic for deterministic, _ in learner.asked] == means
    np.testing.assert_allclose(learner.asked[0][1], task.normalise(task.first_look(targets)), rtol=1e-6)
    left = [len(obs) for _, obs in learner.asked]
    assert left == {"mean-first": [3, 2, 2, 1], "samples": [3, 3, 2, 2], "mean": [3, 2]}[convention]
    assert ended == [*(3 - n for n in left[1:]), 3]
    last = learner.asked[-1][1]
    centre = np.array([0.8, 0.2])
    np.testing.assert_allclose(last[-1, 4:], targets[2] - centre, rtol=1e-5)  # it sees the target that is left


def test_a_policy_that_repeats_itself_is_rolled_out_once():
    """The mean is always straight ahead: at two targets beside it one strike each is rolled out, of 600."""
    rollout = StraightFlight()
    task = StrikeTask(rollout, GoalRegion(Disc((0.8, 0.2), 1.0), hit_radius=0.05), bounds=BOUNDS)
    targets, ended = np.array([[1.0, 0.0], [1.0, 0.3], [0.9, 0.4]]), []
    found = trials_to_hit(Scripted(task, []), task, targets, cap=600, convention="mean", on_trial=ended.append)
    assert (found[0].tolist(), found[1].tolist()) == ([1, 600, 600], [True, False, False])
    assert (rollout.rolled, ended) == ([3], [1, 3])


def test_a_policy_that_goes_round_in_a_circle_is_rolled_out_once_around():
    """Its mean is 0.3, 0.4, 0.5 rad by turns at the first target; at the second it hits with the third."""

    class Circling(Scripted):
        def act(self, obs, *, deterministic=False):
            self.asked.append((deterministic, obs.numpy().copy()))
            actions = np.zeros((len(obs), 5))
            actions[:, 0] = (0.3, 0.4, 0.5)[(len(self.asked) - 1) % 3]
            return torch.as_tensor(actions)

    rollout = StraightFlight()
    task = StrikeTask(rollout, GoalRegion(Disc((0.8, 0.2), 1.0), hit_radius=0.02), bounds=BOUNDS)
    targets, struck = np.array([[1.0, 0.0], [np.cos(0.5), np.sin(0.5)]]), []
    found = trials_to_hit(
        Circling(task, []),
        task,
        targets,
        cap=50,
        convention="mean",
        on_strikes=lambda lanes, _: struck.append([*lanes]),
    )
    assert (found[0].tolist(), found[1].tolist()) == ([50, 3], [False, True])
    assert rollout.rolled == [2, 2, 2]
    assert struck == [[0, 1]] * 3


def test_it_ends_when_everything_is_hit():
    task = StrikeTask(StraightFlight(), GoalRegion(Disc((0.8, 0.2), 1.0), hit_radius=0.05), bounds=BOUNDS)
    learner = Scripted(task, [])
    trials, hit = trials_to_hit(learner, task, np.array([[0.7, 0.0], [1.5, 0.0]]), cap=9)
    assert (trials.tolist(), hit.tolist(), len(learner.asked)) == ([1, 1], [True, True], 1)


def test_a_policy_strikes_within_the_zone_that_it_learned():
    task = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 0.3), bounds=BOUNDS)
    policy = Policy(Scripted(task, []), task)
    assert policy.strike((1.0, 0.1)) == policy.strike(Target((1.0, 0.1)))
    with pytest.raises(InputError, match=r"^target: got \(1.2, 0.2\); allowed: a target in the policy's zone"):
        policy.strike((1.2, 0.2))
    with pytest.raises(InputError, match="2 coordinates"):
        policy.strike((1.0, 0.1, 0.0))


def test_a_policy_strikes_along_the_directions_that_it_learned():
    """It is shown the direction that is asked for, and refuses others before it is asked."""
    rule = ArrivalRule(angle=(0.0, 1.0), speed=1.5)
    task = StrikeTask(StraightFlight(), GoalRegion(Disc((0.8, 0.2), 0.3), rule), bounds=BOUNDS)
    learner = Scripted(task, [])
    policy = Policy(learner, task)
    policy.strike(Target.arriving((1.0, 0.1), 0.3))
    ((_, seen),) = learner.asked
    np.testing.assert_allclose(seen[0, 4:], [0.2 / 0.3, -0.1 / 0.3, np.cos(0.3), np.sin(0.3)], rtol=1e-6)
    for target, said in (
        ((1.0, 0.1), "direction: got nothing"),
        (Target.arriving((1.0, 0.1), 1.2), "direction: got"),
        (Target.arriving((1.0, 0.1), 0.3, speed=1.6), "least speed: got '1.6 m/s'; allowed: at most 1.5 m/s"),
    ):
        with pytest.raises(InputError, match=said):
            policy.strike(target)
    assert len(learner.asked) == 1
    points = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 0.3), bounds=BOUNDS)
    with pytest.raises(InputError, match="made for points alone"):
        Policy(learner, points).strike(Target((1.0, 0.1), direction=(1.0, 0.0)))


def test_trials_until_goals_are_hit():
    """Three targets ahead, to be passed at 0, 0.4 and 0.9 rad: flights at 0.4 and 0.9 rad pass none of them so."""
    rule = ArrivalRule(angle=(-1.0, 1.0), cone=0.1)
    task = StrikeTask(StraightFlight(), GoalRegion(Disc((0.8, 0.2), 1.0), rule, hit_radius=0.05), bounds=BOUNDS)
    places = np.array([[1.0, 0.0], [np.cos(0.4), np.sin(0.4)], [1.0, 0.0]])
    goals = task.arrival.goals_at(places, 0.05, np.array([0.0, 0.4, 0.4]))
    learner = Scripted(task, [0.4, 0.4, 0.4])
    trials, hit = trials_to_hit(learner, task, goals, cap=4)
    assert (trials.tolist(), hit.tolist()) == ([1, 2, 4], [True, True, False])
    left = learner.asked[-1][1]
    np.testing.assert_allclose(left[-1, 6:], [np.cos(0.4), np.sin(0.4)], rtol=1e-6)  # it sees the goal that is left


FOUND = [Score(0.2, 0.3), Score(0.5, 0.3), Score(0.5, 0.2), Score(0.5, 0.2), Score(0.4, 0.1)]


def task_in(zone: Disc) -> StrikeTask:
    return StrikeTask(StraightFlight(), GoalRegion(zone, hit_radius=0.05), bounds=BOUNDS)


def run_of(episodes: int, *, method: str = "ddpg", observation: str = "goal") -> Training:
    task = StrikeTask(StraightFlight(), Disc((1.0, 0.0), 0.5), bounds=BOUNDS, observation=observation)
    settings = settings_for(method, hidden=(4,), **({} if method == "ppo" else {"batch_size": 4}))
    learner = make_learner(method, settings, task, torch.Generator().manual_seed(0))
    return Training(learner, task, TrainingPlan(episodes, 4, 2), held_out_goals(task, 0))


def test_a_score_counts_what_the_first_strikes_hit_and_miss():
    """Strikes straight ahead miss by the goal's distance from the x axis."""
    task = task_in(Disc((1.0, 0.1), 0.15))
    goals, targets = held_out_goals(task, 3), task.targets
    learner = Scripted(task, [])
    found = score(learner, task, goals)
    miss = np.abs(goals.positions[:, 1])
    assert found == Score(pytest.approx((miss <= 0.05).mean()), pytest.approx(miss.mean()))
    assert 0.1 < found.share_hit < 0.9
    assert [deterministic for deterministic, _ in learner.asked] == [True]
    assert task.targets is targets
    assert (task.n_strikes, len(task.counts)) == (0, 0)


def test_goals_are_held_out_of_the_tests_of_the_same_seed():
    task = task_in(Disc((1.0, 0.1), 0.15))
    goals = held_out_goals(task, 3).positions
    tested = sample_goals(task.zone, task.arrival, 0.05, GOALS, np.random.default_rng(3)).positions
    assert goals.shape == (GOALS, 2)
    assert task.zone.contains(goals).all()
    assert not (goals == tested).any()
    np.testing.assert_array_equal(goals, held_out_goals(task, 3).positions)
    assert not (goals == held_out_goals(task, 4).positions).any()


def test_more_hits_are_better_and_of_as_many_the_nearer_ones():
    assert FOUND[0].better_than(None)
    better = [[a.better_than(b) for b in FOUND] for a in FOUND]
    assert better == [
        [False, False, False, False, False],
        [True, False, False, False, True],
        [True, True, False, False, True],
        [True, True, False, False, True],
        [True, False, False, False, False],
    ]


@pytest.mark.parametrize("method", ["sac", "td3", "ddpg", "ppo"])
def test_a_training_keeps_the_policy_of_the_best_score(method, monkeypatch, tmp_path):
    """Scores are asked for every five episodes, not while strikes are random; the third is the best."""
    run, actors, asked = run_of(5 * EVERY, method=method), {}, iter(FOUND)

    def scripted(learner, task, goals):
        actors[run.done] = copy.deepcopy(learner.actor.state_dict())
        return next(asked)

    monkeypatch.setattr(training, "score", scripted)
    seen = run.run()
    assert {e.number: e.held_out for e in seen if e.held_out} == dict(zip((5, 10, 15, 20, 25), FOUND, strict=True))
    assert [e.number for e in seen if e.best] == [5, 10, 15]
    run.save(tmp_path / "checkpoint.pt")
    run.save_best(tmp_path / "best.pt")
    last = copy.deepcopy(run.learner.actor.state_dict())
    assert not same(last, actors[15])
    again, kept = run_of(99, method=method), run_of(99, method=method)
    again.load(tmp_path / "checkpoint.pt")
    kept.load(tmp_path / "best.pt")
    assert again.best is not None
    assert (again.best.episode, again.best.score, again.done) == (15, FOUND[2], 25)
    assert same(again.learner.actor.state_dict(), last)
    assert kept.done == 0
    for one in (run, again, kept):
        assert one.policy().learner is one.learner
        assert same(one.learner.actor.state_dict(), actors[15])


def test_scores_change_nothing_of_what_is_learned():
    """Nothing random is drawn, and no strike is counted as one of the training."""
    with_scores, without = run_of(12), run_of(12)
    without.held_out = None
    with_scores.run()
    without.run()
    assert with_scores.best is not None
    assert without.best is None
    assert same(with_scores.learner.actor.state_dict(), without.learner.actor.state_dict())
    assert torch.equal(with_scores.learner.generator.get_state(), without.learner.generator.get_state())
    assert with_scores.task.n_strikes == without.task.n_strikes == 12 * 4
    assert without.policy().learner is without.learner


def test_random_strikes_are_not_scored():
    run = run_of(6)
    run.plan = TrainingPlan(6, 4, 5)
    assert all(episode.held_out is None for episode in run.run())


def test_a_training_goes_on_from_a_checkpoint_to_any_length(tmp_path):
    """A checkpoint of 7 episodes, taken up by a training of 11, ends as a training of 11; other plans are refused."""
    whole, shorter, longer = run_of(11), run_of(7), run_of(11)
    whole.run()
    shorter.run()
    shorter.save(tmp_path / "checkpoint.pt")
    longer.load(tmp_path / "checkpoint.pt")
    assert len(longer.run()) == 4
    for run, name in ((whole, "whole"), (longer, "longer")):
        run.save(tmp_path / name)
    assert same(load_checkpoint(tmp_path / "whole"), load_checkpoint(tmp_path / "longer"))
    older = load_checkpoint(tmp_path / "checkpoint.pt")
    older["plan"]["episodes"] = 7  # as files of earlier versions have it
    torch.save(older, tmp_path / "older.pt")
    again = run_of(11)
    again.load(tmp_path / "older.pt")
    assert again.done == 7
    other = run_of(11)
    other.plan = TrainingPlan(11, 5, 2)
    with pytest.raises(InputError, match=r"checkpoint\.pt: got .*'trials': 4.*; allowed: a checkpoint of plan"):
        other.load(tmp_path / "checkpoint.pt")


def test_a_damaged_file_of_a_policy_is_refused(tmp_path):
    run = run_of(5)
    run.run()
    run.save_best(tmp_path / "best.pt")
    state = load_checkpoint(tmp_path / "best.pt")
    assert math.isfinite(state["score"]["mean_cost"])
    del state["actor"]
    torch.save(state, tmp_path / "best.pt")
    with pytest.raises(InputError, match=r"best\.pt: got 'a damaged or different file'; allowed: a whole policy file"):
        run_of(5).load(tmp_path / "best.pt")
