"""Hyperparameters of the learners: the paper's if it states them, else the field's usual defaults.

They are in one table, `SETTINGS`; every field is an option of `whiptool.train`. Values from Sects. 2.3.1-2.3.4 are
marked (paper).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from whiptool.errors import InputError
from whiptool.models.numbers import LARGEST, number, whole

_WIDEST, _MOST = 10_000, 1_000_000  # layer; any other whole number. What is beyond is a slip, and fills memory


@dataclass(frozen=True)
class TrainingPlan:
    """Length of a training (Algorithm 1: 500 episodes of 100 trials, the first 50 random).

    Args:
        episodes: Number of episodes.
        trials: Strikes per episode, simulated as one batch, one in each lane (sub-environment).
        random_episodes: Number of initial episodes in which strikes are uniformly random and nothing is learned.
        hindsight: Number of relabelled copies of every strike; needs an observation that contains the target.

    Raises:
        InputError: A number is out of range.
    """

    episodes: int = 500
    trials: int = 100
    random_episodes: int = 50
    hindsight: int = 0

    def __post_init__(self) -> None:
        for name, low in (("episodes", 1), ("trials", 2), ("random_episodes", 0), ("hindsight", 0)):
            whole(name, getattr(self, name), low=low)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of all learners.

    Args:
        hidden: Sizes of the hidden layers (from the paper).
        learning_rate: Learning rate of Adam, for all networks (from the paper).
        discount: Discount factor gamma; None: 0 for the observation `goal`, with which trials are independent, else the
            usual 0.99.
    """

    hidden: tuple[int, ...] = (256, 256)
    learning_rate: float = 3e-4
    discount: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.hidden, (tuple, list)) or not self.hidden:
            raise InputError("hidden", self.hidden, "one or more layer sizes")
        for size in self.hidden:
            whole("hidden", size, high=_WIDEST)
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            if str(f.type).startswith("float") and value is not None:
                high = 1 if f.name in ("discount", "tau") else LARGEST
                number(f.name, value, low=0, high=high, strict=f.name in ("learning_rate", "spread", "kl_target"))
            elif f.type == "int":
                whole(f.name, value, high=_MOST)

    def discount_for(self, observation: str) -> float:
        """Return the discount gamma for an observation."""
        if self.discount is not None:
            return self.discount
        return 0.0 if observation == "goal" else 0.99


@dataclass(frozen=True, kw_only=True)
class OffPolicy(Settings):
    """Settings of SAC, TD3 and DDPG.

    Args:
        tau: Step of the target networks towards the trained ones, Eq. 14 (usual: 0.005).
        batch_size: Transitions per update (usual: 256).
        updates: Updates per strike (Algorithm 1: one).
    """

    tau: float = 0.005
    batch_size: int = 256
    updates: int = 1


@dataclass(frozen=True, kw_only=True)
class SACSettings(OffPolicy):
    """Settings of SAC (soft actor-critic).

    Args:
        alpha: Weight of the entropy, Eq. 16 (paper: 0.2, fixed).
    """

    alpha: float = 0.2


@dataclass(frozen=True, kw_only=True)
class DDPGSettings(OffPolicy):
    """Settings of DDPG (deep deterministic policy gradient).

    Args:
        noise: Standard deviation of the exploration noise, as a fraction of half the width of the strikes' box (usual:
            0.1).
    """

    noise: float = 0.1


@dataclass(frozen=True, kw_only=True)
class TD3Settings(DDPGSettings):
    """Settings of TD3 (twin delayed DDPG).

    Args:
        target_noise: Standard deviation sigma of the noise on the target policy's actions, Eq. 15 (usual: 0.2).
        noise_clip: Largest magnitude c of that noise, Eq. 15 (usual: 0.5).
        delay: Critic updates per update of actor and target networks (usual: 2).
    """

    target_noise: float = 0.2
    noise_clip: float = 0.5
    delay: int = 2


@dataclass(frozen=True, kw_only=True)
class PPOSettings(Settings):
    """Settings of PPO (proximal policy optimization) with an adaptive KL penalty, Eq. 11.

    Args:
        hidden, learning_rate: As in `Settings` (from the paper).
        kl_target: Target of the divergence, to which beta is adapted (usual: 0.01).
        beta: Initial weight of the KL penalty (usual: 1).
        epochs: Passes over a batch (usual: 10).
        minibatch: Transitions per step (usual: 64).
        spread: Initial standard deviation of the actions, as a fraction of half the width of the strikes' box (usual:
            1).
    """

    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-4
    kl_target: float = 0.01
    beta: float = 1.0
    epochs: int = 10
    minibatch: int = 64
    spread: float = 1.0


SETTINGS: dict[str, type[Settings]] = {
    "sac": SACSettings,
    "td3": TD3Settings,
    "ddpg": DDPGSettings,
    "ppo": PPOSettings,
}


def settings_for(method: str, **changes: Any) -> Settings:
    """Return the default settings of a learner, with changes by name.

    Raises:
        InputError: No learner has this name, or the learner has no such setting.
    """
    if method not in SETTINGS:
        raise InputError("learner", method, ", ".join(SETTINGS))
    names = [f.name for f in dataclasses.fields(SETTINGS[method])]
    for name in changes:
        if name not in names:
            raise InputError(f"setting of {method}", name, ", ".join(names))
    return SETTINGS[method](**changes)
