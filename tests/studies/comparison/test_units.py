"""The units of a comparison on a tip that flies straight: counts at several radii, caps, seeds, plans."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from fake_rollout import StraightFlight
from scripted import Scripted

from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import StrikeBounds
from whiptool.objective import Objective, Target
from whiptool.optimizers import search
from whiptool.studies.comparison.learner_unit import CHECKPOINT_EVERY, Checkpoint, LearnerUnit
from whiptool.studies.comparison.plan import CHUNK, Comparison
from whiptool.studies.comparison.policy_trials import RecordedTask, misses_of, trials_within
from whiptool.studies.comparison.units import Scene, SearchUnit
from whiptool.zone import Disc


class Flights(Scene):
    def rollout(self, threads=None):
        return StraightFlight(wild_above=2.5)


def scene(**changes) -> Scene:
    options = {"targets": 7, "cap": 12, "radii": (0.3, 0.1), "zone": Disc((0.8, -0.8), 0.2), **changes}
    return Flights(model=preset("lemon2024"), controller=Controller(), **options)


def test_targets_are_drawn_once_for_all():
    points = scene().points()
    assert points.shape == (7, 2)
    assert (np.linalg.norm(points - [0.8, -0.8], axis=1) <= 0.2).all()
    np.testing.assert_array_equal(points, scene().points())
    assert not np.array_equal(points, scene(target_seed=1).points())


def test_the_difficulty_of_a_task_is_measured_by_strikes_that_grow_with_its_targets():
    for targets, strikes in ((7, 700), (40, 4_000), (300, 10_000)):
        unit = Comparison(scene=scene(targets=targets), methods=("random",)).difficulty()
        assert unit.strikes == strikes
    assert Comparison(scene=scene(), methods=("random",)).difficulty(quick=True).strikes == 2_000


@pytest.mark.parametrize("method", ["random", "directl"])
def test_a_search_unit_counts_to_the_first_trial_within_each_radius(method):
    s = scene()
    result = SearchUnit(scene=s, method=method, seed=3, first=2, last=6).run(None, None)
    assert [(x["convention"], x["hit_radius"]) for x in result["outcomes"]] == [("", 0.3), ("", 0.1)]
    diverged = 0
    for place, i in enumerate(range(2, 6)):
        objective = Objective(s.rollout(), Target(tuple(s.points()[i]), 0.1), max_trials=12, stop_at_hit=True)
        seed = int(np.random.SeedSequence((3, i)).generate_state(1)[0]) >> 1
        trace = search(objective, method, seed=seed).trace
        diverged += sum(trial.outcome.diverged for trial in trace)
        for outcome in result["outcomes"]:
            within = [t.number for t in trace if t.outcome.miss_distance <= outcome["hit_radius"]]
            assert outcome["trials"][place] == (within[0] if within else 12)
            assert outcome["hit"][place] is bool(within)
    hits = [sum(x["hit"]) for x in result["outcomes"]]
    assert hits[0] > 0
    assert hits[0] >= hits[1]
    assert result["n_diverged"] == diverged
    assert (result["training_trials"], result["note"]) == (0, "")
    assert result["wall_time"] > 0


@pytest.mark.parametrize("method", ["library", "random"])
def test_a_library_comes_before_the_search(method):
    unit = SearchUnit(scene=scene(), method=method, seed=1, first=0, last=3, library=400)
    result = unit.run(None, None)
    assert result["training_trials"] == 400
    assert result["outcomes"][1]["trials"] == [1, 1, 1]  # some of 400 straight lines passed there
    assert all(result["outcomes"][1]["hit"])
    assert unit.series == ("library" if method == "library" else "random+library")


def test_units_have_names_of_their_own():
    units = Comparison(
        scene=scene(targets=CHUNK + 3), methods=("nlopt:GN_CRS2_LM", "sac"), observations=("goal", "paper"), seeds=2
    ).units()
    names = [unit.name for unit in units]
    assert len(set(names)) == len(names) == 2 * 2 + 2 * 2 + 2 * 2
    assert all("/" not in name and ":" not in name for name in names)
    searches = [unit for unit in units if isinstance(unit, SearchUnit) and unit.method == "random" and unit.seed == 1]
    assert [(unit.first, unit.last) for unit in searches] == [(0, CHUNK), (CHUNK, CHUNK + 3)]


@pytest.mark.parametrize(
    ("further", "expected"),
    [(None, (100, 7, 30)), (100, (100, 7, 30)), (200, (100, 7, 30)), (50, (50, 7, 15)), (33, (33, 7, 10))],
)
def test_other_observations_train_in_proportion(further, expected):
    plan = Comparison(
        scene=scene(), methods=("sac",), episodes=100, trials=7, random_episodes=30, further_episodes=further
    )
    assert plan.training("paper") == (100, 7, 30)
    assert plan.training("goal") == plan.training("relative") == expected
    unit = plan.learner_units("sac", "goal")[2]
    assert (unit.episodes, unit.trials, unit.random_episodes, unit.seed) == (*expected, 2)


def test_nothing_is_compared_with_nothing():
    for wrong in ({"seeds": 0}, {"scene": scene(targets=0)}, {"scene": scene(cap=0)}, {"scene": scene(radii=())}):
        with pytest.raises(InputError):
            Comparison(**{"scene": scene(), "methods": ("random",), **wrong})
    with pytest.raises(InputError, match="tarot"):
        Comparison(scene=scene(), methods=("random", "tarot"))
    Comparison(scene=scene(targets=1, cap=1, radii=(0.1,)), methods=("random",), seeds=1)


@pytest.mark.parametrize(("rewards", "kept"), [([1.0, 2.0], [1.0, 2.0]), ([1.0, 2.0, 3.0], [1.0, 2.0]), ([1.0], [])])
def test_a_checkpoint_is_taken_up_where_its_history_reaches(rewards, kept, tmp_path, monkeypatch):
    """Two episodes are done: what the history holds beyond them is cut, and one that is shorter is not believed."""
    monkeypatch.setattr("whiptool.rl.training.load_checkpoint", lambda path: {"done": 2})
    loaded: list[Path] = []
    training = SimpleNamespace(done=2, load=loaded.append)
    checkpoint = Checkpoint(tmp_path / "unit.pt")
    assert checkpoint.load(training) == {"rewards": [], "seconds": 0.0}
    checkpoint.path.touch()
    checkpoint.history.write_text(json.dumps({"rewards": rewards, "seconds": 3.0}))
    assert checkpoint.load(training)["rewards"] == kept
    assert loaded == ([checkpoint.path] if kept else [])


BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 1.0), (1.0, 0.5, 0.3, 0.8, 2.0))
TARGETS = np.array([[1.0, 0.0], [np.cos(0.5), np.sin(0.5)], [np.cos(0.9), np.sin(0.9)]])


def recorded(radius: float) -> RecordedTask:
    return RecordedTask(StraightFlight(), Disc((0.8, 0.2), 1.0), bounds=BOUNDS, hit_radius=radius)  # type: ignore[arg-type]


def test_trials_of_a_policy_at_several_radii():
    """Targets at 0, 0.5 and 0.9 rad; samples at -0.3, 0.45, 0.8, 0.89 rad: misses are sines of the difference."""
    angles = [-0.3, 0.45, 0.8, 0.89]
    radii = (0.2, 0.06, 0.02)
    task = recorded(0.02)
    found = trials_within(Scripted(task, angles), task, TARGETS, radii, cap=4, convention="samples")  # type: ignore[arg-type]
    for radius, (trials, hit) in found.items():
        for i, at in enumerate((0.0, 0.5, 0.9)):
            misses = [np.sin(abs(at - angle)) for angle in angles]
            within = [n for n, miss in enumerate(misses, 1) if miss <= radius]
            assert trials[i] == (within[0] if within else 4)
            assert hit[i] == bool(within)
    task = recorded(0.02)
    lists = misses_of(Scripted(task, angles), task, TARGETS, cap=4, convention="samples")  # type: ignore[arg-type]
    for misses, at in zip(lists, (0.0, 0.5, 0.9), strict=True):
        np.testing.assert_allclose(misses, [np.sin(abs(at - angle)) for angle in angles], atol=1e-12)
    task = recorded(0.12)
    lists = misses_of(Scripted(task, angles), task, TARGETS, cap=4, convention="samples")  # type: ignore[arg-type]
    assert [len(misses) for misses in lists] == [4, 2, 3]


def test_a_learner_unit_trains_and_strikes(tmp_path, monkeypatch):
    s = scene(cap=5)
    unit = LearnerUnit(scene=s, method="sac", observation="goal", seed=2, episodes=12, trials=4, random_episodes=12,
                       settings=(("batch_size", 4), ("alpha", 0.05)))  # fmt: skip
    saved = []
    save = Checkpoint.save

    def watched(self, run, history):
        saved.append(run.done)
        save(self, run, history)

    monkeypatch.setattr(Checkpoint, "save", watched)
    result = unit.run(tmp_path, None)
    assert saved == [CHECKPOINT_EVERY, 12]
    assert result["training_trials"] == 48
    assert len(result["rewards"]) == 12
    kinds = [(x["convention"], x["hit_radius"]) for x in result["outcomes"]]
    assert kinds == [("mean-first", 0.3), ("mean-first", 0.1), ("samples", 0.3), ("mean", 0.3)]
    strikes, points = np.array(result["first_strikes"]), s.points()
    near = s.rollout().approach(strikes, points, t_stay=s.t_stay)
    np.testing.assert_allclose(result["first_misses"], near.distance)
    first = np.array(result["outcomes"][0]["trials"]) == 1
    np.testing.assert_array_equal(first, near.distance <= 0.3)
    training, history, note = unit.trained(tmp_path, None)  # from the checkpoint, at its end
    assert (training.done, note) == (12, "")
    assert training.learner.settings.alpha == 0.05
    assert history["rewards"] == result["rewards"]
    assert history["seconds"] > 0
    assert isinstance(training.learner.generator, torch.Generator)


def test_hindsight_only_where_it_is_possible():
    for method, observation, copies in (("sac", "goal", 3), ("sac", "paper", 0), ("ppo", "goal", 0)):
        unit = LearnerUnit(scene=scene(), method=method, observation=observation, seed=0, hindsight=3)
        assert unit._fresh(None).plan.hindsight == copies
