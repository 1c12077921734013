"""Files of other programs: each is recognised, and told what to do with it."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import plain_rows, same, write_rows

from whiptool.errors import InputError
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.readers import read_recording, write_csv
from whiptool.recording.readers.joint_log import read_joint_log
from whiptool.recording.strike_recording import StrikeRecording

MOTIVE = """Format Version,1.23,Take Name,swing,Take Notes,,Capture Frame Rate,240.000000,Export Frame Rate,240.000000
,,Marker,Marker,Marker
,,whip:tip,whip:tip,whip:tip
Frame,Time (Seconds),X,Y,Z
0,0.000000,0.1,0.2,0.3
"""


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.bag", "#ROSBAG V2.0\n", "a whole ROS 1 bag"),
        ("a.mcap", "\x89MCAP0\r\n", "a whole ROS 2 bag"),
    ],
)
def test_what_another_program_wrote_is_named_with_the_cure(tmp_path, name, text, said):
    (tmp_path / name).write_bytes(text.encode("latin-1" if text.startswith("\x89") else "utf-8"))
    with pytest.raises(InputError, match=said) as caught:
        read_recording(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_joint_log_of_another_program_is_named_too(tmp_path):
    (tmp_path / "a.csv").write_text("t,tip_x,tip_y\n0,0,0\n0.1,0,1\n")
    (tmp_path / "log.csv").write_text(MOTIVE)
    with pytest.raises(InputError, match=r"log\.csv: got 'a CSV export of OptiTrack Motive'"):
        read_recording(tmp_path / "a.csv", joints="log.csv")


def test_a_joint_log_is_no_recording(tmp_path):
    """`identify *.csv` in a folder of whiptool's own tables names it, too."""
    (tmp_path / "a.joints.csv").write_text("t,shoulder,elbow\n0,0,0\n0.1,0,1\n")
    with pytest.raises(InputError, match=r"a joint log.*leave it out.*a\.csv"):
        read_recording(tmp_path / "a.joints.csv")


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
    listed = 'joints_start = 7.0\njoint_units = "deg"\njoint_columns = ["position_shoulder", "velocity_elbow"]\n'
    recording = recorded(tmp_path, listed)
    np.testing.assert_allclose(angles(recording), np.deg2rad([[-0.5, 9], [-0.6, 9], [-0.7, 9]]))
    np.testing.assert_allclose(times(recording), [0, 0.1, 0.2])
    in_order = recording.ordered(("any", "two"))
    assert in_order.joint_names == ("any", "two")
    np.testing.assert_array_equal(angles(in_order), angles(recording))
    with pytest.raises(InputError, match=r"column: got 'q1'; .*position_elbow"):
        recorded(tmp_path, 'joint_columns = ["q1"]\n')
    with pytest.raises(InputError, match="joint_columns"):
        recorded(tmp_path, "joint_columns = 3\n")


def test_a_log_of_unnamed_columns_is_in_order(tmp_path):
    write_rows(tmp_path / "log.csv", [["t", "a", "b"], [0, 1, 2], [1, 3, 4]])
    log = read_joint_log(tmp_path / "log.csv")
    assert log.names == ()
    np.testing.assert_array_equal(np.column_stack([log.t, log.q]), [[0, 1, 2], [1, 3, 4]])
    write_rows(tmp_path / "log.csv", [["t"], [0], [1]])
    with pytest.raises(InputError, match="one column per joint"):
        read_joint_log(tmp_path / "log.csv")


def test_an_exported_trajectory_is_a_joint_log(tmp_path):
    told = JointTrajectory.of_strike(Strike((0.1, 0.2), (0.5, -0.3), 0.4), ("shoulder", "elbow"), rest=0.1)
    told.save_csv(tmp_path / "told.csv")
    log = read_joint_log(tmp_path / "told.csv")
    np.testing.assert_array_equal(log.t, told.t)
    np.testing.assert_array_equal(log.q, told.q)
    assert log.names == told.joints


