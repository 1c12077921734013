"""Maps that come with the package: they are of the presets as these are, small, and hit; and how a map is packed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from command_line import assert_one_line, called

import whiptool as wt
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import usual_region
from whiptool.models import preset
from whiptool.optimizers.gradient_search import REFINED
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.map_files import (
    FOLDER,
    load_packed,
    map_of,
    map_of_arm,
    save_packed,
    shipped_map,
    shipped_names,
)
from whiptool.strike_map.strike_map import HIDDEN, Gate

NAMES = ["lemon2024", "panda", "ur5e"]


def test_names_and_sizes():
    assert shipped_names() == NAMES
    assert all((FOLDER / f"{name}.npz").stat().st_size < 10e6 for name in NAMES)


def test_a_packed_map_is_the_map_to_single_and_half_precision(tmp_path):
    rng, widths = np.random.default_rng(0), (7, *HIDDEN, 1)
    strikes, slopes = rng.normal(size=(9, 5)), rng.normal(size=(2, 9, 2, 6))
    answers = Answers(strikes, *rng.normal(size=(2, 9, 2)), *slopes)
    weights = tuple(rng.normal(size=shape).astype(np.float32) for shape in pairwise(widths))
    biases = tuple(rng.normal(size=width).astype(np.float32) for width in widths[1:])
    gate = Gate(weights, biases, rng.normal(size=7), rng.random(7) + 1)
    save_packed(tmp_path / "map.npz", answers, gate)
    kept, same = load_packed(tmp_path / "map.npz")
    np.testing.assert_allclose(kept.strikes, answers.strikes, rtol=1e-7)
    np.testing.assert_allclose(kept.tip_slopes, answers.tip_slopes, rtol=1e-3)
    seen = rng.normal(size=(4, 7))
    np.testing.assert_array_equal(same.odds(seen), gate.odds(seen))


def test_the_gate_is_a_network_with_rectified_units():
    """By hand: one feature, one unit in each hidden layer."""
    ones = np.ones((1, 1), np.float32)
    gate = Gate((2 * ones, ones, ones), (ones[0], -ones[0], 3 * ones[0]), np.array([5.0]), np.array([2.0]))
    np.testing.assert_allclose(gate.odds(np.array([[7.0], [1.0]])), [2 * 1 + 1 - 1 + 3, 3])


def test_a_robots_usual_region_is_a_shell_above_its_floor_and_a_persons_a_ball():
    ur5e, person, plane = (usual_region(preset(name)) for name in ("ur5e", "nah2023", "lemon2024"))
    points = ur5e.zone.place(np.random.default_rng(0).random((2000, 4)))
    assert 0.9 < np.linalg.norm(points, axis=1).min() < np.linalg.norm(points, axis=1).max() < 2.3
    assert points[:, 0].min() > 0 < points[:, 2].min()
    assert ur5e.rule.drawn == 1
    assert ur5e.rule.speed == 1.0
    assert person.rule.only_points
    assert plane.rule.only_points
    assert plane.zone.contains(np.array([[1.2, 0.1], [1.3, 0.0]])).all()
    assert not plane.zone.contains(np.array([[0.1, 0.0], [1.2, 1.0]])).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_answers_pass_where_they_say(name):
    """So the preset, its controller and the engine are those that the map was built with."""
    found = shipped_map(name)
    some = found.answers.take(np.random.default_rng(0).integers(0, len(found.answers), 60))
    near = found.striker.rollout.approach(some.strikes, some.tips, t_stay=found.striker.t_stay)
    assert near.distance.max() < 2e-3
    goals = found.region.draw(20, np.random.default_rng(1))
    assert found.refined(goals).struck.hit.sum() >= 18


def test_a_search_may_begin_from_it():
    rollout, target = wt.CompiledRollout(preset("lemon2024")), wt.Target((1.2, 0.1), hit_radius=1e-4)
    found = wt.search(rollout, target, "map")
    assert found.outcome is not None
    assert found.outcome.hit
    assert found.n_trials < 40 * REFINED
    with pytest.raises(InputError, match="lemon2024, panda, ur5e"):
        map_of(replace(preset("lemon2024"), gravity=1.6))
    assert map_of(preset("lemon2024")) is shipped_map("lemon2024")
    assert map_of_arm(preset("lemon2024").arm) is shipped_map("lemon2024")
    assert map_of_arm(preset("nah2023").arm) is None


def test_a_search_without_a_map_is_refused_before_anything_is_written(tmp_path):
    done = called("optimize", "--model", "nah2023", "--method", "map", "--out", "run", cwd=tmp_path)
    assert_one_line(done, "lemon2024, panda, ur5e")
    assert not (tmp_path / "run").exists()


def test_a_map_of_points_answers_goals_with_directions_and_speeds():
    goal = wt.Target.arriving((1.2, 0.1), 1.0, speed=3.0)
    assert wt.Objective(wt.CompiledRollout(preset("lemon2024")), goal)(wt.load_map("Lemon2024").strike(goal)).hit


def test_an_unknown_map_is_refused():
    with pytest.raises(InputError, match=r"lemon2024, panda, ur5e; or the run folder"):
        wt.load_map("nah2023")


@pytest.mark.slow
def test_it_takes_no_pytorch():
    program = (
        "import sys; import whiptool as wt; wt.load_map('lemon2024').strike((1.2, 0.1)); print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
