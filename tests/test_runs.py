"""Run folders: what is refused leaves none, a full disk leaves whole files, a run goes on after a kill."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from full_disk import full_disk
from search_words import SEARCH

from whiptool.commands import cli, optimize
from whiptool.commands.options.option_group import OutputOptions, ResumableOptions
from whiptool.commands.pictures import StrikePictures
from whiptool.errors import InputError, WhiptoolError
from whiptool.objective import Trial
from whiptool.optimizers.trial_log import TRIALS, TrialLog
from whiptool.references import CITATIONS
from whiptool.runs import CONFIG, RESULT, RunFolder


@pytest.fixture(scope="module")
def plain():
    """Searches without figures and MuJoCo, for speed."""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(StrikePictures, "__enter__", lambda self: self)
        patch.setattr(StrikePictures, "draw", lambda self: [])
        patch.setattr(optimize.SearchRun, "_replay", lambda *_: {"miss_distance": None, "difference": None})
        patch.setattr("whiptool.viz.plots.save_convergence", lambda *_, **__: None)
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
        with cli.new_folder(kind(out=tmp_path / "run"), "x", {"command": "x"}):
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
        cli.new_folder(kind(out=tmp_path), "x", {})
    assert str(raised.value).endswith("to go on with a killed run, give --resume") == resumable
