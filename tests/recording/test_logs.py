"""Time stamps: one bad stamp costs one sample, a stretch of them is refused, and so is what no recording lasts."""

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.recording.logs import Column, check_pace, gaps, good_stamps, in_numbers, order_of

EVEN = np.arange(40) / 60


def changed(at, value, base=EVEN) -> np.ndarray:
    stamps = base.copy()
    stamps[at] = value
    return stamps


@pytest.mark.parametrize(
    ("stamps", "bad"),
    [
        (changed(10, EVEN[9]), 10),  # the second of a pair repeats the first
        (changed(9, EVEN[10]), 9),  # the first of a pair has what the second should have
        (changed(10, EVEN[3]), 10),
        (changed(10, np.nan), 10),
        (changed(0, np.nan), 0),
        (changed(10, 0.0, EVEN + 5), 10),
        (changed(0, 0.0, EVEN + 1.7e9), 0),
        (changed(10, 99.0), 10),
        (changed(-1, 0.0), 39),
        (changed(-1, 99.0), 39),
    ],
)
def test_a_bad_stamp_costs_its_own_sample(stamps, bad):
    keep, said = good_stamps(stamps, "stamps")
    np.testing.assert_array_equal(np.flatnonzero(~keep), [bad])
    assert f"left out 1 of 40 samples, whose stamps cannot be right: {bad + 1} (" in said[0]


def test_good_stamps_are_kept_without_a_word():
    for stamps in (EVEN, np.delete(EVEN, [7, 8]), EVEN + 1.7e9):
        keep, said = good_stamps(stamps, "stamps")
        assert keep.all()
        assert not said


def test_a_stretch_of_doubled_stamps_is_refused():
    held, pairs = EVEN.copy(), EVEN.copy()
    held[10:16] = EVEN[10]
    pairs[11:20:2] = pairs[10:19:2]
    for stamps in (held, pairs, np.zeros(40), np.full(40, np.nan)):
        with pytest.raises(InputError, match="each later than the previous stamp"):
            good_stamps(stamps, "stamps")
    with pytest.raises(InputError, match="samples 11 to 16"):
        good_stamps(held, "stamps")


@pytest.mark.parametrize(
    ("t", "said"),
    [
        (1e3 * EVEN + 4e5, "steps of 16.6667.*milliseconds"),
        (1e6 * EVEN, "microseconds"),
        (1e9 * EVEN + 1.7e18, "nanoseconds"),
        (np.arange(8000) * 0.2, "span of 1599.8 s in 8000 rows.*milliseconds"),
        (np.arange(3000) * 0.5, "steps of 0.5.*milliseconds"),
        (1e-9 * EVEN, "steps from 1e-05 s"),
    ],
)
def test_times_that_no_strike_lasts_are_refused_with_the_likely_cause(t, said):
    with pytest.raises(InputError, match=said):
        check_pace("t", t)


def test_holes_are_told():
    assert gaps("joints", EVEN, least=0.05) == []
    (said,) = gaps("joints", np.r_[EVEN, EVEN + EVEN[-1] + 0.2], least=0.05, steps=3)
    assert said == "joints: a hole where about 11 samples are missing, the longest of 0.2 s from 0.650 to 0.850 s"
    assert "2 holes where about 3 samples" in gaps("frames", np.delete(EVEN, [7, 20, 21]))[0]


UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
PANDA = tuple(f"panda_joint{i}" for i in range(1, 8))


@pytest.mark.parametrize(
    ("name", "words", "kind", "unit"),
    [
        ("/arm1/joint_states/shoulder_pan_joint/position [deg]", ("arm", "1", "shoulder", "pan"), "position", "deg"),
        ("position_elbow", ("elbow",), "position", ""),
        ("elbow_flex.pos", ("elbow", "flex"), "position", ""),
        ("robot1.elbow_joint", ("robot", "1", "elbow"), "", ""),
        ("ShoulderPan_deg", ("shoulder", "pan"), "", "deg"),
        ("actual_q_0", ("0",), "position", ""),
        ("target_q_0", ("0",), "command", ""),
        ("actual_qd_0", ("0",), "other", ""),
        ("elbow velocity", ("elbow",), "other", ""),
        ("t [ms]", (), "time", "ms"),
        ("timestamp_ns", (), "time", "ns"),
        ("tip_t", ("tip",), "time", ""),
    ],
)
def test_a_name_is_taken_apart(name, words, kind, unit):
    column = Column.of(name)
    assert (column.words, column.kind, column.unit) == (words, kind, unit)


@pytest.mark.parametrize("spelling", ["{}", "/ns/{}", "robot1.{}", "robot1_{}", "{}_joint", "position_{}", "{}.pos"])
def test_joints_are_found_by_name_in_any_order(spelling):
    bare = [joint.removesuffix("_joint") for joint in UR]
    names = [spelling.format(joint) for joint in reversed(bare)]
    assert order_of(names, UR) == [5, 4, 3, 2, 1, 0]
    assert order_of([*names[:2], "gripper", *names[2:]], UR) == [6, 5, 4, 3, 1, 0]


def test_joints_that_are_numbered_are_in_the_order_of_their_numbers():
    assert order_of([f"joint{i}" for i in (2, 1, 3, 4, 5, 6, 7)], PANDA) == [1, 0, 2, 3, 4, 5, 6]
    assert order_of([f"q{i}" for i in (1, 0, 2, 3, 4, 5)], UR) == [1, 0, 2, 3, 4, 5]
    assert order_of([f"panda_joint{i}" for i in (7, 2, 1, 3, 4, 5, 6)], PANDA[:6]) == [2, 1, 3, 4, 5, 6]
    assert in_numbers(["b", "a"]) == [1, 0]
    assert in_numbers(["q1", "q3"]) is None
    assert in_numbers(["hip", "knee"]) is None


@pytest.mark.parametrize(
    ("names", "joints", "said"),
    [
        (("elbow", "shoulder"), ("shoulder", "wrist"), "no column is for wrist"),
        (("left_elbow", "right_elbow"), ("shoulder", "elbow"), "there are several for elbow"),
        (("hip", "knee"), ("shoulder", "elbow"), "no column is for shoulder, elbow.*joint_columns = {shoulder"),
        ((*(f"q{i}" for i in range(7)),), PANDA[:6], "joint_columns"),
        (("shoulder", "q2"), ("shoulder", "elbow"), "no column is for elbow"),
    ],
)
def test_what_no_name_matches_is_refused(names, joints, said):
    with pytest.raises(InputError, match=said):
        order_of(names, joints)


def test_a_list_in_the_arms_order_needs_no_names_but_is_not_read_against_them():
    assert order_of(("hip", "knee"), ("shoulder", "elbow"), listed=True) == [0, 1]
    assert order_of(("elbow", "shoulder"), ("shoulder", "elbow"), listed=True) == [1, 0]
    with pytest.raises(InputError, match="no column is for wrist"):
        order_of(("elbow", "hip"), ("elbow", "wrist"), listed=True)
