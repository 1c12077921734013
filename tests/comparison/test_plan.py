"""Plans of comparisons: their units, names and shares of training."""

from __future__ import annotations

import pytest
from flights import scene

from whiptool.commands.compare import CompareOptions
from whiptool.comparison import plan
from whiptool.comparison.learner_unit import LearnerUnit
from whiptool.comparison.plan import CHUNK, Comparison
from whiptool.comparison.search_unit import SearchUnit
from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.rl.settings import TrainingPlan
from whiptool.rollout import CompiledRollout


def test_the_difficulty_of_a_task_is_measured_by_strikes_that_grow_with_its_targets():
    for targets, strikes in ((7, 700), (40, 4_000), (300, 10_000)):
        unit = Comparison(scene=scene(targets=targets), methods=("random",)).difficulty()
        assert unit.strikes == strikes
    assert Comparison(scene=scene(), methods=("random",)).difficulty(quick=True).strikes == 500


def test_units_have_keys_of_their_own():
    units = Comparison(
        scene=scene(targets=CHUNK + 3), methods=("nlopt:GN_CRS2_LM", "sac"), observations=("goal", "tip"), seeds=2
    ).units()
    keys = [unit.key for unit in units]
    assert len(set(keys)) == len(keys) == 2 * 2 + 2 * 2 + 2 * 2
    assert all("/" not in key and ":" not in key for key in keys)
    searches = [unit for unit in units if isinstance(unit, SearchUnit) and unit.method == "random" and unit.seed == 1]
    assert [(unit.first, unit.last) for unit in searches] == [(0, CHUNK), (CHUNK, CHUNK + 3)]


@pytest.mark.parametrize(
    ("further", "expected"),
    [(None, (100, 7, 30)), (100, (100, 7, 30)), (200, (100, 7, 30)), (50, (50, 7, 15)), (33, (33, 7, 10))],
)
def test_other_observations_train_in_proportion(further, expected):
    plan = Comparison(scene=scene(), methods=("sac",), plan=TrainingPlan(100, 7, 30), further_episodes=further)
    assert plan.training("tip") == TrainingPlan(100, 7, 30)
    assert plan.training("goal") == plan.training("relative") == TrainingPlan(*expected)
    unit = plan.learner_units("sac", "goal")[2]
    assert (unit.episodes, unit.trials, unit.random_episodes, unit.seed) == (*expected, 2)


def test_nothing_is_compared_with_nothing():
    for wrong in ({"seeds": 0}, {"scene": scene(targets=0)}, {"scene": scene(cap=0)}, {"scene": scene(radii=())}):
        with pytest.raises(InputError):
            Comparison(**{"scene": scene(), "methods": ("random",), **wrong})
    with pytest.raises(InputError, match="tarot"):
        Comparison(scene=scene(), methods=("random", "tarot"))
    Comparison(scene=scene(targets=1, cap=1, radii=(0.1,)), methods=("random",), seeds=1)


def test_a_learner_is_trained_under_one_observation_unless_more_are_asked_for():
    """On the command line as in Python."""
    for usual in (Comparison(scene=scene(), methods=("sac",)).observations, CompareOptions().observation):
        assert usual == ("goal",)
    asked = Comparison(scene=scene(), methods=("sac", "ga"), observations=("tip", "goal"), seeds=2).units()
    learners = [(unit.observation, unit.seed) for unit in asked if isinstance(unit, LearnerUnit)]
    assert learners == [("tip", 0), ("tip", 1), ("goal", 0), ("goal", 1)]


@pytest.mark.parametrize("accuracy", [{}, {"tolerance": 1e-3}, {"timestep": 2e-3}])
def test_methods_are_compared_at_the_accuracy_of_the_rollout_that_is_given(monkeypatch, accuracy):
    units = []
    monkeypatch.setattr(plan.Store, "results", lambda self, some, desc: units.extend(some))
    monkeypatch.setattr(plan, "collect", lambda *_: [])
    rollout = CompiledRollout(preset("lemon2024"), **accuracy)
    plan.compare(rollout, methods=("random",), targets=1, max_trials=1)
    again = units[0].scene.rollout()
    assert (again.tolerance, again.timestep) == (rollout.tolerance, rollout.timestep)
