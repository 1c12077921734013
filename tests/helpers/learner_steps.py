"""Learners in double precision, and in NumPy the networks, gradients and steps that they should have."""

from __future__ import annotations

import numpy as np
import torch
from scipy.stats import norm

from whiptool.rl.actor_critic import LEARNERS
from whiptool.rl.learner import OffPolicyLearner, Transitions
from whiptool.rl.settings import settings_for

OBS, ACT, BATCH, RATE = 3, 2, 5, 0.05
DISCOUNT = 0.9
Parameters = list[np.ndarray]


def make(method: str, *, seed: int = 0, **changes):
    """A learner with small networks in double precision that descends its gradients at `RATE`."""
    settings = settings_for(method, hidden=(4,), **changes)
    generator = torch.Generator().manual_seed(seed)
    learner = LEARNERS[method](settings, n_obs=OBS, n_act=ACT, discount=DISCOUNT, generator=generator)
    for name in ("actor", "target_actor", "critic", "target_critic", "value"):
        if hasattr(learner, name):
            getattr(learner, name).double()
    for name in ("actor", "critic", "value"):
        if hasattr(learner, name):
            descent = torch.optim.SGD(getattr(learner, name).parameters(), lr=RATE)
            setattr(learner, f"{name}_optimizer", descent)
    if isinstance(learner, OffPolicyLearner):
        single = learner.normal
        learner.normal = lambda *shape: single(*shape).double()
    return learner


def transitions(seed: int = 1, count: int = BATCH) -> Transitions:
    rng = np.random.default_rng(seed)
    arrays = (
        rng.normal(size=(count, OBS)),
        rng.uniform(-1, 1, (count, ACT)),
        rng.normal(size=count),
        rng.normal(size=(count, OBS)),
        (np.arange(count) % 3 == 0).astype(float),
    )
    return Transitions(*map(torch.as_tensor, arrays))


def shaken(module, seed: int):
    """Weights of their own, so that a target network differs from its source."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter += 0.3 * torch.randn(parameter.shape, generator=generator)


def numbers(module) -> Parameters:
    return [parameter.detach().numpy().copy() for parameter in module.parameters()]


def draws(learner, *shapes) -> list[np.ndarray]:
    """What the learner will draw next, without drawing it."""
    generator = torch.Generator()
    generator.set_state(learner.generator.get_state())
    return [torch.randn(shape, generator=generator).double().numpy() for shape in shapes]


def perceptron(parameters: Parameters, x: np.ndarray, activation=lambda x: np.maximum(x, 0)) -> np.ndarray:
    """Two layers, `count` networks side by side: (B, in) to (count, B, out)."""
    first, second, bias, last_bias = parameters
    return np.stack([activation(x @ a + c) @ b + d for a, b, c, d in zip(first, second, bias, last_bias, strict=True)])


def q_values(critic: Parameters, obs, action) -> np.ndarray:
    return perceptron(critic, np.hstack([obs, action]))[..., 0]


def squashed(actor: Parameters, obs, noise) -> tuple[np.ndarray, np.ndarray]:
    """Action and log-density of tanh(u), u normal, by the change of variables."""
    out = perceptron(actor, obs)[0]
    mean, spread = out[:, :ACT], np.exp(np.clip(out[:, ACT:], -5, 2))
    u = mean + spread * noise
    action = np.tanh(u)
    return action, (norm.logpdf(u, mean, spread) - np.log(1 - action**2)).sum(axis=1)


def descended(loss, parameters: Parameters, *, step: float = 1e-6) -> Parameters:
    """The parameters after one step against the gradient of a loss, by central differences."""
    result = [x.copy() for x in parameters]
    for into, array in zip(result, parameters, strict=True):
        for i in np.ndindex(array.shape):
            before = array[i]
            array[i] = before + step
            above = loss(parameters)
            array[i] = before - step
            below = loss(parameters)
            array[i] = before
            into[i] = before - RATE * (above - below) / (2 * step)
    return result


def assert_same(module, expected: Parameters) -> None:
    for parameter, array in zip(module.parameters(), expected, strict=True):
        np.testing.assert_allclose(parameter.detach().numpy(), array, rtol=1e-7, atol=1e-8)


def mixed(target: Parameters, source: Parameters, tau: float) -> Parameters:
    return [(1 - tau) * a + tau * b for a, b in zip(target, source, strict=True)]  # Eq. 14


def plain(batch: Transitions) -> tuple[np.ndarray, ...]:
    return tuple(x.numpy() for x in (batch.obs, batch.action, batch.reward, batch.next_obs, batch.terminated))
