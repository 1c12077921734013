"""Train a policy over a zone of targets (Algorithm 1): `python -m whiptool.train --method sac`."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from whiptool.commands import cli
from whiptool.errors import InputError, WhiptoolError, expect
from whiptool.extras import optional
from whiptool.models import numbers
from whiptool.options import (
    MANY_TARGETS,
    Learner,
    ModelOptions,
    Observation,
    ResumableOptions,
    SeedOptions,
    SimulatedControllerOptions,
    StepOptions,
    TrainingOptions,
    ZoneGoalOptions,
    flag,
    refuse_idle,
    whole,
)
from whiptool.progress import Progress, note
from whiptool.references import CITATIONS
from whiptool.rollout.interface import Rollout
from whiptool.words import counted, method_name

if TYPE_CHECKING:
    from whiptool.goals.zone import Zone
    from whiptool.rl.policy import Policy
    from whiptool.rl.settings import Settings
    from whiptool.rl.task import StrikeTask
    from whiptool.rl.training import Training, TrainingEpisode
    from whiptool.rollout import CompiledRollout

CHECKPOINT, BEST, EPISODES, CURVE = "checkpoint.pt", "best.pt", "episodes.csv", "learning.png"
TRIALS_TO_HIT = 600  # that a trained policy has at each target
_HYPERPARAMETERS = (
    "learning_rate",
    "discount",
    "alpha",
    "tau",
    "batch_size",
    "updates",
    "noise",
    "target_noise",
    "noise_clip",
    "delay",
    "kl_target",
    "beta",
    "epochs",
    "minibatch",
    "spread",
)


@dataclass(frozen=True, kw_only=True)
class TrainOptions(
    ResumableOptions,
    SeedOptions,
    TrainingOptions,
    StepOptions,
    SimulatedControllerOptions,
    ModelOptions,
    ZoneGoalOptions,
):
    """Train a policy that strikes at any target of a zone; the zone's centre is --target."""

    changeable: ClassVar[tuple[str, ...]] = ("checkpoint_every", "episodes")
    first: ClassVar[tuple[str, ...]] = (
        "method",
        "region",
    )
    in_space: ClassVar[bool] = True

    method: Learner = "sac"
    """Learning algorithm."""
    region: Path | None = None
    """Draw the targets from the region in this file instead of a disc (see whiptool.goals.zone.Region)."""
    observation: Observation = "goal"
    """What the policy observes."""
    reward: Literal["paper", "log"] = "paper"
    """Reward: Eq. 17, or minus the logarithm of the miss distance in units of the hit radius."""
    strikes: int = 100
    """Largest number of strikes at one target in an episode."""
    hidden: tuple[int, ...] | None = None
    """Sizes of the hidden layers. The defaults of this and the following options down to --spread depend on the method;
    see the documentation."""
    learning_rate: float | None = None
    """Learning rate of Adam."""
    discount: float | None = None
    """Discount factor gamma; default: 0 for observation goal, else 0.99."""
    alpha: float | None = None
    """Weight of the entropy (sac)."""
    tau: float | None = None
    """Soft-update rate (sac, td3, ddpg)."""
    batch_size: int | None = None
    """Transitions per update (sac, td3, ddpg)."""
    updates: int | None = None
    """Updates per strike (sac, td3, ddpg)."""
    noise: float | None = None
    """Standard deviation of the exploration noise (td3, ddpg)."""
    target_noise: float | None = None
    """sigma of Eq. 15 (td3)."""
    noise_clip: float | None = None
    """c of Eq. 15 (td3)."""
    delay: int | None = None
    """Critic updates per actor update (td3)."""
    kl_target: float | None = None
    """Target KL divergence per batch, towards which beta is adjusted (ppo)."""
    beta: float | None = None
    """Initial weight of the KL penalty (ppo)."""
    epochs: int | None = None
    """Passes over a batch (ppo)."""
    minibatch: int | None = None
    """Transitions per gradient step (ppo)."""
    spread: float | None = None
    """Initial standard deviation of the actions (ppo)."""
    checkpoint_every: int = 10
    """Episodes between checkpoints."""
    tests: int = 300
    """Number of targets on which the trained policy is tested (Eq. 21)."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.rl.settings import settings_for

        super().check()
        settings_for(self.method, **self.hyperparameters())
        if self.region is not None:
            refuse_idle(self, dict.fromkeys(self.of_disc, "only without --region"))
        whole("--tests", self.tests, high=MANY_TARGETS)
        for name in ("checkpoint_every", "strikes"):
            whole(flag(name), getattr(self, name))
        if self.hindsight and (self.method == "ppo" or self.observation != "goal"):
            allowed = "0, unless the learner has a replay buffer (sac, td3, ddpg) and the observation is goal"
            raise InputError("--hindsight", self.hindsight, allowed)

    def needs(self) -> tuple[str, ...]:
        """Return the modules of extras that the command imports with these options."""
        return ("torch", "tensorboard")

    def hyperparameters(self) -> dict[str, Any]:
        """Those that are given."""
        given = {name: getattr(self, name) for name in ("hidden", *_HYPERPARAMETERS)}
        return {name: value for name, value in given.items() if value is not None}


_EXAMPLE = (
    "Train a policy that strikes at any target of a zone. "
    "Example: python -m whiptool.train --method sac --episodes 20 --random-episodes 4"
)


def main(args: Sequence[str] | None = None) -> int:
    """The command line; the exit status is 0, 1 for a failure, 2 for bad input, 130 when interrupted."""
    return cli.run(lambda: _main(args))


def _main(args: Sequence[str] | None) -> int:
    options = cli.parse_resumable(TrainOptions, command="train", description=_EXAMPLE, args=args)
    with cli.options_named(options):
        run = _Run(options)
        with run.folder:
            return run.train()


def load_policy(run_folder: str | Path) -> Policy:
    """Return the policy that `python -m whiptool.train` left in its run folder.

    Args:
        run_folder: The folder, for the best policy, the last one of a training that kept none; or one of the files in
            it: `best.pt`, or `checkpoint.pt` for the policy of its last checkpoint.

    Raises:
        InputError: PyTorch is not installed, or the folder is of another command, or holds no whole file of a policy.
    """
    expect(str, PathLike, run_folder=run_folder)
    optional("torch", "a policy")
    from whiptool.rl.policy import Policy

    given = Path(run_folder)
    folder = given.parent if given.is_file() else given
    kept = folder / BEST if (folder / BEST).is_file() else folder / CHECKPOINT
    training = build_training(cli.options_of_run(TrainOptions, folder, command="train"))
    training.load(given if given.is_file() else kept)
    return Policy(training.learner, training.task)


def train(
    rollout: CompiledRollout,
    zone: Zone | None = None,
    method: str = "sac",
    *,
    episodes: int = 500,
    trials: int = 100,
    random_episodes: int | None = None,
    hindsight: int = 0,
    seed: int = 0,
    progress: bool = True,
    settings: Mapping[str, Any] | None = None,
    **task: Any,
) -> Policy:
    """Train a policy that strikes at any target of a zone (Algorithm 1), in memory: without a run folder.

    Args:
        rollout: Simulator of the model and controller.
        zone: Zone of the targets, such as `Disc((1.2, 0.1), 0.2)`; None: the paper's disc, in space a ball.
        method: `sac`, `td3`, `ddpg` or `ppo`. Capital letters and hyphens make no difference.
        episodes: Number of episodes.
        trials: Strikes per episode, all in one batch.
        random_episodes: Episodes at the start with random strikes; None: a tenth of them.
        hindsight: Relabelled copies of every strike, see `whiptool.rl.settings.TrainingPlan`.
        seed: Seed of everything random.
        progress: Show a bar.
        settings: Hyperparameters of the learner by name, such as `{"learning_rate": 1e-3}`.
        task: Further arguments of `whiptool.rl.task.StrikeTask` by name, such as `hit_radius` and `arrival`.

    Returns:
        The policy that hit most held-out goals, or the last policy if the training was too short to evaluate any:
        `policy.strike(target)`, or `policy.predict(observation)`.

    Raises:
        InputError: PyTorch is not installed, there is no such learner, or a number is out of range.
        Diverged: A loss is not finite.
    """
    expect(Rollout, rollout=rollout)
    torch = optional("torch", "training")

    from whiptool.comparison.learner_unit import one_torch_thread
    from whiptool.rl.held_out import held_out_goals
    from whiptool.rl.settings import TrainingPlan, settings_for
    from whiptool.rl.task import StrikeTask
    from whiptool.rl.training import Training, make_learner

    expect(str, method=method)
    method = method_name(method)
    seed, episodes = numbers.whole("seed", seed, low=0), numbers.whole("episodes", episodes)
    plan = TrainingPlan(episodes, trials, episodes // 10 if random_episodes is None else random_episodes, hindsight)
    struck, generator = StrikeTask(rollout, zone, **task), torch.Generator().manual_seed(seed)
    learner = make_learner(method, settings_for(method, **settings or {}), struck, generator)
    training = Training(learner, struck, plan, held_out_goals(struck, seed))
    with one_torch_thread(), Progress(total=episodes, unit=" episodes", desc=method, disable=not progress) as bar:

        def on_episode(episode: TrainingEpisode) -> None:
            bar.update()

        training.run(on_episode)
    return training.policy()


def build_training(options: TrainOptions) -> Training:
    """Return the training that options ask for, not begun."""
    torch = optional("torch", "whiptool train")
    from whiptool.rl.held_out import held_out_goals
    from whiptool.rl.training import Training, TrainingPlan, make_learner

    task, generator = build_task(options), torch.Generator().manual_seed(options.seed)
    learner = make_learner(options.method, settings_of(options), task, generator)
    plan = TrainingPlan(options.episodes, options.trials, options.random_episodes, options.hindsight)
    return Training(learner, task, plan, held_out_goals(task, options.seed))


def build_task(options: TrainOptions) -> StrikeTask:
    """Return the task that options ask for."""
    from whiptool.goals.zone import Region
    from whiptool.rl.task import StrikeTask

    model, controller = options.build_model(), options.build_controller()
    zone = options.build_disc(model) if options.region is None else Region.load(options.region)
    return StrikeTask(
        options.build_compiled(model, controller),
        zone,
        arrival=options.build_arrival(),
        observation=options.observation,
        reward=options.reward,
        hit_radius=options.hit_radius,
        strikes=options.strikes,
        t_stay=options.t_stay,
    )


def settings_of(options: TrainOptions) -> Settings:
    """Return the learner's settings that options ask for."""
    from whiptool.rl.settings import settings_for

    return settings_for(options.method, **options.hyperparameters())


