"""Sidecars of recordings, and every kind of damage."""

import pytest
import tomli_w
from recordings import TABLE, full, fuzz, plain_rows, write_rows

from whiptool.errors import InputError
from whiptool.recording.readers import (
    read_recording,
    write_csv,
)


@pytest.mark.parametrize(
    ("side", "said"),
    [
        ({"colour": 1}, "colour.*one of the keys"),
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


@pytest.mark.parametrize("name", ["a.toml", "a.joints.csv"])
def test_fuzz_sidecars(tmp_path, name):
    write_csv(full(), tmp_path / "a.csv")
    fuzz(tmp_path / name, 100, lambda: read_recording(tmp_path / "a.csv"))
