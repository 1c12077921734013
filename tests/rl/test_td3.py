"""The smoothed action of TD3's target policy."""

from __future__ import annotations

import numpy as np
import torch
from learner_steps import ACT, OBS, draws, make, numbers, perceptron


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
