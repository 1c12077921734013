"""Trainings and policies from the configurations of runs, and a training without a run folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from whiptool.errors import InputError, expect
from whiptool.extras import optional
from whiptool.given_files import parsing
from whiptool.goals.arrival_rule import GoalRegion, named_rule, named_zone
from whiptool.goals.target import HIT_RADIUS, Target
from whiptool.goals.zone import Zone
from whiptool.impedance.controller import controller_from_table
from whiptool.models import numbers
from whiptool.models.files import model_from_table
from whiptool.models.strike import T_STAY, Strike
from whiptool.process_settings import HeldSetting
from whiptool.progress import Progress
from whiptool.rl.settings import TrainingPlan, settings_for
from whiptool.rl.task import OLD_OBSERVATIONS, StrikeTask
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.interface import Rollout
from whiptool.runs import CONFIG, config_of
from whiptool.words import method_name

if TYPE_CHECKING:
    from whiptool.rl.policy import Policy
    from whiptool.rl.training import Training, TrainingEpisode

CHECKPOINT, BEST, EPISODES = "checkpoint.pt", "best.pt", "episodes.csv"  # files of a run folder


def task_of(config: Mapping[str, Any]) -> StrikeTask:
    """Return the task of a run of `whiptool train`, from its configuration."""
    options, model = config["options"], model_from_table(config["model"])
    controller, observation = controller_from_table(config["controller"]), options.get("observation", "goal")
    accuracy = {"tolerance": options.get("tolerance"), "timestep": options.get("timestep")}
    return StrikeTask(
        CompiledRollout(model, controller, **accuracy),
        GoalRegion(named_zone(options, model), named_rule(options), options.get("hit_radius", HIT_RADIUS)),
        observation=OLD_OBSERVATIONS.get(observation, observation),
        reward=options.get("reward", "paper"),
        strikes=options.get("strikes", 100),
        t_stay=options.get("t_stay", T_STAY),
    )


def training_of(config: Mapping[str, Any]) -> Training:
    """Return the training, before its first episode, that the configuration of a run of `whiptool train` describes."""
    options = config["options"]
    settings = {name: tuple(x) if isinstance(x, list) else x for name, x in config["settings"].items()}
    plan = TrainingPlan(**{name: options[name] for name in ("episodes", "trials", "random_episodes", "hindsight")})
    return _training(options["method"], settings, task_of(config), plan, options["seed"])


def _training(method: str, settings: Mapping[str, Any], task: StrikeTask, plan: TrainingPlan, seed: int) -> Training:
    torch = optional("torch", "whiptool train")
    from whiptool.rl.actor_critic import make_learner
    from whiptool.rl.policy import held_out_goals
    from whiptool.rl.training import Training

    learner = make_learner(method, settings_for(method, **settings), task, torch.Generator().manual_seed(seed))
    return Training(learner, task, plan, held_out_goals(task, seed))


def load_policy(run_folder: str | Path) -> Policy:
    """Return the policy in a run folder of `python -m whiptool.train`.

    Args:
        run_folder: The folder, for its best policy or, if none was stored, its last; or one of the files in it:
            `best.pt`, or `checkpoint.pt` for the policy of its last checkpoint.

    Raises:
        InputError: PyTorch is not installed, or the folder is of another command, or has no complete file of a policy.
    """
    expect(str, PathLike, run_folder=run_folder)
    optional("torch", "a policy")
    from whiptool.rl.policy import Policy

    given = Path(run_folder)
    folder = given.parent if given.is_file() else given
    kept = folder / BEST if (folder / BEST).is_file() else folder / CHECKPOINT
    config = config_of(folder, "train")
    with parsing(folder / CONFIG, "TOML"):
        training = training_of(config)
    training.load(given if given.is_file() else kept)
    return Policy(training.learner, training.task)


def held_out_strike(policy: Path) -> tuple[Policy, Target, Strike]:
    """Return a stored policy, the first of its training's held-out goals, and the policy's first strike at it.

    Args:
        policy: As `run_folder` of `load_policy`, with its errors.
    """
    from whiptool.rl.policy import held_out_goals

    folder, loaded = policy.parent if policy.is_file() else policy, load_policy(policy)
    target = Target.of(held_out_goals(loaded.task, config_of(folder, "train")["options"]["seed"]), 0)
    return loaded, target, loaded.strike(target)


def train(
    rollout: CompiledRollout | StrikeTask,
    zone: Zone | GoalRegion | None = None,
    method: str = "sac",
    *,
    episodes: int | None = None,
    plan: TrainingPlan | None = None,
    seed: int = 0,
    progress: bool = True,
    settings: Mapping[str, Any] | None = None,
) -> Policy:
    """Train a policy that strikes at any target of a zone (Algorithm 1), in memory: without a run folder.

    Args:
        rollout: Simulator of the model and controller, of which a `StrikeTask` is made; or a `StrikeTask`.
        zone: Zone of the targets, such as `Disc((1.2, 0.1), 0.2)`, or region of goals, see `StrikeTask`.
        method: `sac`, `td3`, `ddpg` or `ppo`. Capital letters and hyphens make no difference.
        episodes: Number of episodes of 100 strikes, the first tenth of which are random; 500 if no `plan` is given.
        plan: Length of the training, in place of `episodes`.
        seed: Seed of everything random.
        progress: Show a bar.
        settings: Hyperparameters of the learner by name, such as `{"learning_rate": 1e-3}`.

    Returns:
        The policy that hit most held-out goals, or the last policy if the training was too short to evaluate any:
        `policy.strike(target)`, or `policy.predict(observation)`.

    Raises:
        InputError: PyTorch is not installed, there is no such learner, a number is out of range, or `episodes` and
            `plan` are both given.
        Diverged: A loss is not finite.
    """
    expect(Rollout, StrikeTask, rollout=rollout)
    optional("torch", "training")
    expect(str, method=method)
    expect(TrainingPlan, type(None), plan=plan)
    method = method_name(method)
    seed = numbers.whole("seed", seed, low=0)
    if plan is None:
        episodes = numbers.whole("episodes", 500 if episodes is None else episodes)
        plan = TrainingPlan(episodes, random_episodes=episodes // 10)
    elif episodes is not None:
        raise InputError("episodes", episodes, "None with a plan, which has the number of episodes")
    if isinstance(rollout, StrikeTask) and zone is not None:
        raise InputError("zone", str(zone), "None, because a StrikeTask has a zone")
    task = rollout if isinstance(rollout, StrikeTask) else StrikeTask(rollout, zone)
    training = _training(method, settings or {}, task, plan, seed)
    with one_torch_thread(), Progress(total=plan.episodes, unit=" episodes", desc=method, disable=not progress) as bar:

        def on_episode(episode: TrainingEpisode) -> None:
            bar.update()

        training.run(on_episode)
    return training.policy()


def _one_thread() -> Callable[[], None]:
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    return lambda: torch.set_num_threads(before)


_ONE_THREAD = HeldSetting(_one_thread, in_each=True)  # as of OpenMP


def one_torch_thread() -> AbstractContextManager[None]:
    """Limit PyTorch to one thread within a `with` block, so that sums are reproducible to the last digit. The limit
    is the whole process's.
    """
    return _ONE_THREAD.held()
