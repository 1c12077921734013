"""Columns of joint logs: whose joint they are, as robots' and laboratories' writers spell it."""

import pytest

from whiptool.errors import InputError
from whiptool.recording.joint_columns import Column, in_numbers, order_of

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
