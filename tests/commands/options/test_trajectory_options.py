"""Options of a trajectory for a robot: which files they write of which strikes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from whiptool.commands.options.trajectory_options import TrajectoryOptions
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller
from whiptool.models import preset
from whiptool.models.hand_space import HandSpace
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike

LEMON = preset("lemon2024")
OF_HAND = HandSpace(LEMON.arm).path(np.array([0.45, -0.1, 0.4, 0.0, 0.5]))
OF_JOINTS = Strike((-1.2, 0.9), (1.2, 0.3), 0.7)


def written(path: Path, strike) -> tuple[list[str], JointTrajectory]:
    options = TrajectoryOptions(export_trajectory=path, rest=0.1, trajectory_rate=50)
    found = options.build_trajectory(LEMON, strike, 0.1)
    assert found is not None
    options.write_trajectory(found, Controller(OIAC()))
    return sorted((file.name for file in path.parent.iterdir()), key=len), found


@pytest.mark.parametrize(
    ("strike", "name", "files"),
    [
        (OF_HAND, "strike.csv", ["strike.csv"]),
        (OF_HAND, "strike.yaml", ["strike.yaml", "strike-hand.yaml"]),
        (OF_JOINTS, "strike.csv", ["strike.csv"]),
        (OF_JOINTS, "strike.yml", ["strike.yml"]),
    ],
)
def test_the_poses_of_a_strike_of_the_hand_stand_beside_a_goal(strike, name, files, tmp_path):
    names, found = written(tmp_path / name, strike)
    assert names == files
    assert (found.hand is None) == (strike is OF_JOINTS)


def test_the_files_of_one_strike_say_the_same(tmp_path):
    found = written(tmp_path / "strike.csv", OF_HAND)[1]
    written(tmp_path / "strike.yaml", OF_HAND)
    read = JointTrajectory.load_csv(tmp_path / "strike.csv")
    goal = yaml.safe_load((tmp_path / "strike.yaml").read_text())["trajectory"]["points"]
    hand = yaml.safe_load((tmp_path / "strike-hand.yaml").read_text())["points"]
    assert [p["time_from_start"] for p in goal] == [p["time_from_start"] for p in hand]
    np.testing.assert_array_equal([p["positions"] for p in goal], read.q)
    places = [list(p["transforms"][0]["translation"].values()) for p in hand]
    assert read.hand is not None
    np.testing.assert_array_equal(places, read.hand[:, :3])
    np.testing.assert_array_equal(read.q, found.q)


@pytest.mark.parametrize(("place", "why"), [("none/way.csv", "none is not an existing folder"), ("way.csv", "folder")])
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_computed(place, why, tmp_path):
    (tmp_path / "way.csv").mkdir()
    with pytest.raises(InputError, match=f"--export-trajectory.*can be written.*{why}"):
        TrajectoryOptions(export_trajectory=tmp_path / place).check()
    TrajectoryOptions(export_trajectory=tmp_path / "new.csv").check()
