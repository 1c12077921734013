"""Twin delayed DDPG (Fujimoto et al. 2018): clipped double critics, target smoothing (Eq. 15), delayed actor.

Eq. 13 as printed takes its target at the present state and action; this is the cited algorithm.
"""

from __future__ import annotations

from torch import Tensor, zeros

from whiptool.rl.ddpg import DDPG
from whiptool.rl.replay import Transitions
from whiptool.rl.settings import TD3Settings


class TD3(DDPG):
    """TD3 learner: DDPG with clipped double critics, target smoothing and delayed actor updates."""

    def __init__(self, settings: TD3Settings, **sizes) -> None:
        super().__init__(settings, n_critics=2, **sizes)
        self._counter = _Counter()

    def update(self, batch: Transitions) -> dict[str, Tensor]:
        """Make one gradient step of the critics, and every `delay`-th time of actor and targets; return the losses by
        name.
        """
        self._counter.n += 1
        if self._counter.n % self.settings.delay == 0:
            return super().update(batch)
        return self.update_critic(batch)

    def next_action(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the target policy's actions with clipped noise (Eq. 15), and zero as the bonus on their value."""
        s = self.settings
        noise = (s.target_noise * self.normal(len(obs), self.n_act)).clamp(-s.noise_clip, s.noise_clip)  # Eq. 15
        return (self.target_actor(obs) + noise).clamp(-1, 1), zeros(())

    def _parts(self) -> dict:
        return {**super()._parts(), "counter": self._counter}


class _Counter:
    """Number of updates, with the interface of a network's state."""

    n = 0

    def state_dict(self) -> dict:
        return {"n": self.n}

    def load_state_dict(self, state: dict) -> None:
        self.n = int(state["n"])
