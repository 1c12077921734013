"""Networks of the learners. Weights are drawn from a given generator, not from torch's global generator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional as F

LOG_STD = (-5.0, 2.0)  # bounds of the logarithm of a Gaussian policy's spread
_LOG_2PI = math.log(2 * math.pi)


class Layers(nn.Module):
    """`count` multilayer perceptrons of the same shape, evaluated together.

    Args:
        sizes: Widths of the layers from input to output.
        generator: Generator of the initial weights (uniform within 1 / sqrt(fan-in), as in torch's own layers).
        count: Number of networks.
        activation: Activation between layers.
    """

    def __init__(self, sizes: Sequence[int], generator: torch.Generator, *, count: int = 1, activation=F.relu) -> None:
        super().__init__()
        self.activation = activation
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for fan_in, fan_out in pairwise(sizes):
            bound = 1 / math.sqrt(fan_in)
            for into, shape in ((self.weights, (count, fan_in, fan_out)), (self.biases, (count, 1, fan_out))):
                into.append(nn.Parameter((2 * torch.rand(shape, generator=generator) - 1) * bound))

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs (count, B, out) for inputs (B, in)."""
        x = x.expand(len(self.weights[0]), *x.shape)
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, x, weight)
            if i < last:
                x = self.activation(x)
        return x


class Critic(nn.Module):
    """`count` networks, each of which estimates the value Q(s, a) of an action a in a state s."""

    def __init__(self, n_obs: int, n_act: int, hidden: Sequence[int], generator: torch.Generator, count: int) -> None:
        super().__init__()
        self.layers = Layers([n_obs + n_act, *hidden, 1], generator, count=count)

    def forward(self, obs: Tensor, action: Tensor) -> Tensor:
        """Return the `count` estimates of Q, (count, B), for observations (B, n_obs) and actions (B, n_act)."""
        return self.layers(torch.cat([obs, action], dim=1)).squeeze(-1)


class DeterministicActor(nn.Module):
    """Actor that returns the action a = tanh(f(s)) in a state s, with a network f."""

    def __init__(self, n_obs: int, n_act: int, hidden: Sequence[int], generator: torch.Generator) -> None:
        super().__init__()
        self.layers = Layers([n_obs, *hidden, n_act], generator)

    def forward(self, obs: Tensor) -> Tensor:
        """Return actions in [-1, 1], (B, n_act), for observations (B, n_obs)."""
        return torch.tanh(self.layers(obs)[0])


class SquashedGaussianActor(nn.Module):
    """Actor with actions a = tanh(u); u is normally distributed, and its mean and standard deviation depend on the
    state (SAC, appendix C).
    """

    def __init__(self, n_obs: int, n_act: int, hidden: Sequence[int], generator: torch.Generator) -> None:
        super().__init__()
        self.layers = Layers([n_obs, *hidden, 2 * n_act], generator)

    def forward(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean and the logarithm of the standard deviation of u, (B, n_act) each, for observations (B,
        n_obs).
        """
        mean, log_std = self.layers(obs)[0].chunk(2, dim=1)
        return mean, log_std.clamp(*LOG_STD)

    def sample(self, obs: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Return actions (B, n_act) for standard normal noise (B, n_act), and their log densities, (B,)."""
        mean, log_std = self(obs)
        u = mean + log_std.exp() * noise
        # log(1 - tanh(u)^2) without cancellation
        squash = 2 * (math.log(2) - u - F.softplus(-2 * u))
        return torch.tanh(u), (-0.5 * (noise**2 + _LOG_2PI) - log_std - squash).sum(dim=1)


class GaussianActor(nn.Module):
    """Actor with normally distributed actions; the mean depends on the state, the standard deviation does not (PPO)."""

    def __init__(
        self, n_obs: int, n_act: int, hidden: Sequence[int], generator: torch.Generator, *, spread: float
    ) -> None:
        super().__init__()
        self.layers = Layers([n_obs, *hidden, n_act], generator, activation=torch.tanh)
        with torch.no_grad():
            self.layers.weights[-1].mul_(0.01)  # nearly the same action everywhere at first
        self.log_std = nn.Parameter(torch.full((n_act,), math.log(spread)))

    def forward(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean and the logarithm of the standard deviation, (B, n_act) each, for observations (B, n_obs)."""
        mean = self.layers(obs)[0]
        return mean, self.log_std.expand_as(mean)


def log_density(u: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Return the log density of u under diagonal normal distributions, (B,)."""
    return (-0.5 * (((u - mean) / log_std.exp()) ** 2 + _LOG_2PI) - log_std).sum(dim=1)


def divergence(mean: Tensor, log_std: Tensor, new_mean: Tensor, new_log_std: Tensor) -> Tensor:
    """Return the Kullback-Leibler divergence KL[old | new] of diagonal normal distributions, (B,)."""
    ratio = (2 * (log_std - new_log_std)).exp()
    shift = ((new_mean - mean) / new_log_std.exp()) ** 2
    return 0.5 * (ratio + shift - 1 - 2 * (log_std - new_log_std)).sum(dim=1)


@torch.no_grad()
def soft_update(target: nn.Module, source: nn.Module, tau: float) -> None:
    """Update target parameters by Eq. 14: target <- tau source + (1 - tau) target."""
    for into, new in zip(target.parameters(), source.parameters(), strict=True):
        into.lerp_(new, tau)


def adam(module: nn.Module, learning_rate: float) -> torch.optim.Adam:
    """Return the Adam optimiser of a module's parameters, in PyTorch's fused implementation."""
    return torch.optim.Adam(module.parameters(), lr=learning_rate, fused=True)


def descend(optimizer: torch.optim.Optimizer, loss: Tensor) -> None:
    """Make one step of an optimizer down the gradient of a loss."""
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
