"""Replay buffer: transitions in preallocated arrays, the oldest overwritten first."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Transitions:
    """B transitions.

    Args:
        obs, next_obs: (B, n_obs).
        action: Actions in [-1, 1], (B, n_act).
        reward: (B,).
        terminated: 1 where nothing follows, (B,); a truncated trial has 0, so that its future is bootstrapped.
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
        """Add transitions, overwriting the oldest where there is no room."""
        count = len(new.reward)
        where = (self._next + torch.arange(count)) % self.capacity
        for name, array in vars(self._data).items():
            array[where] = getattr(new, name).to(array.dtype)
        self._next = (self._next + count) % self.capacity
        self.size = min(self.size + count, self.capacity)

    def sample(self, count: int, generator: torch.Generator) -> Transitions:
        """Uniformly drawn transitions, with replacement."""
        which = torch.randint(self.size, (count,), generator=generator)
        return Transitions(**{name: array[which] for name, array in vars(self._data).items()})

    def state_dict(self) -> dict:
        """What is held, for a checkpoint."""
        used = {name: array[: self.size].clone() for name, array in vars(self._data).items()}
        return {"size": self.size, "next": self._next, **used}

    def load_state_dict(self, state: dict) -> None:
        """Take up a checkpoint."""
        self.size, self._next = int(state["size"]), int(state["next"])
        for name, array in vars(self._data).items():
            array[: self.size] = state[name]
