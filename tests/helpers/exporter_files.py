"""A small arm in the manner of ten exporters and makers, written for these tests, and what has to come of each file."""

from __future__ import annotations

from dataclasses import dataclass

from whiptool.models.robot_files import ArmChoice


@dataclass(frozen=True)
class Exported:
    """A robot's file.

    Args:
        text: What it says.
        choice: Which chain is taken.
        joints: Names of the joints that move, as the file has them; none: it is refused.
        refusal: How, as a pattern.
        weightless: Whether its inertia is not known.
    """

    text: str
    choice: ArmChoice | None = None
    joints: tuple[str, ...] = ()
    refusal: str = ""
    weightless: bool = False


BODY = """<inertial><origin xyz="{x} 0.01 0.1" rpy="0.1 0 0.2"/><mass value="{mass}"/>
  <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0.002" izz="0.025"/></inertial>"""
MESH = """<visual><geometry><mesh filename="package://robot/meshes/{name}.STL" scale="0.001 0.001 0.001"/></geometry>
  </visual>"""


def link(name: str, mass: float | None = 1.0, more: str = "") -> str:
    """A link with a mesh that is nowhere; no mass: without `<inertial>`."""
    inertial = "" if mass is None else BODY.format(x=0.02 * mass, mass=mass)
    return f'<link name="{name}">{inertial}{MESH.format(name=name)}{more}</link>'


def joint(
    name: str, parent: str, child: str, *, axis: str = "0 1 0", kind: str = "revolute", limit: str = "", more: str = ""
) -> str:
    """A joint 0.3 m above its parent; of a kind that needs one a limit of 2 rad to both sides."""
    limit = limit or '<limit lower="-2" upper="2" effort="50" velocity="3"/>'
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0.02 0 0.3" rpy="0.1 0.2 0.3"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>{"" if kind in ("fixed", "continuous") else limit}{more}</joint>'
    )


def robot(*parts: str, head: str = '<?xml version="1.0" encoding="utf-8"?>', attributes: str = "") -> str:
    """A URDF file."""
    return f'{head}\n<robot name="arm"{attributes}>' + "\n".join(parts) + "</robot>"


COMMENT = '<?xml version="1.0" encoding="utf-8"?>\n<!-- This URDF was created by an exporter: <robot> -->'
FINGERS = (
    link("left", 0.05), link("right", 0.05),
    joint("left_finger", "c", "left", kind="prismatic",
          limit='<limit lower="0" upper="0.04" effort="9" velocity="1"/>'),
    joint("right_finger", "c", "right", kind="prismatic", more='<mimic joint="left_finger" multiplier="-1"/>',
          limit='<limit lower="-0.04" upper="0" effort="9" velocity="1"/>'),
)  # fmt: skip
THREE = (link("base"), link("a", 2.0), link("b", 1.5), link("c", 0.5))
CHAIN = (joint("j1", "base", "a", axis="0 0 1"), joint("j2", "a", "b"), joint("j3", "b", "c", axis="1 0 0"))
NO_RANGE = '<limit lower="0" upper="0" effort="0" velocity="0"/>'

MENAGERIE = """<mujoco model="arm"><compiler angle="radian" meshdir="assets" autolimits="true"/>
<default><default class="arm"><joint axis="0 1 0" range="-2 2" damping="0.5" armature="0.1"/>
  <general gaintype="fixed" biastype="affine" gainprm="500" biasprm="0 -500 -50" forcerange="-40 40" ctrlrange="-2 2"/>
  <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>
  <default class="collision"><geom type="capsule" group="3"/></default></default></default>
<asset><mesh file="base.obj"/><mesh file="upper.obj"/></asset>
<worldbody><light pos="0 0 1"/><body name="base" childclass="arm"><geom class="visual" mesh="base"/>
  <body name="upper" pos="0 0 0.2" quat="1 0 0 1"><inertial mass="3" pos="0 0.1 0.2" diaginertia="0.1 0.09 0.02"/>
    <joint name="shoulder" axis="0 0 1"/><geom class="visual" mesh="upper"/>
    <geom class="collision" size="0.05" fromto="0 0 0 0 0 0.3"/>
    <body name="fore" pos="0.1 0 0.4"><inertial mass="1" pos="0 0 0.1" diaginertia="0.02 0.02 0.01"/>
      <joint name="elbow"/><geom class="collision" size="0.04 0.1" pos="0 0 0.1"/>
      <site name="attachment" pos="0 0 0.3"/>
</body></body></body></worldbody>
<actuator><general class="arm" name="a1" joint="shoulder"/>
  <general class="arm" name="a2" joint="elbow" forcerange="-9 9"/></actuator>
<keyframe><key name="home" qpos="0 1" ctrl="0 1"/></keyframe></mujoco>"""

