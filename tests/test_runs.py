"""Run folders and what to cite in them."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk
from search_words import SEARCH

import whiptool as wt
from whiptool.commands import cli, optimize, run_folders
from whiptool.commands.options.option_group import OutputOptions, ResumableOptions
from whiptool.errors import InputError, WhiptoolError
from whiptool.impedance.laws import LAWS
from whiptool.models.presets import PRESETS
from whiptool.models.strike import Strike
from whiptool.objective import Trial
from whiptool.optimizers.trial_log import TRIALS, TrialLog
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.runs import ALWAYS, CITATIONS, CONFIG, LOCK, RESULT, WORKS, RunFolder, _entries, citations, used_by


def keys(bibtex: str) -> list[str]:
    return re.findall(r"^@\w+\{(\w+),$", bibtex, re.MULTILINE)


def test_everything_that_can_be_used_is_known():
    assert set(PRESETS) | set(LAWS) | set(wt.METHODS) <= set(WORKS)


def test_entries_are_whole_and_all_used():
    entries = _entries()
    assert list(entries) == keys("\n".join(entries.values()))
    assert {key for works in WORKS.values() for key in works} | set(ALWAYS) == set(entries)
    for key, entry in entries.items():
        assert entry.count("{") == entry.count("}"), key
        assert set(re.findall(r"^  (\w+) = ", entry, re.MULTILINE)) >= {"author", "title", "year"}, key


def test_each_name_brings_its_works_once():
    found = keys(citations("CMA-ES", "ga", "oiac", "nlopt:GN_CRS2_LM"))
    assert found == [*ALWAYS, "hansen2001", "nomura2024", "blank2020", "xiong2021", "johnson2007"]
    assert keys(wt.citations()) == list(ALWAYS)
    with pytest.raises(InputError, match=r"'UR7'.*panda"):
        citations("UR7")


def test_a_run_says_what_it_used(tmp_path):
    config = {"command": "human", "model": {"name": "nah2023"}, "controller": {"law": "constant"}}
    config["options"] = {"methods": ["sac", "random"], "arm": "mine.urdf"}
    assert list(used_by(config, {"method": "directl"})) == ["human", "nah2023", "constant", "directl", "sac", "random"]
    with RunFolder.create(tmp_path / "run", config) as folder:
        folder.write_result({"hit": True})
    said = keys((folder.path / CITATIONS).read_text(encoding="utf-8"))
    assert said == [*ALWAYS, "krotov2022", "nah2023", "hogan1985", "haarnoja2018"]
    assert json.loads((folder.path / "result.json").read_text(encoding="utf-8")) == {"hit": True}


@pytest.fixture(scope="module")
def plain():
    """Searches without figures and MuJoCo, for speed."""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("whiptool.commands.pictures.draw_here", lambda *_, **__: [])
        patch.setattr(optimize.SearchRun, "_replay", lambda *_: ({"difference": None}, "not computed here"))
        patch.setattr("whiptool.viz.plots_search.save_convergence", lambda *_, **__: None)
        yield


@pytest.fixture(scope="module")
def alone(plain, tmp_path_factory) -> Path:
    """A search that nothing disturbs."""
    run = tmp_path_factory.mktemp("alone") / "run"
    assert optimize.main([*SEARCH, "--out", str(run)]) == 0
    return run


def outcome_of(run: Path) -> tuple:
    result = json.loads((run / RESULT).read_text())
    del result["wall_time"]
    return result, (run / TRIALS).read_text()


@pytest.mark.parametrize(("error", "stays"), [(WhiptoolError, False), (KeyboardInterrupt, True), (OSError, True)])
def test_a_refused_run_leaves_no_folder(tmp_path: Path, error: type[BaseException], stays: bool) -> None:
    with pytest.raises(error), RunFolder.create(tmp_path / "run", {}):
        raise error
    assert (tmp_path / "run").exists() == stays


def test_a_refused_run_that_had_begun_stays(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", {})
    folder.write_result({})
    with pytest.raises(WhiptoolError), folder:
        raise WhiptoolError
    assert sorted(path.name for path in folder.path.iterdir()) == [CITATIONS, CONFIG, RESULT]


def test_two_that_resume_one_run_strike_no_trial_twice(alone: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    """The second comes while the first is at its tenth trial."""
    run, append = tmp_path / "run", TrialLog.append

    def with_company(self: TrialLog, trial: Trial) -> None:
        if trial.number == 10:
            monkeypatch.setattr(TrialLog, "append", append)
            capsys.readouterr()
            assert optimize.main(["--resume", str(run)]) == 2
            said = capsys.readouterr().err
            assert said.strip().splitlines()[-1].startswith(f"whiptool: --resume: got '{run}'")
            assert f"process {os.getpid()} on " in said
        append(self, trial)

    monkeypatch.setattr(TrialLog, "append", with_company)
    assert optimize.main([*SEARCH, "--out", str(run)]) == 0
    assert outcome_of(run) == outcome_of(alone)


@pytest.mark.parametrize(("left", "file"), [(2000, TRIALS), (100_000, "trajectory.npz")])
def test_a_search_on_a_full_disk_leaves_whole_files(left: int, file: str, alone: Path, tmp_path: Path, capsys) -> None:
    run = tmp_path / "run"
    with full_disk(left):
        assert optimize.main([*SEARCH, "--out", str(run)]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said == f"whiptool: [Errno 27] File too large: '{run / file}'"
    assert not list(run.glob(".*"))
    kept = (run / TRIALS).read_bytes()
    assert (alone / TRIALS).read_bytes().startswith(kept)
    assert kept.endswith(b"\n")
    if file == TRIALS:  # with room again
        assert optimize.main(["--resume", str(run), "--no-video"]) == 0
        assert outcome_of(run) == outcome_of(alone)


@pytest.mark.parametrize(("kind", "resumable"), [(ResumableOptions, True), (OutputOptions, False)])
def test_an_interruption_says_how_to_go_on(kind, resumable, tmp_path, capsys):
    def command() -> int:
        with run_folders.new_folder(kind(out=tmp_path / "run"), "x", {"command": "x"}):
            raise KeyboardInterrupt

    assert cli.run(command) == 130
    said = capsys.readouterr().err
    assert said.startswith("whiptool: interrupted")
    assert (f"go on with --resume {tmp_path / 'run'}" in said) == resumable


@pytest.mark.parametrize(("kind", "resumable"), [(ResumableOptions, True), (OutputOptions, False)])
def test_a_taken_folder_is_named_as_it_was_given(kind, resumable, tmp_path):
    """The library speaks of a run folder, the command of its option, and of `--resume` where it has that."""
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(InputError, match=r"^run folder: got .*; allowed: a folder that is new or empty$"):
        RunFolder.create(tmp_path, {})
    with pytest.raises(InputError, match=r"^--out: got .* new or empty") as raised:
        run_folders.new_folder(kind(out=tmp_path), "x", {})
    assert str(raised.value).endswith("to go on with a killed run, give --resume") == resumable


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
        assert cli.main_of(module)([*word, *COMMANDS[command], "--out", "run"]) == 2
        said = capsys.readouterr().err.splitlines()[-1]
        assert said.startswith("whiptool: --out: got 'run'")
        assert f"process {os.getpid()} on " in said
        assert {path.name for path in folder.path.iterdir()} == {CONFIG, LOCK}