def test_names_of_joints_come_back_from_files(tmp_path):
    recording = recorded(tmp_path, "joints_start = 7.1\n")
    recording.save(tmp_path / "b.npz")
    write_csv(recording, tmp_path / "c.csv")
    for file in ("b.npz", "c.csv"):
        same(read_recording(tmp_path / file), recording, but=("source", "sha256", "sigma_assumed"))
    with pytest.raises(InputError, match="joint_names"):
        StrikeRecording(recording.t, recording.points, recording.markers, joint_names=("a",))


def log_of(tmp_path, header, rows, side="") -> StrikeRecording:
    """Tracks beside a log of these columns, over the same half second."""
    write_rows(tmp_path / "a.csv", plain_rows())
    write_rows(tmp_path / "log.csv", [header, *rows])
    (tmp_path / "a.toml").write_text('joints = "log.csv"\n' + side)
    return read_recording(tmp_path / "a.csv")


T = np.arange(0, 0.6, 0.01)
SHOULDER, ELBOW = np.sin(T), 0.3 + np.cos(2 * T)


def at(**columns: np.ndarray) -> tuple[list[str], list[list[float]]]:
    """Header and rows."""
    return list(columns), np.column_stack(list(columns.values())).tolist()


@pytest.mark.parametrize(
    ("header", "unit", "side"),
    [
        (["time", "elbow_joint", "shoulder_joint"], 1, ""),
        (["t [s]", "/arm/elbow", "/arm/shoulder"], 1, ""),
        (["t", "elbow [deg]", "shoulder [deg]"], np.rad2deg(1), ""),
        (["t", "elbow", "shoulder"], np.rad2deg(1), 'joint_units = "deg"\n'),
        (["t", "q_2", "q_1"], 1, ""),
        (["t", "b", "a"], 1, 'joint_columns = {shoulder = "a", elbow = "b"}\n'),
        (["t", "elbow", "shoulder"], 1, 'joint_columns = ["elbow", "shoulder"]\n'),
        (["stamp", "axis7", "axis3"], 1, 'joint_columns = ["axis3", "axis7"]\n'),
    ],
)
def test_columns_in_another_order_are_the_same_joints(tmp_path, header, unit, side):
    rows = np.column_stack([T, unit * ELBOW, unit * SHOULDER]).tolist()
    recording = log_of(tmp_path, header, rows, side).for_model(preset("lemon2024"))
    np.testing.assert_allclose(angles(recording), np.column_stack([SHOULDER, ELBOW]), atol=1e-12)
    assert recording.joint_names in ((), ("shoulder", "elbow"))


def test_speeds_torques_commands_and_grippers_are_no_joints(tmp_path):
    header = ["t", "gripper", "elbow", "elbow_vel", "target_elbow", "shoulder", "effort.shoulder", "camera_ok"]
    other = np.full_like(T, 7.0)
    rows = np.column_stack([T, 100 * T, ELBOW, other, other, SHOULDER, other, other]).tolist()
    recording = log_of(tmp_path, header, rows).for_model(preset("lemon2024"))
    np.testing.assert_allclose(angles(recording), np.column_stack([SHOULDER, ELBOW]))
    said = "; ".join(recording.remarks)
    assert "left aside gripper" in said
    assert "joints by name, in the arm's order: shoulder, elbow; left aside: camera_ok" in said


def test_a_log_that_no_name_matches_is_refused_and_a_list_is_heard(tmp_path):
    rows = np.column_stack([T, ELBOW, SHOULDER]).tolist()
    with pytest.raises(InputError, match=r"a\.csv: joints: got 'knee, hip'.*joint_columns = {shoulder"):
        log_of(tmp_path, ["t", "knee", "hip"], rows).for_model(preset("lemon2024"))
    listed = log_of(tmp_path, ["t", "knee", "hip"], rows, 'joint_columns = ["hip", "knee"]\n')
    np.testing.assert_allclose(angles(listed.for_model(preset("lemon2024"))), np.column_stack([SHOULDER, ELBOW]))


