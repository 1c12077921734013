"""Units that train a learner: checkpoints, training, strikes."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from flights import scene

from whiptool.comparison.learner_unit import CHECKPOINT_EVERY, Checkpoint, LearnerUnit
from whiptool.goals.arrival_rule import ArrivalRule


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
