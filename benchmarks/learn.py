"""How fast does our SAC learn, against Stable-Baselines3's? The paper's circle, `goal` observation, 2,000 strikes.

Both get the same environment, budget, first random strikes and hyperparameters (256-256, 3e-4, batches of 256, fixed
alpha of 0.2, no discount, one update per strike), and see observations normalised alike; in turn, seed by seed, in one
process. Then each strikes at 300 random targets until it hits: the mean action first, after a miss samples. The full
form trains both on to 4,000 strikes.

    python benchmarks/learn.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from tqdm import tqdm

from whiptool.goals.zone import sample
from whiptool.rl.actor_critic import make_learner
from whiptool.rl.environment import WhipEnv, make_task
from whiptool.rl.learner import Learner
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.settings import TrainingPlan, settings_for
from whiptool.rl.task import StrikeTask
from whiptool.rl.training import Training

TRIALS, RANDOM_EPISODES = 100, 4
CAP = 600

Extend = Callable[[int], Learner]  # trains for so many more strikes


class Normalised(gymnasium.ObservationWrapper):
    """Shows what our own learners are shown."""

    def __init__(self, env: gymnasium.Env, task: StrikeTask) -> None:
        super().__init__(env)
        self.task = task
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (task.n_obs,), np.float32)

    def observation(self, observation: np.ndarray) -> np.ndarray:
        """One observation, (n_obs,)."""
        return self.task.normalise(observation[None])[0].astype(np.float32)


class Guest:
    """A Stable-Baselines3 learner, asked as ours are."""

    def __init__(self, algorithm: BaseAlgorithm) -> None:
        self.algorithm = algorithm

    def act(self, obs: torch.Tensor, *, deterministic: bool = False) -> torch.Tensor:
        """Actions, (B, n_act)."""
        return torch.as_tensor(self.algorithm.predict(obs.numpy(), deterministic=deterministic)[0])


def ours(seed: int) -> Extend:
    """This project's SAC."""
    task = make_task(observation="goal")
    learner = make_learner("sac", settings_for("sac"), task, torch.Generator().manual_seed(seed))
    training = Training(learner, task, TrainingPlan(trials=TRIALS, random_episodes=RANDOM_EPISODES))

    def extend(strikes: int) -> Learner:
        training.run(episodes=strikes // TRIALS)
        return learner

    return extend


def theirs(seed: int) -> Extend:
    """Stable-Baselines3's SAC."""
    env = WhipEnv(observation="goal")
    algorithm = SAC(
        "MlpPolicy",
        Normalised(env, env.task),
        learning_rate=3e-4,
        buffer_size=100_000,
        learning_starts=RANDOM_EPISODES * TRIALS,
        batch_size=256,
        gamma=0.0,
        ent_coef=0.2,
        policy_kwargs={"net_arch": [256, 256]},
        seed=seed,
        device="cpu",
    )

    def extend(strikes: int) -> Learner:
        algorithm.learn(strikes, reset_num_timesteps=False)
        return Guest(algorithm)

    return extend


def clocks() -> np.ndarray:
    """Wall time, and time of all cores, which hardly depends on what else they do [s], (2,)."""
    return np.array([time.perf_counter(), time.process_time()])


def main() -> None:
    """Train, strike and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one seed, 2,000 strikes")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    seeds, budgets = (1, [2000]) if arguments.quick else (3, [2000, 4000])
    judge = make_task(observation="goal")
    targets = sample(judge.zone, 300, np.random.default_rng(0))
    makers = {"ours": ours, "sb3": theirs}
    for make in makers.values():
        make(99)(600)  # imports, compiles and warms up before the clock starts
    seconds = {name: np.zeros((seeds, len(budgets), 2)) for name in makers}  # wall time, and time of all cores
    trials = {name: np.zeros((seeds, len(budgets), len(targets))) for name in makers}
    for seed in tqdm(range(seeds), leave=False):
        for name, make in list(makers.items())[:: 1 if seed % 2 == 0 else -1]:
            start = clocks()
            extend, done, spent = make(seed), 0, clocks() - start
            for i, budget in enumerate(budgets):
                start = clocks()
                learner = extend(budget - done)
                spent += clocks() - start
                seconds[name][seed, i], done = spent, budget
                trials[name][seed, i] = trials_to_hit(learner, judge, targets, cap=CAP)[0]
    ratios = seconds["ours"] / seconds["sb3"]
    report = {}
    for i, budget in enumerate(budgets):
        report[budget] = {
            "wall_time": float(seconds["ours"][:, i, 0].mean()),
            "wall_time_sb3": float(seconds["sb3"][:, i, 0].mean()),
            "wall_time_over_sb3": float(np.median(ratios[:, i, 0])),
            "cpu_time_over_sb3": float(np.median(ratios[:, i, 1])),
            "trials_to_hit": float(trials["ours"][:, i].mean()),
            "trials_to_hit_sb3": float(trials["sb3"][:, i].mean()),
            "largest_trials": int(trials["ours"][:, i].max()),
            "largest_trials_sb3": int(trials["sb3"][:, i].max()),
        }
    if arguments.json:
        later = {f"after_{budget}": r for budget, r in report.items() if budget != budgets[0]}
        print(
            json.dumps({"seeds": seeds, "targets": len(targets), "strikes": budgets[0], **report[budgets[0]], **later})
        )
        return
    print(f"SAC, ours against Stable-Baselines3's: {seeds} seeds, trials to hit over {len(targets)} targets")
    for budget, r in report.items():
        print(
            f"  after {budget} strikes: wall time {r['wall_time_over_sb3']:.2f} of theirs, time of all cores "
            f"{r['cpu_time_over_sb3']:.2f}"
        )
        for name, end in (("ours", ""), ("SB3", "_sb3")):
            print(
                f"    {name:5s} {r['wall_time' + end]:6.1f} s   trials to hit: mean {r['trials_to_hit' + end]:.3f}, "
                f"largest {r['largest_trials' + end]}"
            )


if __name__ == "__main__":
    main()
