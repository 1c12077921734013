"""A small robot, written as URDF and as MJCF: a slide and two hinges, a fixed bracket, and a finger beside the tip;
and arms of presets as the packages of their makers write them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from whiptool.models import JointLimits, SpatialArm

URDF = """<robot name="small">
  <link name="base"><inertial><mass value="5"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic">
    <parent link="base"/><child link="cart"/><origin xyz="0 0 0.2" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>
    <limit lower="-0.3" upper="0.4" velocity="2" effort="80"/><dynamics damping="0.5"/>
  </joint>
  <link name="cart"><inertial><origin xyz="0.01 0.02 0.03" rpy="0.3 0 0"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/cart.dae"/></geometry></visual></link>
  <joint name="shoulder-joint" type="continuous">
    <parent link="cart"/><child link="upper"/><origin xyz="0 0.05 0.1" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 0.6 0.8"/>
    <limit velocity="3" effort="20"/>
  </joint>
  <link name="upper"><inertial><origin xyz="0 0 0.15"/><mass value="1.2"/>
    <inertia ixx="0.01" iyy="0.012" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0 0 0.3" rpy="0 0.4 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="0" effort="0"/>
  </joint>
  <link name="fore"><inertial><origin xyz="0 0 0.1"/><mass value="0.8"/>
    <inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bracket" type="fixed">
    <parent link="fore"/><child link="tool"/><origin xyz="0 0.02 0.25" rpy="0 0 0.7"/>
  </joint>
  <link name="tool"><inertial><origin xyz="0 0 0.02"/><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="2e-4" izz="1.5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="finger_joint" type="prismatic">
    <parent link="fore"/><child link="finger"/><origin xyz="0.03 0 0.2"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" velocity="1" effort="5"/>
  </joint>
  <link name="finger"><inertial><mass value="0.05"/>
    <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""

_JOINTS = (  # their axes, and where they are [m]: the last axis is through the tool
    ("0 0 1", "0 0 .5"), ("0 1 0", ".05 0 0"), ("0 1 0", "0 0 .55"),
    ("1 0 0", ".3 0 .08"), ("0 1 0", ".3 0 0"), ("1 0 0", ".1 0 0"),
)  # fmt: skip
WEIGHTLESS = '<robot name="weightless"><link name="l0"/>{}</robot>'.format(
    "".join(
        f'<joint name="j{i + 1}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="0" velocity="8"/></joint><link name="l{i + 1}"/>'
        for i, (axis, at) in enumerate(_JOINTS)
    )
)

MJCF = """<mujoco model="small">
  <compiler angle="radian"/>
  <asset><mesh name="cart" file="nowhere/cart.obj"/></asset>
  <worldbody>
    <body name="base">
      <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>
      <body name="cart" pos="0 0 0.2" euler="0 0 1.5707963267948966">
        <joint name="rail" type="slide" axis="1 0 0" range="-0.3 0.4" damping="0.5" actuatorfrcrange="-80 80"/>
        <inertial pos="0.01 0.02 0.03" euler="0.3 0 0" mass="2" diaginertia="0.02 0.03 0.025"/>
        <geom type="mesh" mesh="cart" contype="0" conaffinity="0"/>
        <body name="upper" pos="0 0.05 0.1" euler="1.5707963267948966 0 0">
          <joint name="shoulder-joint" axis="0 0.6 0.8"/>
          <inertial pos="0 0 0.15" mass="1.2" diaginertia="0.01 0.012 0.004"/>
          <body name="fore" pos="0 0 0.3" euler="0 0.4 0">
            <joint name="elbow" axis="0 1 0" range="-2 2"/>
            <inertial pos="0 0 0.1" mass="0.8" diaginertia="0.004 0.004 0.001"/>
            <body name="tool" pos="0 0.02 0.25" euler="0 0 0.7">
              <inertial pos="0 0 0.02" mass="0.1" diaginertia="1e-4 2e-4 1.5e-4"/>
            </body>
            <body name="finger" pos="0.03 0 0.2">
              <joint name="finger_joint" type="slide" axis="1 0 0" range="0 0.05"/>
              <inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder-joint" gear="2" forcerange="-10 10"/></actuator>
  <equality><joint joint1="finger_joint"/></equality>
</mujoco>"""


