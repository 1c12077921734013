"""Recordings that a clock, a camera or a log has spoilt: a fit is right within its intervals, refused, or withdrawn.

Simulated strikes of a whip that is known, spoilt in one way each, through the command as a user calls it. Intervals
are of 95 %: of many draws of noise one in twenty misses its truth, and none by more than three standard errors.
"""

from __future__ import annotations

import csv
import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import called
from films import film
from scipy.stats import binom

from whiptool.models import preset, write_model
from whiptool.models.strike import default_bounds
from whiptool.recording.readers.tracks import write_csv
from whiptool.recording.strike_recording import StrikeRecording

LEMON = preset("lemon2024")
TRUE = {"whip.k": 0.242, "whip.b": 0.092}
GUESS = LEMON.with_parameters({"whip.k": 0.32, "whip.b": 0.07})
DRAWS = 5
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


@cache
def sound(draw: int = 0) -> tuple[StrikeRecording, ...]:
    """Two strikes, with one of many draws of a camera's noise."""
    strikes = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 2)
    seeds = (2 * draw, 2 * draw + 1)
    films = [
        film(LEMON, v, np.random.default_rng(seed), sigma=2e-3, rate=100.0)
        for v, seed in zip(strikes, seeds, strict=True)
    ]
    return tuple(dataclasses.replace(r, joints_t=r.joints_t[::8], joints_q=r.joints_q[::8]) for r in films)


def at(recording: StrikeRecording, t: np.ndarray, frames: np.ndarray | slice = slice(None)) -> StrikeRecording:
    """These frames of a recording, stamped with other times."""
    some = {name: getattr(recording, name)[frames] for name in ("points", "sigma")}
    return dataclasses.replace(recording, t=t, t_points=np.repeat(t[:, None], 1, axis=1), **some)


def fast(share: float):
    return lambda r: at(r, r.t * (1 + share))


def counted(left_out: int, *, doubled: int = 0):
    """Frames that are missing, or there twice, in the middle; the times are those of a count."""

    def spoil(r: StrikeRecording) -> StrikeRecording:
        middle = int(np.searchsorted(r.t, 0.35))
        frames = np.r_[0:middle, [middle] * doubled, middle + left_out : len(r.t)].astype(int)
        return at(r, r.t[0] + 0.01 * np.arange(len(frames)), frames)

    return spoil


def placed(mend):
    return lambda r: dataclasses.replace(r, points=mend(r.points))


def identified(
    folder: Path, spoil, *, first_alone: bool = False, edit=None, drive: str = "command"
) -> tuple[str, dict]:
    """What the command makes of recordings, spoilt, written and perhaps edited: `refused` with its line, else `right`,
    `wrong` or `withdrawn` with its JSON. By the joints one will do."""
    write_model(GUESS, folder / "guess.toml")
    for i, recording in enumerate(sound()):
        write_csv(recording if first_alone and i else spoil(recording), folder / f"s{i}.csv")
        if edit is not None:
            edit(folder / f"s{i}.csv")
    words = ["--model", "guess.toml", "--free", "k", "b", "--drive", drive, "--starts", 1, "--out", "out", "--json"]
    files = ["s0.csv"] if drive == "joints" else ["s0.csv", "s1.csv"]
    done = called("identify", *files, *words, cwd=folder)
    if done.returncode:
        assert done.returncode == 2
        assert not (folder / "out").exists()  # no fit was begun
        assert done.stderr.splitlines()[-1].startswith("whiptool: ")
        return "refused", {"line": done.stderr.splitlines()[-1]}
    summary = json.loads(done.stdout)
    if summary["warning"] is not None:
        report = (folder / "out" / "report.html").read_text()
        assert {p["class"] for p in summary["parameters"]} <= {"withdrawn", "flat", "at bound"}
        assert all(p["interval"] is None for p in summary["parameters"])
        assert summary["ratios"] == []
        assert "well determined" not in report
        return "withdrawn", summary
    inside = [
        p["interval"] is None or p["interval"][0] <= TRUE[p["name"]] <= p["interval"][1] for p in summary["parameters"]
    ]
    return ("right" if all(inside) else "wrong"), summary


def nothing(r: StrikeRecording) -> StrikeRecording:
    return r


@pytest.mark.parametrize("drive", ["command", "joints"])
def test_sound_recordings_are_right(tmp_path, drive):
    came, summary = identified(tmp_path, nothing, drive=drive)
    assert came == "right"
    assert summary["clock_fault"] is None
    assert summary["remarks"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "first_alone", "kind", "size"),
    [
        (fast(0.01), False, "clock_rate", 0.01),
        (fast(-0.01), False, "clock_rate", -0.01),
        (counted(1), True, None, -0.01),
        (counted(2), True, None, -0.02),
        (counted(3), True, None, -0.03),
        (counted(0, doubled=1), True, None, 0.01),
        (lambda r: at(r, r.t + 0.03), False, "delay", 0.03),
    ],
)
def test_wrong_times_withdraw_the_result_and_are_named(tmp_path, spoil, first_alone, kind, size):
    came, summary = identified(tmp_path, spoil, first_alone=first_alone)
    assert came == "withdrawn"
    fault = summary["clock_fault"]
    assert fault["p_value"] < 1e-3
    assert fault["source"].endswith("s0.csv") or not first_alone
    if kind is None:  # a late clock looks much alike
        assert np.sign(fault["size"]) == np.sign(size)
        assert "stamped twice" in summary["warning"] or "lost" in summary["warning"]
    else:
        assert fault["kind"] == kind
        assert fault["size"] == pytest.approx(size, rel=0.1)
    assert fault["source"] in summary["warning"]


