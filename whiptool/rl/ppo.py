"""Proximal policy optimization (Schulman et al. 2017) with the adaptive KL penalty of Eq. 11."""

from __future__ import annotations

import torch
from torch import Tensor

from whiptool.rl.learner import Learner
from whiptool.rl.networks import GaussianActor, Layers, adam, descend, divergence, log_density
from whiptool.rl.replay import Transitions
from whiptool.rl.settings import PPOSettings


class PPO(Learner):
    """PPO learner: a batch of strikes, one per lane, is used for several passes and then discarded.

    Actions are clipped to the box only for simulation, so that their densities are those of the Gaussian. As a batch
    has one strike per lane, the advantage of Eq. 11 is the one-step residual r + gamma V(s') - V(s).
    """

    def __init__(self, settings: PPOSettings, **sizes) -> None:
        super().__init__(settings, **sizes)
        self.actor = GaussianActor(self.n_obs, self.n_act, settings.hidden, self.generator, spread=settings.spread)
        self.value = Layers([self.n_obs, *settings.hidden, 1], self.generator, activation=torch.tanh)
        self.actor_optimizer = adam(self.actor, settings.learning_rate)
        self.value_optimizer = adam(self.value, settings.learning_rate)
        self.penalty = Penalty(settings.beta, settings.kl_target)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """Return the mean action, or a sample; (B, n_act), not clipped."""
        mean, log_std = self.actor(obs)
        if deterministic:
            return mean
        return mean + log_std.exp() * torch.randn(mean.shape, generator=self.generator)

    def learn(self, new: Transitions, *, update: bool = True) -> dict[str, float]:
        """Make several passes over transitions of the current policy, then adapt the penalty; return the losses by
        name.
        """
        if not update:  # what another policy did teaches an on-policy learner nothing
            return {}
        with torch.no_grad():
            mean, log_std = (x.clone() for x in self.actor(new.obs))  # the spread is a view of what is about to learn
            log_p = log_density(new.action, mean, log_std)
            following = self.discount * (1 - new.terminated) * self._value(new.next_obs)
            returns = new.reward + following
            advantage = returns - self._value(new.obs)
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        losses: dict[str, Tensor] = {}
        for _ in range(self.settings.epochs):
            order = torch.randperm(len(new.reward), generator=self.generator)
            for some in order.split(self.settings.minibatch):
                new_mean, new_log_std = self.actor(new.obs[some])
                ratio = (log_density(new.action[some], new_mean, new_log_std) - log_p[some]).exp()
                kl = divergence(mean[some], log_std[some], new_mean, new_log_std).mean()
                losses["actor"] = self.penalty.beta * kl - (ratio * advantage[some]).mean()  # Eq. 11
                descend(self.actor_optimizer, losses["actor"])
                losses["value"] = ((self._value(new.obs[some]) - returns[some]) ** 2).mean()
                descend(self.value_optimizer, losses["value"])
        with torch.no_grad():
            losses["divergence"] = divergence(mean, log_std, *self.actor(new.obs)).mean()
        values = {name: float(loss.detach()) for name, loss in losses.items()}
        self.check(values)
        self.penalty.adapt(values["divergence"])
        return values

    def _value(self, obs: Tensor) -> Tensor:
        return self.value(obs)[0, :, 0]

    def _parts(self) -> dict:
        names = ("actor", "value", "actor_optimizer", "value_optimizer", "penalty")
        return {name: getattr(self, name) for name in names}


class Penalty:
    """Weight beta of Eq. 11, doubled or halved to keep the divergence near its target (Schulman et al. 2017, Sect.
    4)."""

    def __init__(self, beta: float, target: float) -> None:
        self.beta, self.target = beta, target

    def adapt(self, divergence: float) -> None:
        """Adapt beta to the divergence after an update."""
        if divergence > 1.5 * self.target:
            self.beta = min(self.beta * 2, 1e6)
        elif divergence < self.target / 1.5:
            self.beta = max(self.beta / 2, 1e-6)

    def state_dict(self) -> dict:
        """Return the state for a checkpoint."""
        return {"beta": self.beta}

    def load_state_dict(self, state: dict) -> None:
        """Restore the state from a checkpoint."""
        self.beta = float(state["beta"])
