"""Logs of a robot's joints: exported trajectories, foreign columns, other orders and clocks."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import plain_rows, same, write_rows

from whiptool.errors import InputError
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.recording.readers import read_recording, write_csv
from whiptool.recording.readers.joint_log import read_joint_log
from whiptool.recording.strike_recording import StrikeRecording

ROWS = [
    ["stamp", "position_elbow", "velocity_elbow", "position_shoulder", "velocity_shoulder"],
    [7.0, 0.1, 9.0, -0.5, 9.0],
    [7.1, 0.2, 9.0, -0.6, 9.0],
    [7.2, 0.3, 9.0, -0.7, 9.0],
]


def recorded(tmp_path, side: str) -> StrikeRecording:
    """Tracks beside a joint log."""
    write_rows(tmp_path / "a.csv", plain_rows())
    write_rows(tmp_path / "log.csv", ROWS)
    (tmp_path / "a.toml").write_text('joints = "log.csv"\n' + side)
    return read_recording(tmp_path / "a.csv")


def times(recording: StrikeRecording) -> np.ndarray:
    """Of its joint log, which is there."""
    assert recording.joints_t is not None
    return recording.joints_t


def angles(recording: StrikeRecording) -> np.ndarray:
    """Likewise."""
    assert recording.joints_q is not None
    return recording.joints_q


def test_positions_are_taken_by_name_and_put_into_the_arms_order(tmp_path):
    recording = recorded(tmp_path, "joints_start = 7.1\n")
    assert recording.joint_names == ("elbow", "shoulder")
    np.testing.assert_allclose(times(recording), [-0.1, 0, 0.1])
    assert recording.t[0] == plain_rows()[1][0]  # the tracks' clock is their own
    ordered = recording.ordered(("shoulder", "elbow"))
    np.testing.assert_array_equal(angles(ordered), [[-0.5, 0.1], [-0.6, 0.2], [-0.7, 0.3]])
    with pytest.raises(InputError, match=r"joints: got 'elbow, shoulder'.*shoulder, wrist"):
        recording.ordered(("shoulder", "wrist"))


def test_columns_are_taken_as_they_are_listed(tmp_path):
    listed = 'start = 7.0\njoint_units = "deg"\njoint_columns = ["position_shoulder", "velocity_elbow"]\n'
    recording = recorded(tmp_path, listed)
    np.testing.assert_allclose(angles(recording), np.deg2rad([[-0.5, 9], [-0.6, 9], [-0.7, 9]]))
    np.testing.assert_allclose(times(recording), [0, 0.1, 0.2])
    assert recording.joint_names == ()
    assert recording.ordered(("any", "two")) is recording
    with pytest.raises(InputError, match=r"column: got 'q1'; .*position_elbow"):
        recorded(tmp_path, 'joint_columns = ["q1"]\n')
    with pytest.raises(InputError, match="joint_columns"):
        recorded(tmp_path, "joint_columns = 3\n")


def test_a_log_of_unnamed_columns_is_in_order(tmp_path):
    write_rows(tmp_path / "log.csv", [["t", "a", "b"], [0, 1, 2], [1, 3, 4]])
    t, q, names = read_joint_log(tmp_path / "log.csv")
    assert names == ()
    np.testing.assert_array_equal(np.column_stack([t, q]), [[0, 1, 2], [1, 3, 4]])
    write_rows(tmp_path / "log.csv", [["t"], [0], [1]])
    with pytest.raises(InputError, match="one column per joint"):
        read_joint_log(tmp_path / "log.csv")


def test_an_exported_trajectory_is_a_joint_log(tmp_path):
    told = JointTrajectory.of_strike(Strike((0.1, 0.2), (0.5, -0.3), 0.4), ("shoulder", "elbow"), rest=0.1)
    told.save_csv(tmp_path / "told.csv")
    t, q, names = read_joint_log(tmp_path / "told.csv")
    np.testing.assert_array_equal(t, told.t)
    np.testing.assert_array_equal(q, told.q)
    assert names == told.joints


def test_names_of_joints_come_back_from_files(tmp_path):
    recording = recorded(tmp_path, "joints_start = 7.1\n")
    recording.save(tmp_path / "b.npz")
    write_csv(recording, tmp_path / "c.csv")
    for file in ("b.npz", "c.csv"):
        same(read_recording(tmp_path / file), recording, but=("source", "sha256"))
    with pytest.raises(InputError, match="joint_names"):
        StrikeRecording(recording.t, recording.points, recording.markers, joint_names=("a",))
