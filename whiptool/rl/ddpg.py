"""Deep deterministic policy gradient (Lillicrap et al. 2016).

Eq. 12 as printed adds an entropy term, which a deterministic policy does not have; this is the cited algorithm.
"""

from __future__ import annotations

import torch
from torch import Tensor

from whiptool.rl.learner import OffPolicyLearner
from whiptool.rl.networks import DeterministicActor, soft_update
from whiptool.rl.settings import DDPGSettings


class DDPG(OffPolicyLearner):
    """DDPG learner: one critic, one deterministic actor, slowly updated target networks of both, Gaussian
    exploration."""

    Actor = DeterministicActor

    def __init__(self, settings: DDPGSettings, *, n_critics: int = 1, **sizes) -> None:
        super().__init__(settings, n_critics=n_critics, **sizes)
        self.target_actor = DeterministicActor(self.n_obs, self.n_act, settings.hidden, self.generator)
        self.target_actor.requires_grad_(False)
        soft_update(self.target_actor, self.actor, 1.0)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """Return the actor's actions (B, n_act), with noise unless `deterministic`."""
        action = self.actor(obs)
        if deterministic:
            return action
        return (action + self.settings.noise * self.normal(len(obs), self.n_act)).clamp(-1, 1)

    def next_action(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the target policy's next actions, and zero as the bonus on their value."""
        return self.target_actor(obs), torch.zeros(())

    def actor_loss(self, obs: Tensor) -> dict[str, Tensor]:
        """Return the mean value of the actor's actions by the (first) critic, negative."""
        return {"actor": -self.critic(obs, self.actor(obs))[0].mean()}

    def update_targets(self) -> None:
        """One step of the slow targets of actor and critics, Eq. 14."""
        soft_update(self.target_actor, self.actor, self.settings.tau)
        super().update_targets()

    def _parts(self) -> dict:
        return {**super()._parts(), "target_actor": self.target_actor}
