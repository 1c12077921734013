"""What `recording show` doubts before a fit: units, origin, axes and commands that contradict the file."""

from __future__ import annotations

import math

import numpy as np
import pytest
from lab_files import FORMATS, swing

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.recording.readers import find_format, read_recording
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


def bare_c3d(path, units="") -> np.ndarray:
    """A whip that hangs and then swings, in a file that states neither units nor axes; its places [m]."""
    import ezc3d

    begun = np.maximum(T - 0.5, 0)
    handle = np.stack([0.3 * np.sin(6 * begun), 0 * T, 1.5 + 0 * T], axis=1)
    tip = handle + 0.5 * np.stack([np.sin(5 * begun), 0 * T, -np.cos(5 * begun)], axis=1)
    c3d = ezc3d.c3d()
    group = c3d["parameters"]["POINT"]
    group["RATE"]["value"], group["UNITS"]["value"], group["LABELS"]["value"] = [120.0], [units], ["handle", "tip"]
    places = np.stack([handle, tip], axis=1)
    c3d["data"]["points"] = np.concatenate([1e3 * places.transpose(2, 1, 0), np.ones((1, 2, len(T)))])
    c3d.write(str(path))
    return places


def test_a_file_that_states_neither_units_nor_axes_is_shown_and_asked_for_them(tmp_path):
    """But fitted it is not; and gravity says from what is shown which axis is up."""
    pytest.importorskip("ezc3d")
    places = bare_c3d(tmp_path / "a.c3d")
    shown = understand(str(tmp_path / "a.c3d"))
    np.testing.assert_allclose(shown.found.points, places, atol=1e-6)
    found = {finding.topic: finding for finding in shown.findings}
    assert (found["units"].certainty, found["axes"].certainty) == ("doubtful", "doubtful")
    assert found["units"].fix == "state units in the sidecar: one of m, cm, mm, in"
    assert found["units"].reason.startswith("nothing states it")
    bare_c3d(tmp_path / "b.c3d", units="furlong")
    odd = {finding.topic: finding for finding in understand(str(tmp_path / "b.c3d")).findings}
    assert odd["units"].reason.endswith("b.c3d: POINT:UNITS says 'furlong', and no fit is made without")
    assert found["axes"].fix.startswith("state axes in the sidecar: which of its axes point forward, up and out")
    assert found["up"].value.startswith("z is up")
    with pytest.raises(InputError, match="POINT:UNITS"):
        read_recording(tmp_path / "a.c3d")
    with pytest.raises(InputError, match="units"):  # what is stated wrongly is not guessed
        understand(str(tmp_path / "a.c3d"), units="furlongs")


@pytest.mark.parametrize(("rate", "said"), [(60, "doubtful"), (15, "measured")])
def test_a_rate_that_no_camera_has_is_doubted_or_refused(rate, said, tmp_path):
    """Of seconds in a column that says milliseconds."""
    rows = "".join(f"{i / rate!r},{0.5 * math.sin(i / 30)},{-0.5 * math.cos(i / 30)}\n" for i in range(100))
    (tmp_path / "a.csv").write_text("t [ms],tip_x,tip_y\n" + rows)
    found = findings(tmp_path / "a.csv")["rate"]
    assert (found.certainty, found.numbers["rate"]) == (said, pytest.approx(1e3 * rate))
    remarks = understand(str(tmp_path / "a.csv")).found.remarks
    assert any("60,000 a second, which is doubtful" in x for x in remarks) == (rate == 60)
    rows = "".join(f"{i / 120!r},0.1,{-0.5 * math.cos(i / 30)}\n" for i in range(100))
    (tmp_path / "b.csv").write_text("t [ms],tip_x,tip_y\n" + rows)
    with pytest.raises(InputError, match=r"t: got 'steps of 8.33.*are these seconds, in a column whose name says a sm"):
        understand(str(tmp_path / "b.csv"))


def test_a_file_in_pixels_that_states_neither_clock_nor_scale_is_shown_and_asked_for_them(tmp_path):
    file, write, _ = FORMATS["DeepLabCut CSV"]
    write(tmp_path / file, swing())
    found = findings(tmp_path / file)
    assert found["rate"].value == "unknown, shown as if 60 frames a second"
    assert found["rate"].fix == "state fps in the sidecar: fps or timestamps"
    assert found["units"].value == "unknown, shown as if a millimetre a pixel"
    assert found["units"].fix.startswith("state homography in the sidecar: homography, known_points, or scale and orig")
    assert {found[topic].certainty for topic in ("rate", "units")} == {"doubtful"}
    with pytest.raises(InputError):
        read_recording(tmp_path / file)
