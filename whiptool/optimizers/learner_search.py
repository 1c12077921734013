"""A learner as a search: one fixed target, so that every strike is seen from the same state and nothing follows it."""

from __future__ import annotations

import numpy as np

from whiptool.extras import optional
from whiptool.objective import Objective

BATCH = 10  # strikes between updates
RANDOM_BATCHES = 2  # before the policy strikes
UPDATES = 4  # of an off-policy learner per strike: a trial costs more than an update


def gain(costs: np.ndarray, hits: np.ndarray) -> np.ndarray:
    """Return the rewards of costs [m] and hits, any shape: Eq. 17, multiplied by the negative cost for hits that have a
    merit.
    """
    from whiptool.rl.task import reward

    return reward(np.maximum(costs, 0), hits) * np.where(costs < 0, -costs, 1.0)


def learner_search(objective: Objective, *, seed: int, learner: str) -> None:
    """Train a learner on the objective's target until the objective stops it.

    Raises:
        SearchStopped: The objective ended the search.
        InputError: PyTorch is not installed.
        RuntimeError: A loss is not finite.
    """
    torch = optional("torch", f"method {learner}")
    from whiptool.rl.learner import Diverged
    from whiptool.rl.replay import Transitions
    from whiptool.rl.settings import OffPolicy, settings_for
    from whiptool.rl.training import LEARNERS

    settings = settings_for(learner)
    if isinstance(settings, OffPolicy):
        settings = settings_for(learner, updates=UPDATES)
    lower, upper = objective.bounds.box
    generator = torch.Generator().manual_seed(seed)
    policy = LEARNERS[learner](settings, n_obs=1, n_act=len(lower), discount=0.0, generator=generator)
    obs, over = torch.zeros(BATCH, 1), torch.ones(BATCH)
    number = 0
    while True:
        number += 1
        explore = number <= RANDOM_BATCHES
        actions = 2 * torch.rand(BATCH, len(lower), generator=generator) - 1 if explore else policy.act(obs)
        box = (np.clip(actions.numpy().astype(float), -1, 1) + 1) / 2
        outcomes = objective.batch(objective.admissible(lower + box * (upper - lower)))
        costs = np.array([outcome.cost for outcome in outcomes])
        gained = gain(costs, np.array([outcome.hit for outcome in outcomes]))
        new = Transitions(obs, actions, torch.as_tensor(gained, dtype=torch.float32), obs, over)
        try:
            policy.learn(new, update=not explore)
        except Diverged as error:
            raise RuntimeError(str(error)) from None  # as NLopt ends a search that failed
