"""Names of joints: the usual ones, what is taken, names from elsewhere, and their subscripts."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whiptool.errors import InputError
from whiptool.models.joint_names import checked_joints, joint_name, subscripts


@pytest.mark.parametrize(
    ("count", "usual"),
    [(1, ("shoulder",)), (2, ("shoulder", "elbow")), (3, ("joint1", "joint2", "joint3"))],
)
def test_joints_of_no_name_get_the_usual_ones(count, usual):
    assert checked_joints((), count) == usual
    assert checked_joints([], count) == usual


def test_given_names_are_kept_in_their_order():
    assert checked_joints(["wrist_2", "a", "Base3"], 3) == ("wrist_2", "a", "Base3")


@pytest.mark.parametrize(
    "given",
    [
        "ab", 3, None,  # no row of names
        ("a",), ("a", "b", "c"), ("a", "a"),  # not two different ones
        ("a", 2), ("a", ""), ("a", "2b"), ("a", "b-c"), ("a", "_b"),  # no names
        ("a", "whip1"), ("a", "tip"), ("a", "target"), ("a", "grip"), ("a", "world"), ("a", "com"), ("a", "end"),
    ],
)  # fmt: skip
def test_names_that_cannot_be_are_refused_with_the_rule(given):
    with pytest.raises(InputError) as caught:
        checked_joints(given, 2)
    assert (caught.value.name, caught.value.given) == ("joints", given)
    assert caught.value.allowed.startswith("2 different names, one per link, of letters and digits")


@given(st.text())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_any_name_from_elsewhere_becomes_one_that_is_allowed(given):
    name = joint_name(given)
    assert checked_joints((name,), 1) == (name,)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("elbow", "elbow"), ("shoulder-joint", "shoulder_joint"), ("panda/joint 1", "panda_joint_1"),
        ("1st", "joint_1st"), ("tip_joint", "joint_tip_joint"), ("whip1", "joint_whip1"), ("Gelenk ä", "Gelenk__"),
    ],
)  # fmt: skip
def test_names_from_elsewhere_change_as_little_as_they_must(given, name):
    assert joint_name(given) == name


@pytest.mark.parametrize(
    ("joints", "short"),
    [
        (("shoulder", "elbow"), ("s", "e")),  # initials that differ
        (("shoulder", "elbow", "wrist"), ("s", "e", "w")),
        (("shoulder", "slide"), ("shoulder", "slide")),  # that do not
        (("joint1", "joint2", "joint3"), ("1", "2", "3")),
        (("joint1",), ("1",)),
        (("joint2", "joint1"), ("joint2", "joint1")),  # not counted in order
        (("Shoulder", "slide"), ("S", "s")),
    ],
)
def test_subscripts(joints, short):
    assert subscripts(joints) == short