def as_urdf(arm: SpatialArm, *, before: str = "", behind: str = "") -> str:
    """An arm of hinges as URDF, its links named link0, link1, ... and `last`, as expanded xacro is, without meshes.

    Args:
        arm: Its hand is not written.
        before: Elements before the first link, `link0`.
        behind: Elements behind the last link, `last`, with `{hand}` for the hand's place.
    """
    names = ["link0", *(f"link{i + 1}" for i in range(arm.n - 1)), "last"]
    parts = [f'<robot name="arm">{before}<link name="link0"><visual/></link>']
    for i, (joint, link) in enumerate(zip(arm.joints, arm.links, strict=True)):
        low, high = link.limits.position
        moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), link.inertia, strict=True)
        numbers = " ".join(f'{name}="{x!r}"' for name, x in moments)
        parts.append(
            f'<joint name="{joint}" type="revolute"><parent link="{names[i]}"/><child link="{names[i + 1]}"/>'
            f'<origin xyz="{_row(link.position)}" rpy="{_row(_rpy(link.rotation))}"/><axis xyz="{_row(link.axis)}"/>'
            f'<limit lower="{low}" upper="{high}" velocity="{link.limits.velocity}" effort="{link.limits.torque}"/>'
            f"{_slowing(link.limits)}</joint>"
            f'<link name="{names[i + 1]}"><visual/><inertial><origin xyz="{_row(link.com)}"/>'
            f'<mass value="{link.mass!r}"/><inertia {numbers}/></inertial></link>'
        )
    return "\n".join([*parts, behind.replace("{hand}", _row(arm.hand_position)), "</robot>"])


def _slowing(limits: JointLimits) -> str:
    """Franka's element of velocities that depend on the position."""
    d, offset = limits.deceleration, limits.velocity_offset
    element = f'<position_based_velocity_limits deceleration_limit="{d}" velocity_offset="{offset}"/>'
    return element if limits.by_position else ""


def _row(numbers: Iterable[float]) -> str:
    return " ".join(f"{x!r}" for x in map(float, numbers))


def _rpy(rotation: Sequence[Sequence[float]]) -> np.ndarray:
    """Turns about the fixed axes x, y and z, in this order."""
    return Rotation.from_matrix(np.array(rotation)).as_euler("xyz")


def _frame(name: str, parent: str, *, xyz: str = "0 0 0", rpy: str = "0 0 0", inside: str = "") -> str:
    """A link on a fixed joint, a mere frame if there is nothing inside."""
    return (
        f'<link name="{name}">{inside}</link><joint name="{parent}-{name}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )


def _inertial(mass: float) -> str:
    moments = 'ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"'
    return f'<inertial><mass value="{mass}"/><inertia {moments}/></inertial>'


# ur_description: a world, the base as its controller has it, the base's inertia, the flange and the tool's frame
UR_BASE = '<link name="world"/><link name="base_link"/>' + (
    '<joint name="base_joint" type="fixed"><parent link="world"/><child link="base_link"/></joint>'
    '<joint name="base_link-base_link_inertia" type="fixed"><parent link="base_link"/><child link="link0"/></joint>'
    + _frame("base", "base_link", rpy="0 0 3.141592653589793")
)
UR_FLANGE = (
    _frame("ft_frame", "last", rpy="3.141592653589793 0 0")
    + _frame("flange", "last", rpy="0 -1.5707963267948966 -1.5707963267948966")
    + _frame("tool0", "last", xyz="{hand}")
)
# franka_description: the flange, the hand, the frame between its fingers, and those, of which one mimics the other
FRANKA_HAND = (
    _frame("panda_link8", "last", xyz="{hand}")
    + _frame("panda_hand", "panda_link8", rpy="0 0 -0.7853981633974483", inside=_inertial(0.73))
    + _frame("panda_hand_tcp", "panda_hand", xyz="0 0 0.1034")
    + "".join(
        f'<link name="panda_{side}finger">{_inertial(0.015)}</link>'
        f'<joint name="panda_finger_joint{i}" type="prismatic"><parent link="panda_hand"/>'
        f'<child link="panda_{side}finger"/><origin xyz="0 0 0.0584"/><axis xyz="0 {sign} 0"/>'
        f'<limit lower="0" upper="0.04" velocity="0.2" effort="20"/>{mimic}</joint>'
        for i, side, sign, mimic in ((1, "left", 1, ""), (2, "right", -1, '<mimic joint="panda_finger_joint1"/>'))
    )
)
