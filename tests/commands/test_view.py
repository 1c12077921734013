"""`python -m whiptool.view`: files, reports, and the viewer."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest
from processes import HANG

from whiptool.commands import simulate, view
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout

LEMON, TARGET, RADIUS = preset("lemon2024"), np.array([1.3, 0.0]), 0.06
STRIKE = [-1.361356816555577, 0.471238898038469, 1.7278759594743862, 1.413716694115407, 0.95]  # hits


@pytest.fixture(scope="module")
def trajectory():
    return CompiledRollout(LEMON, Controller()).trajectory(Strike.from_vector(STRIKE), t_stay=0.3)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of simulate, without a video."""
    folder = tmp_path_factory.mktemp("view") / "run"
    assert simulate.main(["--strike", *map(str, STRIKE), "--no-video", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(autouse=True)
def _no_display(monkeypatch):
    """Tests open no windows; those about windows say so."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")


# --- the command line


def test_simulate_writes_the_page(run):
    assert "Hits the target" in (run / "strike.html").read_text()


def test_what_is_asked_of_the_tips_arrival_is_looked_at_again(tmp_path, capsys):
    """The strike passes the point, and not as it is asked to: written anew, the page still says so."""
    folder = tmp_path / "run"
    asked = ["--direction", "-1", "0", "--cone", "5", "--least-speed", "3"]
    assert simulate.main(["--strike", *map(str, STRIKE), *asked, "--no-video", "--out", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "missed the direction by" in said
    assert "the point by" not in said
    page = (folder / "strike.html").read_text()
    assert "Misses the direction by" in page
    assert view.main([str(folder), "--page"]) == 0
    assert (folder / "strike.html").read_text() == page


@pytest.mark.slow
@pytest.mark.figures
def test_a_strike_in_space_is_written_and_looked_at(tmp_path, capsys):
    folder, strike = tmp_path / "run", ["-1.36", "0", "-1.05", "1.41", "1.73", "0", "-0.35", "1.41", "0.95"]
    model = ["--model", "nah2023", "--controller", "constant", "--target", "1.995", "0", "0"]
    assert simulate.main([*model, "--strike", *strike, "--t-stay", "0.1", "--no-video", "--out", str(folder)]) == 0
    page = (folder / "strike.html").read_text()
    assert "target at (1.995, 0.000, 0.000) m" in page
    assert {f"{x}.png" for x in ("strike", "distance", "tracking", "torque", "gains")} <= {
        file.name for file in folder.iterdir()
    }
    capsys.readouterr()
    assert view.main([str(folder)]) == 0
    assert f"video          {folder / 'strike.mp4'}" in capsys.readouterr().out
    assert (folder / "strike.mp4").read_bytes()[4:8] == b"ftyp"
    assert view.main([str(folder), "--page"]) == 0
    assert (folder / "strike.html").read_text() == page

    with np.load(folder / "trajectory.npz") as data:
        arrays = dict(data)
    short = {"q": arrays["q"][:, :-1], "v": arrays["v"][:, :-1], "names": arrays["names"][:-1]}
    np.savez(folder / "trajectory.npz", **{**arrays, **short})
    capsys.readouterr()
    assert view.main([str(folder)]) == 2
    assert "53 coordinates" in capsys.readouterr().err


@pytest.mark.figures
def test_without_a_display_files_are_written_and_named(run, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    (folder / "strike.html").unlink()
    assert not (folder / "strike.mp4").exists()
    assert view.main([str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"page           {folder / 'strike.html'}" in said
    assert f"video          {folder / 'strike.mp4'}" in said
    assert (folder / "strike.mp4").read_bytes()[4:8] == b"ftyp"
    assert (folder / "strike.html").read_text() == (run / "strike.html").read_text()
    assert {p.name for p in folder.iterdir()} == {p.name for p in run.iterdir()} | {"strike.mp4"}

    # What is there is shown, not made again
    for name in ("strike.mp4", "strike.html"):
        (folder / name).write_text("kept")
    assert view.main([str(folder), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    paths = {"page": str(folder / "strike.html"), "video": str(folder / "strike.mp4")}
    assert shown == {"run": str(folder), "shown": None, "report": None, **paths}
    assert (folder / "strike.mp4").read_text() == (folder / "strike.html").read_text() == "kept"

    # --page writes it anew, and opens it where that can be
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    monkeypatch.setenv("DISPLAY", ":0")
    assert view.main([str(folder), "--page", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["shown"] == "browser"
    assert opened == [(folder / "strike.html").resolve().as_uri()]
    assert (folder / "strike.html").read_text() == (run / "strike.html").read_text()


def test_a_display_that_refuses_is_none(run, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    (folder / "strike.mp4").write_text("kept")
    monkeypatch.setenv("DISPLAY", ":9999")
    assert view.main([str(folder)]) == 0
    assert "no window opens here" in capsys.readouterr().out


def test_a_report_is_shown(tmp_path, capsys):
    (tmp_path / "config.toml").write_text('command = "identify"\n')
    (tmp_path / "report.html").write_text("<p>")
    assert view.main([str(tmp_path)]) == 0
    assert f"report         {tmp_path / 'report.html'}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, "it has no config.toml"),
        ({"config.toml": 'command = "train"\n', "result.json": "{}"}, "this one is of `whiptool train`"),
        ({"config.toml": 'command = "optimize"\n', "trajectory.npz": "x"}, "config.toml: whip"),
        ({"trajectory.npz": "x"}, "a readable TOML file"),
        ({"config.toml": 'command = "rig learn"\n'}, "whiptool rig learn --resume"),
        ({"config.toml": 'command = "adapt"\n', "strike-01.npz": "x"}, "whiptool adapt --resume"),
    ],
)
def test_a_folder_with_nothing_to_see_is_refused_in_one_line(tmp_path, capsys, files, words):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert view.main([str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert words in said.err


def test_no_folder_and_damaged_files(run, tmp_path, capsys):
    assert view.main([str(tmp_path / "nowhere")]) == 2
    assert "it does not exist" in capsys.readouterr().err
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    whole = (folder / "trajectory.npz").read_bytes()
    for damaged in (b"", whole[: len(whole) // 2]):
        (folder / "trajectory.npz").write_bytes(damaged)
        assert view.main([str(folder)]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    (folder / "trajectory.npz").write_bytes(whole)
    text = (folder / "config.toml").read_text()
    (folder / "config.toml").write_text(text.replace("N = 12", "N = 11"))
    assert view.main([str(folder)]) == 2
    assert "14 coordinates" in capsys.readouterr().err


def test_the_command_is_registered():
    done = subprocess.run(
        [sys.executable, "-m", "whiptool.view", "--help"], capture_output=True, text=True, timeout=HANG, check=False
    )
    assert done.returncode == 0
    assert "Example: python -m whiptool.view" in " ".join(done.stdout.split())
    from whiptool.commands.cli import COMMANDS

    assert "view" in COMMANDS


class Viewer:
    """Stands for MuJoCo's viewer: a window that is closed after some frames."""

    def __init__(self, model, data, *, key_callback, frames=100, press=(), **_) -> None:
        import mujoco

        self.model, self.data, self.key, self.left, self.press = model, data, key_callback, frames, list(press)
        self.cam, self.user_scn = mujoco.MjvCamera(), mujoco.MjvScene(model, maxgeom=2000)
        self.seen: list[tuple[float, np.ndarray, int]] = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def lock(self):
        return threading.Lock()

    def is_running(self):
        return self.left > 0

    def sync(self):
        self.left -= 1
        self.seen.append((self.data.time, self.data.qpos.copy(), self.user_scn.ngeom))
        if len(self.seen) in self.press:
            self.key(32)


def watch(run, monkeypatch, **options) -> Viewer:
    """Play a run in a viewer that is not there, at a clock of 60 frames a second."""
    viewers, clock = [], [0.0]

    def launch(model, data, **given):
        viewers.append(Viewer(model, data, **given, **options))
        return viewers[-1]

    def sleep(span):
        clock[0] += 1 / 60 + 1e-6

    monkeypatch.setattr("mujoco.viewer.launch_passive", launch)
    monkeypatch.setattr(view, "window_opens", lambda: True)
    monkeypatch.setattr(view.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(view.time, "sleep", sleep)
    monkeypatch.setenv("DISPLAY", ":0")
    assert view.main([str(run)]) == 0
    return viewers[0]


def test_the_viewer_plays_the_recorded_strike_in_a_loop(run, trajectory, monkeypatch, capsys):
    seen = watch(run, monkeypatch, frames=160).seen
    assert "shown in MuJoCo's viewer" in capsys.readouterr().out
    times = np.array([t for t, *_ in seen])
    np.testing.assert_allclose(times[:70], np.arange(70) / 60, atol=1e-9)  # real speed
    assert (np.diff(times) < 0).sum() == 2  # 160 frames are 2.7 s, the strike lasts 1.25 s
    for t, qpos, _ in seen[:70:7]:
        np.testing.assert_allclose(qpos, [np.interp(t, trajectory.t, x) for x in trajectory.q.T], atol=1e-9)
    bars = [n for *_, n in seen[:70]]
    assert bars[0] == 0
    assert (np.diff(bars) >= 0).all()
    assert bars[-1] > 50


def test_space_pauses_the_viewer(run, monkeypatch):
    times = [t for t, *_ in watch(run, monkeypatch, frames=60, press=(20, 40)).seen]
    assert len(set(times[19:40])) == 1
    assert times[18] < times[19]
    assert times[39] < times[45]


def test_a_strike_and_a_recording_are_written_as_mcap(run, tmp_path, capsys):
    reader = pytest.importorskip("mcap.reader", reason="MCAP files need pip install 'whiptool[io]'")
    recorded = tmp_path / "recorded.csv"
    recorded.write_text("t,tip_x,tip_y\n0,0.1,0.2\n0.1,0.2,0.3\n0.2,0.3,0.4\n")
    for of, topics in ((run, {"/joint_states", "/whip", "/tip"}), (recorded, {"/tip"})):
        path = tmp_path / "strike.mcap"
        assert view.main([str(of), "--mcap", str(path), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["mcap"] == str(path)
        with path.open("rb") as file:
            assert {channel.topic for _, channel, _ in reader.make_reader(file).iter_messages()} == topics
    assert view.main([str(run), "--mcap", str(tmp_path / "absent" / "a.mcap")]) == 2
    assert "whiptool: --mcap: got" in capsys.readouterr().err
