"""Deep deterministic policy gradient (Lillicrap et al. 2016).

Eq. 12 as printed adds an entropy term, which a deterministic policy does not have; this is the cited algorithm.
"""

from __future__ import annotations

import torch
from torch import Tensor

from whiptool.rl.learner import OffPolicyLearner
from whiptool.rl.networks import DeterministicActor, adam, soft_update
from whiptool.rl.replay import Transitions
from whiptool.rl.settings import DDPGSettings


class DDPG(OffPolicyLearner):
    """One critic, one deterministic actor, slow targets of both, Gaussian exploration."""

    def __init__(self, settings: DDPGSettings, *, n_critics: int = 1, **sizes) -> None:
        super().__init__(settings, n_critics=n_critics, **sizes)
        shape = (self.n_obs, self.n_act, settings.hidden, self.generator)
        self.actor, self.target_actor = DeterministicActor(*shape), DeterministicActor(*shape)
        self.target_actor.requires_grad_(False)
        soft_update(self.target_actor, self.actor, 1.0)
        self.actor_optimizer = adam(self.actor, settings.learning_rate)
        self.critic_optimizer = adam(self.critic, settings.learning_rate)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """The actor's action, with noise unless deterministic."""
        action = self.actor(obs)
        if deterministic:
            return action
        return (action + self.settings.noise * self.normal(len(obs), self.n_act)).clamp(-1, 1)

    def update(self, batch: Transitions) -> dict[str, Tensor]:
        """One step for the critic, one for the actor and the targets."""
        losses = self.update_critic(batch)
        return losses | self.update_actor(batch)

    def next_action(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the target policy's next action, and zero to add to its value."""
        return self.target_actor(obs), torch.zeros(())

    def update_critic(self, batch: Transitions) -> dict[str, Tensor]:
        """One step of the critics toward their targets."""
        y = self.target_value(batch, self.next_action)
        loss = ((self.critic(batch.obs, batch.action) - y) ** 2).mean(dim=1).sum()
        self.critic_optimizer.zero_grad()
        loss.backward()
        self.critic_optimizer.step()
        return {"critic": loss.detach()}

    def update_actor(self, batch: Transitions) -> dict[str, Tensor]:
        """One step of the actor up the (first) critic, and of the targets."""
        self.critic.requires_grad_(False)
        loss = -self.critic(batch.obs, self.actor(batch.obs))[0].mean()
        self.actor_optimizer.zero_grad()
        loss.backward()
        self.actor_optimizer.step()
        self.critic.requires_grad_(True)
        soft_update(self.target_actor, self.actor, self.settings.tau)
        soft_update(self.target_critic, self.critic, self.settings.tau)
        return {"actor": loss.detach()}

    def _parts(self) -> dict:
        return {
            "actor": self.actor,
            "target_actor": self.target_actor,
            "critic": self.critic,
            "target_critic": self.target_critic,
            "actor_optimizer": self.actor_optimizer,
            "critic_optimizer": self.critic_optimizer,
            "replay": self.replay,
        }
