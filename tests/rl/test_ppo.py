"""The passes of PPO against the same passes in NumPy."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from learner_steps import (
    DISCOUNT,
    Parameters,
    assert_same,
    descended,
    make,
    numbers,
    perceptron,
    plain,
    shaken,
    transitions,
)
from scipy.stats import norm

from whiptool.rl.ppo import PPO


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
