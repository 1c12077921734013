"""Files of other programs: each is recognised, and told what to do with it."""

import contextlib

import numpy as np
import pytest
from repository import ROOT

from whiptool.errors import InputError
from whiptool.recording.readers import read_recording

MOTIVE = """Format Version,1.23,Take Name,swing,Take Notes,,Capture Frame Rate,240.000000,Export Frame Rate,240.000000
,,Marker,Marker,Marker
,,whip:tip,whip:tip,whip:tip
Frame,Time (Seconds),X,Y,Z
0,0.000000,0.1,0.2,0.3
"""
NEXUS = """Trajectories
200
,,Whip:TIP,,,Whip:HAND,,
Frame,Sub Frame,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm
1,0,100.0,200.0,300.0,1.0,2.0,3.0
"""
QUALISYS = "NO_OF_FRAMES\t100\nNO_OF_CAMERAS\t8\nFREQUENCY\t300\nMARKER_NAMES\ttip\n1.0\t2.0\t3.0\n"
SLEAP = "track,frame_idx,instance.score,tip.x,tip.y,tip.score\ntrack_0,0,0.9,100.0,200.0,0.8\n"
HDF5 = "\x89HDF\r\n\x1a\n" + "\0" * 80


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", MOTIVE, "OptiTrack Motive.*export the take as C3D"),
        ("a.csv", "\ufeff" + MOTIVE.replace("\n", "\r\n"), "OptiTrack Motive"),
        ("a.csv", NEXUS, "Vicon Nexus.*C3D"),
        ("a.csv", NEXUS.replace("200\n", "200,,,,,,,\n", 1), "Vicon Nexus"),
        ("a.tsv", QUALISYS, "Qualisys.*C3D"),
        ("a.txt", QUALISYS, "Qualisys"),
        ("a.csv", SLEAP, "SLEAP.*columns t, tip_x, tip_y"),
        ("a.slp", HDF5, "SLEAP"),
        ("a.h5", HDF5, "SLEAP and DeepLabCut.*columns t, tip_x, tip_y"),
        ("a.txt", "mass_A\nt\tx\ty\n0.0\t1.0\t2.0\n", "Tracker.*t, tip_x, tip_y"),
        ("a.csv", "mass A,,\nt,x,y\n0.0,1.0,2.0\n", "Tracker"),
        ("a.txt", "#multi:\n\tcm A\t\tcm B\t\nt\tx\ty\tx\ty\t\n0.0\t1\t2\t3\t4\n", "Tracker"),
        ("a.trc", "PathFileType\t4\t(X/Y/Z)\ta.trc\n", "TRC"),
        ("a.bag", "#ROSBAG V2.0\n", "rosbags-convert"),
        ("a.mcap", "\x89MCAP0\r\n", "MCAP"),
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


def test_the_lines_for_sleap_write_what_is_read(tmp_path):
    """As the page has them; SLEAP stores (animals, axes, nodes, frames)."""
    h5py = pytest.importorskip("h5py")
    places = np.random.default_rng(0).uniform(0, 100, (1, 2, 2, 9))
    places[..., 1, 4] = np.nan
    with h5py.File(tmp_path / "strike1.analysis.h5", "w") as file:
        file["tracks"], file["node_names"] = places, [b"tip", b"hand"]
    page = (ROOT / "docs" / "file-formats.md").read_text(encoding="utf-8")
    (lines,) = [part.split("```")[0] for part in page.split("```python\n") if "h5py" in part.split("```")[0]]
    with contextlib.chdir(tmp_path):
        exec(compile(lines, "file-formats.md", "exec"), {})
    found = read_recording(tmp_path / "strike1.csv", fps=60, scale=0.01, origin=[0, 0])
    assert found.markers == ("tip", "hand")
    np.testing.assert_allclose(found.points, places[0].transpose(2, 1, 0) * [0.01, -0.01])


def test_a_joint_log_is_no_recording(tmp_path):
    """`identify *.csv` in a folder of whiptool's own tables names it, too."""
    (tmp_path / "a.joints.csv").write_text("t,shoulder,elbow\n0,0,0\n0.1,0,1\n")
    with pytest.raises(InputError, match=r"a joint log.*leave it out.*a\.csv"):
        read_recording(tmp_path / "a.joints.csv")
