"""A learner as a search: random batches first, then its own; what it is shown of every strike."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from toy_objectives import BOUNDS, Bowl, Enough

from whiptool.optimizers.learner_search import BATCH, RANDOM_BATCHES, UPDATES, gain, learner_search
from whiptool.rl import training
from whiptool.rl.task import reward

SURE = 0.4  # [m], below which this objective claims a hit: it measures, and its hit radius is larger


class Counted(Bowl):
    def batch(self, strikes):
        if len(self.batches) == 5:
            raise Enough
        found = super().batch(strikes)
        for outcome in found:
            outcome.hit = outcome.cost <= SURE
        return found


@pytest.mark.parametrize("name", ["sac", "ppo"])
def test_what_the_learner_is_shown(name, monkeypatch):
    made = []

    def make(settings, **sizes):
        learner = kind(settings, **sizes)
        made.append(learner)
        learner.shown = []
        learner.learn = lambda new, *, update: learner.shown.append((new, update))
        learner.act = lambda obs: torch.full((len(obs), 5), 1.5) * torch.linspace(-1, 1, len(obs))[:, None]
        return learner

    kind = training.LEARNERS[name]
    monkeypatch.setitem(training.LEARNERS, name, make)
    bowl = Counted()
    with pytest.raises(Enough):
        learner_search(bowl, seed=4, learner=name)
    (learner,) = made
    assert (learner.n_obs, learner.n_act, learner.discount) == (1, 5, 0.0)
    if name == "sac":
        assert learner.settings.updates == UPDATES
    lower, upper = BOUNDS.box
    assert [len(x) for x in bowl.batches] == [BATCH] * 5
    assert [update for _, update in learner.shown] == [False] * RANDOM_BATCHES + [True] * (5 - RANDOM_BATCHES)
    for strikes, (new, _) in zip(bowl.batches, learner.shown, strict=True):
        box = (np.clip(new.action.double().numpy(), -1, 1) + 1) / 2
        np.testing.assert_allclose(strikes, lower + box * (upper - lower), rtol=1e-6)
        np.testing.assert_allclose(new.reward, reward(bowl.miss(strikes), bowl.miss(strikes) <= SURE), rtol=1e-6)
        assert new.terminated.tolist() == [1.0] * BATCH
        assert new.obs.tolist() == new.next_obs.tolist() == [[0.0]] * BATCH
    explored = np.concatenate([new.action.numpy() for new, _ in learner.shown[:RANDOM_BATCHES]])
    assert explored.min() < -0.8
    assert explored.max() > 0.8
    np.testing.assert_allclose(bowl.batches[-1][[0, -1]], [lower, upper])  # actions beyond the box are clipped


def test_better_hits_gain_more():
    costs = np.array([-1.8, -0.9, -0.2, 0.0, 0.05, 0.08, 0.5])
    expected = [90.0, 45.0, 10.0, 50.0, 50.0, -0.4, -5.0]
    np.testing.assert_allclose(gain(costs, costs <= 0.06), expected)
