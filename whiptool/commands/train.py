"""Train a policy over a zone of targets (Algorithm 1): `python -m whiptool.train --method sac`."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

from whiptool.commands import cli, run_folders
from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.live_options import LiveOptions
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import (
    MANY_TARGETS,
    Conditions,
    Count,
    Names,
    Ranges,
    ResumableOptions,
    SeedOptions,
    unless,
    when,
)
from whiptool.commands.options.search_options import Learner, Observation, TrainingOptions
from whiptool.commands.options.strike_options import StepOptions
from whiptool.commands.options.target_options import ZoneGoalOptions
from whiptool.commands.pictures import PAGE, VIDEO
from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import optional
from whiptool.progress import Progress, note
from whiptool.rl.settings import SETTINGS, settings_for
from whiptool.runs import CITATIONS
from whiptool.words import counted

CURVE = "learning.png"
TRIALS_TO_HIT = 600  # that a trained policy has at each target
HYPERPARAMETERS = {  # the learners that have each of them
    f.name: [learner for learner, of in SETTINGS.items() if hasattr(of, f.name)]
    for kind in SETTINGS.values()
    for f in fields(kind)
}


@dataclass(frozen=True, kw_only=True)
class TrainOptions(
    ResumableOptions,
    LiveOptions,
    SeedOptions,
    TrainingOptions,
    StepOptions,
    SimulatedControllerOptions,
    ModelOptions,
    ZoneGoalOptions,
):
    """Options of `train`, which trains a policy for all targets of a zone with centre --target."""

    changeable: ClassVar[tuple[str, ...]] = ("checkpoint_every", "episodes", "video")
    first: ClassVar[tuple[str, ...]] = (
        "method",
        "region",
    )
    in_space: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(ZoneGoalOptions.of_disc, unless("region")),
        **{name: when("method", *learners) for name, learners in HYPERPARAMETERS.items()},
    }

    ranges: ClassVar[Ranges] = {
        "tests": Count(high=MANY_TARGETS),
        "checkpoint_every": Count(),
        "strikes": Count(),
    }

    method: Learner = "sac"
    """Learning algorithm."""
    region: Path | None = None
    """NPZ file with the cells of a region of targets: arrays corners (cells, 2 or 3) and cell, their width [m]. It
    takes the place of --zone-radius; whiptool.goals.zone.Region.save writes such files."""
    observation: Observation = "goal"
    """Observation: the tip, tip minus target (relative), or tip and target (goal)."""
    reward: Annotated[str, Names("whiptool.rl.task:REWARDS")] = "paper"
    """Reward: paper (Eq. 17), or log: minus the logarithm of the miss distance in units of the hit radius."""
    strikes: int = 100
    """Largest number of strikes at one target in an episode."""
    hidden: tuple[int, ...] | None = None
    """Sizes of the hidden layers. Defaults that are not named here depend on --method; docs/paper.md lists them."""
    learning_rate: float | None = None
    """Learning rate of Adam."""
    discount: float | None = None
    """Discount factor gamma; default: 0 for observation goal, else 0.99."""
    alpha: float | None = None
    """Weight alpha of the entropy (sac)."""
    tau: float | None = None
    """Soft-update rate (sac, td3, ddpg)."""
    batch_size: int | None = None
    """Number of transitions per update (sac, td3, ddpg)."""
    updates: int | None = None
    """Number of updates per strike (sac, td3, ddpg)."""
    noise: float | None = None
    """Standard deviation of the exploration noise (td3, ddpg)."""
    target_noise: float | None = None
    """Standard deviation sigma of the noise that smooths the target policy, Eq. 15 (td3)."""
    noise_clip: float | None = None
    """Largest absolute value c of that noise, Eq. 15 (td3)."""
    delay: int | None = None
    """Number of critic updates per actor update (td3)."""
    kl_target: float | None = None
    """Target KL divergence per batch, towards which beta is adjusted (ppo)."""
    beta: float | None = None
    """Initial weight of the KL penalty (ppo)."""
    epochs: int | None = None
    """Number of passes over a batch (ppo)."""
    minibatch: int | None = None
    """Number of transitions per gradient step (ppo)."""
    spread: float | None = None
    """Initial standard deviation of the actions (ppo)."""
    checkpoint_every: int = 10
    """Number of episodes between checkpoints."""
    tests: int = 300
    """Number of targets on which the trained policy is tested (Eq. 21)."""
    video: bool = True
    """Render a strike of the policy as a video."""

    def check(self) -> None:
        super().check()
        settings_for(self.method, **self.hyperparameters())
        if self.hindsight and (self.method == "ppo" or self.observation != "goal"):
            allowed = "0, unless the learner has a replay buffer (sac, td3, ddpg) and the observation is goal"
            raise InputError("--hindsight", self.hindsight, allowed)

    def needs(self) -> tuple[str, ...]:
        return (*super().needs(), "torch", "tensorboard")

    def hyperparameters(self) -> dict[str, Any]:
        """Hyperparameters that were given, by name."""
        given = {name: getattr(self, name) for name in HYPERPARAMETERS}
        return {name: value for name, value in given.items() if value is not None}


_EXAMPLE = (
    "Train a policy that strikes at any target of a zone. "
    "Example: python -m whiptool.train --method sac --episodes 20 --random-episodes 4"
)


class TrainingRun:
    """One run of `train`: its options are checked before a file is written."""

    def __init__(self, options: TrainOptions) -> None:
        torch = optional("torch", "whiptool train")
        from whiptool.rl.actor_critic import LOSSES
        from whiptool.rl.trained import BEST, CHECKPOINT, EPISODES, task_of, training_of
        from whiptool.rl.training_log import EpisodeTable

        torch.set_num_threads(1)  # the same result on any number of cores; waiting threads would spin

        self.options = options
        model, controller = options.build_model(), options.build_controller()
        settings = run_folders.as_plain(settings_for(options.method, **options.hyperparameters()))
        self.config = run_folders.configuration(options, "train", model, controller, settings=settings)
        self.training, self.tests = training_of(self.config), task_of(self.config)
        options.warn_if_coarse(model, controller, options.build_target(model).position, options.t_stay)
        self.folder = run_folders.open_folder(options, options.method, self.config)
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
        self.table.cut(made)
        self.folder.go_on_with(self.config["options"])
        if self.training.best is None:
            self.best.unlink(missing_ok=True)
        else:
            self.training.save_best(self.best)

    def train(self) -> int:
        """Train with a progress bar, log every episode, and strike at test targets; return the exit status."""
        from whiptool.rl.learner import Diverged
        from whiptool.rl.training_log import EventLog

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
        from whiptool.runs import code_version

        best, options, zone, plan = self.training.best, self.options, self.tests.zone, self.training.plan
        self._draw()
        tried = self._trials()
        summary = {
            "method": options.method,
            "observation": options.observation,
            "training_strikes": plan.episodes * plan.trials,
            "n_diverged": self.training.task.n_diverged,
            "wall_time": seconds,
            "tests": options.tests,
            ("zone_area" if zone.dimension == 2 else "zone_volume"): zone.size,
            "hit_radius": options.hit_radius,
            "arrival": self.tests.arrival.table(),
            "best": None if best is None else {"episode": best.episode, **asdict(best.score)},
            "trials_to_hit": tried,
            "seed": options.seed,
            "version": code_version(),
        }
        self.folder.write_result(summary)
        self._draw_strike()
        options.tell(summary, "\n".join(self._lines(seconds, tried)))

    def _draw(self) -> None:
        """Draw how the training went."""
        from whiptool.viz.plots_search import save_learning

        best, options = self.training.best, self.options
        save_learning(
            self.folder.path / CURVE,
            self.table.columns(),
            random_episodes=options.random_episodes,
            best=None if best is None else best.episode,
            title=f"{options.method.upper()}, observation {options.observation}",
            trials=options.trials,
        )

    def _draw_strike(self) -> None:
        """Draw the policy's first strike at one of its held-out goals, as a page and a video."""
        from whiptool.commands.view import policy_strike

        note("drawing ...")
        strike = policy_strike(self.folder.path)
        strike.write_page(self.folder.path)
        if self.options.video:
            strike.write_video(self.folder.path)

    def _trials(self) -> dict[str, dict[str, Any]]:
        """Return how many trials the best policy needs at test targets, by convention."""
        import numpy as np

        from whiptool.goals.arrival_rule import sample_goals
        from whiptool.rl.policy import CONVENTIONS, trials_to_hit

        best, count, rng = self.training.best, self.options.tests, np.random.default_rng(self.options.seed)
        goals = sample_goals(self.tests.zone, self.tests.arrival, self.tests.hit_radius, count, rng)
        which = "last policy" if best is None else f"best policy, of episode {best.episode}"
        learner, found = self.training.policy().learner, {}
        note(f"striking at {counted(count, 'target')} with the {which} ...")
        for convention in CONVENTIONS:
            with Progress(total=count, desc=convention, unit=" targets", leave=False) as bar:
                trials, hit = trials_to_hit(
                    learner,
                    self.tests,
                    goals,
                    cap=TRIALS_TO_HIT,
                    convention=convention,
                    on_trial=lambda ended, bar=bar: bar.update(ended - bar.n),
                )
            found[convention] = {
                "mean_trials": float(trials.mean()),
                "median_trials": float(np.median(trials)),
                "largest": int(trials.max()),
                "share_hit": float(hit.mean()),
            }
        return found

    def _lines(self, seconds: float, tried: dict[str, dict[str, Any]]) -> list[str]:
        """Return the result for people."""
        from whiptool.rl.policy import CONVENTIONS, GOALS
        from whiptool.rl.trained import BEST, CHECKPOINT, EPISODES

        best, plan, rule = self.training.best, self.training.plan, self.tests.arrival
        strikes = counted(plan.episodes * plan.trials, "strike")
        lines = [f"{self.options.method}: {strikes} in {seconds:.1f} s of training"]
        if best is not None:
            share = f"{best.score.share_hit:.0%} of {counted(GOALS, 'held-out goal')} hit by its first strikes"
            lines.append(f"  best policy    of episode {best.episode}: {share}")
        asked = "" if rule.only_points else f", {rule}"
        targets = counted(self.options.tests, "target")
        lines.append(f"  trials to the first hit of {targets}{asked}, at most {TRIALS_TO_HIT}")
        lines += [
            f"  {convention:12s} mean {r['mean_trials']:.3f}   median {r['median_trials']:g}   "
            f"largest {r['largest']}   hit {r['share_hit']:.1%}   ({CONVENTIONS[convention]})"
            for convention, r in tried.items()
        ]
        drawn = [PAGE, VIDEO] if self.options.video else [PAGE]
        files = [*([] if best is None else [BEST]), CHECKPOINT, EPISODES, CURVE, *drawn, "tensorboard", CITATIONS]
        return [*lines, f"  run folder     {self.folder.path} ({', '.join(files)})"]


def _work(options: TrainOptions) -> int:
    run = TrainingRun(options)
    with run.folder, options.shown(run.folder.path):
        return run.train()


main = cli.command(TrainOptions, "train", _EXAMPLE, _work)
