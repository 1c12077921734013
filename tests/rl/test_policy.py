"""A policy at work on a tip that flies straight: which strikes are asked of it, and what is counted."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from fake_rollout import StraightFlight
from scripted import Scripted

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.target import Target
from whiptool.goals.zone import Disc
from whiptool.models.strike import StrikeBounds
from whiptool.rl.policy import Policy, trials_to_hit
from whiptool.rl.task import StrikeTask

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
    task = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 1.0), bounds=BOUNDS, hit_radius=0.05)
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
    task = StrikeTask(rollout, Disc((0.8, 0.2), 1.0), bounds=BOUNDS, hit_radius=0.05)
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
    task = StrikeTask(rollout, Disc((0.8, 0.2), 1.0), bounds=BOUNDS, hit_radius=0.02)
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
    task = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 1.0), bounds=BOUNDS, hit_radius=0.05)
    learner = Scripted(task, [])
    trials, hit = trials_to_hit(learner, task, np.array([[0.7, 0.0], [1.5, 0.0]]), cap=9)
    assert (trials.tolist(), hit.tolist(), len(learner.asked)) == ([1, 1], [True, True], 1)


def test_a_policy_strikes_within_the_zone_that_it_learned():
    task = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 0.3), bounds=BOUNDS)
    policy = Policy(Scripted(task, []), task)
    assert policy.strike((1.0, 0.1)) == policy.strike(Target((1.0, 0.1)))
    with pytest.raises(InputError, match=r"^target: got \(1.2, 0.2\); allowed: one of the policy's zone"):
        policy.strike((1.2, 0.2))
    with pytest.raises(InputError, match="2 coordinates"):
        policy.strike((1.0, 0.1, 0.0))


def test_a_policy_strikes_along_the_directions_that_it_learned():
    """It is shown the direction that is asked for, and refuses others before it is asked."""
    rule = ArrivalRule(angle=(0.0, 1.0), speed=1.5)
    task = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 0.3), bounds=BOUNDS, arrival=rule)
    learner = Scripted(task, [])
    policy = Policy(learner, task)
    policy.strike(Target.arriving((1.0, 0.1), 0.3))
    ((_, seen),) = learner.asked
    np.testing.assert_allclose(seen[0, 4:], [0.2 / 0.3, -0.1 / 0.3, np.cos(0.3), np.sin(0.3)], rtol=1e-6)
    for target, said in (
        ((1.0, 0.1), "direction: got nothing"),
        (Target.arriving((1.0, 0.1), 1.2), "direction: got"),
        (Target.arriving((1.0, 0.1), 0.3, speed=1.6), "least speed: got 1.6; allowed: up to 1.5 m/s"),
    ):
        with pytest.raises(InputError, match=said):
            policy.strike(target)
    assert len(learner.asked) == 1
    points = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 0.3), bounds=BOUNDS)
    with pytest.raises(InputError, match="only points were learned"):
        Policy(learner, points).strike(Target((1.0, 0.1), direction=(1.0, 0.0)))


def test_trials_until_goals_are_hit():
    """Three targets ahead, to be passed at 0, 0.4 and 0.9 rad: flights at 0.4 and 0.9 rad pass none of them so."""
    rule = ArrivalRule(angle=(-1.0, 1.0), cone=0.1)
    task = StrikeTask(StraightFlight(), Disc((0.8, 0.2), 1.0), bounds=BOUNDS, arrival=rule, hit_radius=0.05)
    places = np.array([[1.0, 0.0], [np.cos(0.4), np.sin(0.4)], [1.0, 0.0]])
    goals = task.arrival.goals_at(places, 0.05, np.array([0.0, 0.4, 0.4]))
    learner = Scripted(task, [0.4, 0.4, 0.4])
    trials, hit = trials_to_hit(learner, task, goals, cap=4)
    assert (trials.tolist(), hit.tolist()) == ([1, 2, 4], [True, True, False])
    left = learner.asked[-1][1]
    np.testing.assert_allclose(left[-1, 6:], [np.cos(0.4), np.sin(0.4)], rtol=1e-6)  # it sees the goal that is left
