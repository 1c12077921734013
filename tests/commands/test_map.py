"""The map command: built, killed, resumed, asked from the command line and from Python."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import called

pytest.importorskip("torch")

from whiptool import load_map
from whiptool.commands import map as command
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.strike_map.map_files import GATE, part_file

SMALL = "build --controller constant --timestep 0.0005 --zone-radius 0.15 --hit-radius 0.03 --arrival-angle -180 180"
BUDGET = "--random-strikes 500 --room 1 --rounds 1 --goals 16 --gate-strikes 100 --tests 10"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("map") / "run"
    assert command.main([*SMALL.split(), *BUDGET.split(), "--out", str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_the_result_says_what_the_map_does(run: Path) -> None:
    result = json.loads((run / "result.json").read_text())
    assert result["tests"] == 10
    assert 0 <= result["one_shot"] <= result["refined"] <= 1  # so small a map's first strikes hit by chance
    assert result["refined"] > 0
    assert result["answers"] == len(load_map(run).answers) > 50
    assert result["arrival"]["arrival_angle"] == [-np.pi, np.pi]


@pytest.mark.slow
def test_a_killed_run_goes_on_to_the_same_map(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    shutil.copytree(run, folder)
    for name in (GATE, part_file(folder, 1).name, "result.json"):
        (folder / name).unlink()
    assert command.main(["build", "--resume", str(folder)]) == 0
    for file in (part_file(run, 1), run / GATE):
        with np.load(file) as first, np.load(folder / file.name) as second:
            assert set(first) == set(second)
            for name in first:
                np.testing.assert_array_equal(first[name], second[name])


def test_a_map_that_is_not_whole_says_how_to_go_on(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "part"
    shutil.copytree(run, folder)
    (folder / GATE).unlink()
    with pytest.raises(InputError, match=r"a finished map.*whiptool map build --resume"):
        load_map(folder)


@pytest.mark.slow
def test_a_strike_from_the_command_line_is_the_one_from_python(run: Path, tmp_path: Path, capsys) -> None:
    words = f"strike {run} --target 1.3 0.05 --arrival-angle 90 --no-video --json"  # at the map's hit radius
    assert command.main([*words.split(), "--out", str(tmp_path / "strike")]) == 0
    told = json.loads(capsys.readouterr().out)
    goal = Target.arriving((1.3, 0.05), np.pi / 2, hit_radius=0.03)
    assert list(told["strike"].values()) == pytest.approx(load_map(run).strike(goal).vector)
    assert told["reference"]["miss_distance"] == pytest.approx(told["miss_distance"], abs=1e-3)
    assert told["hit_radius"] == 0.03
    assert told["arrival"]["angle"] is not None
    assert (tmp_path / "strike/trajectory.npz").exists()
    played = called("simulate", "strike", "--json", "--no-video", "--out", "played", cwd=tmp_path)
    assert json.loads(played.stdout)["miss_distance"] == pytest.approx(told["miss_distance"], abs=1e-6)
    words = words.replace("--json", "--no-refine")
    assert command.main([*words.split(), "--out", str(tmp_path / "first")]) == 0
    assert "one strike from the map of lemon2024" in capsys.readouterr().out
    first = json.loads((tmp_path / "first/result.json").read_text())
    assert list(first["strike"].values()) == pytest.approx(load_map(run).strike(goal, refined=False).vector)


def test_mistakes_in_what_is_struck_from_are_one_line(capsys) -> None:
    for words, said in (("strike", "MAP"), ("strike ur5e --target 1.2 0.3 0.5 --arrival-angle 400", "<= 360")):
        assert command.main(words.split()) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert said in told


@pytest.mark.slow
def test_a_strike_of_a_robot_says_what_it_uses_of_the_limits(tmp_path: Path, capsys) -> None:
    words = "strike ur5e --target 1.2 0.3 0.5 --arrival-angle 60 --no-video --out"
    assert command.main([*words.split(), str(tmp_path / "strike")]) == 0
    said = capsys.readouterr().out
    result, path = (
        json.loads((tmp_path / "strike/result.json").read_text()),
        np.load(tmp_path / "strike/trajectory.npz"),
    )
    joints = preset("ur5e").arm.joint_limits
    speeds = np.abs(path["v"][:, :6]).max(axis=0) / [joint.velocity for joint in joints]
    torques = np.abs(path["tau"]).max(axis=0) / [joint.torque for joint in joints]
    assert max(speeds.max(), torques.max()) - 1e-6 <= result["joint_usage"] <= 1
    assert result["beyond"] is None
    assert re.search(r"\n  joints         within .*: at most \d+ % used\n", said)
    assert f"\n  clearance      {1e3 * result['clearance']:.0f} mm at least; " in said
    assert len(re.findall(r"   within [+-]", said)) == len(result["strike"])
