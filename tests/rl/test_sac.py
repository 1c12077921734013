"""A step of SAC against the same step in NumPy: losses by their formulas, gradients by differences."""

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
    plain,
    q_values,
    shaken,
    squashed,
    transitions,
)


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
