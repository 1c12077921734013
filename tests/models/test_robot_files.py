"""Robots' files that no parser should see are refused; chains of a robot are chosen by name."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from whiptool.errors import InputError
from whiptool.models.mjcf import read_mjcf
from whiptool.models.robot_files import ArmChoice, check_mjcf
from whiptool.models.urdf import read_urdf

BODY = '<body><joint/><geom size="0.1"/>{}</body>'
MJCF = "<mujoco>{}<worldbody>{}</worldbody></mujoco>"


def read(folder: Path, text: str, suffix: str = "xml") -> object:
    (folder / f"x.{suffix}").write_text(text)
    return read_urdf(folder / "x.urdf") if suffix == "urdf" else read_mjcf(folder / "x.xml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MJCF.format("", '<replicate count="100000"><body/></replicate>'), "including replicas"),
        (MJCF.format("", "<replicate count='300'>" * 2 + "<body/>" + "</replicate>" * 2), "including replicas"),
        (MJCF.format("", '<body><flexcomp name="f" type="grid" count="1000 1000 1"/></body>'), "including replicas"),
        (MJCF.format("", '<body><composite type="cable" count="99999 1 1"/></body>'), "including replicas"),
        (MJCF.format('<asset><texture builtin="flat" width="100000000" height="9"/></asset>', ""), "width 100000000"),
        (MJCF.format('<asset><hfield name="h" nrow="1000000" ncol="2" size="1 1 1 1"/></asset>', ""), "nrow 1000000"),
        (MJCF.format("", "<body>" * 5000), "nested elements"),
        ("<!--" * 300_000, "MuJoCo compiles"),
        ("<a '" * 300_000, "MuJoCo compiles"),
        ('<a b="' * 300_000, "MuJoCo compiles"),
        (MJCF.format('<include file="x.xml"/>', ""), "at most 100 included files"),
        (MJCF.format('<include file="/dev/zero"/>', ""), "not a pipe or a device"),
        (MJCF.format('<compiler meshdir="/dev"/><asset><mesh file="zero"/></asset>', ""), "not a pipe or a device"),
    ],
)
def test_mjcf_that_would_not_end_is_refused_at_once(text: str, said: str, tmp_path: Path) -> None:
    begun = time.process_time()
    with pytest.raises(InputError, match=said):
        read(tmp_path, text)
    assert time.process_time() - begun < 10


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot>" + "<link>" * 5000 + "</link>" * 5000 + "</robot>", "nested elements"),
        ('<!DOCTYPE r [<!ENTITY a "&b;&b;"><!ENTITY b "x">]><robot name="&a;"/>', "entities"),
        ("<robot>" + '<link name="a"/>' * 30_000 + "</robot>", "20000 elements"),
    ],
)
def test_urdf_that_would_not_end_is_refused_at_once(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read(tmp_path, text, "urdf")


def test_a_tip_without_a_name_is_found_by_its_number(tmp_path: Path) -> None:
    assert read(tmp_path, MJCF.format("", BODY.format(BODY.format("")))).n == 2


def test_what_is_said_in_comments_and_what_is_replicated_a_few_times_passes(tmp_path: Path) -> None:
    """Three replicas of a shape, on the second of two bodies."""
    many = "<!-- <replicate count='1000000'> -->"
    few = '<replicate count="3" offset="1 0 0"><geom size="0.1"/></replicate>'
    arm = read(tmp_path, MJCF.format(many, BODY.format(f'<body name="tip"><joint/>{few}</body>')))
    assert arm.n == 2
    assert arm.links[1].mass == pytest.approx(3 * arm.links[0].mass)


CHAIN, JOINTS = ("rail", "shoulder", "elbow"), ("rail", "shoulder", "elbow", "finger")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"tip": 3}, "tip"), ({"moving": "elbow"}, "moving"), ({"moving": (1,)}, "moving"),
        ({"locked": ("elbow",)}, "locked"),
        ({"locked": {"elbow": "up"}}, "locked.elbow"), ({"outward": (0, 0, 0)}, "outward"),
        ({"outward": (1, 0)}, "outward"),
        ({"moving": ("elbow",), "locked": {"elbow": 0}}, "locked: got 'elbow'"),
    ],
)  # fmt: skip
def test_choices_are_checked(wrong, message):
    with pytest.raises(InputError, match=f"^{message}"):
        ArmChoice(**wrong)


def test_a_choice_holds_plain_values():
    choice = ArmChoice(moving=["elbow"], locked={"rail": np.float64(1)}, outward=[0, -3, 0])
    assert (choice.moving, choice.locked, choice.outward) == (("elbow",), {"rail": 1.0}, (0.0, -1.0, 0.0))


@pytest.mark.parametrize(
    ("choice", "movers"),
    [
        ({}, ["rail", "shoulder", "elbow"]),
        ({"moving": ("elbow", "rail")}, ["rail", "elbow"]),  # in the chain's order
        ({"locked": {"shoulder": 0.7}}, ["rail", "elbow"]),
        ({"locked": {"finger": 0.01}}, ["rail", "shoulder", "elbow"]),  # beside the chain
        ({"moving": ("rail",), "locked": {"shoulder": 0.7}}, ["rail"]),
    ],
)
def test_joints_that_move(choice, movers):
    assert ArmChoice(**choice).movers(CHAIN, JOINTS) == movers


@pytest.mark.parametrize(
    ("choice", "name", "given_", "allowed"),
    [
        ({"moving": ("wrist",)}, "moving", "wrist", "one of the joints rail, shoulder, elbow"),
        ({"moving": ("finger",)}, "moving", "finger", "one of the joints rail, shoulder, elbow"),
        ({"locked": {"wrist": 0}}, "locked", "wrist", "one of the joints rail, shoulder, elbow, finger"),
        ({"moving": ()}, "moving", [], "one or more of the joints rail, shoulder, elbow"),
        ({"locked": dict.fromkeys(CHAIN, 0)}, "moving", [], "one or more of the joints rail, shoulder, elbow"),
    ],
)
def test_joints_that_are_none_or_none_left_are_named(choice, name, given_, allowed):
    with pytest.raises(InputError) as caught:
        ArmChoice(**choice).movers(CHAIN, JOINTS)
    assert (caught.value.name, caught.value.given, caught.value.allowed) == (name, given_, allowed)


def test_a_chain_without_joints_has_none_to_move():
    with pytest.raises(InputError, match=r"^moving: got \[\]; allowed: .*\(none\)"):
        ArmChoice().movers((), JOINTS)


def test_the_tip_is_the_one_named_or_the_only_end():
    frames = ("base", "fore", "tool", "finger")
    assert ArmChoice(tip="fore").only_tip(("tool", "finger"), frames) == "fore"
    assert ArmChoice().only_tip(("tool",), frames) == "tool"
    with pytest.raises(InputError, match=r"^tip: got 'none'; .* as the robot branches: tool, finger"):
        ArmChoice().only_tip(("tool", "finger"), frames)
    with pytest.raises(InputError, match=r"^tip: got 'flange'; allowed: one of base, fore, tool, finger"):
        ArmChoice(tip="flange").only_tip(("tool",), frames)


@pytest.mark.parametrize(
    ("asset", "world", "found"),
    [
        ('<hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/>', "", "numbers in all"),
        ('<hfield name="h" nrow="2000" ncol="2000" size="1 1 1 1"/>', "", None),
        ('<hfield nrow="2000" ncol="2000" size="1 1 1 1"/>' * 6, "", "numbers in all"),
        ('<texture name="t" type="cube" builtin="flat" width="9999"/>', "", "numbers in all"),
        ('<mesh name="m" builtin="supersphere" params="5000 1 1"/>', "", "numbers in all"),
        ('<mesh name="m" builtin="supersphere" params="32 1.5 2.55"/>', "", None),
        ("", '<flexcomp name="f" type="grid" count="25 25 25"/>', "numbers in all"),
        ('<include file="part.xml"/>' * 6, "", "numbers in all"),
        ("", '<replicate count="6"><include file="part.xml"/></replicate>', "numbers in all"),
        ('<model file="part.xml"/>' * 6, "", "numbers in all"),
        ("", f'<geom user="{"1 " * 5000}"/>' + "<body/>" * 5000, "numbers in all"),
        (
            '<model name="m" file="many.xml"/>',
            '<replicate count="30"><attach model="m"/></replicate>',
            "20000 elements",
        ),
        ("", '<attach model="m"/>', "each <model> before the <attach>"),
    ],
)
def test_sizes_that_multiply_are_refused_before_mujoco_makes_anything(tmp_path, asset, world, found):
    """MuJoCo took 8 to 12 GB for some of these, or minutes."""
    (tmp_path / "part.xml").write_text("<mujocoinclude><hfield nrow='2000' ncol='2000'/></mujocoinclude>")
    (tmp_path / "many.xml").write_text(f"<mujoco><worldbody>{'<body/>' * 1000}</worldbody></mujoco>")
    path = tmp_path / "robot.xml"
    path.write_text(f"<mujoco><asset>{asset}</asset><worldbody>{world}</worldbody></mujoco>")
    if found is None:
        return check_mjcf(path)
    with pytest.raises(InputError, match=found) as caught:
        check_mjcf(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 800


@given(st.tuples(*[st.floats(-5, 5)] * 3))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_the_hand_is_a_rotation_whose_minus_z_is_outward(outward):
    length = np.linalg.norm(outward)
    assume(length > 1e-6)
    R = ArmChoice(outward=outward).hand
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1)
    np.testing.assert_allclose(-R[:, 2], np.array(outward) / length, atol=1e-14)


def test_the_hand_of_a_flange_has_exact_zeros():
    np.testing.assert_array_equal(np.abs(ArmChoice().hand), np.eye(3))


@pytest.mark.parametrize(
    ("value", "limits", "turns", "asked"),
    [
        (45, (-2.9, 2.9), True, r"45\.0; allowed: from -2\.9 to 2\.9 rad.* degrees"),
        (-90, (-np.inf, np.inf), True, r"-90\.0; allowed: from -12\.5664 to 12\.5664 rad.* degrees"),
        (30, (0.0, 0.04), False, r"30\.0; allowed: from 0 to 0\.04 m.* millimetres"),
    ],
)
def test_positions_of_locked_joints_in_degrees_or_millimetres_are_asked_about(value, limits, turns, asked):
    with pytest.raises(InputError, match=rf"^locked\.elbow: got {asked}\?$"):
        ArmChoice(locked={"elbow": value}).check_locked("elbow", *limits, turns=turns)
    for right in (limits[1], 0.0):
        if np.isfinite(right):
            ArmChoice(locked={"elbow": right}).check_locked("elbow", *limits, turns=turns)
