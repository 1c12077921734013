"""What the learners have in common: how they begin, act, are stored and take up."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from learner_steps import ACT, DISCOUNT, OBS, draws, make, numbers, perceptron, shaken, squashed, transitions

from whiptool.rl.learner import OffPolicyLearner
from whiptool.rl.replay import Transitions
from whiptool.rl.settings import settings_for
from whiptool.rl.training import LEARNERS


@pytest.mark.parametrize("method", ["sac", "ddpg", "td3"])
def test_critics_and_their_targets_begin_alike(method):
    learner = make(method)
    pairs = [(learner.critic, learner.target_critic)]
    if method != "sac":
        pairs.append((learner.actor, learner.target_actor))
    for source, target in pairs:
        assert all(torch.equal(a, b) for a, b in zip(source.parameters(), target.parameters(), strict=True))
        assert not any(parameter.requires_grad for parameter in target.parameters())
    first = numbers(learner.critic)[0]
    assert len(first) == (1 if method == "ddpg" else 2)
    if len(first) == 2:
        assert not np.array_equal(*first)


def test_what_is_done_is_the_policys_mean_or_a_draw():
    """The draws of each policy from the same normal numbers, in NumPy."""
    obs = torch.rand(20, OBS, generator=torch.Generator().manual_seed(5)).double()
    changes = {"sac": {}, "td3": {"noise": 0.7}, "ddpg": {"noise": 0.7}, "ppo": {"spread": 0.5}}
    for method in LEARNERS:
        learner = make(method, **changes[method])
        shaken(learner.actor, 3)
        actor, (noise,) = numbers(learner.actor), draws(learner, (20, ACT))
        if method == "sac":
            mean, sampled = np.tanh(perceptron(actor, obs.numpy())[0][:, :ACT]), squashed(actor, obs.numpy(), noise)[0]
        elif method == "ppo":
            mean = perceptron(actor[1:], obs.numpy(), np.tanh)[0]
            sampled = mean + np.exp(actor[0]) * noise
        else:
            mean = np.tanh(perceptron(actor, obs.numpy())[0])
            sampled = np.clip(mean + 0.7 * noise, -1, 1)
            assert (np.abs(sampled) == 1).any()
        np.testing.assert_allclose(learner.act(obs, deterministic=True).numpy(), mean, rtol=1e-9)
        np.testing.assert_allclose(learner.act(obs).numpy(), sampled, rtol=1e-9)


@pytest.mark.parametrize("method", ["sac", "td3", "ddpg", "ppo"])
def test_a_learner_takes_up_where_another_was(method):
    """Of another seed, and then of the other's weights and draws: both go on alike."""
    settings, sizes = settings_for(method, hidden=(4,)), {"n_obs": OBS, "n_act": ACT, "discount": DISCOUNT}
    generators = [torch.Generator().manual_seed(seed) for seed in (0, 1)]
    one, other = (LEARNERS[method](settings, **sizes, generator=g) for g in generators)
    singles = [Transitions(*(x.float() for x in vars(transitions(seed)).values())) for seed in (2, 3)]
    one.learn(singles[0])
    obs = singles[1].obs
    assert not torch.equal(one.act(obs, deterministic=True), other.act(obs, deterministic=True))
    other.load_state_dict(copy.deepcopy(one.state_dict()))
    assert torch.equal(one.act(obs), other.act(obs))
    assert one.learn(singles[1]) == other.learn(singles[1])
    assert torch.equal(one.act(obs, deterministic=True), other.act(obs, deterministic=True))


def test_every_transition_is_stored_and_learned_from_as_often_as_told():
    learner = make("ddpg", updates=3, batch_size=4)
    assert isinstance(learner, OffPolicyLearner)
    sizes = []

    def update(batch):
        sizes.append(len(batch.reward))
        return {"critic": torch.tensor(float(len(sizes)))}

    learner.update = update
    assert learner.learn(transitions(count=5)) == {"critic": 15.0}
    assert sizes == [4] * 15
    assert learner.learn(transitions(count=5), update=False) == {}
    assert (learner.replay.size, len(sizes)) == (10, 15)
