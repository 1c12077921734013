"""Damage to a log of trials is said and put aside."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.objective import Arrival, Outcome, Trial
from whiptool.optimizers.trial_log import TRIALS, TrialLog

ARM = preset("lemon2024").arm


def trial(number: int) -> Trial:
    two = (0.25, float("nan"))
    return Trial(number, (0.1, 0.2, 0.3, 0.4, 0.5), Outcome(0.1 * number, False, 0.7, two, two, two, two, False))


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
CELLS = {  # of the third trial: the strike, and the miss distance behind it
    "a miss that is no number": (b"0.5,0.3000", b"0.5,nan#"),
    "an infinite miss": (b"0.5,0.3000", b"0.5,inf#"),
    "a miss below 0": (b"0.5,0.3000", b"0.5,-3.0#"),
    "a strike without an end": (b"3,0.1,", b"3,-inf,"),
    "a strike that is no number": (b"3,0.1,", b"3,nan,"),
    "an underscore": (b"3,0.1,", b"3,0_0.1,"),
    "a hit that is no number": (b",0,0.7,", b",nan,0.7,"),
}


def _with_cell(lines: list[bytes], old: bytes, new: bytes) -> bytes:
    """The log with other cells in the third trial; `#` stands for the rest of the number."""
    line = lines[3].replace(old, new)
    head, cut, rest = line.partition(b"#")
    line = head + rest[rest.index(b",") :] if cut else line
    assert line != lines[3]
    return b"".join([*lines[:3], line, *lines[4:]])


DAMAGES |= {name: (lambda lines, cells=cells: _with_cell(lines, *cells), 2) for name, cells in CELLS.items()}


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


@pytest.mark.parametrize("cost", [b"nan", b"-0.02"])
def test_a_strike_that_arrives_has_a_cost(cost: bytes, tmp_path: Path) -> None:
    two = (0.25, 1.5)
    missed = Outcome(0.2, False, 0.7, two, two, two, two, False, arrival=Arrival(0.1, 3.0, 0.02))
    log = TrialLog(tmp_path / TRIALS, ARM, arriving=True)
    log.append(Trial(1, (0.1, 0.2, 0.3, 0.4, 0.5), missed))
    line = (tmp_path / TRIALS).read_bytes().splitlines()[1]
    assert log.columns.trial(line) is not None
    assert log.columns.trial(line.replace(b"3.0,0.02,", b"3.0," + cost + b",")) is None


def test_an_infinite_distance_of_a_strike_that_diverged_is_read(tmp_path: Path) -> None:
    two = (0.25, 0.5)
    lost = Trial(1, (0.1, 0.2, 0.3, 0.4, 0.5), Outcome(float("inf"), False, 0.7, two, two, two, two, True))
    log = TrialLog(tmp_path / TRIALS, ARM)
    log.append(lost)
    assert log.read() == [lost]


def test_a_first_line_cut_off_is_an_empty_log(tmp_path: Path) -> None:
    (tmp_path / TRIALS).write_bytes(logged(tmp_path / TRIALS, 1)[0][:-5])
    assert TrialLog(tmp_path / TRIALS, ARM).read() == []
    assert (tmp_path / TRIALS).read_bytes() == b""


def test_trials_in_space_have_three_coordinates(tmp_path: Path) -> None:
    arm = preset("ur5e").arm
    three, six = (0.1, -0.2, 0.3), tuple(float(i) for i in range(6))
    hit = Trial(1, tuple(0.1 * i for i in range(13)), Outcome(0.01, True, 0.7, three, three, six, six, False))
    log = TrialLog(tmp_path / TRIALS, arm)
    log.append(hit)
    assert TrialLog(tmp_path / TRIALS, arm).read() == [hit]
    header = (tmp_path / TRIALS).read_text().splitlines()[0].split(",")
    assert header[17:23] == [f"tip_{x}" for x in "xyz"] + [f"tip_velocity_{x}" for x in "xyz"]
    assert header[23] == "max_joint_speed_shoulder_pan"


@pytest.mark.parametrize("arriving", [False, True])
def test_criteria_are_read_as_they_were_written(arriving: bool, tmp_path: Path) -> None:
    two, came = (0.25, 1.5), Arrival(0.1, 3.0, 0.02) if arriving else None
    given = [
        Outcome(0.01, True, 0.7, two, two, two, two, False, None, came, (12.5, 0.01), -0.3),
        Outcome(0.2, False, 0.7, two, two, two, two, False, None, came, (9.5, float("inf"))),
        Outcome(2.0, False, 0.7, two, two, two, two, True),
    ]
    log = TrialLog(tmp_path / TRIALS, ARM, arriving=arriving, criteria=["effort", "robustness"])
    for i, outcome in enumerate(given):
        log.append(Trial(i + 1, (0.1, 0.2, 0.3, 0.4, 0.5), outcome))
    assert [trial.outcome for trial in log.read()] == given
    assert b"effort,robustness,merit" in (tmp_path / TRIALS).read_bytes()


def test_what_refused_a_strike_is_read_as_it_was_written(tmp_path: Path) -> None:
    two = (0.25, 0.5)
    trials = [
        Trial(i, (0.1, 0.2, 0.3, 0.4, 0.5), Outcome(3.0, False, 0.7, two, two, two, two, False, refused=why))
        for i, why in enumerate(["joint", None, "clearance"], start=1)
    ]
    log = TrialLog(tmp_path / TRIALS, ARM, limited=True)
    for one in trials:
        log.append(one)
    assert TrialLog(tmp_path / TRIALS, ARM, limited=True).read() == trials
    logged(tmp_path / "old.csv", 2)
    text = (tmp_path / TRIALS).read_text().splitlines()
    assert [line.split(",")[-2] for line in text] == ["status", "refused", "miss", "refused"]
    with pytest.raises(InputError, match="refused"):  # of a version that did not write the column
        TrialLog(tmp_path / "old.csv", ARM, limited=True).read()


@pytest.mark.parametrize("content", [bytes(range(256)), b"\xc5\xd7\x14", "größe,q\n".encode()])
def test_a_file_that_is_no_log_is_refused_in_words_and_kept(tmp_path, content):
    path = tmp_path / "trials.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        TrialLog(path, preset("lemon2024").arm).read()
    assert "trials.csv: got 'bytes that are not text'; allowed: the columns trial,q_si," in str(caught.value)
    assert "\\x" not in str(caught.value)
    assert path.read_bytes() == content
