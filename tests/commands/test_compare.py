"""Comparisons: what is counted, that neither workers nor a cluster nor a kill change it, and what is refused."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_one_line, called, whiptool
from processes import HANG

from whiptool.comparison import Comparison, LearnerUnit, SearchUnit, Series, TargetScene, collect
from whiptool.comparison.learner_unit import Checkpoint, trials_within
from whiptool.comparison.plan import deterministic
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.target import Target
from whiptool.goals.zone import Disc
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.settings import TrainingPlan
from whiptool.rl.trained import one_torch_thread

TIMES = ("wall_time",)
SMALL = ("--targets", 6, "--seeds", 1, "--max-trials", 12, "--episodes", 12, "--trials", 8, "--random-episodes", 6)
COARSE = ("--timestep", 0.001)
FEW = (*SMALL, *COARSE, "--methods", "ga", "sac", "--observation", "goal", "--tighter", 0.03)


def table(run: Path) -> list[dict[str, str]]:
    """Its lines, without what a clock says."""
    with (run / "table.csv").open() as file:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def scene() -> TargetScene:
    return TargetScene(
        model=preset("lemon2024"), controller=Controller(), targets=8, cap=15, radii=(0.06, 0.02), timestep=1e-3
    )


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Path:
    """A small comparison in one process."""
    folder = tmp_path_factory.mktemp("alone")
    done = called("compare", *FEW, "--workers", 1, "--out", "run", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((folder / "run" / "result.json").read_text())
    return folder / "run"


def test_search_unit_counts_what_a_search_at_each_radius_would(scene):
    """One search to the tightest radius tells the trials at all of them."""
    unit = SearchUnit(scene=scene, method="cmaes", seed=3, first=2, last=6)
    outcomes = unit.run(None, 1)["outcomes"]
    rollout = scene.rollout()
    for outcome, radius in zip(outcomes, scene.radii, strict=True):
        for place, i in enumerate(range(2, 6)):
            objective = Objective(
                rollout, Target(tuple(scene.points()[i]), radius), max_trials=scene.cap, stop_at_hit=True
            )
            seed = int(np.random.SeedSequence((3, i)).generate_state(1)[0]) >> 1
            trace = search(objective, "cmaes", seed=seed).trace
            hits = [trial.number for trial in trace if trial.outcome.hit]
            assert outcome["trials"][place] == (hits[0] if hits else scene.cap)
            assert outcome["hit"][place] == bool(hits)


def test_chunks_make_no_difference(scene):
    whole = SearchUnit(scene=scene, method="random", seed=1, first=0, last=4).run(None, None)["outcomes"]
    parts = [SearchUnit(scene=scene, method="random", seed=1, first=i, last=i + 2).run(None, 1) for i in (0, 2)]
    for i, outcome in enumerate(whole):
        assert outcome["trials"] == [x for part in parts for x in part["outcomes"][i]["trials"]]


@pytest.mark.slow
def test_learner_goes_on_from_a_checkpoint_as_if_nothing_had_happened(scene, tmp_path):
    """Also when the history is ahead of the checkpoint, as after a kill between the two."""
    unit = LearnerUnit(scene=scene, method="sac", observation="goal", seed=1, episodes=14, trials=6, random_episodes=5)

    def plain(result: dict) -> dict:
        return {k: v for k, v in result.items() if k not in TIMES}

    whole = plain(unit.run(None, None))
    with one_torch_thread(), Checkpoint.within(tmp_path, unit.key) as checkpoint:
        training = unit._fresh(None)
        rewards = [episode.mean_reward for episode in training.run(episodes=7)]
        checkpoint.save(training, {"rewards": [*rewards, 1e9], "seconds": 0.0})
    assert plain(unit.run(tmp_path, None)) == whole
    assert len(whole["rewards"]) == 14
    assert whole["training_trials"] == 14 * 6
    with Checkpoint.within(tmp_path, unit.key) as checkpoint:  # a history that does not reach: start again
        checkpoint.history.write_text(json.dumps({"rewards": [], "seconds": 0.0}))
    assert plain(unit.run(tmp_path, None)) == whole


@pytest.mark.parametrize("convention", ["mean-first", "samples"])
def test_policy_unit_counts_what_the_policy_does(scene, convention):
    """At the tightest radius as `trials_to_hit` says; a wider one never takes longer."""
    unit = LearnerUnit(scene=scene, method="ppo", observation="goal", seed=2, episodes=2, trials=6, random_episodes=1)
    training = unit._fresh(1)
    found = {}
    for task_radius, radii in ((0.02, (0.02,)), (0.02, (0.06, 0.02))):
        training.learner.generator.manual_seed(0)
        task = unit._task(task_radius, 1)
        found[radii] = trials_within(training.learner, task, scene.points(), radii, cap=30, convention=convention)
    training.learner.generator.manual_seed(0)
    expected = trials_to_hit(training.learner, unit._task(0.02, 1), scene.points(), cap=30, convention=convention)
    for result in found.values():
        for got, wanted in zip(result[0.02], expected, strict=True):
            np.testing.assert_array_equal(got, wanted)
    trials, hit = found[0.06, 0.02][0.06]
    assert (trials <= expected[0]).all()
    assert (hit >= expected[1]).all()
    assert (trials < expected[0]).any()


def test_interval_knows_that_seeds_differ():
    """Two seeds that disagree by 50 trials leave the mean open: t with one degree of freedom, up to the cap."""
    trials = np.array([[10] * 30, [60] * 30])
    one = Series("sac", "goal", "mean-first", 0.06, trials, np.ones_like(trials, bool), 0.0, 0, 0.0, cap=600)
    assert one.mean == 35
    low, high = one.interval
    assert 1 < low < 1.01
    assert high == 600


def test_random_is_always_there_and_directl_has_one_seed(scene):
    comparison = Comparison(scene=scene, methods=("directl", "sac"), observations=("goal",), seeds=3)
    seeds = {(u.method, u.seed) for u in comparison.units()}
    assert seeds == {("directl", 0), *((m, s) for m in ("sac", "random") for s in range(3))}
    assert deterministic("nlopt:GN_ORIG_DIRECT_L")
    assert not deterministic("nlopt:GN_DIRECT_L_RAND")


def test_tasks_of_a_folder_share_no_results(scene):
    """Also the unit that says what one strike hits."""
    plans = [Comparison(scene=s, methods=("ga", "sac")) for s in (scene, replace(scene, zone=Disc(radius=0.3)))]
    keys = [{u.key for u in (*plan.units(), plan.difficulty())} for plan in plans]
    assert not keys[0] & keys[1]


def test_collect_puts_seeds_and_chunks_in_order(scene):
    units = [SearchUnit(scene=scene, method="ga", seed=s, first=f, last=f + 2) for s in (0, 1) for f in (0, 2)]
    results = {
        u.key: {
            "outcomes": [{"convention": "", "hit_radius": 0.06, "trials": [10 * u.seed + u.first + i for i in (0, 1)],
                          "hit": [True, u.seed == 0]}],
            "training_trials": 0, "n_diverged": 1, "wall_time": 2.0, "note": "",
        }
        for u in units
    }  # fmt: skip
    (one,) = collect(units, results)
    assert one.trials.tolist() == [[0, 1, 2, 3], [10, 11, 12, 13]]
    assert one.hit.tolist() == [[True] * 4, [True, False] * 2]
    assert (one.n_diverged, one.wall_time, one.cap) == (4, 4.0, scene.cap)


def test_compare_writes_tables_and_plots(alone):
    rows = table(alone)
    assert {(r["method"], r["observation"]) for r in rows} == {("ga", ""), ("sac", "goal"), ("random", "")}
    assert {r["convention"] for r in rows if r["method"] == "sac"} == {"mean-first", "samples", "mean"}
    assert {r["hit_radius"] for r in rows} == {"0.06", "0.03"}
    for r in rows:
        assert float(r["low"]) <= float(r["mean_trials"]) <= float(r["high"]) <= 12
        assert r["training_trials"] == ("96.0" if r["method"] == "sac" else "0.0")
    task = json.loads((alone / "result.json").read_text())["task"]
    assert 0 < task["random_strikes_hit"] < task["one_strike_hits"] <= 1
    assert len(task["one_strike"]) == 5
    text = (alone / "table.md").read_text()
    assert text.startswith("6 targets: a disc of radius 0.1 m around (1.3, 0) m. One and the same strike hits ")
    assert "| SAC, goal |" in text
    assert "training trials" in text
    for name in ("bars.png", "ecdf.png"):
        assert (alone / name).read_bytes()[:4] == b"\x89PNG"
    assert not list((alone / "checkpoints").iterdir())


@pytest.mark.slow
def test_methods_are_compared_at_the_same_directions(tmp_path):
    """The report and the result say what is asked, and every search is one at the target's own direction."""
    asked = ("--target", 1, 0.3, "--arrival-angle", 60, 120, "--cone", 25, "--least-speed", 2)
    few = ("--targets", 3, "--seeds", 1, "--max-trials", 60, "--episodes", 4, "--trials", 8, "--random-episodes", 2)
    words = (*asked, *few, *COARSE, "--methods", "sac", "--observation", "goal", "--hindsight", 1, "--tighter", 0.04)
    done = called("compare", *words, "--workers", 1, "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    run = tmp_path / "run"
    said = "within 25 degrees of a random angle for each target, from 60 to 120 degrees, at 2 m/s or more. One and"
    assert said in (run / "table.md").read_text()
    result = json.loads((run / "result.json").read_text())
    assert result["arrival"]["least_speed"] == 2
    assert 0 < result["task"]["one_strike_hits"] <= 1
    rule = ArrivalRule(angle=(np.radians(60), np.radians(120)), cone=np.radians(25), speed=2.0)
    zone = Disc((1.0, 0.3))
    scene = TargetScene(
        model=preset("lemon2024"), controller=Controller(), zone=zone, targets=3, arrival=rule, timestep=1e-3
    )
    rollout, found = scene.rollout(1), []
    for i in range(3):
        target = replace(Target.of(scene.goals(), i), hit_radius=0.06)
        objective = Objective(rollout, target, max_trials=60, stop_at_hit=True)
        trace = search(objective, "random", seed=int(np.random.SeedSequence((0, i)).generate_state(1)[0]) >> 1).trace
        found.append(len(trace))
    (row,) = [row for row in table(run) if row["method"] == "random" and row["hit_radius"] == "0.06"]
    assert float(row["mean_trials"]) == pytest.approx(np.mean(found))
    assert called("compare", "--resume", "run", "--least-speed", 3, cwd=tmp_path).returncode == 2
    again = called("compare", "--resume", "run", cwd=tmp_path)
    assert again.returncode == 0, again.stderr


@pytest.mark.slow
def test_workers_make_no_difference(alone, tmp_path):
    done = whiptool("compare", *FEW, "--out", "run", "--workers", 2, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert table(tmp_path / "run") == table(alone)


def started(ray):
    """A cluster. Ray gives its own parts 15 s to start, which nothing changes: that is not what is tested here."""
    for _ in range(3):
        try:
            return ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
        except Exception as error:
            reason = str(error)
            ray.shutdown()
    pytest.skip(f"Ray does not start on a machine as busy as this: {reason}")


@pytest.mark.hours
def test_a_ray_cluster_makes_no_difference(alone, tmp_path, monkeypatch):
    """A real cluster on this machine, found by its address."""
    ray = pytest.importorskip("ray")
    # once it runs, it waits for its workers, and kills none because others take the memory
    patience = {"worker_register_timeout_seconds": HANG, "health_check_failure_threshold": 1000}
    for name, value in {**patience, "memory_monitor_refresh_ms": 0, "USAGE_STATS_ENABLED": 0}.items():
        monkeypatch.setenv(f"RAY_{name}", str(int(value)))
    context = started(ray)
    try:
        done = whiptool("compare", *FEW, "--out", "run", "--cluster", context.address_info["gcs_address"], cwd=tmp_path)
    finally:
        ray.shutdown()
    assert done.returncode == 0, done.stderr
    assert table(tmp_path / "run") == table(alone)


def test_killed_and_resumed_it_ends_the_same(alone, tmp_path):
    """SIGKILL while the learner trains, with its workers, at whatever they are."""
    words = [sys.executable, "-m", "whiptool.compare", *map(str, FEW), "--out", "run", "--workers", "2"]
    process = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not list((tmp_path / "run").glob("*/*")):
        assert process.poll() is None
        time.sleep(0.02)
    process.kill()
    process.wait()
    assert not (tmp_path / "run" / "table.csv").exists()
    done = called("compare", "--resume", "run", "--workers", 1, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert table(tmp_path / "run") == table(alone)
    results = [json.loads((run / "result.json").read_text()) for run in (tmp_path / "run", alone)]
    for result in results:
        del result["wall_time"]
        for row in result["rows"]:
            del row["wall_time"]
    assert results[0] == results[1]
    refused = called("compare", "--resume", "run", "--targets", 7, cwd=tmp_path)
    assert refused.returncode == 2
    assert "--targets" in refused.stderr


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--cluster", "127.0.0.1:1"), "--cluster"),
        (("--cluster", "nowhere"), "--cluster"),
    ],
)
def test_bad_input_gets_one_line(words, named, tmp_path):
    done = called("compare", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"whiptool: {named}")
    assert done.stderr.count("\n") == 1


def test_other_observations_train_shorter_in_proportion(scene):
    """500 episodes, 50 random, become 100 and 10; never more than the first."""
    plan = Comparison(scene=scene, further_episodes=100)
    assert plan.training("tip") == TrainingPlan(500, 100, 50)
    assert plan.training("goal") == plan.training("relative") == TrainingPlan(100, 100, 10)
    short = TrainingPlan(20, random_episodes=4)
    assert Comparison(scene=scene, plan=short, further_episodes=100).training("goal") == short
    with pytest.raises(InputError, match="episodes"):
        Comparison(scene=scene, further_episodes=0)


def test_a_whip_that_no_posture_holds_free_is_refused_before_units_are_made(tmp_path):
    words = ["compare", "--model", "ur5e", "--mount", "ceiling", 0.5, "--methods", "random"]
    assert_one_line(called(*words, cwd=tmp_path), "whiptool: --whip-length and --mount: got 'a whip of 1 m on an arm")
    assert not (tmp_path / "runs").exists()
