"""Sidecars of recordings, and every kind of damage."""

import pytest
import robot_log_files
import tomli_w
from recordings import TABLE, full, fuzz, plain_rows, write_lerobot, write_rows

from whiptool import preset
from whiptool.errors import InputError
from whiptool.models.files import write_model
from whiptool.recording.readers import open_any, read_recording, write_csv


@pytest.mark.parametrize(
    ("side", "said"),
    [
        ({"colour": 1}, "colour.*one of the keys"),
        ({"unit": "mm"}, r"unit: got 'mm'.*; did you mean units\?$"),
        ({"units": "ft"}, "one of m, cm, mm, in"),
        ({"strike": {"q_i": [1.0], "D": 1.0}}, "q_i, q_f and D"),
        ({"strike": {**TABLE, "D": -1.0}}, "strike.D"),
        ({"strike": {**TABLE, "q_i": "now"}}, "strike"),
        ({"joints": "../a.csv"}, "without folders"),
        ({"joints": "absent.csv"}, "absent.csv"),
        ({"axes": ["x", "x"]}, "different axes"),
        ({"axes": ["z", "x"]}, "axes"),
        ({"start": "soon"}, "a number"),
        ({"target": "there"}, "target"),
        ({"controller": 3}, "a table"),
        ({"exposure": "long"}, "exposure"),
    ],
)
def test_sidecar_damage(tmp_path, side, said):
    write_rows(tmp_path / "a.csv", plain_rows())
    (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.csv")
    (tmp_path / "a.toml").write_text("units =")
    with pytest.raises(InputError, match="TOML"):
        read_recording(tmp_path / "a.csv")


@pytest.mark.parametrize("name", ["b.npz", "b.csv"])
def test_a_sidecar_of_which_nothing_is_read_is_refused_by_its_name(tmp_path, name):
    """Next to a recording of whiptool's own, and to a log, alone or named by tracks; unless it is another file's."""
    full().save(tmp_path / "b.npz")
    write_csv(full(), tmp_path / "whole.csv")
    log = (tmp_path / "whole.joints.csv").read_text()
    if name == "b.csv":
        (tmp_path / "b.npz").unlink()
        (tmp_path / name).write_text(log)
    open_any(str(tmp_path / name))
    (tmp_path / "b.toml").write_text("start = 1.0")
    said = r"b\.toml: got 'a sidecar'; allowed: none, for nothing of it is read with "
    with pytest.raises(InputError, match=said):
        open_any(str(tmp_path / name))
    if name == "b.csv":
        write_rows(tmp_path / "a.csv", plain_rows())
        with pytest.raises(InputError, match=said):
            read_recording(tmp_path / "a.csv", joints=tmp_path / name)
    write_model(preset("lemon2024"), tmp_path / "b.toml")  # no sidecar: a model of the same name
    open_any(str(tmp_path / name))
    (tmp_path / "b.toml").write_text("start = 1.0")
    (tmp_path / "b.mp4").touch()
    open_any(str(tmp_path / name))


@pytest.mark.parametrize("inside", ["bag_of_ros", "dataset"])
def test_a_sidecar_next_to_a_folder_is_refused_where_that_in_the_folder_is_read(tmp_path, inside):
    folder = tmp_path / "set"
    if inside == "dataset":
        pytest.importorskip("pyarrow")
        write_lerobot(folder)
    else:
        pytest.importorskip("rosbags")
        robot_log_files.write_states(folder)
    (tmp_path / "set.toml").write_text("start = 1.0\nstrat = 1.0")
    with pytest.raises(InputError, match=r"set\.toml: got 'a sidecar'; .*; move it into the folder, as whiptool\.toml"):
        open_any(str(folder))
    (tmp_path / "set.toml").rename(folder / "whiptool.toml")
    with pytest.raises(InputError, match=r"whiptool\.toml: strat: got 1\.0; allowed: one of the keys"):
        open_any(str(folder))


@pytest.mark.parametrize("name", ["a.toml", "a.joints.csv"])
def test_fuzz_sidecars(tmp_path, name):
    write_csv(full(), tmp_path / "a.csv")
    fuzz(tmp_path / name, 100, lambda: read_recording(tmp_path / "a.csv"))
