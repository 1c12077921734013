"""Searches within a motor's speed-torque line: what is beyond it is never a hit, and searches are led back."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import whiptool as wt
from whiptool.commands.optimize import main
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, Controller
from whiptool.limits.arm_limits import XM430, limits_preset
from whiptool.objective import Objective
from whiptool.optimizers import search

TARGET = Target((1.2, 0.1))
SLOW = [-0.622, 0.221, 0.705, 2.122, 1.176]  # hits, within the line
FAST = [-1.36, 0.47, 1.73, 1.41, 0.95]  # beyond it


@cache
def rollout() -> wt.CompiledRollout:
    return wt.CompiledRollout(wt.preset("lemon2024"), Controller(OIAC()), timestep=5e-4)


def fast_hit() -> np.ndarray:
    """A strike that hits, with motors that can do anything."""
    found = search(Objective(rollout(), TARGET, max_trials=600, stop_at_hit=True), "directl")
    assert found.outcome is not None
    assert found.outcome.hit
    assert found.strike is not None
    return found.strike.vector


def test_a_hit_beyond_the_line_is_none() -> None:
    vector = fast_hit()
    objective = Objective(rollout(), TARGET, limits=XM430)
    outcome = objective(vector)
    assert not outcome.hit
    assert outcome.miss_distance > objective.penalty > 2.0
    assert outcome.refused is not None
    assert objective.n_refused == 1
    assert objective.n_diverged == 0
    within = objective(SLOW)
    assert within.hit
    assert within.miss_distance == Objective(rollout(), TARGET)(SLOW).miss_distance
    assert objective.n_refused == 1
    assert not objective.gradient(vector)[1].any()


def test_the_whole_strike_decides_where_peaks_do_not() -> None:
    """Largest speed and torque need not come at the same instant."""
    bounds = Objective(rollout(), TARGET).bounds
    strikes = bounds.sample(np.random.default_rng(0), 300)
    strikes[:, -1] = np.maximum(strikes[:, -1], 1.2)
    near = rollout().approach(strikes, np.array(TARGET.position), t_stay=0.3)
    exact = np.array([XM430.violation(path) for path in rollout().trajectories(strikes, t_stay=0.3)])
    peaks = XM430.violation_of_peaks(near)
    assert (peaks >= exact - 1e-6).all()
    objective = Objective(rollout(), TARGET, limits=XM430)
    outcomes = objective.batch(strikes)
    assert [o.refused is not None for o in outcomes] == (exact > 0).tolist()
    saved = (peaks > 0) & (exact <= 0)
    assert saved.any()
    beyond = np.flatnonzero(exact > 0)
    order = beyond[np.argsort(exact[beyond])]
    assert (np.diff([outcomes[i].miss_distance for i in order]) >= 0).all()  # the penalty grows with the violation


@pytest.mark.parametrize("method", ["directl", "ga"])
def test_searches_find_hits_within_the_line(method: str) -> None:
    objective = Objective(rollout(), TARGET, max_trials=3000, stop_at_hit=True, limits=XM430)
    found = search(objective, method, seed=0)
    assert found.strike is not None
    assert found.outcome is not None
    assert found.outcome.hit
    assert XM430.violation(rollout().trajectory(found.strike, t_stay=0.3)) <= 0
    assert objective.n_refused > 0


def test_a_trajectory_is_judged_alike() -> None:
    objective = Objective(rollout(), TARGET, limits=XM430)
    path = rollout().trajectory(wt.Strike.from_vector(FAST), t_stay=0.3)
    assert objective.judge(path).miss_distance == pytest.approx(objective(FAST).miss_distance, rel=1e-6)
    assert objective.judge(path).refused is not None


def test_a_diverged_strike_is_worse_than_any_refused_one() -> None:
    held = wt.CompiledRollout(
        wt.preset("lemon2024"), Controller(wt.oiac_preset("table4"), control_period=0.002), timestep=5e-4
    )
    objective = Objective(held, TARGET, limits=XM430)
    outcome = objective(FAST)
    assert outcome.diverged
    assert outcome.miss_distance == 2 * objective.penalty
    assert (objective.n_diverged, objective.n_refused) == (1, 0)
    assert Objective(held, TARGET)(FAST).miss_distance == objective.penalty


@pytest.mark.slow
def test_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    common = ["--target", "1.2", "0.1", "--preset", "printed", "--limits", "xm430", "--no-video"]
    lower, upper = [str(x - 0.05) for x in SLOW], [str(x + 0.05) for x in SLOW]
    near = ["--method", "random", "--max-trials", "40", "--lower", *lower, "--upper", *upper, *common]
    assert main([*near, "--out", str(tmp_path / "run")]) == 0
    assert "within the XM430-W350's speed-torque line: at most" in capsys.readouterr().out
    result = json.loads((tmp_path / "run/result.json").read_text())
    assert result["hit"]
    assert 0 < result["motor_usage"] <= 1
    lower, upper = [str(x - 0.01) for x in FAST], [str(x + 0.01) for x in FAST]
    far = ["--method", "random", "--max-trials", "3", "--lower", *lower, "--upper", *upper, *common]
    assert main([*far, "--out", str(tmp_path / "all-refused")]) == 0
    said = capsys.readouterr()
    assert "like all other strikes" in said.out
    assert "not confirmed" not in said.err
    result = json.loads((tmp_path / "all-refused/result.json").read_text())
    assert (result["hit"], result["n_refused"], result["motor_usage"] > 1) == (False, 3, True)


def test_unknown_limits_get_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="xm430"):
        limits_preset("xl320")
    assert main(["--limits", "xl320", "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "xl320" in error
    assert not (tmp_path / "run").exists()
