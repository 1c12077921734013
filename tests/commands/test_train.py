"""The training command: its files, and that a killed run goes on to the same end."""

from __future__ import annotations

import csv
import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from checkpoints import same
from full_disk import full_disk

from whiptool import whole_files
from whiptool.commands import train
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import sample_goals
from whiptool.goals.target import Target
from whiptool.goals.zone import sample
from whiptool.models import preset
from whiptool.objective import Objective
from whiptool.rl import trained, training_log
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.trained import EPISODES, load_policy
from whiptool.rl.training import load_checkpoint
from whiptool.rollout import CompiledRollout

SHORT = ["--episodes", "12", "--random-episodes", "2", "--trials", "16", "--tests", "5", "--checkpoint-every", "2"]


@pytest.fixture(autouse=True)
def few_trials_to_hit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A policy that learned as little as these seldom hits, and would strike 600 times at each target."""
    monkeypatch.setattr(train, "TRIALS_TO_HIT", 20)


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / EPISODES).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.figures
def test_a_run_leaves_its_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert train.main([*SHORT, "--method", "td3", "--json", "--out", str(tmp_path / "run")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((tmp_path / "run/result.json").read_text())
    assert summary["training_strikes"] == 12 * 16
    assert set(summary["trials_to_hit"]) == {"mean-first", "samples", "mean"}
    table = rows(tmp_path / "run")
    assert [int(row["number"]) for row in table] == list(range(1, 13))
    assert table[1]["critic"] == ""
    assert float(table[2]["critic"]) > 0  # nothing is learned in the random episodes
    assert list((tmp_path / "run/tensorboard").iterdir())
    assert (tmp_path / "run" / train.CURVE).read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "run" / train.VIDEO).read_bytes()[4:8] == b"ftyp"
    assert "first strike of a policy trained with td3" in (tmp_path / "run" / train.PAGE).read_text()
    scored = {int(row["number"]): (float(row["held_out_hit"]), -float(row["held_out_cost"])) for row in table[4::5]}
    best = max(scored, key=scored.__getitem__)
    told = {"episode": best, "share_hit": scored[best][0], "mean_cost": -scored[best][1]}
    assert summary["best"] == told
    assert all(row["held_out_hit"] == "" for row in table if int(row["number"]) not in scored)
    policy = load_policy(tmp_path / "run")
    assert same(policy.learner.actor.state_dict(), load_checkpoint(tmp_path / "run" / trained.BEST)["actor"])
    last = load_policy(tmp_path / "run" / trained.CHECKPOINT)
    assert same(last.learner.state_dict(), load_checkpoint(tmp_path / "run" / trained.CHECKPOINT)["learner"])
    options = train.TrainOptions()
    targets = sample(policy.task.zone, 40, np.random.default_rng(0))
    strikes = np.array([policy.strike(target).vector for target in targets])
    near = CompiledRollout(preset("lemon2024"), options.build_controller()).approach(strikes, targets)
    policy.task.hit_radius = float(np.median(near.distance))
    hit = trials_to_hit(policy.learner, policy.task, targets, cap=1, convention="mean")[1]
    np.testing.assert_array_equal(near.distance <= policy.task.hit_radius, hit)
    with pytest.raises(InputError, match=r"target: got .* allowed: 2 coordinates"):
        policy.strike((1.0, 0.0, 0.2))
    with pytest.raises(InputError, match=r"config\.toml"):
        load_policy(tmp_path)


UPWARD = ["--target", "1", "0.3", "--arrival-angle", "60", "120", "--cone", "60", "--hit-radius", "0.3"]


@pytest.mark.slow
def test_a_policy_is_trained_at_arrival_angles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its result and words say what was asked; its strikes hit as an objective of each target says."""
    run = tmp_path / "run"
    words = [*UPWARD, "--hindsight", "1", "--episodes", "5", "--random-episodes", "2", "--trials", "16", "--tests", "1"]
    assert train.main([*words, "--out", str(run)]) == 0
    said = "arriving within 60 degrees of a random angle for each target, from 60 to 120 degrees"
    assert said in capsys.readouterr().out
    assert json.loads((run / "result.json").read_text())["arrival"] == {
        "direction": None,
        "arrival_angle": pytest.approx([math.radians(60), math.radians(120)]),
        "cone": pytest.approx(math.radians(60)),
        "least_speed": None,
    }
    policy = load_policy(run)
    goals = sample_goals(policy.task.zone, policy.task.arrival, 0.3, 30, np.random.default_rng(1))
    targets = [Target.of(goals, i) for i in range(30)]
    rollout = CompiledRollout(preset("lemon2024"), train.TrainOptions().build_controller())
    hit = [Objective(rollout, target)(policy.strike(target)).hit for target in targets]
    np.testing.assert_array_equal(trials_to_hit(policy.learner, policy.task, goals, cap=1, convention="mean")[1], hit)
    with pytest.raises(InputError, match=r"direction: got nothing; allowed: one for which the policy or map was made"):
        policy.strike((1.0, 0.3))
    with pytest.raises(InputError, match=r"angles from 60 to 120 degrees"):
        policy.strike(Target.arriving((1.0, 0.3), 0.0))
    assert train.main(["--resume", str(run), "--cone", "20"]) == 2
    assert "--cone: got 20.0; allowed: 60.0, as the run was begun" in capsys.readouterr().err


