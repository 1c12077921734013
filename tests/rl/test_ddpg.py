"""Steps of DDPG, and of TD3, against the same steps in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from learner_steps import (
    ACT,
    BATCH,
    DISCOUNT,
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
    transitions,
)


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
