"""Settings of the learners are checked."""

from __future__ import annotations

import math

import pytest
import torch
from one_joint import one_joint_task

from whiptool.errors import InputError
from whiptool.rl.actor_critic import make_learner
from whiptool.rl.settings import SETTINGS, TrainingPlan, settings_for


def test_settings_are_checked():
    assert settings_for("sac", alpha=0, discount=0).discount_for("tip") == 0
    assert settings_for("sac").discount_for("goal") == 0
    assert settings_for("sac").discount_for("relative") == 0.99
    for method, wrong in (
        ("sac", {"alpha": -1}),
        ("sac", {"batch_size": 2.5}),
        ("sac", {"batch_size": True}),
        ("sac", {"batch_size": 10**9}),
        ("sac", {"alpha": "0.2"}),
        ("sac", {"hidden": 256}),
        ("sac", {"hidden": (2.5,)}),
        ("sac", {"hidden": ("256",)}),
        ("sac", {"hidden": (256, 10**9)}),
        ("ppo", {"kl_target": 0.0}),
        ("sac", {"updates": 0}),
        ("td3", {"delay": 0}),
        ("ddpg", {"discount": 1.1}),
        ("ddpg", {"noise": math.nan}),
        ("ppo", {"spread": 0.0}),
        ("ppo", {"learning_rate": 0}),
        ("ppo", {"hidden": ()}),
        ("ppo", {"alpha": 0.1}),
        ("dqn", {}),
    ):
        with pytest.raises(InputError):
            settings_for(method, **wrong)
    for wrong in ({"episodes": 0}, {"episodes": True}, {"trials": 1}, {"random_episodes": -1}, {"hindsight": -1}):
        with pytest.raises(InputError):
            TrainingPlan(**wrong)
    with pytest.raises(InputError, match=", ".join(SETTINGS)):
        make_learner("dqn", settings_for("sac"), one_joint_task(), torch.Generator())
    with pytest.raises(InputError, match="observation"):
        one_joint_task(observation="all")
