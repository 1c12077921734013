"""One process at a time writes to a run's folder."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from search_words import SEARCH

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.references import CITATIONS
from whiptool.run_lock import LOCK
from whiptool.runs import CONFIG, RESULT, RunFolder


def test_a_folder_is_one_process_at_a_time(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path / "run", {"command": "mine"}) as folder:
        for again in (lambda: RunFolder.open(folder.path), lambda: RunFolder.create(folder.path, {})):
            with pytest.raises(InputError, match=rf"no other command works in; process {os.getpid()} on .* since 2"):
                again()
        folder.write_result({"whole": True})
    assert {path.name for path in folder.path.iterdir()} == {CITATIONS, CONFIG, RESULT}
    with RunFolder.open(folder.path):
        pass


def test_the_lock_of_a_killed_process_is_stale(tmp_path: Path) -> None:
    program = (
        "import sys, time; from pathlib import Path; from whiptool.runs import RunFolder\n"
        "folder = RunFolder.create(Path(sys.argv[1]), {}); print('holds', flush=True); time.sleep(3600)"
    )
    words = [sys.executable, "-c", program, str(tmp_path / "run")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "holds\n"
            with pytest.raises(InputError, match=f"process {process.pid} "):
                RunFolder.open(tmp_path / "run")
        finally:
            process.kill()
    assert (tmp_path / "run" / LOCK).exists()
    (tmp_path / "run" / ".tmp-result.json").write_text("{")
    with RunFolder.open(tmp_path / "run") as folder:
        assert str(os.getpid()) in (folder.path / LOCK).read_text()
    assert [path.name for path in folder.path.iterdir()] == [CONFIG]


def test_what_a_process_left_that_was_killed_at_once_is_taken_for_new(tmp_path: Path) -> None:
    for name in (LOCK, ".tmp-config.toml"):
        (tmp_path / name).write_text("")
    RunFolder.create(tmp_path, {"command": "mine"}).close()
    assert [path.name for path in tmp_path.iterdir()] == [CONFIG]


def test_what_is_anybodys_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(InputError, match="new or empty"):
        RunFolder.create(tmp_path, {})
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


COMMANDS = {
    "optimize": SEARCH,
    "simulate": ["--strike", "-1.2", "0.9", "1.2", "0.3", "0.7", "--no-video"],
    "identify": ["strike.npz"],
    "adapt": ["--target", "1.2", "0.1", "--camera", "tip", "--whip", "uniform"],
    "train": ["--episodes", "2", "--random-episodes", "1", "--trials", "2"],
    "compare": ["--quick", "--methods", "random"],
    "reproduce": ["fig5", "--quick"],
    "rig strike": ["--strike", "-0.622", "0.221", "0.705", "2.122", "1.176", "--camera", "points"],
    "rig learn": ["--camera", "points"],
}


@pytest.mark.parametrize("command", [pytest.param(x, marks=[pytest.mark.slow] * (x == "adapt")) for x in COMMANDS])
def test_no_command_writes_where_another_does(command: str, tmp_path: Path, capsys, monkeypatch) -> None:
    if command == "train":
        pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    points = np.stack([np.linspace(0, 1, 30), np.full(30, -1.0)], axis=1)[:, None]
    strike = Strike((-1.2, 0.9), (1.2, 0.3), 0.7)
    StrikeRecording(
        t=np.linspace(0, 1, 30), points=points, markers=("tip",), sigma=np.full((1, 1), 0.01), strike=strike
    ).save("strike.npz")
    module, *word = command.split()
    with RunFolder.create(Path("run"), {"command": "mine"}) as folder:
        assert import_module(f"whiptool.commands.{module}").main([*word, *COMMANDS[command], "--out", "run"]) == 2
        said = capsys.readouterr().err.splitlines()[-1]
        assert said.startswith("whiptool: --out: got 'run'")
        assert f"process {os.getpid()} on " in said
        assert {path.name for path in folder.path.iterdir()} == {CONFIG, LOCK}
