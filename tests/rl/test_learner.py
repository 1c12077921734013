"""One update step of each learner against the same step in NumPy: losses by their formulas, gradients by differences.

Learners run in double precision with plain gradient descent in place of Adam, so that a step is the gradient itself.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from scipy.stats import norm

from whiptool.rl.learner import OffPolicyLearner
from whiptool.rl.ppo import PPO
from whiptool.rl.replay import Transitions
from whiptool.rl.settings import settings_for
from whiptool.rl.training import LEARNERS

OBS, ACT, BATCH, RATE = 3, 2, 5, 0.05
DISCOUNT = 0.9
Parameters = list[np.ndarray]


def make(method: str, *, seed: int = 0, **changes):
    """A learner with small networks in double precision that descends its gradients at `RATE`."""
    settings = settings_for(method, hidden=(4,), **changes)
    generator = torch.Generator().manual_seed(seed)
    learner = LEARNERS[method](settings, n_obs=OBS, n_act=ACT, discount=DISCOUNT, generator=generator)  # type: ignore[arg-type]
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


@pytest.mark.parametrize("method", ["sac", "td3", "ddpg", "ppo"])
def test_a_learner_takes_up_where_another_was(method):
    """Of another seed, and then of the other's weights and draws: both go on alike."""
    settings, sizes = settings_for(method, hidden=(4,)), {"n_obs": OBS, "n_act": ACT, "discount": DISCOUNT}
    generators = [torch.Generator().manual_seed(seed) for seed in (0, 1)]
    one, other = (LEARNERS[method](settings, **sizes, generator=g) for g in generators)  # type: ignore[arg-type]
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
