"""What the learners have in common: how they begin, act, are stored and take up."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from learner_steps import ACT, DISCOUNT, OBS, draws, make, numbers, perceptron, shaken, squashed, transitions

from whiptool.rl.actor_critic import LEARNERS
from whiptool.rl.learner import OffPolicyLearner, ReplayBuffer, Transitions
from whiptool.rl.settings import settings_for


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


def test_replay_overwrites_the_oldest():
    buffer = ReplayBuffer(5, 1, 1)

    def add(*numbers):
        x = torch.tensor(numbers, dtype=torch.float32)
        buffer.add(Transitions(x[:, None], x[:, None], x, x[:, None], x > 4))

    add(1, 2, 3)
    assert set(buffer.sample(200, torch.Generator().manual_seed(0)).reward.tolist()) == {1, 2, 3}
    add(4, 5, 6, 7)
    assert buffer.size == 5
    drawn = buffer.sample(500, torch.Generator().manual_seed(0))
    assert set(drawn.reward.tolist()) == {3, 4, 5, 6, 7}
    assert torch.equal(drawn.obs[:, 0], drawn.reward)
    assert torch.equal(drawn.terminated, (drawn.reward > 4).float())
    other = ReplayBuffer(5, 1, 1)
    other.load_state_dict(buffer.state_dict())
    for each in (buffer, other):
        each.add(Transitions(**{name: array[:3] for name, array in vars(drawn).items()}))
    assert all(
        torch.equal(*map(torch.as_tensor, pair))
        for pair in zip(buffer.state_dict().values(), other.state_dict().values())
    )


def test_the_oldest_is_the_next_to_go():
    buffer = ReplayBuffer(4, 2, 1)

    def held():
        return buffer.state_dict()["reward"].tolist()

    def add(*numbers):
        x = torch.tensor(numbers)
        buffer.add(Transitions(x[:, None].expand(-1, 2), x[:, None], x, -x[:, None].expand(-1, 2), torch.zeros(len(x))))

    add(1.0, 2.0, 3.0)
    assert (held(), buffer.size) == ([1, 2, 3], 3)
    add(4.0, 5.0, 6.0)
    assert (held(), buffer.size) == ([5, 6, 3, 4], 4)
    add(7.0)
    assert held() == [5, 6, 7, 4]
    drawn = buffer.sample(4000, torch.Generator().manual_seed(0))
    counts = torch.bincount(drawn.reward.int(), minlength=8)[4:]
    assert (counts > 850).all()  # uniform, with replacement
    assert torch.equal(drawn.next_obs, -drawn.obs)
    assert drawn.obs.shape == (4000, 2)