@pytest.mark.parametrize(
    ("rows", "side", "said"),
    [
        (np.column_stack([T, 60 * ELBOW, 60 * SHOULDER]), "", r"column elbow.*degrees \(joint_units\)"),
        (np.column_stack([T, 30 * ELBOW, 30 * SHOULDER]), "", "a range of .*degrees"),
        (np.column_stack([1e3 * T, ELBOW, SHOULDER]), "", "joints_t: got 'steps of 10'.*milliseconds"),
        (
            np.column_stack([T + 4e5, ELBOW, SHOULDER]),
            "",
            "joints_t.*from 400000 to.*do the clocks differ.*joints_start",
        ),
        (np.column_stack([T + 1.7e9, ELBOW, SHOULDER]), "", "joints_t.*do the clocks differ"),
        (np.column_stack([T // 0.1, ELBOW, SHOULDER]), "", "each later than the previous stamp"),
        (np.column_stack([T, ELBOW, SHOULDER]), 'joint_units = "normalized"\n', "joint_ranges.*angles at -100 and 100"),
    ],
)
def test_a_log_of_another_unit_or_clock_is_refused(tmp_path, rows, side, said):
    with pytest.raises(InputError, match=said) as caught:
        log_of(tmp_path, ["t", "elbow", "shoulder"], rows.tolist(), side)
    assert "a.csv" in str(caught.value) or "log.csv" in str(caught.value) or "a.toml" in str(caught.value)


def test_clocks_of_their_own_are_brought_together(tmp_path):
    rows = np.column_stack([1e3 * (T + 4e5), ELBOW, SHOULDER]).tolist()
    recording = log_of(tmp_path, ["t_ms", "elbow", "shoulder"], rows, "joints_start = 4e5\n")
    np.testing.assert_allclose(times(recording), T, atol=1e-9)


def test_repeated_rows_bad_stamps_empty_cells_and_turns_are_told(tmp_path):
    rows = np.column_stack([T, ELBOW, SHOULDER])
    rows[20:, 1] += 2 * np.pi  # as an encoder wraps
    rows[40, 0] = rows[39, 0]
    rows[50, 2] = np.nan
    rows = np.insert(rows, [5, 5, 30], rows[[4, 4, 29]], axis=0)  # as UR's recorder writes them
    recording = log_of(tmp_path, ["t", "elbow", "shoulder"], rows.tolist())
    left = np.delete(np.arange(60), [40, 50])
    np.testing.assert_allclose(times(recording), T[left])
    np.testing.assert_allclose(angles(recording), np.column_stack([ELBOW, SHOULDER])[left], atol=1e-12)
    said = "; ".join(recording.remarks)
    for words in ("3 rows that repeat", "1 of 59 samples", "1 rows with an empty cell", "undone, at 0.200 s"):
        assert words in said


def test_holes_and_short_logs_are_told(tmp_path):
    header, rows = at(t=T, elbow=ELBOW, shoulder=SHOULDER)
    assert not any("hole" in x or "late" in x or "early" in x for x in log_of(tmp_path, header, rows).remarks)
    hole = "; ".join(log_of(tmp_path, header, rows[:10] + rows[29:]).remarks)
    assert "joints: a hole where about 19 samples are missing, the longest of 0.2 s from 0.090 to 0.290 s" in hole
    short = "; ".join(log_of(tmp_path, header, rows[10:30]).remarks)
    assert "joints: the log starts late, 0.100 s after the first frame" in short
    assert "joints: the log ends early, 0.193 s before the last frame" in short


def test_normalized_positions_have_the_ranges_that_are_said(tmp_path):
    header, rows = at(t=T, elbow=100 * np.sin(T), shoulder=-100 * np.sin(T))
    side = 'joint_units = "normalized"\njoint_ranges = {shoulder = [-1.0, 2.0], elbow = [-0.5, 0.5]}\n'
    recording = log_of(tmp_path, header, rows, side).for_model(preset("lemon2024"))
    expected = np.column_stack([0.5 - 1.5 * np.sin(T), 0.5 * np.sin(T)])
    np.testing.assert_allclose(angles(recording), expected, atol=1e-12)


def test_of_a_long_log_what_lies_near_the_frames_is_used(tmp_path):
    t = np.arange(0, 3000, 0.1)
    rows = np.column_stack([t - 1500, np.sin(t), np.cos(t)]).tolist()
    recording = log_of(tmp_path, ["t", "elbow", "shoulder"], rows).for_model(preset("lemon2024"))
    assert -1.01 < times(recording)[0] < times(recording)[-1] < 1.5


COMMAS = "t;tip_x;tip_y\n0,00;0,5;-0,25\n0,01;{};-0,25\n0,02;0,5;-0,25\n"


@pytest.mark.parametrize("cell", ["1.234,5", "1.234", "-1.234.567,8", "12.345,67"])
def test_separators_of_thousands_are_refused_with_the_cell(cell, tmp_path):
    """A thousand without decimals would be read as one; a point in a column of points is a decimal point."""
    (tmp_path / "a.csv").write_text(COMMAS.format(cell))
    with pytest.raises(InputError, match=rf"row 3, column 2: got '{cell}'.*without separators of thousands"):
        read_recording(tmp_path / "a.csv")
    (tmp_path / "a.txt").write_text(TRACKS.replace("\t4\t", f"\t{cell}\t", 1))
    with pytest.raises(InputError, match=rf"row 3, column 2: got '{cell}'.*without separators of thousands"):
        read_recording(tmp_path / "a.txt")
    (tmp_path / "a.csv").write_text(COMMAS.format("1,234").replace("0,01;", "0.01;").replace("0,02;", "0.02;"))
    assert read_recording(tmp_path / "a.csv").points[1, 0].tolist() == [1.234, -0.25]


TRACKS = "mass A\t\t\nt\tx\ty\n0,00\t4\t5,5\n0,01\t4,5\t5\n0,02\t4,5\t5\n"


@pytest.mark.parametrize("cell", ["1_0.5", "1_0", "\u0661\u0662", "0x10", "1e5_0"])
def test_numbers_in_a_notation_of_python_alone_are_refused(cell, tmp_path):
    (tmp_path / "a.csv").write_text(f"t,tip_x,tip_y\n0,0,0\n0.1,{cell},1\n0.2,0,1\n", encoding="utf-8")
    with pytest.raises(InputError, match=rf"row 3, column 2: got '{cell}'; allowed: a number or empty"):
        read_recording(tmp_path / "a.csv")
    (tmp_path / "a.txt").write_text(TRACKS.replace("\t4\t", f"\t{cell}\t", 1), encoding="utf-8")
    with pytest.raises(InputError, match=rf"row 3, column 2: got '{cell}'; allowed: a number or empty"):
        read_recording(tmp_path / "a.txt")


@pytest.mark.parametrize("coded", ["utf-16", "utf-8-sig", "cp1252"])
def test_tables_and_sidecars_are_read_in_the_encodings_that_windows_writes(coded, tmp_path):
    """UTF-16 with its mark, as `Unicode text` of spreadsheets and redirected output of PowerShell are."""
    side = 'units = "cm"\njoints = "log.csv"\n'
    (tmp_path / "a.toml").write_text(side, encoding="utf-8" if coded == "cp1252" else coded)
    (tmp_path / "a.csv").write_text("t;tip_x;tip_y\n0;0;50\n0,1;0;50\n0,2;0;50\n", encoding=coded)
    (tmp_path / "log.csv").write_text("t\tq1 [\N{DEGREE SIGN}]\n0\t90\n0.1\t90\n0.2\t90\n", encoding=coded)
    found = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(found.points[:, 0], [[0, 0.5]] * 3)
    np.testing.assert_allclose(angles(found)[:, 0], np.pi / 2)
    (tmp_path / "b.txt").write_text(TRACKS, encoding=coded)
    np.testing.assert_array_equal(read_recording(tmp_path / "b.txt").points[:, 0], [[4, 5.5], [4.5, 5], [4.5, 5]])
    (tmp_path / "c.csv").write_text("t,angle1\n0,0.1\n0.1,0.2\n0.2,0.3\n", encoding=coded)
    assert read_recording(tmp_path / "c.csv").markers == ("link1",)
