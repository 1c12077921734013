"""Replay buffer: transitions in preallocated arrays, the oldest overwritten first."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


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
