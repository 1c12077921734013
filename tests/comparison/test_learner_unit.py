"""Units that train a learner: checkpoints, training, strikes."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from fake_rollout import StraightFlight
from flights import scene
from scripted import Scripted

from whiptool.comparison.learner_unit import CHECKPOINT_EVERY, Checkpoint, LearnerUnit, trials_within
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.zone import Disc
from whiptool.models.strike import StrikeBounds
from whiptool.rl.task import StrikeTask


@pytest.mark.parametrize(("rewards", "kept"), [([1.0, 2.0], [1.0, 2.0]), ([1.0, 2.0, 3.0], [1.0, 2.0]), ([1.0], [])])
def test_a_checkpoint_is_taken_up_where_its_history_reaches(rewards, kept, tmp_path, monkeypatch):
    """Two episodes are done: what the history holds beyond them is cut, and one that is shorter is not believed."""
    monkeypatch.setattr("whiptool.rl.training.load_checkpoint", lambda path: {"done": 2})
    loaded: list[Path] = []
    training = SimpleNamespace(done=2, load=loaded.append)
    checkpoint = Checkpoint(tmp_path / "unit.pt")
    assert checkpoint.load(training) == {"rewards": [], "seconds": 0.0}
    checkpoint.path.touch()
    checkpoint.history.write_text(json.dumps({"rewards": rewards, "seconds": 3.0}))
    assert checkpoint.load(training)["rewards"] == kept
    assert loaded == ([checkpoint.path] if kept else [])


def test_a_learner_unit_trains_and_strikes(tmp_path, monkeypatch):
    s = scene(cap=5)
    unit = LearnerUnit(scene=s, method="sac", observation="goal", seed=2, episodes=12, trials=4, random_episodes=12,
                       settings=(("batch_size", 4), ("alpha", 0.05)))  # fmt: skip
    saved = []
    save = Checkpoint.save

    def watched(self, run, history):
        saved.append(run.done)
        save(self, run, history)

    monkeypatch.setattr(Checkpoint, "save", watched)
    result = unit.run(tmp_path, None)
    assert saved == [CHECKPOINT_EVERY, 12]
    assert result["training_trials"] == 48
    assert len(result["rewards"]) == 12
    kinds = [(x["convention"], x["hit_radius"]) for x in result["outcomes"]]
    assert kinds == [("mean-first", 0.3), ("mean-first", 0.1), ("samples", 0.3), ("mean", 0.3)]
    strikes, points = np.array(result["first_strikes"]), s.points()
    near = s.rollout().approach(strikes, points, t_stay=s.t_stay)
    np.testing.assert_allclose(result["first_misses"], near.distance)
    first = np.array(result["outcomes"][0]["trials"]) == 1
    np.testing.assert_array_equal(first, near.distance <= 0.3)
    training, history, note = unit.trained(tmp_path, None)  # from the checkpoint, at its end
    assert (training.done, note) == (12, "")
    assert training.learner.settings.alpha == 0.05
    assert history["rewards"] == result["rewards"]
    assert history["seconds"] > 0
    assert isinstance(training.learner.generator, torch.Generator)


def test_hindsight_only_where_it_is_possible():
    for method, observation, copies in (("sac", "goal", 3), ("sac", "tip", 0), ("ppo", "goal", 0)):
        unit = LearnerUnit(scene=scene(), method=method, observation=observation, seed=0, hindsight=3)
        assert unit._fresh(None).plan.hindsight == copies


def test_a_learner_unit_strikes_along_directions():
    """Its first strikes, judged by hand: what hits at the first trial passes near enough, at the target's own angle."""
    s = scene(cap=3, arrival=ArrivalRule(angle=(-1.2, -0.4), cone=0.3))
    unit = LearnerUnit(scene=s, method="sac", observation="goal", seed=2, episodes=3, trials=4, random_episodes=2,
                       hindsight=1, settings=(("batch_size", 4), ("hidden", (8,))))  # fmt: skip
    result = unit.run(None, None)
    strikes, goals = np.array(result["first_strikes"]), s.goals()
    near = s.rollout().approach(strikes, goals.positions, t_stay=s.t_stay)
    np.testing.assert_allclose(result["first_misses"], near.distance)
    angles = np.arctan2(goals.directions[:, 1], goals.directions[:, 0])
    for outcome in result["outcomes"][:2]:
        first = np.array(outcome["trials"]) == 1
        hit = (near.distance <= outcome["hit_radius"]) & (np.abs(strikes[:, 0] - angles) <= 0.3)
        np.testing.assert_array_equal(first, hit)


BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 1.0), (1.0, 0.5, 0.3, 0.8, 2.0))
TARGETS = np.array([[1.0, 0.0], [np.cos(0.5), np.sin(0.5)], [np.cos(0.9), np.sin(0.9)]])


def recorded(radius: float) -> StrikeTask:
    return StrikeTask(StraightFlight(), GoalRegion(Disc((0.8, 0.2), 1.0), hit_radius=radius), bounds=BOUNDS)


def test_trials_of_a_policy_at_several_radii():
    """Targets at 0, 0.5 and 0.9 rad; samples at -0.3, 0.45, 0.8, 0.89 rad: misses are sines of the difference."""
    angles = [-0.3, 0.45, 0.8, 0.89]
    radii = (0.2, 0.06, 0.02)
    task = recorded(0.02)
    found = trials_within(Scripted(task, angles), task, TARGETS, radii, cap=4, convention="samples")
    for radius, (trials, hit) in found.items():
        for i, at in enumerate((0.0, 0.5, 0.9)):
            misses = [np.sin(abs(at - angle)) for angle in angles]
            within = [n for n, miss in enumerate(misses, 1) if miss <= radius]
            assert trials[i] == (within[0] if within else 4)
            assert hit[i] == bool(within)


def test_trials_at_several_radii_where_a_direction_is_asked_for():
    """The same flights at the same targets; the second one is to be passed at 0.8 rad, within 0.2 rad."""
    angles, wanted = [-0.3, 0.45, 0.8, 0.89], np.array([0.0, 0.8, 0.9])
    radii = (0.4, 0.2, 0.06)
    rule, zone = ArrivalRule(angle=(-1.0, 1.0), cone=0.2), Disc((0.8, 0.2), 1.0)
    task = StrikeTask(StraightFlight(), GoalRegion(zone, rule, hit_radius=0.06), bounds=BOUNDS)
    goals = rule.goals_at(TARGETS, 0.4, wanted)
    found = trials_within(Scripted(task, angles), task, goals, radii, cap=4, convention="samples")
    for radius, (trials, hit) in found.items():
        for i, at in enumerate((0.0, 0.5, 0.9)):
            hits = [
                number
                for number, angle in enumerate(angles, 1)
                if np.sin(abs(at - angle)) <= radius and abs(angle - wanted[i]) <= 0.2
            ]
            assert trials[i] == (hits[0] if hits else 4)
            assert hit[i] == bool(hits)
    assert found[0.4][1].tolist() == [False, True, True]
    assert found[0.06][1].tolist() == [False, False, True]


class Low:
    """The first angle may be 0.6 at most, which peaks tell or only the whole strike."""

    judges, by_peaks, command, positions, smooth = "motor", True, None, None, ()

    def __init__(self, *, whole: bool) -> None:
        self.of_candidates = whole

    def violation_of_peaks(self, near):
        return np.full(len(near.distance), -1.0) if self.of_candidates else near.max_joint_speed[:, 0] - 0.6

    def violation(self, strike):
        return strike.vector[0] - 0.6


class Following(StraightFlight):
    def trajectory(self, strike, *, t_stay):
        return strike


@pytest.mark.parametrize("whole", [False, True])
def test_a_strike_that_the_limits_refuse_is_a_hit_at_no_radius(whole):
    """Of samples at -0.3, 0.45, 0.8 and 0.89 rad the last two are refused, which alone pass the target at 0.9 rad."""
    limits, zone = Low(whole=whole), Disc((0.8, 0.2), 1.0)
    task = StrikeTask(Following(), GoalRegion(zone, hit_radius=0.02), bounds=BOUNDS, limits=limits)
    found = trials_within(
        Scripted(task, [-0.3, 0.45, 0.8, 0.89]), task, TARGETS, (0.2, 0.02), cap=4, convention="samples"
    )
    assert found[0.2][1].tolist() == [False, True, False]
    assert found[0.02][1].tolist() == [False, False, False]
