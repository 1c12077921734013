"""Shapes of a robot's file that touch at rest: which pairs are left out, by hand."""

from __future__ import annotations

import numpy as np

from whiptool.models import Model
from whiptool.models.arm_choice import ArmChoice
from whiptool.models.arm_files import read_robot
from whiptool.models.robots import rope
from whiptool.models.scene import Scene

LINK = """<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><geometry><cylinder radius="{radius}" length="0.4"/></geometry></collision></link>"""
JOINT = """<joint name="j{i}" type="revolute"><parent link="l{before}"/><child link="l{i}"/><origin xyz="0 0 {step}"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint>"""


def robot(step: float) -> str:
    """Upright cylinders 0.4 m long, one every `step` metres."""
    joints = "".join(JOINT.format(i=i, before=i - 1, step=step) for i in (1, 2, 3))
    return f'<robot name="r">{"".join(LINK.format(i=i, radius=0.1) for i in range(4))}{joints}</robot>'


def test_pairs_that_touch_at_rest_are_left_out_and_said(tmp_path):
    """Every 0.15 m: the base reaches into the second link, but not into the third; with round ends it would."""
    path = tmp_path / "r.urdf"
    path.write_text(robot(0.15))
    arm = read_robot(path)
    assert arm.never_touch == (("base", "j2"), ("j1", "j3"))
    assert "base and j2, j1 and j3" in arm.notes[0]
    whip = rope(3)
    pairs = {scene.links_of(pair) for scene in (Scene(Model(whip, arm), of=of) for of in ("close", "apart"))
             for pair in scene.pairs}  # fmt: skip
    assert pairs == {(-1, 2)}
    asked = read_robot(path, ArmChoice(never_touch=[("j1", "j3")]))
    assert asked.never_touch == (("j1", "j3"),)
    assert asked.notes == ()


def test_flat_ends_are_flat(tmp_path):
    """Every 0.25 m: between the base and the second link are 0.1 m, where round ends would overlap by as much."""
    path = tmp_path / "r.urdf"
    path.write_text(robot(0.25))
    arm = read_robot(path)
    assert arm.never_touch == ()
    assert Scene(Model(rope(3), arm), of="close").distances(np.zeros((1, 3)))[0].min() > 0.09
