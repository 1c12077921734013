"""The learners: SAC, DDPG and TD3, which learn from a replay buffer, and PPO, which learns from its last strikes."""

from __future__ import annotations

import torch
from torch import Tensor, zeros

from whiptool.errors import InputError
from whiptool.rl.learner import Learner, OffPolicyLearner, Transitions
from whiptool.rl.networks import (
    DeterministicActor,
    GaussianActor,
    Layers,
    SquashedGaussianActor,
    adam,
    descend,
    divergence,
    log_density,
    soft_update,
)
from whiptool.rl.settings import DDPGSettings, PPOSettings, SACSettings, Settings, TD3Settings
from whiptool.rl.task import StrikeTask


class SAC(OffPolicyLearner):
    """Soft actor-critic (Haarnoja et al. 2018): maximises the reward plus alpha times the policy's entropy.

    The temperature alpha is fixed, as in Eq. 16.
    """

    Actor = SquashedGaussianActor

    def __init__(self, settings: SACSettings, **sizes) -> None:
        super().__init__(settings, n_critics=2, **sizes)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """Return the policy's actions (B, n_act): its squashed mean if `deterministic`, else a sample."""
        return torch.tanh(self.actor(obs)[0]) if deterministic else self._sample(obs)[0]

    def next_action(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """Return a sample of the policy (B, n_act), and the entropy term that is added to its value (B,)."""
        action, log_p = self._sample(obs)
        return action, -self.settings.alpha * log_p

    def actor_loss(self, obs: Tensor) -> dict[str, Tensor]:
        """Return the loss `actor` of Eq. 16, and the policy's `entropy`."""
        action, log_p = self._sample(obs)
        value = self.critic(obs, action).amin(dim=0)
        return {"actor": (self.settings.alpha * log_p - value).mean(), "entropy": -log_p.mean()}  # Eq. 16

    def update_targets(self) -> None:
        """Move the target networks of the critics one step towards the critics (Eq. 14) if the discount is not 0."""
        if self.discount:
            super().update_targets()

    def _sample(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        return self.actor.sample(obs, self.normal(len(obs), self.n_act))


class DDPG(OffPolicyLearner):
    """Deep deterministic policy gradient (Lillicrap et al. 2016): one critic, one deterministic actor, slowly updated
    target networks of both, Gaussian exploration.

    Eq. 12 as printed adds an entropy term, which a deterministic policy does not have; this is the cited algorithm.
    """

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
        """Return the negative mean value of the actor's actions by the first critic."""
        return {"actor": -self.critic(obs, self.actor(obs))[0].mean()}

    def update_targets(self) -> None:
        """Move the target networks of actor and critics one step towards actor and critics (Eq. 14)."""
        soft_update(self.target_actor, self.actor, self.settings.tau)
        super().update_targets()

    def _parts(self) -> dict:
        return {**super()._parts(), "target_actor": self.target_actor}


class TD3(DDPG):
    """Twin delayed DDPG (Fujimoto et al. 2018): clipped double critics, target smoothing (Eq. 15), delayed actor.

    Eq. 13 as printed takes its target at the present state and action; this is the cited algorithm.
    """

    def __init__(self, settings: TD3Settings, **sizes) -> None:
        super().__init__(settings, n_critics=2, **sizes)
        self._counter = _Counter()

    def update(self, batch: Transitions) -> dict[str, Tensor]:
        """Make one gradient step of the critics, and every `delay`-th time of actor and target networks; return the
        losses by name.
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


class PPO(Learner):
    """Proximal policy optimization (Schulman et al. 2017) with the adaptive KL penalty of Eq. 11.

    A batch of strikes, one per lane (sub-environment), is used for several passes and then discarded. Actions are
    clipped to the box only for simulation, so that their densities are those of the Gaussian. As a batch has one strike
    per lane, the advantage of Eq. 11 is the one-step residual r + gamma V(s') - V(s).
    """

    def __init__(self, settings: PPOSettings, **sizes) -> None:
        super().__init__(settings, **sizes)
        self.actor = GaussianActor(self.n_obs, self.n_act, settings.hidden, self.generator, spread=settings.spread)
        self.value = Layers([self.n_obs, *settings.hidden, 1], self.generator, activation=torch.tanh)
        self.actor_optimizer = adam(self.actor, settings.learning_rate)
        self.value_optimizer = adam(self.value, settings.learning_rate)
        self.penalty = Penalty(settings.beta, settings.kl_target)

    @torch.no_grad()
    def act(self, obs: Tensor, *, deterministic: bool = False) -> Tensor:
        """Return actions (B, n_act), not clipped: the policy's mean if `deterministic`, else a sample."""
        mean, log_std = self.actor(obs)
        if deterministic:
            return mean
        return mean + log_std.exp() * torch.randn(mean.shape, generator=self.generator)

    def learn(self, new: Transitions, *, update: bool = True) -> dict[str, float]:
        """Make several passes over transitions of the current policy, then adapt the penalty; return the losses by
        name.
        """
        if not update:  # what another policy did teaches an on-policy learner nothing
            return {}
        with torch.no_grad():
            mean, log_std = (x.clone() for x in self.actor(new.obs))  # the spread is a view of what is about to learn
            log_p = log_density(new.action, mean, log_std)
            following = self.discount * (1 - new.terminated) * self._value(new.next_obs)
            returns = new.reward + following
            advantage = returns - self._value(new.obs)
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        losses: dict[str, Tensor] = {}
        for _ in range(self.settings.epochs):
            order = torch.randperm(len(new.reward), generator=self.generator)
            for some in order.split(self.settings.minibatch):
                new_mean, new_log_std = self.actor(new.obs[some])
                ratio = (log_density(new.action[some], new_mean, new_log_std) - log_p[some]).exp()
                kl = divergence(mean[some], log_std[some], new_mean, new_log_std).mean()
                losses["actor"] = self.penalty.beta * kl - (ratio * advantage[some]).mean()  # Eq. 11
                descend(self.actor_optimizer, losses["actor"])
                losses["value"] = ((self._value(new.obs[some]) - returns[some]) ** 2).mean()
                descend(self.value_optimizer, losses["value"])
        with torch.no_grad():
            losses["divergence"] = divergence(mean, log_std, *self.actor(new.obs)).mean()
        values = {name: float(loss.detach()) for name, loss in losses.items()}
        self.check(values)
        self.penalty.adapt(values["divergence"])
        return values

    def _value(self, obs: Tensor) -> Tensor:
        return self.value(obs)[0, :, 0]

    def _parts(self) -> dict:
        names = ("actor", "value", "actor_optimizer", "value_optimizer", "penalty")
        return {name: getattr(self, name) for name in names}


class Penalty:
    """Weight beta of the KL divergence between old and new policy in Eq. 11, which is doubled or halved to keep the
    divergence near its target (Schulman et al. 2017, Sect. 4).
    """

    def __init__(self, beta: float, target: float) -> None:
        self.beta, self.target = beta, target

    def adapt(self, divergence: float) -> None:
        """Double beta if the divergence after an update is above 1.5 times its target; halve it if below the target /
        1.5.
        """
        if divergence > 1.5 * self.target:
            self.beta = min(self.beta * 2, 1e6)
        elif divergence < self.target / 1.5:
            self.beta = max(self.beta / 2, 1e-6)

    def state_dict(self) -> dict:
        """Return the state for a checkpoint."""
        return {"beta": self.beta}

    def load_state_dict(self, state: dict) -> None:
        """Restore the state from a checkpoint."""
        self.beta = float(state["beta"])


LEARNERS: dict[str, type[Learner]] = {"sac": SAC, "td3": TD3, "ddpg": DDPG, "ppo": PPO}
LOSSES = {
    "sac": ("critic", "actor", "entropy"),
    "td3": ("critic", "actor"),
    "ddpg": ("critic", "actor"),
    "ppo": ("actor", "value", "divergence"),
}


def make_learner(method: str, settings: Settings, task: StrikeTask, generator: torch.Generator) -> Learner:
    """Return a new learner for a task.

    Raises:
        InputError: No learner has this name.
    """
    if method not in LEARNERS:
        raise InputError("learner", method, ", ".join(LEARNERS))
    return LEARNERS[method](
        settings,
        n_obs=task.n_obs,
        n_act=task.n_act,
        discount=settings.discount_for(task.observation),
        generator=generator,
    )
