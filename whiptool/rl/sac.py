"""Soft actor-critic (Haarnoja et al. 2018), with the fixed temperature of Eq. 16."""

from __future__ import annotations

import torch
from torch import Tensor

from whiptool.rl.learner import OffPolicyLearner
from whiptool.rl.networks import SquashedGaussianActor
from whiptool.rl.settings import SACSettings


class SAC(OffPolicyLearner):
    """SAC learner: maximises the reward plus alpha times the policy's entropy."""

    Actor = SquashedGaussianActor

    def __init__(self, settings: SACSettings, **sizes) -> None:
        super().__init__(settings, n_critics=2, **sizes)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """Return the squashed mean if `deterministic`, or a sample; (B, n_act)."""
        return torch.tanh(self.actor(obs)[0]) if deterministic else self._sample(obs)[0]

    def next_action(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return a sample of the policy, and the entropy term that is added to its value."""
        action, log_p = self._sample(obs)
        return action, -self.settings.alpha * log_p

    def actor_loss(self, obs: Tensor) -> dict[str, Tensor]:
        """Return the loss of Eq. 16, and the entropy."""
        action, log_p = self._sample(obs)
        value = self.critic(obs, action).amin(dim=0)
        return {"actor": (self.settings.alpha * log_p - value).mean(), "entropy": -log_p.mean()}  # Eq. 16

    def update_targets(self) -> None:
        """One step of the slow targets where a future counts."""
        if self.discount:
            super().update_targets()

    def _sample(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        return self.actor.sample(obs, self.normal(len(obs), self.n_act))
