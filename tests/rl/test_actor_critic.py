"""The learners: their losses in closed form, and what they learn."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from learner_steps import (
    ACT,
    BATCH,
    DISCOUNT,
    OBS,
    Parameters,
    assert_same,
    descended,
    draws,
    make,
    mixed,
    numbers,
    perceptron,
    plain,
    q_values,
    shaken,
    squashed,
    transitions,
)
from scipy.stats import norm

from whiptool.rl.actor_critic import PPO


@pytest.mark.parametrize("discount", [DISCOUNT, 0.0])
def test_a_step_of_sac(discount):
    learner, batch = make("sac", alpha=0.3, tau=0.1), transitions()
    learner.discount = discount
    shaken(learner.target_critic, 7)
    obs, action, reward, next_obs, over = plain(batch)
    actor, critic, target = map(numbers, (learner.actor, learner.critic, learner.target_critic))
    *following, noise = draws(learner, *[(BATCH, ACT)] * (2 if discount else 1))
    y = reward
    if discount:
        next_action, log_p = squashed(actor, next_obs, following[0])
        y = reward + discount * (1 - over) * (q_values(target, next_obs, next_action).min(axis=0) - 0.3 * log_p)

    def critic_loss(critic):
        return sum(np.mean((q - y) ** 2) for q in q_values(critic, obs, action))

    new_critic = descended(critic_loss, critic)

    def actor_loss(actor):  # Eq. 16, up the critic that has just improved
        a, log_p = squashed(actor, obs, noise)
        return np.mean(0.3 * log_p - q_values(new_critic, obs, a).min(axis=0))

    losses = learner.update(batch)
    assert float(losses["critic"]) == pytest.approx(critic_loss(critic), rel=1e-9)
    assert float(losses["actor"]) == pytest.approx(actor_loss(actor), rel=1e-7)
    assert float(losses["entropy"]) == pytest.approx(-squashed(actor, obs, noise)[1].mean(), rel=1e-9)
    assert_same(learner.critic, new_critic)
    assert_same(learner.actor, descended(actor_loss, actor))
    assert_same(learner.target_critic, mixed(target, new_critic, 0.1) if discount else target)
    assert all(parameter.requires_grad for parameter in learner.critic.parameters())


@pytest.mark.parametrize("method", ["ddpg", "td3"])
def test_a_step_of_the_deterministic_policies(method):
    """TD3 smooths its target policy (Eq. 15), takes the smaller of two critics, moves its actor every other time."""
    td3 = method == "td3"
    changes = {"target_noise": 0.6, "noise_clip": 0.4, "delay": 2} if td3 else {}
    learner, batch = make(method, tau=0.1, **changes), transitions()
    shaken(learner.target_critic, 7)
    shaken(learner.target_actor, 8)
    obs, action, reward, next_obs, over = plain(batch)
    for number in (1, 2):
        parts = (learner.actor, learner.target_actor, learner.critic, learner.target_critic)
        actor, target_actor, critic, target = map(numbers, parts)
        next_action = np.tanh(perceptron(target_actor, next_obs)[0])
        if td3:
            noise = np.clip(0.6 * draws(learner, (BATCH, ACT))[0], -0.4, 0.4)
            assert (np.abs(noise) == 0.4).any()
            next_action = np.clip(next_action + noise, -1, 1)
        y = reward + DISCOUNT * (1 - over) * q_values(target, next_obs, next_action).min(axis=0)

        def critic_loss(critic, y=y):
            return sum(np.mean((q - y) ** 2) for q in q_values(critic, obs, action))

        new_critic = descended(critic_loss, critic)

        def actor_loss(actor, new_critic=new_critic):
            return -np.mean(q_values(new_critic, obs, np.tanh(perceptron(actor, obs)[0]))[0])

        losses = learner.update(batch)
        assert float(losses["critic"]) == pytest.approx(critic_loss(critic), rel=1e-9)
        assert_same(learner.critic, new_critic)
        if td3 and number == 1:
            assert "actor" not in losses
            new_actor = actor
            assert_same(learner.target_actor, target_actor)
            assert_same(learner.target_critic, target)
        else:
            assert float(losses["actor"]) == pytest.approx(actor_loss(actor), rel=1e-7)
            new_actor = descended(actor_loss, actor)
            assert_same(learner.target_actor, mixed(target_actor, new_actor, 0.1))
            assert_same(learner.target_critic, mixed(target, new_critic, 0.1))
        assert_same(learner.actor, new_actor)
        assert all(parameter.requires_grad for parameter in learner.critic.parameters())


def test_the_smoothed_action_stays_in_the_box():
    learner = make("td3", target_noise=0.6, noise_clip=0.4)
    with torch.no_grad():
        learner.target_actor.layers.biases[-1] += 3  # near 1 everywhere
    noise = np.clip(0.6 * draws(learner, (50, ACT))[0], -0.4, 0.4)
    obs = torch.rand(50, OBS, generator=torch.Generator().manual_seed(0)).double()
    mean = np.tanh(perceptron(numbers(learner.target_actor), obs.numpy())[0])
    action, bonus = learner.next_action(obs)
    np.testing.assert_allclose(action.detach().numpy(), np.clip(mean + noise, -1, 1), rtol=1e-12)
    assert float(bonus) == 0
    assert (action == 1).any()


def ppo_step(actor: Parameters, value: Parameters, batch, old, returns, advantage, some, beta):
    """One minibatch of PPO with the KL penalty of Eq. 11; new parameters, and both losses before the step."""
    obs, action = batch[0][some], batch[1][some]
    old_mean, old_spread = old[0][some], old[1]

    def actor_loss(actor):
        mean, spread = perceptron(actor[1:], obs, np.tanh)[0], np.exp(actor[0])
        densities = (norm.logpdf(action, m, s).sum(axis=1) for m, s in ((mean, spread), (old_mean, old_spread)))
        ratio = np.exp(np.subtract(*densities))
        kl = np.log(spread / old_spread) + (old_spread**2 + (old_mean - mean) ** 2) / (2 * spread**2) - 0.5
        return beta * np.mean(kl.sum(axis=1)) - np.mean(ratio * advantage[some])

    def value_loss(value):
        return np.mean((perceptron(value, obs, np.tanh)[0, :, 0] - returns[some]) ** 2)

    losses = actor_loss(actor), value_loss(value)
    return descended(actor_loss, actor), descended(value_loss, value), losses


def test_the_passes_of_ppo():
    """Three passes over two minibatches: later steps feel the ratio and the penalty, which are flat at the first."""
    learner = make("ppo", epochs=3, minibatch=3, beta=2.0, kl_target=1e-9, spread=0.7)
    assert isinstance(learner, PPO)
    shaken(learner.actor, 3)
    batch = transitions(count=6)
    obs, _, reward, next_obs, over = plain(batch)
    actor, value = numbers(learner.actor), numbers(learner.value)
    old = perceptron(actor[1:], obs, np.tanh)[0], np.exp(actor[0])
    returns = reward + DISCOUNT * (1 - over) * perceptron(value, next_obs, np.tanh)[0, :, 0]
    advantage = returns - perceptron(value, obs, np.tanh)[0, :, 0]
    advantage = (advantage - advantage.mean()) / advantage.std(ddof=1)
    generator = torch.Generator()
    generator.set_state(learner.generator.get_state())
    for _ in range(3):
        order = torch.randperm(6, generator=generator).numpy()
        for some in (order[:3], order[3:]):
            actor, value, losses = ppo_step(actor, value, plain(batch), old, returns, advantage, some, 2.0)
    got = learner.learn(batch)
    assert_same(learner.actor, actor)
    assert_same(learner.value, value)
    assert (got["actor"], got["value"]) == pytest.approx(losses, rel=1e-6)
    mean, spread = perceptron(actor[1:], obs, np.tanh)[0], np.exp(actor[0])
    kl = np.log(spread / old[1]) + (old[1] ** 2 + (old[0] - mean) ** 2) / (2 * spread**2) - 0.5
    assert got["divergence"] == pytest.approx(kl.sum(axis=1).mean(), rel=1e-6)
    assert learner.penalty.beta == 4.0  # far beyond its target
    state = copy.deepcopy(learner.state_dict()["actor"])
    assert learner.learn(batch, update=False) == {}
    assert all(torch.equal(x, learner.state_dict()["actor"][name]) for name, x in state.items())
