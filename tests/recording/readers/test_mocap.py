"""Motion capture: axes, units, rates and what was filled, as each file has them."""

from __future__ import annotations

import numpy as np
import pytest
from lab_files import FORMATS, Motion, qualisys_mat, swing
from pendulum_data import DATA

from whiptool.errors import InputError
from whiptool.recording.readers import read_recording
from whiptool.recording.readers.mocap import even_times

MOTIVE = "Format Version,1.23,Export Frame Rate,100,Length Units,Meters,Coordinate Space,Global\n\n"
BONES = ",Type,Bone,Bone,Bone\n,Name,Hip,Hip,Hip\n,ID,1,1,1\n,,Position,Position,Position\n"
FRAMES = "Frame,Time (Seconds),X,Y,Z\n0,0,1,2,3\n1,0.01,1,2,3\n"


@pytest.fixture
def motion() -> Motion:
    return swing()


def test_the_sidecar_says_what_is_up_where_the_file_does_not(motion, tmp_path):
    """A cage whose z is up in Motive, and one whose y is up in Nexus."""
    read = {}
    for name, assumed, turned in (("Motive", "y", "z"), ("Nexus", "z", "y")):
        _, write, _ = FORMATS[name]
        other = Motion(motion.places, motion.markers)
        object.__setattr__(other, "in_space", lambda up, turned=turned: motion.in_space(turned))
        write(tmp_path / f"{name}.csv", other)
        markers = {"tip": "tip"} if name == "Motive" else {"tip": "TIP"}
        read[name] = read_recording(tmp_path / f"{name}.csv", up=turned, markers=markers)
        wrong = read_recording(tmp_path / f"{name}.csv", markers=markers)
        np.testing.assert_allclose(read[name].points[:, 0, :2], motion.places[:, 1] / 1e3, atol=1e-12)
        assert np.nanmax(np.abs(wrong.points[:, 0, 1])) == 0  # the plane lay on the floor
        assert any(f"{turned} is up, as the sidecar says" in note for note in read[name].remarks)
        assert any(f"{assumed} is up, as is" in note for note in wrong.remarks)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MOTIVE.replace("Global", "Local"), "Coordinate Space: got 'Local'"),
        (MOTIVE.replace("Meters", "Furlongs"), "Length Units: got 'Furlongs'; allowed: one of m, cm, mm, in"),
        (MOTIVE.replace(",100,", ",0,"), "Export Frame Rate: got '0'"),
    ],
)
def test_motives_first_row_is_heard(text, said, tmp_path):
    rows = BONES.replace("Bone", "Marker").replace("Hip", "tip") + FRAMES
    (tmp_path / "a.csv").write_text(text + rows)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text(MOTIVE.replace("Global", "Global,Axis Convention,Z-Up") + rows)
    found = read_recording(tmp_path / "a.csv")
    np.testing.assert_array_equal(found.points[0, 0], [1, 3, -2])
    assert "axes: z is up, as the file says, x taken as forward; else say axes" in found.remarks
    other = MOTIVE.replace("1.23", "9.1").replace("Global", "Global,Total Exported Frames,7")
    (tmp_path / "a.csv").write_text(other + rows)
    remarks = "; ".join(read_recording(tmp_path / "a.csv").remarks)
    assert "format version 9.1: read as versions 1.1 to 3 are" in remarks
    assert "the file holds 2 frames, and announces 7" in remarks


def test_rigid_bodies_alone_are_markers_where_they_are(tmp_path):
    """As Motive exports a stick without its markers, in quotation marks."""
    names = (
        ',"Type","Rigid Body",' + ",".join(['"Rigid Body"'] * 7) + "\n,Name" + ",Stick" * 8 + "\n,ID" + ",7" * 8 + "\n"
    )
    what = ",," + "Rotation," * 4 + "Position," * 3 + "Mean Marker Error\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z,\n"
    rows = "0,0.000000,0,0,0,1,1.5,2.5,3.5,0.001\n1,0.010000,,,,,,,,\n2,0.020000,0,0,0,1,1.25,2.25,3.25,0.001\n"
    (tmp_path / "a.csv").write_text(MOTIVE + names + what + rows)
    found = read_recording(tmp_path / "a.csv", markers={"handle": "Stick"})
    np.testing.assert_array_equal(found.points[:, 0], [[1.5, 2.5, 3.5], [np.nan] * 3, [1.25, 2.25, 3.25]])
    assert any(note.startswith("left out the rotations of 1 rigid body;") for note in found.remarks)


def test_times_of_few_digits_are_those_of_the_even_clock():
    """Whole milliseconds at 120 frames a second; but a clock that drifts is heard."""
    number = np.arange(1, 400)
    exact = number / 120
    t, said = even_times(np.round(exact, 3), number, 120.0, "Time")
    np.testing.assert_allclose(t, exact, atol=1e-12)
    assert "agrees" in said
    late, _ = even_times(np.round(exact - 1 / 120, 5), number, 120.0, "Time")
    np.testing.assert_allclose(late, exact - 1 / 120, atol=1e-12)
    half, said = even_times(np.round((number[::2] - 1) / 240, 5), number[::2], 120.0, "Time")  # 120 of 240 a second
    np.testing.assert_allclose(half, (number[::2] - 1) / 240, atol=1e-12)
    assert "agrees" in said
    drifting = np.round(1.001 * exact, 6)
    t, said = even_times(drifting, number, 120.0, "Time")
    np.testing.assert_array_equal(t, drifting)
    assert "does not go evenly" in said