class _Run:
    """One training: everything is checked before anything is written."""

    def __init__(self, options: TrainOptions) -> None:
        torch = optional("torch", "whiptool train")
        from whiptool.rl.episode_table import EpisodeTable
        from whiptool.rl.training import LOSSES

        torch.set_num_threads(1)  # the same result on any number of cores; waiting threads would spin

        self.options = options
        model, controller = options.build_model(), options.build_controller()
        self.training, self.tests = build_training(options), build_task(options)
        options.warn_if_coarse(model, controller, options.build_target(model).position, options.t_stay)
        settings = settings_of(options)
        self.config = cli.configuration(options, "train", model, controller, settings=cli.as_plain(settings))
        self.folder = cli.open_folder(options, options.method, self.config)
        self.checkpoint, self.best = self.folder.path / CHECKPOINT, self.folder.path / BEST
        self.table = EpisodeTable(self.folder.path / EPISODES, LOSSES[options.method])

    def _begin(self) -> None:
        """Take up the checkpoint of a run that is resumed; what came after it will be made again.

        Raises:
            InputError: It holds more episodes than are asked for now.
        """
        if self.checkpoint.exists():
            self.training.load(self.checkpoint)
        made = self.training.done
        if self.options.episodes < made:
            allowed = f"{made} or more, as many as the run has made"
            raise InputError("--episodes", self.options.episodes, allowed, "start a new run")
        self.folder.go_on_with(self.config["options"])
        self.table.cut(made)
        if self.training.best is None:
            self.best.unlink(missing_ok=True)
        else:
            self.training.save_best(self.best)

    def train(self) -> int:
        """Train with a progress bar, log every episode, and strike at test targets at the end."""
        from whiptool.rl.event_log import EventLog
        from whiptool.rl.learner import Diverged

        training, options = self.training, self.options
        self._begin()
        start = time.monotonic()
        board = EventLog(self.folder.path / "tensorboard", first_step=training.done + 1)
        with Progress(
            total=training.plan.episodes,
            initial=training.done,
            unit=" episodes",
            desc=options.method,
            file=sys.stderr,
            dynamic_ncols=True,
            leave=False,
        ) as bar:

            def on_episode(episode) -> None:
                self.table.add(episode)
                board.add(episode.scalars(), episode.number)
                if episode.best:
                    training.save_best(self.best)
                if episode.number % options.checkpoint_every == 0:
                    training.save(self.checkpoint)
                bar.set_postfix_str(f"reward {episode.mean_reward:.1f}, hits {episode.share_hit:.0%}", refresh=False)
                bar.update()

            try:
                training.run(on_episode)
                training.save(self.checkpoint)
            except Diverged as error:
                kept = (
                    f"the last good checkpoint is {self.checkpoint}" if self.checkpoint.exists() else "none was saved"
                )
                raise WhiptoolError(f"{error}; {kept}") from None
        self._report(time.monotonic() - start)
        return 0

    def _report(self, seconds: float) -> None:
        """Eq. 21 of the best policy under every convention, as a file and for people; the curve as a picture."""
        import numpy as np

        from whiptool.goals.arrival_rule import sample_goals
        from whiptool.rl.held_out import GOALS
        from whiptool.rl.policy import CONVENTIONS, trials_to_hit
        from whiptool.runs import code_version
        from whiptool.viz.plots_learning import save_learning

        best, learner = self.training.best, self.training.policy().learner
        save_learning(
            self.folder.path / CURVE,
            self.table.columns(),
            random_episodes=self.options.random_episodes,
            best=None if best is None else best.episode,
            title=f"{self.options.method.upper()}, observation {self.options.observation}",
            trials=self.options.trials,
        )
        zone, rule, rng = self.tests.zone, self.tests.arrival, np.random.default_rng(self.options.seed)
        goals = sample_goals(zone, rule, self.tests.hit_radius, self.options.tests, rng)
        which = "last policy" if best is None else f"best policy, of episode {best.episode}"
        note(f"striking at {counted(self.options.tests, 'target')} with the {which} ...")
        result: dict[str, Any] = {}
        for convention in CONVENTIONS:
            with Progress(total=self.options.tests, desc=convention, unit=" targets", leave=False) as bar:
                trials, hit = trials_to_hit(
                    learner,
                    self.tests,
                    goals,
                    cap=TRIALS_TO_HIT,
                    convention=convention,
                    on_trial=lambda ended, bar=bar: bar.update(ended - bar.n),
                )
            result[convention] = {
                "mean_trials": float(trials.mean()),
                "median_trials": float(np.median(trials)),
                "largest": int(trials.max()),
                "share_hit": float(hit.mean()),
            }
        plan = self.training.plan
        summary = {
            "method": self.options.method,
            "observation": self.options.observation,
            "training_strikes": plan.episodes * plan.trials,
            "n_diverged": self.training.task.n_diverged,
            "wall_time": seconds,
            "tests": self.options.tests,
            ("zone_area" if zone.dimension == 2 else "zone_volume"): zone.size,
            "hit_radius": self.options.hit_radius,
            "arrival": rule.table(),
            "best": None if best is None else {"episode": best.episode, **asdict(best.score)},
            "trials_to_hit": result,
            "seed": self.options.seed,
            "version": code_version(),
        }
        self.folder.write_result(summary)
        if self.options.json:
            print(json.dumps(summary, allow_nan=False))
            return
        print(f"{self.options.method}: {counted(plan.episodes * plan.trials, 'strike')} in {seconds:.1f} s of training")
        if best is not None:
            share = f"{best.score.share_hit:.0%} of {counted(GOALS, 'held-out goal')} hit by its first strikes"
            print(f"  best policy    of episode {best.episode}: {share}")
        asked = "" if rule.only_points else f", {rule}"
        print(f"  trials to the first hit of {counted(self.options.tests, 'target')}{asked}, at most {TRIALS_TO_HIT}")
        for convention, r in result.items():
            print(
                f"  {convention:12s} mean {r['mean_trials']:.3f}   median {r['median_trials']:g}   "
                f"largest {r['largest']}   hit {r['share_hit']:.1%}   ({CONVENTIONS[convention]})"
            )
        files = [*([] if best is None else [BEST]), CHECKPOINT, EPISODES, CURVE, "tensorboard", CITATIONS]
        print(f"  run folder     {self.folder.path} ({', '.join(files)})")
