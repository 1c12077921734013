"""`python -m whiptool.recording`: what is understood of files is printed and drawn, and converted without a change."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from command_line import assert_one_line, called
from recordings import T, full, images, places, plain_rows, same, times, write_rows, write_video

from whiptool.recording import picture
from whiptool.recording.readers import open_any, read_recording
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.recording.understood import understand


def shown(*files, cwd) -> list[dict[str, dict]]:
    """The findings of each file by topic; of several of one topic the first."""
    done = called("recording", "show", *files, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (cwd / found["picture"]).read_bytes().startswith(b"\x89PNG")
    return [{f["topic"]: f for f in reversed(one["findings"])} for one in found["files"]]


def test_a_table_without_a_word_on_its_frame_is_shown_with_what_was_assumed(tmp_path):
    write_rows(tmp_path / "a.csv", plain_rows())
    (found,) = shown("a.csv", cwd=tmp_path)
    assert found["clock"]["numbers"] == {"frames": T, "start": 0.0, "end": pytest.approx(times()[-1])}
    assert found["rate"]["numbers"]["rate"] == pytest.approx(60)
    assert found["markers"]["numbers"]["seen"] == {"tip": T, "handle": T - 3}
    assert found["gaps"]["numbers"]["longest"] == {"handle": pytest.approx(4 / 60)}
    assert [found[x]["certainty"] for x in ("clock", "rate", "units", "axes", "strike")] == [
        "stated", "measured", "assumed", "assumed", "assumed"
    ]  # fmt: skip
    assert 'units = "mm"' in found["units"]["fix"]
    text = called("recording", "show", "a.csv", cwd=tmp_path).stdout
    assert "handle (27 of 30 frames)" in text
    assert max(map(len, text.splitlines())) <= 100


def test_what_the_sidecar_states_is_said_to_be_stated(tmp_path):
    write_rows(tmp_path / "a.csv", plain_rows())
    (tmp_path / "a.toml").write_text('units = "cm"\naxes = ["x", "y"]\nstart = 0.1\nsigma = 0.002\n')
    (found,) = shown("a.csv", cwd=tmp_path)
    assert found["units"]["certainty"] == found["axes"]["certainty"] == "stated"
    assert found["extent"]["numbers"]["high"] == pytest.approx(np.nanmax(places(), axis=(0, 1)) / 100)
    assert "key start" not in found["clock"]["reason"]
    assert found["clock"]["numbers"]["start"] == pytest.approx(-0.1)


def test_uneven_frames_and_exchanged_labels_are_seen(tmp_path):
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.005, 0.03, 60))
    path = np.stack([np.stack([3 * t, np.sin(3 * t)], 1), np.stack([3 * t, 2 + np.cos(3 * t)], 1)], 1)
    path[30:] = path[30:, ::-1]
    StrikeRecording(t, path, ("tip", "handle")).save(tmp_path / "a.npz")
    (found,) = shown("a.npz", cwd=tmp_path)
    assert found["rate"]["numbers"]["even"] is False
    assert found["labels"]["certainty"] == "doubtful"
    assert "handle became tip" in found["labels"]["value"]


def test_a_log_alone_and_a_film_are_shown_too(tmp_path):
    pytest.importorskip("cv2")
    write_rows(
        tmp_path / "robot.csv", [["timestamp", "actual_q_0", "actual_q_1"], *([k / 500, k, 2] for k in range(9))]
    )
    write_video(tmp_path / "a.avi", images())
    (tmp_path / "a.toml").write_text("fps = 60\n")
    log, film = shown("robot.csv", "a.avi", cwd=tmp_path)
    assert log["joints"]["certainty"] == "assumed"  # in the arm's order
    assert log["joint rate"]["numbers"]["rate"] == pytest.approx(500)
    assert film["images"]["numbers"] == {"width": 64, "height": 48}
    assert film["units"]["certainty"] == "doubtful"


@pytest.mark.parametrize(
    ("changes", "titles"),
    [
        ({}, ["paths (o: first)", "coordinates"]),
        (
            {"points": places(d=3), "up": "y"},
            ["paths from the side (o: first)", "paths from above (o: first)", "coordinates"],
        ),
        ({"hand_t": times(), "hand_pose": np.tile([0, 0, 0, 0, 0, 0, 1.0], (T, 1))}, [*"ab", "measured hand"]),
    ],
)
def test_a_picture_has_a_panel_for_what_there_is_and_none_that_is_empty(tmp_path, monkeypatch, changes, titles):
    without = {"joints_t": None, "joints_q": None, "joint_names": (), "target": None}
    dataclasses.replace(full(), **(without | changes)).save(tmp_path / "a.npz")
    drawn = []
    monkeypatch.setattr(picture, "save_figure", lambda figure, path: drawn.extend(figure.axes))
    picture.draw([understand(str(tmp_path / "a.npz"))], tmp_path / "a.png")
    assert len(drawn) == len(titles)
    assert drawn[-1].get_title(loc="left") == titles[-1]
    assert all(ax.lines for ax in drawn)
    if "up" in changes:
        assert [ax.get_ylabel() for ax in drawn[:2]] == ["y [m]", "z [m]"]
        assert drawn[1].yaxis_inverted()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"points": places(d=3), "up": "y", "target": None},
        {"joint_names": ("shoulder [deg]", "elbow.pos")},
        {"joint_names": ("b", "a"), "joints_listed": True},
        {"joint_names": ("q2", "q1")},
        {"hand_t": times(), "hand_pose": np.tile([0.1, 0.2, 0.3, 0, 0, 0, 1], (T, 1))},
        {"points": places(d=3), "up": "y", "hand_t": times(), "hand_pose": np.tile([1, 2, 3, 0, 0.6, 0, 0.8], (T, 1))},
    ],
)
def test_what_is_converted_reads_back_the_same(tmp_path, changes):
    recording = dataclasses.replace(full(), **changes)
    recording.save(tmp_path / "a.npz")
    done = called("recording", "convert", "a.npz", "b.csv", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "b.csv" in json.loads(done.stdout)["written"]
    same(recording, read_recording(tmp_path / "b.csv"), but=("source", "sha256"))


def test_no_file_is_overwritten_nor_given_the_sidecar_of_another(tmp_path):
    full().save(tmp_path / "a.npz")
    (tmp_path / "a.toml").write_text('units = "mm"')
    assert_one_line(called("recording", "convert", "a.npz", "a.csv", cwd=tmp_path), "such as a_converted.csv")
    assert_one_line(called("recording", "convert", "a.npz", "b.csv", cwd=tmp_path), "a.toml: got 'a sidecar'")
    assert (tmp_path / "a.toml").read_text() == 'units = "mm"'
    (tmp_path / "a.toml").unlink()
    assert called("recording", "convert", "a.npz", "b.csv", cwd=tmp_path).returncode == 0
    assert_one_line(called("recording", "convert", "a.npz", "b.csv", cwd=tmp_path), "b.csv, b.toml")


def test_a_log_reads_back_the_same(tmp_path):
    rows = "".join(f"{k / 100},{k / 10},{k / 20}\n" for k in range(40))
    (tmp_path / "log.csv").write_text(f"t,position_one [deg],position_two [deg]\n{rows}")
    done = called("recording", "convert", "log.csv", "new.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    log = open_any(str(tmp_path / "new.csv")).joints
    assert log.names == ("one", "two")
    np.testing.assert_allclose(log.q, np.deg2rad([[k / 10, k / 20] for k in range(40)]), atol=1e-15)


def test_angles_of_links_are_converted_too(tmp_path):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "a.npz", angle=rng.normal(size=(T, 2)), velocity=rng.normal(size=(T, 2)), dt=0.01)
    assert called("recording", "convert", "a.npz", "b.csv", cwd=tmp_path).returncode == 0
    same(read_recording(tmp_path / "a.npz"), read_recording(tmp_path / "b.csv"), but=("source", "sha256"))


def test_what_does_not_fit_into_csv_is_refused_and_leaves_nothing(tmp_path):
    recording = dataclasses.replace(full(), joint_names=("shoulder [deg]", "elbow"), joints_listed=True)
    recording.save(tmp_path / "a.npz")
    done = called("recording", "convert", "a.npz", "b.csv", cwd=tmp_path)
    assert_one_line(done, "joint")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_picture_that_is_drawn_over_an_older_one_is_said(tmp_path):
    write_rows(tmp_path / "a.csv", plain_rows())
    first, again = (called("recording", "show", "a.csv", cwd=tmp_path).stdout for _ in range(2))
    assert first.endswith("drawn in recording.png\n")
    assert again.endswith("drawn in recording.png, over an older picture\n")


def test_images_have_nothing_to_convert(tmp_path):
    pytest.importorskip("cv2")
    write_video(tmp_path / "a.avi", images())
    (tmp_path / "a.toml").write_text("fps = 60\n")
    assert_one_line(called("recording", "convert", "a.avi", "b.csv", cwd=tmp_path), "identify tracks the tip")
