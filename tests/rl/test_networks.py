"""Networks and densities of the learners against torch's own."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import torch
from torch import distributions, nn

from whiptool.rl.actor_critic import Penalty
from whiptool.rl.networks import (
    Critic,
    DeterministicActor,
    GaussianActor,
    Layers,
    SquashedGaussianActor,
    adam,
    divergence,
    log_density,
    soft_update,
)


def test_the_density_of_a_squashed_gaussian():
    generator = torch.Generator().manual_seed(0)
    actor = SquashedGaussianActor(4, 3, (16,), generator).double()
    obs, noise = torch.rand(50, 4).double(), torch.randn(50, 3, generator=generator).double()
    action, log_p = actor.sample(obs, noise)
    mean, log_std = actor(obs)
    normal = distributions.Independent(distributions.Normal(mean, log_std.exp()), 1)
    squashed = distributions.TransformedDistribution(normal, [distributions.TanhTransform()])
    assert torch.allclose(log_p, squashed.log_prob(action), atol=1e-8)
    assert torch.allclose(log_density(noise, mean, log_std), normal.log_prob(noise))
    _, far = actor.sample(obs, noise + 1e3)
    assert torch.isfinite(far).all()


def test_the_divergence_of_gaussians():
    a, b, c, d = torch.randn(4, 30, 5, generator=torch.Generator().manual_seed(1)).double()
    p, q = (distributions.Independent(distributions.Normal(m, s.exp()), 1) for m, s in ((a, b), (c, d)))
    assert torch.allclose(divergence(a, b, c, d), distributions.kl_divergence(p, q))
    assert not divergence(a, b, a, b).any()


def test_the_penalty_steers_the_divergence():
    penalty = Penalty(1.0, 0.01)
    for divergence_, beta in ((0.02, 2), (0.012, 2), (0.001, 1), (0.001, 0.5)):
        penalty.adapt(divergence_)
        assert penalty.beta == beta


def test_networks_side_by_side_equal_torchs_own():
    x = torch.rand(20, 4)
    layers = Layers([4, 8, 8, 2], torch.Generator().manual_seed(0), count=3)
    out = layers(x)
    assert out.shape == (3, 20, 2)
    for n in range(3):
        linear = [nn.Linear(4, 8), nn.Linear(8, 8), nn.Linear(8, 2)]
        with torch.no_grad():
            for layer, weight, bias in zip(linear, layers.weights, layers.biases, strict=True):
                bound = 1 / math.sqrt(layer.in_features)
                assert float(weight.abs().max()) <= bound  # as torch draws them
                assert float(weight.std()) == pytest.approx(bound / math.sqrt(3), rel=0.25)
                layer.weight.copy_(weight[n].T)
                layer.bias.copy_(bias[n, 0])
        stack = nn.Sequential(linear[0], nn.ReLU(), linear[1], nn.ReLU(), linear[2])
        assert torch.allclose(out[n], stack(x), atol=1e-6)
    critic = Critic(3, 1, (8,), torch.Generator().manual_seed(0), 2)
    assert torch.equal(critic(x[:, :3], x[:, 3:]), critic.layers(x)[..., 0])


def test_soft_updates():
    a, b = (Layers([2, 2], torch.Generator().manual_seed(seed)) for seed in (0, 1))
    before = copy.deepcopy(a)
    soft_update(a, b, 0.25)
    for new, old, source in zip(a.parameters(), before.parameters(), b.parameters(), strict=True):
        assert torch.allclose(new, 0.25 * source + 0.75 * old)  # Eq. 14


def test_the_penalty_waits_near_its_target_and_is_bounded():
    """Schulman et al. 2017, Sect. 4: twice beyond 1.5 targets, half below a target over 1.5."""
    for divergence_, factor in ((0.0151, 2), (0.0149, 1), (0.01 / 1.49, 1), (0.01 / 1.51, 0.5)):
        penalty = Penalty(3.0, 0.01)
        penalty.adapt(divergence_)
        assert penalty.beta == 3.0 * factor
    for divergence_, bound in ((1.0, 1e6), (0.0, 1e-6)):
        penalty = Penalty(1.0, 0.01)
        for _ in range(40):
            penalty.adapt(divergence_)
        assert penalty.beta == bound
    other = Penalty(1.0, 0.01)
    other.load_state_dict(penalty.state_dict())
    assert other.beta == penalty.beta


def test_first_weights_are_uniform_within_their_bound():
    """Their mean, spread and extremes, over many; nothing is drawn from torch's global generator."""
    state = torch.get_rng_state()
    layers = Layers([25, 400, 2], torch.Generator().manual_seed(0), count=2)
    assert torch.equal(torch.get_rng_state(), state)
    for parameter, bound in ((layers.weights[0], 0.2), (layers.biases[0], 0.2), (layers.weights[1], 0.05)):
        values = parameter.detach().numpy() / bound
        assert abs(values.mean()) < 4 / math.sqrt(3 * values.size)
        assert values.std() == pytest.approx(1 / math.sqrt(3), rel=0.06)
        assert 0.98 < values.max() <= 1
        assert -1 <= values.min() < -0.98
        assert not np.array_equal(values[0], values[1])


def test_actors_are_their_layers():
    x = torch.rand(7, 3, generator=torch.Generator().manual_seed(1))
    plain = DeterministicActor(3, 2, (5,), torch.Generator().manual_seed(0))
    assert torch.equal(plain(x), torch.tanh(plain.layers(x)[0]))
    squashed = SquashedGaussianActor(3, 2, (5,), torch.Generator().manual_seed(0))
    with torch.no_grad():
        squashed.layers.biases[-1][0, 0] = torch.tensor([0.0, 0.0, 9.0, -9.0])
    mean, log_std = squashed(x)
    assert torch.equal(mean, squashed.layers(x)[0][:, :2])
    assert (log_std[:, 0] == 2).all()
    assert (log_std[:, 1] == -5).all()
    gaussian = GaussianActor(3, 2, (5,), torch.Generator().manual_seed(0), spread=0.4)
    mean, log_std = gaussian(x)
    like = Layers([3, 5, 2], torch.Generator().manual_seed(0), activation=torch.tanh)
    with torch.no_grad():
        like.weights[-1] /= 100
    assert torch.allclose(mean, like(x)[0], atol=1e-7)
    assert log_std.exp().detach().numpy() == pytest.approx(np.full((7, 2), 0.4))
    assert adam(plain, 0.02).param_groups[0]["lr"] == 0.02