def mended(folder: Path, draw: int) -> dict:
    """What the command makes of a fast clock with a clock rate of each recording's own; numbers are near the truth."""
    for i, recording in enumerate(sound(draw)):
        write_csv(fast(0.01)(recording), folder / f"s{i}.csv")
    write_model(GUESS, folder / "guess.toml")
    words = ["--model", "guess.toml", "--free", "k", "b", "--starts", 1, "--out", "out", "--json"]
    done = called("identify", "s0.csv", "s1.csv", *words, "--per-recording", "clock_rate", cwd=folder)
    summary = json.loads(done.stdout)
    assert summary["warning"] is None
    for p in summary["parameters"]:
        assert abs(p["value"] - TRUE[p["name"]]) < 3 * p["standard_error"]
    for recording in summary["recordings"]:
        assert recording["own"]["clock_rate"] == pytest.approx(1.01, abs=1e-3)
    return summary


def test_what_is_named_is_what_mends_it(tmp_path):
    """With a clock rate of each recording's own, as the message says, a fast clock does no harm."""
    mended(tmp_path, draw=0)


@pytest.mark.slow
def test_of_many_draws_no_more_intervals_miss_than_one_in_twenty_makes_likely(tmp_path_factory):
    """No more than intervals of 95 % have missing in 99 of 100 such counts: 3 of 10."""
    found = [p for draw in range(DRAWS) for p in mended(tmp_path_factory.mktemp("draw"), draw)["parameters"]]
    missed = [p["name"] for p in found if not p["interval"][0] <= TRUE[p["name"]] <= p["interval"][1]]
    assert len(found) == 2 * DRAWS
    assert len(missed) <= binom.ppf(0.99, len(found), 0.05)


@pytest.mark.parametrize("drive", ["command", "joints"])
@pytest.mark.parametrize(
    ("mend", "said"),
    [
        (lambda x: x @ TURN.T, "its axes should be (y, -x)"),
        (lambda x: x * [-1, 1], "its axes should be (-x, y)"),
        (lambda x: x / 1000, "they were m, read as mm"),
        (lambda x: x * 1000, "are these millimetres or pixels?"),
    ],
)
def test_wrong_axes_and_units_are_refused(tmp_path, mend, said, drive):
    if "millimetres" in said:

        def edit(path: Path) -> None:
            rewritten(path, lambda name, x: x * 1000 if name in ("tip_x", "tip_y") else x)

        came, told = identified(tmp_path, nothing, edit=edit, drive=drive)
    else:
        came, told = identified(tmp_path, placed(mend), drive=drive)
    assert came == "refused"
    assert said in told["line"]
    assert "s0.csv" in told["line"]


def rewritten(path: Path, change, names=None, rows=lambda t: True) -> None:
    """Change a table's numbers by column, perhaps its header, and leave out rows by their time."""
    header, *table = csv.reader(path.open())
    numbers = [
        [change(name, float(x)) for name, x in zip(header, row, strict=True)] for row in table if rows(float(row[0]))
    ]
    names = header if names is None else names
    order = [header.index(x) if x in header else i for i, x in enumerate(names)]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([names, *([row[i] for i in order] for row in numbers)])


def same(name: str, x: float) -> float:
    return x


def joints_of(path: Path) -> Path:
    return path.with_suffix(".joints.csv")


def test_columns_in_another_order_are_read_by_name(tmp_path):
    def edit(path: Path) -> None:
        header = next(csv.reader(joints_of(path).open()))
        rewritten(joints_of(path), same, names=[header[0], header[2], header[1]])

    assert identified(tmp_path, nothing, edit=edit, drive="joints")[0] == "right"


def test_columns_under_other_names_are_read_or_refused(tmp_path):
    def edit(path: Path) -> None:
        rewritten(joints_of(path), same, names=["t", "arm/shoulder_joint", "arm/elbow_joint"])

    assert identified(tmp_path, nothing, edit=edit, drive="joints")[0] == "right"


@pytest.mark.parametrize("drive", ["command", "joints"])
def test_joints_in_degrees_are_read_so_or_refused(tmp_path, drive):
    def edit(path: Path) -> None:
        rewritten(joints_of(path), lambda name, x: x if name == "t" else 57.29577951308232 * x)

    came, told = identified(tmp_path, nothing, edit=edit, drive=drive)
    assert came == "refused"
    assert "degrees" in told["line"]


def test_a_hole_in_the_joints_is_refused(tmp_path):
    def edit(path: Path) -> None:
        rewritten(joints_of(path), same, rows=lambda t: not 0.2 < t < 0.4)

    came, told = identified(tmp_path, nothing, edit=edit, drive="joints")
    assert came == "refused"
    assert "a hole of 0.2" in told["line"]


def test_joints_that_are_logged_rarely_are_right(tmp_path):
    def spoil(r: StrikeRecording) -> StrikeRecording:
        return dataclasses.replace(r, joints_t=r.joints_t[::4], joints_q=r.joints_q[::4])

    assert identified(tmp_path, spoil, drive="joints")[0] == "right"
