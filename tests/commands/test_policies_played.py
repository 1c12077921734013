"""Policies are simulated and looked at: with what they were trained with, at a target of their zone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from whiptool.commands import run_folders

pytest.importorskip("torch")

from whiptool.commands import simulate, train, view
from whiptool.commands.run_folders import is_policy
from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.rl.trained import BEST, CHECKPOINT, load_policy
from whiptool.rollout import CompiledRollout

HOW = ["--preset", "printed", "--zone-radius", "0.3", "--hit-radius", "0.2", "--timestep", "0.0005"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("policy") / "run"
    short = ["--episodes", "5", "--random-episodes", "2", "--trials", "8", "--tests", "1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "TRIALS_TO_HIT", 3)
        assert train.main([*HOW, *short, "--out", str(folder)]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("file", ["", BEST, CHECKPOINT])
def test_the_strike_of_a_policy_is_simulated(run: Path, file: str, tmp_path: Path, capsys) -> None:
    """With the controller and the steps of its training; what is given counts beside them."""
    words = [str(run / file), "--target", "1.2", "0.1", "--no-video", "--json", "--out", str(tmp_path / "played")]
    assert simulate.main(words) == 0
    told = json.loads(capsys.readouterr().out)
    strike = load_policy(run / file).strike((1.2, 0.1))
    assert list(told["strike"].values()) == strike.vector.tolist()
    controller = train.TrainOptions(preset="printed").build_controller()
    near = CompiledRollout(preset("lemon2024"), controller, timestep=5e-4).approach(strike, (1.2, 0.1))
    assert told["miss_distance"] == pytest.approx(float(near.distance[0]), abs=1e-9)
    assert (told["timestep"], told["hit_radius"], told["target"]) == (5e-4, 0.2, [1.2, 0.1])
    assert view.read_strike(tmp_path / "played").target.position == (1.2, 0.1)


@pytest.mark.slow
def test_what_is_no_strike_of_the_policy_is_refused_in_one_line(run: Path, tmp_path: Path, capsys) -> None:
    for words, said in (
        ([str(run), "--target", "1.65", "0"], "--target: got (1.65, 0.0); allowed: "),
        (
            [str(run), "--strike", "1", "0", "0", "0", "1"],
            "--strike: got (1.0, 0.0, 0.0, 0.0, 1.0); allowed: only without a policy",
        ),
        ([str(run), "--space", "hand"], "--space: got hand; allowed: only without a policy"),
    ):
        assert simulate.main([*words, "--out", str(tmp_path / "out")]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert lines[-1].replace("'", "").startswith(f"whiptool: {said}"), lines


@pytest.mark.slow
@pytest.mark.parametrize("file", ["", CHECKPOINT])
def test_a_policy_is_looked_at_by_a_strike_at_one_of_its_targets(run: Path, file: str, capsys, monkeypatch) -> None:
    """Its files are written anew every time: the policy may have learned since."""
    monkeypatch.setattr(view, "has_display", lambda: False)
    drawn: list[view.StrikeRun] = []
    monkeypatch.setattr(view.StrikeRun, "write_video", lambda strike, folder: drawn.append(strike))
    for _ in range(2):
        (run / view.PAGE).write_text("of an earlier policy")
        assert view.main([str(run / file), "--json"]) == 0
        told = capsys.readouterr()
        assert json.loads(told.out)["page"] == str(run / view.PAGE)
        assert "one of its held-out goals" in told.err
        assert "of an earlier policy" not in (run / view.PAGE).read_text()
    policy = load_policy(run / file)
    for strike in drawn:
        assert policy.task.zone.contains(np.array(strike.target.position))
        expected = policy.task.rollout.trajectory(policy.strike(strike.target), t_stay=policy.task.t_stay)
        np.testing.assert_array_equal(strike.trajectory.q, expected.q)
        assert strike.label == "OIAC printed, first strike of a policy trained with sac"
    assert len(drawn) == 2


def trained(folder: Path, **options) -> Path:
    """The folder of a training that has not begun."""
    config = {"command": "train", "options": run_folders.as_plain(train.TrainOptions(**options).kept())}
    (folder / "config.toml").write_text(tomli_w.dumps(config))
    return folder


@pytest.mark.parametrize(
    ("given", "angle", "cone"),
    [
        ({}, None, 10.0),
        ({"arrival_angle": (80.0,), "cone": 20.0}, 80.0, 20.0),
        ({"arrival_angle": (60.0, 120.0), "cone": 20.0}, None, 10.0),
        ({"direction": (0.0, 1.0), "cone": 20.0, "least_speed": 3.0}, None, 20.0),
    ],
)
def test_a_policys_target_is_asked_for_as_it_was_trained(given, angle, cone, tmp_path: Path) -> None:
    found = simulate._of_policy(trained(tmp_path, model="ur5e", target=(1.2, 0.0, 0.4), **given))
    assert (found.model, found.target) == ("ur5e", (1.2, 0.0, 0.4))
    assert (found.arrival_angle, found.cone) == (angle, cone)
    assert (found.direction, found.least_speed) == (given.get("direction"), given.get("least_speed"))
    assert not found.json


def test_only_a_training_with_a_checkpoint_is_a_policy(tmp_path: Path) -> None:
    assert not is_policy(trained(tmp_path))
    (tmp_path / CHECKPOINT).write_bytes(b"")
    assert is_policy(tmp_path)
    assert is_policy(tmp_path / CHECKPOINT)
    (tmp_path / "config.toml").write_text('command = "optimize"\n')
    assert not is_policy(tmp_path)
    with pytest.raises(InputError, match="run_folder"):
        simulate._of_policy(tmp_path)
