"""The report of a strike on a rig: its numbers against sums by hand, what it shows where data are missing."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from fallen_tip import cycles, struck

from whiptool.commands.rig import _lines, _summary
from whiptool.goals.target import Target
from whiptool.limits.arm_limits import XM430
from whiptool.models import preset
from whiptool.recording.filmed_approach import Frames, Judgement, judge_frames
from whiptool.rig.cyclelog import Phase
from whiptool.rig.stops import SafetyError
from whiptool.rig.strike_report import (
    draw,
    plot_current,
    plot_cycles,
    plot_distance_seen,
    plot_tip,
    save_pictures,
    sections,
)
from whiptool.rig.struck import Run, Struck
from whiptool.viz.report import Picture, Table, Text, to_html
from whiptool.viz.style import STYLE

MODEL = preset("lemon2024")
TARGET = Target((0.9, 0.0), hit_radius=0.05)


def rows(table: Table) -> dict[str, list[str]]:
    return {row[0]: list(row[1:]) for row in table.rows}


def test_the_tables_tell_what_the_cycles_hold():
    one = struck()
    result, servos, loop = sections(one, MODEL, TARGET, draw(one, MODEL, TARGET))
    table = rows(next(part for part in servos.parts if isinstance(part, Table)))
    # on the line: torque over stall torque and speed over no-load speed, the manual's 46 rev/min and 2.3 A
    usage = 1.0 / 2.3 + 2.0 / (46 * 2 * np.pi / 60)
    assert table["elbow"] == ["2.00", "1.00", f"{usage:.0%}", "3.0", "1 of 100 cycles", "31", "12.0"]
    assert table["shoulder"][:3] == ["0.00", "0.01", f"{0.01 / 2.3:.0%}"]
    assert table["shoulder"][-1] == "10.5"  # not the 5 V before the strike
    phases = rows(next(part for part in loop.parts if isinstance(part, Table)))
    assert phases["approach"] == ["100", "0", "2.00", "0", "0.25"]
    assert phases["strike"] == ["100", "1", "5.00", "0", "0.25"]
    said = rows(next(part for part in result.parts if isinstance(part, Table)))
    miss = re.match(r"([\d.]+) ± ([\d.]+) cm", said["miss distance"][0])
    assert miss is not None
    assert float(miss[1]) == pytest.approx(2.0, abs=0.1)
    assert said["closest approach"] == ["at 0.100 s, 3.0 m/s"]
    assert "true miss (known to the twin only)" not in said


def test_the_band_of_a_current_is_what_the_motor_carries_at_that_speed():
    with matplotlib.rc_context(STYLE):
        ax = matplotlib.figure.Figure().subplots()
        plot_current(ax, cycles().during(Phase.STRIKE), 1, "elbow", XM430)
    band = ax.collections[0].get_paths()[0].vertices
    at = band[np.isclose(band[:, 0], 0.002 * 30)][:, 1]
    assert at.min() == pytest.approx(-2.3)  # braking: the stall current
    assert at.max() == pytest.approx(2.3 * (1 - 2.0 / (46 * 2 * np.pi / 60)))
    still = band[np.isclose(band[:, 0], 0.002 * 10)][:, 1]
    assert (still.min(), still.max()) == (pytest.approx(-2.3), pytest.approx(2.3))


def test_the_distance_is_in_the_unit_of_the_title():
    with matplotlib.rc_context(STYLE):
        ax = plot_distance_seen(matplotlib.figure.Figure().subplots(), struck(), TARGET)
    assert ax.get_ylabel() == "distance tip to target [cm]"
    assert re.match(r"estimated miss [\d.]+ ± [\d.]+ cm", ax.get_title(loc="left"))
    seen = next(line for line in ax.lines if line.get_label() == "as seen").get_ydata()
    assert seen.min() == pytest.approx(2.0, abs=0.1)  # [cm], as the tip falls past
    assert "hit radius 5 cm" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_arm_is_drawn_where_its_encoders_say():
    with matplotlib.rc_context(STYLE):
        ax = plot_tip(matplotlib.figure.Figure().subplots(), struck(), MODEL, TARGET)
    arm = next(line for line in ax.lines if str(line.get_label()).startswith("arm at the start"))
    l1, l2 = MODEL.arm.per_link("length")
    # q = 0 hangs down, counter-clockwise is positive
    elbow = np.array([l1 * np.sin(0.3), -l1 * np.cos(0.3)])
    hand = elbow + np.array([l2 * np.sin(-0.3), -l2 * np.cos(-0.3)])
    np.testing.assert_allclose(np.transpose(arm.get_data()), [[0, 0], elbow, hand], atol=1e-12)
    near = next(line for line in ax.lines if line.get_label() == "closest approach")
    np.testing.assert_allclose(np.ravel(near.get_data()), [0.92, 0.0], atol=2e-3)


def test_the_picture_of_cycles_shows_a_late_sample_and_counts_what_was_wrong():
    with matplotlib.rc_context(STYLE):
        ax = plot_cycles(matplotlib.figure.Figure().subplots(), cycles())
    between = ax.lines[0].get_ydata()
    assert np.nanargmax(between) == 135
    assert np.nanmax(between) == pytest.approx(5.0)  # [ms]: a period and 3 ms
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert {"no sample: 1", "cut to the current limit: 1"} <= set(legend)


def test_what_is_missing_is_left_out_and_said(tmp_path: Path):
    unseen = struck(markers=("handle",))
    result = sections(unseen, MODEL, TARGET, draw(unseen, MODEL, TARGET))[0]
    assert rows(result.parts[0])["the tip"] == ["was not seen"]
    fault = SafetyError("elbow", "measured 3 A, allowed 2.6 A")
    ended = Struck(Run(cycles(phases=(Phase.APPROACH,)), fault, False, 0, 0, "CUT THE POWER"), None)
    pictures = draw(ended, MODEL, TARGET)
    found = sections(ended, MODEL, TARGET, pictures)
    assert [section.title for section in found] == ["Result", "Control cycles"]
    said = found[0].parts[0]
    assert isinstance(said, Text)
    assert "fault" in said.text
    assert str(fault) in said.text
    assert "CUT THE POWER" in said.text
    assert [path.name for path in save_pictures(tmp_path, pictures)] == ["cycles.png"]
    assert len(to_html("A strike", "", {}, found)) > 5000


def test_a_closest_approach_between_frames_is_said_to_be_unseen():
    """The tip falls past at 3 m/s, 2 cm beside the target at 0.1 s, where no frame shows it."""
    one = struck()
    recording = one.recording
    assert recording is not None
    seen = np.abs(recording.t - 0.1) > 0.021
    gap = dataclasses.replace(
        recording,
        t=recording.t[seen],
        t_points=recording.t_points[seen],
        points=recording.points[seen],
        sigma=recording.sigma[seen],
    )
    one = dataclasses.replace(one, recording=gap)
    assert one.unseen(TARGET) == pytest.approx((0.075, 0.125))
    assert struck().unseen(TARGET) is None
    for which, how in ((one, "interpolated"), (struck(), "measured")):
        assert f"{how} miss distance 0.0" in _lines(which, _summary(which, TARGET), TARGET, "file")[0]
    result = sections(one, MODEL, TARGET, draw(one, MODEL, TARGET))[0]
    said = rows(next(part for part in result.parts if isinstance(part, Table)))
    assert said["closest approach"] == ["at 0.100 s, 3.0 m/s"]
    assert said["the tip was not seen"] == ["from 0.075 to 0.125 s, around the closest approach"]


def test_a_whole_run_leaves_three_pictures(tmp_path: Path):
    one = struck()
    figures = draw(one, MODEL, TARGET)
    names = [path.name for path in save_pictures(tmp_path, figures)]
    assert names == ["strike.png", "servos.png", "cycles.png"]
    pictures = [p for section in sections(one, MODEL, TARGET, figures) for p in section.parts if isinstance(p, Picture)]
    assert len(pictures) == 3


def test_a_strike_is_judged_once_for_each_target(monkeypatch: pytest.MonkeyPatch):
    """Also one whose tip was not seen; a changed strike is judged anew."""
    asked: list[Target] = []

    def judge(frames: Frames, target: Target) -> Judgement:
        asked.append(target)
        return judge_frames(frames, target)

    monkeypatch.setattr("whiptool.rig.struck.judge_frames", judge)
    one, further = struck(), Target((0.9, 0.1), hit_radius=0.05)
    sections(one, MODEL, TARGET, draw(one, MODEL, TARGET))
    assert asked == [TARGET]
    first, second = one.judged(TARGET), one.judged(further)
    assert first is one.judged(Target(TARGET.position, TARGET.hit_radius))
    assert first != second
    assert asked == [TARGET, further]
    assert dataclasses.replace(one).judged(TARGET) == first
    assert asked == [TARGET, further, TARGET]
    assert struck(markers=("handle",)).judged(TARGET) is None
    assert len(asked) == 3
