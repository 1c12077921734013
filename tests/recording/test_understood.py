"""What `recording show` doubts before a fit: units, origin, axes and commands that contradict the file."""

from __future__ import annotations

import math

import numpy as np
import pytest
from lab_files import FORMATS, swing

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.recording.readers import find_format
from whiptool.recording.understood import understand

T = np.arange(0, 2.0, 1 / 120)


def findings(path, **said):
    return {finding.topic: finding for finding in reversed(understand(str(path), **said).findings)}


@pytest.mark.parametrize("name", ["Motive", "Nexus", "TRC"])
def test_a_unit_that_contradicts_the_file_is_doubted(name, tmp_path):
    file, write, _ = FORMATS[name]
    options = write(tmp_path / file, swing())
    wrong, right = (understand(str(tmp_path / file), **{**options, "units": unit}) for unit in ("cm", "mm"))
    (doubted,) = (x for x in wrong.findings if x.topic == "units" and x.reason.startswith("taken as"))
    assert doubted.certainty == "doubtful"
    assert doubted.reason == "taken as cm, as the sidecar says, but the file states mm"
    assert f"units: {doubted.reason}" in wrong.found.remarks  # which a fit prints
    assert not any("the file states mm" in x.reason for x in right.findings)


def test_an_origin_is_shown_and_doubted_where_it_seems_to_be_in_metres(tmp_path):
    file, write, _ = FORMATS["Motive"]
    options = write(tmp_path / file, swing())
    right = findings(tmp_path / file, **options, origin=[200, 1400, -100])["origin"]
    assert (right.certainty, right.numbers["origin"]) == ("stated", pytest.approx([0.2, 1.4, -0.1]))
    assert "0.2, 1.4, -0.1 m" in right.value
    wrong = findings(tmp_path / file, **options, origin=[0.2, 1.4, -0.1])["origin"]
    assert wrong.certainty == "doubtful"
    assert wrong.fix.endswith("say origin = [200, 1400, -100]")


def test_a_strike_in_degrees_is_doubted_as_a_fit_refuses_it(tmp_path):
    file, write, _ = FORMATS["Motive"]
    options = write(tmp_path / file, swing())
    degrees = Strike(q_i=(-78, 27), q_f=(99, 81), D=0.95)
    radians = Strike(q_i=tuple(np.radians(degrees.q_i)), q_f=tuple(np.radians(degrees.q_f)), D=0.95)
    found = [findings(tmp_path / file, **options, strike=strike)["strike"] for strike in (degrees, radians)]
    assert [one.certainty for one in found] == ["doubtful", "stated"]
    assert "are these degrees?" in found[0].fix


@pytest.mark.parametrize(("up", "axes", "right"), [
    ("z", ["x", "y"], ["x", "z"]), ("x", ["y", "z"], ["y", "x"]), ("-y", ["z", "x"], ["z", "-y"]),
])  # fmt: skip
def test_axes_without_the_vertical_are_doubted_with_the_right_ones(up, axes, right, tmp_path):
    """A whip of 0.8 m hangs for 0.4 s, then its hand and tip move forward."""
    vertical, forward = (np.eye(3)["xyz".index(name[-1])] * (-1) ** name.startswith("-") for name in (up, axes[0]))
    s = np.clip(T - 0.4, 0, None)[:, None]
    hand = 0.5 * np.sin(3 * s) * forward
    tip = hand - 0.8 * vertical * np.cos(s) + 0.8 * np.sin(s) * forward
    noise = 1e-3 * np.random.default_rng(0).normal(size=(len(T), 6))
    header = "t,handle_x,handle_y,handle_z,tip_x,tip_y,tip_z"
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, np.hstack([hand, tip]) + noise]), header=header, comments="",
               delimiter=",")  # fmt: skip
    wrong = findings(tmp_path / "a.csv", axes=axes)
    assert wrong["axes"].certainty == "doubtful"
    assert wrong["axes"].fix == 'say axes = ["{}", "{}"] in the sidecar'.format(*right)
    assert wrong["labels"].fix in ("", "correct the axes first")
    (aside,) = set("xyz") - {axis[-1] for axis in right}
    across = findings(tmp_path / "a.csv", axes=[aside, right[1]])["axes"]
    assert across.certainty == "doubtful"
    assert across.reason == f"the markers move farther along {right[0]}, which is left out, than along {aside}"
    assert across.fix == wrong["axes"].fix
    seen = np.column_stack([T, tip + noise[:, 3:]])
    np.savetxt(tmp_path / "tip.csv", seen, header="t,tip_x,tip_y,tip_z", comments="", delimiter=",")
    alone = findings(tmp_path / "tip.csv", axes=[aside, right[1]])["axes"]
    assert alone.fix == "state as axes the one along which the whip moves, then the one that points up"
    good = findings(tmp_path / "a.csv", axes=right)
    assert good["axes"].certainty == "stated"
    assert good["up"].numbers["angle"] < math.radians(1)


def test_what_is_no_recording_is_refused_with_what_was_meant(tmp_path):
    (tmp_path / "run" / "recordings").mkdir(parents=True)
    (tmp_path / "run" / "config.toml").touch()
    (tmp_path / "a.csv").touch()
    (tmp_path / "a.toml").write_text('units = "mm"')
    (tmp_path / "a.pid").write_text("1234")
    for name, said in (
        ("a.toml", "it is a sidecar, which is read with a.csv: leave it out"),
        ("run", f"did you mean {tmp_path / 'run' / 'recordings' / '*.npz'}?"),
        ("a.pid", "LeRobot"),
    ):
        with pytest.raises(InputError) as caught:
            find_format(tmp_path / name)
        assert str(caught.value).endswith(said)
        assert len(str(caught.value)) < 300 + len(str(tmp_path / name)) * 2
