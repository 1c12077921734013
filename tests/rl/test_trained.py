"""Tasks and trainings by the configuration of a run: as the run was begun, whatever its files say now."""

from __future__ import annotations

import math

import pytest

from whiptool.commands import run_folders

pytest.importorskip("torch")

from whiptool.commands.train import TrainOptions
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.zone import Disc
from whiptool.models import preset, write_model
from whiptool.rl.settings import settings_for
from whiptool.rl.trained import task_of, training_of


def configuration(**given) -> dict:
    options = TrainOptions(**given)
    settings = run_folders.as_plain(settings_for(options.method, **options.hyperparameters()))
    return run_folders.configuration(
        options, "train", options.build_model(), options.build_controller(), settings=settings
    )


def test_the_task_is_that_of_the_run_though_the_model_file_has_changed(tmp_path):
    file = tmp_path / "model.toml"
    write_model(preset("lemon2024"), file)
    config = configuration(model=str(file), target=(1.1, 0.1), zone_radius=0.05, arrival_angle=(30.0,), least_speed=2.0)
    write_model(preset("nah2020-n10"), file)
    task = task_of(config)
    assert task.rollout.model.whip == preset("lemon2024").whip
    assert task.zone == Disc((1.1, 0.1), 0.05)
    assert task.arrival == ArrivalRule(angle=math.radians(30), speed=2.0)


def test_an_observation_has_the_name_that_it_has_now():
    config = configuration()
    config["options"]["observation"] = "paper"
    assert task_of(config).observation == "tip"


def test_a_training_has_the_settings_of_the_run():
    config = configuration(method="td3", hidden=(8, 4), noise=0.3, episodes=4, random_episodes=1, trials=2)
    training = training_of(config)
    assert (training.learner.settings.hidden, training.learner.settings.noise) == ((8, 4), 0.3)
    assert training.plan.episodes == 4
