"""Base classes of learners, which act, receive transitions and update themselves; and the replay buffer."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from whiptool.errors import WhiptoolError
from whiptool.rl.networks import Critic, adam, descend, soft_update
from whiptool.rl.settings import OffPolicy, Settings


@dataclass(frozen=True)
class Transitions:
    """B transitions of a Markov decision process.

    Args:
        obs, next_obs: Observations before and after, (B, n_obs) each.
        action: Actions in [-1, 1], (B, n_act).
        reward: Rewards, (B,).
        terminated: 1 at the end of an episode, (B,); 0 for a truncated episode, whose future value is bootstrapped.
    """

    obs: Tensor
    action: Tensor
    reward: Tensor
    next_obs: Tensor
    terminated: Tensor


class ReplayBuffer:
    """Holds the last `capacity` transitions."""

    def __init__(self, capacity: int, n_obs: int, n_act: int) -> None:
        self.capacity, self.size, self._next = capacity, 0, 0
        self._data = Transitions(
            torch.zeros(capacity, n_obs),
            torch.zeros(capacity, n_act),
            torch.zeros(capacity),
            torch.zeros(capacity, n_obs),
            torch.zeros(capacity),
        )

    def add(self, new: Transitions) -> None:
        """Add transitions; the oldest are overwritten if the buffer is full."""
        count = len(new.reward)
        where = (self._next + torch.arange(count)) % self.capacity
        for name, array in vars(self._data).items():
            array[where] = getattr(new, name).to(array.dtype)
        self._next = (self._next + count) % self.capacity
        self.size = min(self.size + count, self.capacity)

    def sample(self, count: int, generator: torch.Generator) -> Transitions:
        """Return `count` transitions drawn uniformly with replacement."""
        which = torch.randint(self.size, (count,), generator=generator)
        return Transitions(**{name: array[which] for name, array in vars(self._data).items()})

    def state_dict(self) -> dict:
        """Return the contents for a checkpoint."""
        used = {name: array[: self.size].clone() for name, array in vars(self._data).items()}
        return {"size": self.size, "next": self._next, **used}

    def load_state_dict(self, state: dict) -> None:
        """Restore the contents from a checkpoint."""
        self.size, self._next = int(state["size"]), int(state["next"])
        for name, array in vars(self._data).items():
            array[: self.size] = state[name]


class Diverged(WhiptoolError):
    """Raised if a loss is not finite; the last checkpoint still has a finite state of the learner."""


class Learner(ABC):
    """Base of reinforcement learners.

    Args:
        settings: Hyperparameters.
        n_obs, n_act: Numbers of entries of a normalised observation and of an action, whose entries are in [-1, 1].
        discount: Discount factor gamma.
        generator: Generator of all random numbers.
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
        """Return actions (B, n_act) for observations (B, n_obs): the policy's mean or mode if `deterministic`, else
        exploring.
        """

    @abstractmethod
    def learn(self, new: Transitions, *, update: bool = True) -> dict[str, float]:
        """Add transitions and, if `update`, improve the policy; return the losses by name.

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
            Diverged: A loss is not finite.
        """
        for name, value in losses.items():
            if not math.isfinite(value):
                raise Diverged(f"{name} has become {value}: try a smaller learning rate")

    def state_dict(self) -> dict:
        """Return the state from which a killed run can be resumed exactly: tensors and numbers only."""
        state = {name: part.state_dict() for name, part in self._parts().items()}
        return {**state, "generator": self.generator.get_state()}

    def load_state_dict(self, state: dict) -> None:
        """Restore a state from `state_dict`."""
        for name, part in self._parts().items():
            part.load_state_dict(state[name])
        self.generator.set_state(state["generator"])


class OffPolicyLearner(Learner):
    """Base of SAC, TD3 and DDPG: a replay buffer, and critics with slowly updated target networks."""

    Actor: type[nn.Module]  # the network that acts

    def __init__(self, settings: OffPolicy, *, capacity: int = 100_000, n_critics: int, **sizes) -> None:
        super().__init__(settings, **sizes)
        self.replay = ReplayBuffer(capacity, self.n_obs, self.n_act)
        shape = (self.n_obs, self.n_act, settings.hidden, self.generator)
        self.critic = Critic(*shape, n_critics)
        self.target_critic = Critic(*shape, n_critics).requires_grad_(False)
        soft_update(self.target_critic, self.critic, 1.0)
        self.actor = self.Actor(*shape)
        self.actor_optimizer = adam(self.actor, settings.learning_rate)
        self.critic_optimizer = adam(self.critic, settings.learning_rate)

    def learn(self, new: Transitions, *, update: bool = True) -> dict[str, float]:
        """Store the transitions and, if `update`, make `settings.updates` gradient steps for each; return the losses by
        name.
        """
        self.replay.add(new)
        losses: dict[str, Tensor] = {}
        for _ in range(self.settings.updates * len(new.reward) if update else 0):
            losses |= self.update(self.replay.sample(self.settings.batch_size, self.generator))
        values = {name: float(loss) for name, loss in losses.items()}
        self.check(values)
        return values

    def update(self, batch: Transitions) -> dict[str, Tensor]:
        """Make one gradient step of the critics, then one of the actor, and update the target networks; return the
        losses by name.
        """
        losses = self.update_critic(batch)
        return losses | self.update_actor(batch)

    def update_critic(self, batch: Transitions) -> dict[str, Tensor]:
        """Make one gradient step of the critics towards their target values; return the loss."""
        y = self.target_value(batch)
        loss = ((self.critic(batch.obs, batch.action) - y) ** 2).mean(dim=1).sum()
        descend(self.critic_optimizer, loss)
        return {"critic": loss.detach()}

    @torch.no_grad()
    def target_value(self, batch: Transitions) -> Tensor:
        """Return the targets of the critics, (B,): r + gamma min_i Q_i(s', a'), or r for terminated transitions.

        `next_action` is only called if gamma is not 0.
        """
        if self.discount == 0:
            return batch.reward
        action, bonus = self.next_action(batch.next_obs)
        value = self.target_critic(batch.next_obs, action).amin(dim=0) + bonus
        return batch.reward + self.discount * (1 - batch.terminated) * value

    def update_actor(self, batch: Transitions) -> dict[str, Tensor]:
        """Make one gradient step of the actor with the critics fixed, and update the target networks; return the losses
        by name.
        """
        self.critic.requires_grad_(False)
        losses = self.actor_loss(batch.obs)
        descend(self.actor_optimizer, losses["actor"])
        self.critic.requires_grad_(True)
        self.update_targets()
        return {name: loss.detach() for name, loss in losses.items()}

    @abstractmethod
    def next_action(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the actions at the next observations, (B, n_act), and the term that is added to their value in the
        critics' targets, (B,) or ().
        """

    @abstractmethod
    def actor_loss(self, obs: Tensor) -> dict[str, Tensor]:
        """Return the loss `actor`, and further values for the log."""

    def update_targets(self) -> None:
        """Move the target networks of the critics one step towards the critics (Eq. 14)."""
        soft_update(self.target_critic, self.critic, self.settings.tau)

    def normal(self, *shape: int) -> Tensor:
        """Return an array of standard normal noise with the given shape."""
        return torch.randn(shape, generator=self.generator)

    def _parts(self) -> dict:
        names = ("actor", "critic", "target_critic", "actor_optimizer", "critic_optimizer", "replay")
        return {name: getattr(self, name) for name in names}
