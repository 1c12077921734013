"""Run folders: one process at a time writes there, a full disk leaves whole files, damage is said and put aside."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from whiptool.commands import cli, optimize
from whiptool.errors import InputError, WhiptoolError
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.objective import Outcome, Trial
from whiptool.optimizers.trial_log import TRIALS, TrialLog
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.cyclelog import CycleLog, Cycles
from whiptool.rollout import Trajectory
from whiptool.run_lock import LOCK
from whiptool.runs import CONFIG, RESULT, RunFolder
from whiptool.whole_files import append_whole, replacing, write_npz, write_whole

ARM = preset("lemon2024").arm
SEARCH = ["--no-video", "--method", "random", "--target", "1.25", "0.05", "--no-stop-at-hit", "--timestep", "0.002"]
SEARCH += ["--preset", "printed", "--max-trials", "20"]


def fill_disk(left: int = 0) -> None:
    """From now on no file of this process grows beyond this size [bytes], as on a disk that is full."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (left, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


@pytest.fixture
def disk():
    """What fills the disk; it is empty again afterwards."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield fill_disk
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def trial(number: int) -> Trial:
    two = (0.25, float("nan"))
    return Trial(number, (0.1, 0.2, 0.3, 0.4, 0.5), Outcome(0.1 * number, False, 0.7, two, two, two, two, False))


@pytest.fixture(scope="module")
def plain():
    """Searches without figures and MuJoCo, for speed."""

    def save_strike(folder: Path, trajectory: Trajectory, *_, **__) -> list[str]:
        trajectory.save(folder / "trajectory.npz")
        return []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimize, "save_strike", save_strike)
        patch.setattr(optimize._Run, "_replay", lambda *_: {"miss_distance": None, "difference": None})
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


# one process at a time


def test_a_folder_is_one_process_at_a_time(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path / "run", {"command": "mine"}) as folder:
        for again in (lambda: RunFolder.open(folder.path), lambda: RunFolder.create(folder.path, {})):
            with pytest.raises(InputError, match=rf"no other command works in; process {os.getpid()} on .* since 2"):
                again()
        folder.write_result({"whole": True})
    assert {path.name for path in folder.path.iterdir()} == {CONFIG, RESULT}
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
    assert sorted(path.name for path in folder.path.iterdir()) == [CONFIG, RESULT]


def test_a_device_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    """`--export /dev/stdout` must not leave a regular file in /dev. Through a link, for a test that fails as root."""
    null = tmp_path / "null"
    null.symlink_to(os.devnull)
    write_whole(null, "lost")
    assert null.is_symlink()
    assert [path.name for path in tmp_path.iterdir()] == ["null"]


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


@pytest.mark.parametrize("command", COMMANDS)
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


# a full disk


WRITERS: dict[str, Callable[[Path], None]] = {
    "write": lambda path: write_whole(path, "new" * 1000),
    "append": lambda path: append_whole(path, b"new" * 1000),
    "arrays": lambda path: write_npz(path, {"x": np.random.default_rng(0).random(1000)}),
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("there", [True, False])
def test_what_does_not_fit_leaves_no_half(writer: str, there: bool, tmp_path: Path, disk) -> None:
    path = tmp_path / "file"
    if there:
        path.write_bytes(b"before")
    disk(100)
    with pytest.raises(OSError, match=r"file'$") as caught:
        WRITERS[writer](path)
    assert caught.value.filename == str(path)
    disk(resource.RLIM_INFINITY)
    assert (path.read_bytes() if path.exists() else b"") == (b"before" if there else b"")
    assert {found.name for found in tmp_path.iterdir()} <= {"file"}


def test_an_error_without_a_number_names_the_file_too(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"film\.mp4: no frames"), replacing(tmp_path / "film.mp4"):
        raise OSError("no frames")


@pytest.mark.parametrize("room", [True, False])
def test_a_film_is_whole_or_not_there(room: bool, tmp_path: Path, disk) -> None:
    from whiptool.viz import video

    film = SimpleNamespace(size=(64, 64), q=range(5))
    frames = (np.full((64, 64, 3), 40 * i, np.uint8) for i in range(5))
    disk(resource.RLIM_INFINITY if room else 100)
    expected = nullcontext() if room else pytest.raises(OSError, match=r"strike\.mp4: .* the disk may be full")
    with expected, replacing(tmp_path / "strike.mp4") as unfinished:
        video._encode(unfinished, film, frames, 25.0, None)  # type: ignore[arg-type]
    assert [path.name for path in tmp_path.iterdir()] == (["strike.mp4"] if room else [])


def test_a_record_of_cycles_keeps_whole_rows(tmp_path: Path, disk) -> None:
    log, path = CycleLog(2, tmp_path / "cycles.log"), tmp_path / "cycles.log"
    row = np.arange(3 + 8 * 2 + 3).tolist()
    log.append(row)
    disk(path.stat().st_size + 20)
    with pytest.raises(OSError, match=r"cycles\.log"):
        log.append(row)
    log.close()
    assert len(Cycles.load(path)) == 1
    assert (path.stat().st_size - path.read_bytes().index(b"\n") - 1) % (8 * len(row)) == 0


@pytest.mark.parametrize(("left", "file"), [(2000, TRIALS), (100_000, "trajectory.npz")])
def test_a_search_on_a_full_disk_leaves_whole_files(
    left: int, file: str, alone: Path, tmp_path: Path, capsys, disk
) -> None:
    run = tmp_path / "run"
    disk(left)
    assert optimize.main([*SEARCH, "--out", str(run)]) == 1
    disk(resource.RLIM_INFINITY)
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said == f"whiptool: [Errno 27] File too large: '{run / file}'"
    assert not list(run.glob(".*"))
    kept = (run / TRIALS).read_bytes()
    assert (alone / TRIALS).read_bytes().startswith(kept)
    assert kept.endswith(b"\n")
    if file == TRIALS:  # with room again
        assert optimize.main(["--resume", str(run), "--no-video"]) == 0
        assert outcome_of(run) == outcome_of(alone)


# damage


def logged(path: Path, trials: int) -> list[bytes]:
    log = TrialLog(path, ARM)
    for number in range(1, trials + 1):
        log.append(trial(number))
    return path.read_bytes().splitlines(keepends=True)


GARBAGE = bytes(range(256)) * 3
DAMAGES: dict[str, tuple[Callable[[list[bytes]], bytes], int]] = {
    "a line cut off": (lambda lines: b"".join(lines)[:-9], 4),
    "garbage behind": (lambda lines: b"".join(lines) + GARBAGE, 5),
    "garbage without a line's end": (lambda lines: b"".join(lines) + b"\0" * 50, 5),
    "garbage within": (lambda lines: b"".join([*lines[:3], GARBAGE, *lines[4:]]), 2),
    "a line that is missing": (lambda lines: b"".join([*lines[:3], *lines[4:]]), 2),
    "a line twice": (lambda lines: b"".join([*lines[:3], lines[2], *lines[3:]]), 2),
    "a word for a number": (lambda lines: b"".join([*lines[:3], lines[3].replace(b"0.25", b"half"), *lines[4:]]), 2),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_intact_of_a_damaged_log_is_kept(damage: str, tmp_path: Path, capsys) -> None:
    path, (do, intact) = tmp_path / TRIALS, DAMAGES[damage]
    lines = logged(path, 5)
    path.write_bytes(do(lines))
    read = TrialLog(path, ARM).read()
    assert [repr(found) for found in read] == [repr(trial(1 + i)) for i in range(intact)]
    assert path.read_bytes() == b"".join(lines[: 1 + intact])
    said, aside = capsys.readouterr().err, tmp_path / "trials-damaged-1.csv"
    if damage == "a line cut off":  # as every kill may leave it
        assert (said, aside.exists()) == ("", False)
    else:
        assert said.count("\n") == 1
        assert f"{path}, line {intact + 2}: no trial" in said
        assert aside.read_bytes() == do(lines)


@pytest.mark.parametrize("content", [GARBAGE, b"\0" * 50, b"trial,q\n1,2\n"])
def test_a_log_without_its_first_line_is_refused_and_stays(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / TRIALS
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"trials\.csv: got .* move it away"):
        TrialLog(path, ARM).read()
    assert path.read_bytes() == content


def test_a_first_line_cut_off_is_an_empty_log(tmp_path: Path) -> None:
    (tmp_path / TRIALS).write_bytes(logged(tmp_path / TRIALS, 1)[0][:-5])
    assert TrialLog(tmp_path / TRIALS, ARM).read() == []
    assert (tmp_path / TRIALS).read_bytes() == b""


@pytest.mark.parametrize("resumable", [True, False])
def test_an_interruption_says_how_to_go_on(resumable, tmp_path, capsys):
    def command() -> int:
        with RunFolder.create(tmp_path / "run", {"command": "x"}, resumable=resumable):
            raise KeyboardInterrupt

    assert cli.run(command) == 130
    said = capsys.readouterr().err
    assert said.startswith("whiptool: interrupted")
    assert (f"go on with --resume {tmp_path / 'run'}" in said) == resumable