SHAPES = "<collision><geometry><{}/></geometry></collision>".format
EXPORTED = {
    # SolidWorks: limits that nobody filled in
    "solidworks.urdf": Exported(
        robot(*THREE, *(text.replace('lower="-2" upper="2"', 'lower="0" upper="0"') for text in CHAIN), head=COMMENT),
        refusal=r"joint j1: got 'lower 0 and upper 0'; allowed: a <limit> whose lower is below its upper, or type=",
    ),
    # onshape-to-robot: a link and a joint of one name, and frames as links of nearly no mass
    "onshape.urdf": Exported(
        robot(link("base"), link("shoulder", 2.0), link("elbow", 1.0), link("tool", 1e-9),
              joint("shoulder", "base", "shoulder"), joint("elbow", "shoulder", "elbow", axis="1 0 0"),
              joint("tool_frame", "elbow", "tool", kind="fixed"), head=COMMENT),
        joints=("shoulder", "elbow"),
    ),
    # Fusion2URDF: joints called after timelines, transmissions, joints that turn on and on
    "fusion.urdf": Exported(
        robot(*THREE[:3], joint("Rev 1", "base", "a", kind="continuous", axis="0 0 1"), joint("Rev 2", "a", "b"),
              '<transmission name="Rev 1_tran"><joint name="Rev 1"><hardwareInterface>x</hardwareInterface></joint>'
              "</transmission><gazebo><plugin name='control' filename='x.so'/></gazebo>"),
        joints=("Rev 1", "Rev 2"),
    ),
    # xacro: materials, a world, a dead end and a tool frame
    "xacro.urdf": Exported(
        robot('<material name="grey"><color rgba="1 1 1 1"/></material><link name="world"/><link name="tool0"/>',
              '<link name="optical"/>', *THREE, *CHAIN, joint("fix", "world", "base", kind="fixed"),
              joint("flange", "c", "tool0", kind="fixed"), joint("camera", "b", "optical", kind="fixed"),
              attributes=' xmlns:xacro="http://wiki.ros.org/xacro"'),
        joints=("j1", "j2", "j3"),
    ),
    # MuJoCo Menagerie: classes, meshes apart, affine servos
    "menagerie.xml": Exported(MENAGERIE, joints=("shoulder", "elbow")),
    # Isaac: balls for collision, a joint that closes a loop of the gripper in an element of its own
    "isaac.urdf": Exported(
        robot(link("base", more=SHAPES('cylinder radius="0.1" length="0.1"')),
              *(link(name, 1.0, SHAPES('sphere radius="0.06"')) for name in "ab"), *CHAIN[:2],
              '<loop_joint name="loop" type="spherical"><link1 link="a"/><link2 link="b"/></loop_joint>'),
        joints=("j1", "j2"),
    ),
    # Gazebo: extensions of SDF, whose prefixes nothing declares
    "gazebo.urdf": Exported(
        robot(*THREE, *CHAIN, '<gazebo reference="a"><ignition:contact ignition:mu="1"/><selfCollide>0</selfCollide>'
              "</gazebo>"),
        joints=("j1", "j2", "j3"),
    ),
    # Drake: an undeclared prefix, rotors
    "drake.urdf": Exported(
        robot(*THREE[:3], CHAIN[0], joint("j2", "a", "b", more='<drake:rotor_inertia value="1e-4"/>'
              '<drake:gear_ratio value="100"/>')),
        joints=("j1", "j2"),
    ),
    # KUKA: meshes without masses
    "kuka.urdf": Exported(
        robot(*(link(name, None) for name in ("base", "a", "b", "c")), *CHAIN),
        joints=("j1", "j2", "j3"), weightless=True,
    ),
    # xArm: fingers that mimic each other behind the wrist; the tip has to be named
    "xarm.urdf": Exported(
        robot(*THREE, *CHAIN, *FINGERS), refusal=r"tip: got 'none'.*branches: left, right; give --arm-tip NAME"
    ),
    "kinova.urdf": Exported(
        robot(*THREE, *CHAIN, *FINGERS, '<link name="end_effector"/>', joint("ee", "c", "end_effector", kind="fixed")),
        ArmChoice(tip="end_effector"), joints=("j1", "j2", "j3"),
    ),
}  # fmt: skip