def test_points_that_qualisys_filled_are_missing(motion, tmp_path):
    kind = np.isfinite(motion.places[..., 0].T).astype(int)
    kind[0, 30:35], kind[1, 50], kind[1, 60] = 2, 3, 4
    qualisys_mat(tmp_path / "a.mat", motion, kind)
    found = read_recording(tmp_path / "a.mat")
    assert found.seen.sum(axis=0).tolist() == [len(motion.t) - 5, len(motion.t) - 5]  # an edited point was measured
    assert any("are taken as missing: handle 5, tip 1" in note for note in found.remarks)


@pytest.mark.parametrize("digits", ["{:.3E}", "{:.3f}", "{:g}"])
def test_times_of_trackers_digits_are_those_of_an_even_clock(digits, tmp_path):
    """Of 30 frames a second up to half a millisecond is lost in each time, late in a file 5 ms."""
    exact = np.arange(400) / 30
    shown = exact if "E" in digits else np.round(exact, 3)
    rows = [f"{digits.format(t)},{0.001 * i},2.0" for i, t in enumerate(shown)]
    (tmp_path / "a.csv").write_text("\n".join(["mass A,,", "t,x,y", *rows]))
    np.testing.assert_allclose(read_recording(tmp_path / "a.csv").t, exact, atol=2e-4)
    rows[20:] = [f"{round(t, 3) + 0.02:.3f},{0.001 * i},2.0" for i, t in enumerate(exact[20:])]
    (tmp_path / "a.csv").write_text("\n".join(["mass A,,", "t,x,y", *rows]))
    np.testing.assert_allclose(read_recording(tmp_path / "a.csv").t[20:], np.round(exact[20:], 3) + 0.02, atol=1e-9)


NAMELESS = {
    "a.trc": "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tNumFrames\tNumMarkers\tUnits\n100\t2\t2\tm\n"
    "Frame#\tTime\ttip\t\t\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n1\t0\t1\t2\t3\t4\t5\t6\n2\t.01\t1\t2\t3\t4\t5\t6\n",
    "a.tsv": "NO_OF_FRAMES\t2\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDATA_INCLUDED\t3D\nMARKER_NAMES\ttip\t\n"
    "1\t2\t3\t4\t5\t6\n1\t2\t3\t4\t5\t6\n",
    "a.csv": "Trajectories\n100\n,,tip,,,,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,m,m,m,m,m,m\n"
    "1,0,1,2,3,4,5,6\n2,0,1,2,3,4,5,6\n",
    "a.txt": "#multi:\ttip\t\t\t\nt\tx\ty\tx\ty\n0\t1\t2\t4\t5\n0.01\t1\t2\t4\t5\n",
    "b.csv": MOTIVE + ",,Marker,Marker,Marker,Marker,Marker,Marker\n,,tip,tip,tip,,,\n,,7,7,7,8,8,8\n"
    + ",,Position,Position,Position,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,X,Y,Z\n"
    + "0,0,1,2,3,4,5,6\n1,0.01,1,2,3,4,5,6\n",
}  # fmt: skip


@pytest.mark.parametrize("name", NAMELESS)
def test_markers_without_a_name_are_read_and_numbered(name, tmp_path):
    (tmp_path / name).write_text(NAMELESS[name])
    axes = {} if name == "a.txt" else {"axes": ["x", "y", "z"], "units": "m"}
    found = read_recording(tmp_path / name, **axes)
    assert found.markers == ("tip", "marker2")
    np.testing.assert_array_equal(found.marker("marker2")[0], [4, 5, 6][: found.points.shape[2]])
    assert any("numbered in the file's order: marker2" in note for note in found.notes)


def test_a_header_that_counts_other_markers_than_there_are_is_told(tmp_path):
    for name, key in (("a.trc", "\t2\t2\tm\n"), ("a.tsv", "NO_OF_MARKERS\t2")):
        (tmp_path / name).write_text(NAMELESS[name].replace(key, key.replace("2\tm", "3\tm").replace("S\t2", "S\t3")))
        notes = read_recording(tmp_path / name, axes=["x", "y", "z"], units="m").notes
        assert any(note.startswith("the file holds 2 markers, and announces 3") for note in notes)


def test_the_case_of_a_marker_without_a_name_is_read():
    file = DATA.parent / "cases/recordings/unnamed_extra.trc"
    if not file.exists():
        pytest.skip("../shared/data is absent")
    found = read_recording(file)
    assert (found.markers, len(found.t)) == (("tip", "marker2"), 180)
    np.testing.assert_allclose(found.points[1], [[0.00749922, 0.8000625, 0.00041667], [0.00249974, 1.8, 0]])
