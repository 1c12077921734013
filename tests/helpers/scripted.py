"""A policy whose actions are given."""

from __future__ import annotations

import numpy as np
import torch

from whiptool.rl.task import StrikeTask


class Scripted:
    """Strikes straight ahead when asked for its mean, else one listed direction after the other."""

    def __init__(self, task: StrikeTask, directions: list[float]) -> None:
        self.task, self.directions, self.asked = task, list(directions), []

    def act(self, obs: torch.Tensor, *, deterministic: bool = False) -> torch.Tensor:
        self.asked.append((deterministic, obs.numpy().copy()))
        actions = np.zeros((len(obs), 5))
        actions[:, 0] = 0.0 if deterministic else self.directions.pop(0)
        return torch.as_tensor(actions)
