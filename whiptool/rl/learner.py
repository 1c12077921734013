"""What every learner is to the rest of the toolbox: it acts, it is shown transitions, it updates itself."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any

import torch
from torch import Tensor

from whiptool.errors import WhiptoolError
from whiptool.rl.networks import Critic, soft_update
from whiptool.rl.replay import ReplayBuffer, Transitions
from whiptool.rl.settings import OffPolicy, Settings


class Diverged(WhiptoolError):
    """A loss is not finite; what the learner knew before is in the last checkpoint."""


class Learner(ABC):
    """A policy that improves with the transitions it is shown.

    Args:
        settings: Its hyperparameters.
        n_obs, n_act: Sizes of an observation (normalised) and of an action, each in [-1, 1].
        discount: gamma.
        generator: Everything random is drawn from it.
    """

    actor: Any  # the network that acts

    def __init__(
        self, settings: Settings, *, n_obs: int, n_act: int, discount: float, generator: torch.Generator
    ) -> None:
        self.settings: Any = settings  # of the learner's own kind
        self.n_obs, self.n_act = n_obs, n_act
        self.discount, self.generator = discount, generator

    @abstractmethod
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """Actions for observations (B, n_obs): the policy's mean or mode, or one that explores; (B, n_act)."""

    @abstractmethod
    def learn(self, new: Transitions, *, update: bool = True) -> dict[str, float]:
        """Take in transitions and, unless asked not to, improve; losses by name.

        Raises:
            Diverged: A loss is not finite.
        """

    @abstractmethod
    def _parts(self) -> dict:
        """Whatever has a `state_dict`, by name."""

    @staticmethod
    def check(losses: dict[str, float]) -> None:
        """Refuse to continue with a loss that is not finite.

        Raises:
            Diverged: One of them is not finite.
        """
        for name, value in losses.items():
            if not math.isfinite(value):
                raise Diverged(f"{name} has become {value}: try a smaller learning rate")

    def state_dict(self) -> dict:
        """Everything that a killed run needs to go on as if nothing had happened; tensors and numbers only."""
        state = {name: part.state_dict() for name, part in self._parts().items()}
        return {**state, "generator": self.generator.get_state()}

    def load_state_dict(self, state: dict) -> None:
        """Take up what `state_dict` gave."""
        for name, part in self._parts().items():
            part.load_state_dict(state[name])
        self.generator.set_state(state["generator"])


class OffPolicyLearner(Learner):
    """What SAC, TD3 and DDPG share: a replay buffer, critics with slow targets, one update per strike."""

    def __init__(self, settings: OffPolicy, *, capacity: int = 100_000, n_critics: int, **sizes) -> None:
        super().__init__(settings, **sizes)
        self.replay = ReplayBuffer(capacity, self.n_obs, self.n_act)
        shape = (self.n_obs, self.n_act, settings.hidden)
        self.critic = Critic(*shape, self.generator, n_critics)
        self.target_critic = Critic(*shape, self.generator, n_critics).requires_grad_(False)
        soft_update(self.target_critic, self.critic, 1.0)

    def learn(self, new: Transitions, *, update: bool = True) -> dict[str, float]:
        """Store the transitions, then update `updates` times for each of them."""
        self.replay.add(new)
        losses: dict[str, Tensor] = {}
        for _ in range(self.settings.updates * len(new.reward) if update else 0):
            losses |= self.update(self.replay.sample(self.settings.batch_size, self.generator))
        values = {name: float(loss) for name, loss in losses.items()}
        self.check(values)
        return values

    @abstractmethod
    def update(self, batch: Transitions) -> dict[str, Tensor]:
        """One step of gradient descent; losses by name."""

    def target_value(self, batch: Transitions, next_action) -> Tensor:
        """r + gamma min_i Q_i(s', a') where something follows, (B,); `next_action` is asked only if it counts."""
        if self.discount == 0:
            return batch.reward
        with torch.no_grad():
            action, bonus = next_action(batch.next_obs)
            value = self.target_critic(batch.next_obs, action).amin(dim=0) + bonus
            return batch.reward + self.discount * (1 - batch.terminated) * value

    def normal(self, *shape: int) -> Tensor:
        """Return standard normal noise of a shape."""
        return torch.randn(shape, generator=self.generator)
