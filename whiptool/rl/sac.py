"""Soft actor-critic (Haarnoja et al. 2018), with the fixed temperature of Eq. 16."""

from __future__ import annotations

import torch
from torch import Tensor

from whiptool.rl.learner import OffPolicyLearner
from whiptool.rl.networks import SquashedGaussianActor, adam, soft_update
from whiptool.rl.replay import Transitions
from whiptool.rl.settings import SACSettings


class SAC(OffPolicyLearner):
    """Maximises reward plus alpha times the policy's entropy."""

    def __init__(self, settings: SACSettings, **sizes) -> None:
        super().__init__(settings, n_critics=2, **sizes)
        self.actor = SquashedGaussianActor(self.n_obs, self.n_act, settings.hidden, self.generator)
        self.actor_optimizer = adam(self.actor, settings.learning_rate)
        self.critic_optimizer = adam(self.critic, settings.learning_rate)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """The squashed mean, or a sample."""
        if deterministic:
            return torch.tanh(self.actor(obs)[0])
        return self.actor.sample(obs, self.normal(len(obs), self.n_act))[0]

    def update(self, batch: Transitions) -> dict[str, Tensor]:
        """One step for the critics, one for the actor."""
        alpha = self.settings.alpha

        def next_action(obs: Tensor) -> tuple[Tensor, Tensor]:
            action, log_p = self.actor.sample(obs, self.normal(len(obs), self.n_act))
            return action, -alpha * log_p

        y = self.target_value(batch, next_action)
        q = self.critic(batch.obs, batch.action)
        critic_loss = ((q - y) ** 2).mean(dim=1).sum()
        self.critic_optimizer.zero_grad()
        critic_loss.backward()
        self.critic_optimizer.step()

        self.critic.requires_grad_(False)  # saves the critics' own gradients
        action, log_p = self.actor.sample(batch.obs, self.normal(len(batch.obs), self.n_act))
        actor_loss = (alpha * log_p - self.critic(batch.obs, action).amin(dim=0)).mean()  # Eq. 16
        self.actor_optimizer.zero_grad()
        actor_loss.backward()
        self.actor_optimizer.step()
        self.critic.requires_grad_(True)
        if self.discount:
            soft_update(self.target_critic, self.critic, self.settings.tau)
        return {"critic": critic_loss.detach(), "actor": actor_loss.detach(), "entropy": -log_p.detach().mean()}

    def _parts(self) -> dict:
        return {
            "actor": self.actor,
            "critic": self.critic,
            "target_critic": self.target_critic,
            "actor_optimizer": self.actor_optimizer,
            "critic_optimizer": self.critic_optimizer,
            "replay": self.replay,
        }