# a run that stays before its last episode, so that it can be killed however slow the machine is
WAITS_FOR_ITS_END = """
import sys, time
from whiptool.commands import train  # noqa: E402
from whiptool.rl.training import Training
episode = Training.episode
Training.episode = lambda self: time.sleep(3600) if self.done == 11 else episode(self)
sys.exit(train.main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_killed_run_resumes_to_the_same_end(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert train.main([*SHORT, "--hindsight", "1", "--out", str(whole)]) == 0
    command = [sys.executable, "-c", WAITS_FOR_ITS_END, *SHORT, "--hindsight", "1", "--out", str(killed)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (killed / EPISODES).exists() or len(rows(killed)) < 5:
        assert process.poll() is None, "ended before it could be killed"
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert len(rows(killed)) < 12
    assert train.main(["--resume", str(killed)]) == 0
    assert same(load_checkpoint(whole / trained.CHECKPOINT), load_checkpoint(killed / trained.CHECKPOINT))
    assert (whole / EPISODES).read_text() == (killed / EPISODES).read_text()
    results = [json.loads((folder / "result.json").read_text()) for folder in (whole, killed)]
    assert results[0]["trials_to_hit"] == results[1]["trials_to_hit"]


@pytest.mark.slow
def test_a_run_that_is_trained_longer_is_a_run_of_that_length(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also one that is made shorter than it was begun, as far as it has not gone beyond."""
    whole, longer = tmp_path / "whole", tmp_path / "longer"
    fewer = [*SHORT[2:], "--seed", "3"]
    assert train.main(["--episodes", "11", *fewer, "--out", str(whole)]) == 0
    assert train.main(["--episodes", "6", *fewer, "--out", str(longer)]) == 0
    capsys.readouterr()
    assert train.main(["--resume", str(longer), "--episodes", "5"]) == 2
    assert "--episodes: got 5; allowed: 6 or more, as many as the run has made" in capsys.readouterr().err
    assert train.main(["--resume", str(longer), "--episodes", "11"]) == 0
    for file in (trained.CHECKPOINT, trained.BEST):
        assert same(load_checkpoint(whole / file), load_checkpoint(longer / file))
    for file in (EPISODES, train.CURVE, "config.toml"):
        assert (whole / file).read_bytes() == (longer / file).read_bytes()
    results = [json.loads((folder / "result.json").read_text()) for folder in (whole, longer)]
    assert results[0] == results[1] | {"wall_time": results[0]["wall_time"]}
    assert load_policy(longer).strike((1.25, 0.05)) == load_policy(whole).strike((1.25, 0.05))


def test_a_full_disk_leaves_the_last_checkpoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from whiptool.rl.training import Training

    run, episode = tmp_path / "run", Training.episode

    def on_a_full_disk(self):
        if self.done == 5:
            (run / f".tmp-{trained.CHECKPOINT}").symlink_to("/dev/full")
        return episode(self)

    with monkeypatch.context() as patch:
        patch.setattr(Training, "episode", on_a_full_disk)
        assert train.main([*SHORT, "--out", str(run)]) == 1
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("whiptool: ")
    assert "No space left" in error
    assert str(run / trained.CHECKPOINT) in error
    assert not list(run.glob(".*"))
    assert load_checkpoint(run / trained.CHECKPOINT)["done"] <= 5


@pytest.mark.parametrize("file", [EPISODES, "tensorboard/events*"])
def test_a_full_disk_leaves_whole_lines_and_events(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run, append_whole = tmp_path / "run", whole_files.append_whole
    room = ExitStack()

    def on_a_full_disk(path: Path, content: str | bytes) -> None:
        if len(rows(run)) == 5 and path.match(file):
            room.enter_context(full_disk(path.stat().st_size + 20))
        append_whole(path, content)

    with room, monkeypatch.context() as patch:
        patch.setattr(training_log, "append_whole", on_a_full_disk)
        assert train.main([*SHORT, "--out", str(run)]) == 1
    error = capsys.readouterr().err.strip().splitlines()[-1]
    (path,) = run.glob(file)
    assert error == f"whiptool: [Errno 27] File too large: '{path}'"
    assert (run / EPISODES).read_text().endswith("\n")
    assert [int(row["number"]) for row in rows(run)] == [1, 2, 3, 4, 5]
    seen = EventAccumulator(str(run / "tensorboard")).Reload().Scalars("mean_reward")
    assert [event.step for event in seen] == ([1, 2, 3, 4, 5] if file == EPISODES else [1, 2, 3, 4])
    assert [event.value for event in seen] == pytest.approx(
        [float(row["mean_reward"]) for row in rows(run)][: len(seen)]
    )


def test_nan_ends_with_the_last_good_checkpoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from whiptool.rl import training
    from whiptool.rl.task import StrikeTask

    good, steps = StrikeTask.step, []

    def poisoned(self, actions):
        step = good(self, actions)
        steps.append(1)
        if len(steps) > 5:
            step.reward[:] = float("nan")
        return step

    monkeypatch.setattr(training.StrikeTask, "step", poisoned)
    assert train.main([*SHORT, "--out", str(tmp_path / "run")]) == 1
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert "nan" in error
    assert trained.CHECKPOINT in error
    assert load_checkpoint(tmp_path / "run" / trained.CHECKPOINT)["done"] == 4
