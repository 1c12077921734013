"""Robot arms and a human arm in space, as published; a rope for the robots."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from whiptool.models.capsules import Capsule
from whiptool.models.parameters import Model
from whiptool.models.profile import WhipProfile
from whiptool.models.spatial_arm import IDENTITY, JointLimits, Matrix, SpatialArm, SpatialLink, Vector
from whiptool.models.stick import with_stick
from whiptool.models.whip import WhipParameters

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_NOTHING = (0.0,) * 6  # inertia of a massless link
_HALF_X: Matrix = ((1, 0, 0), (0, -1, 0), (0, 0, -1))  # half a turn about x: the whip goes on along the flange's z


def _roll(quarters: int) -> Matrix:
    """Return the rotation by quarter turns about x."""
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    return ((1, 0, 0), (0, c, -s), (0, s, c))


# ---------------------------------------------------------------------------------------------------------------------
# Nah et al. 2023 (iScience): right arm of a person, hinges of the shoulder at one point, in this order: flexion,
# adduction and abduction, rotation. Masses, centres and inertias of their MuJoCo model.


def _human_arm() -> SpatialArm:
    def massless(axis: Vector) -> SpatialLink:
        return SpatialLink(0.0, (0, 0, 0), _NOTHING, axis, (0, 0, 0))

    upper = SpatialLink(1.595, (0, 0, -0.129), (0.011917, 0.011937, 0.001325, 0, 0, 0), _Z, (0, 0, 0))
    fore = SpatialLink(0.869, (0, 0, -0.112), (0.004765, 0.004855, 0.000472, 0, 0, 0), (0, -1, 0), (0, 0, -0.294))
    return SpatialArm(
        (massless((0, -1, 0)), massless((-1, 0, 0)), upper, fore),
        joints=("shoulder_flexion", "shoulder_abduction", "shoulder_rotation", "elbow"),
        hand_position=(0, 0, -0.291),
    )


NAH2023 = Model(
    name="nah2023",
    arm=_human_arm(),
    # nodes are spheres of radius 0.02 m: 2/5 m r^2
    whip=WhipParameters(
        N=25, l=0.072, m=0.012, k=0.242, b=0.092, joints="universal", node_inertia=0.4 * 0.012 * 0.02**2
    ),
)


# ---------------------------------------------------------------------------------------------------------------------
# A rope on a stick, for robots: "Point It, Strike It" (2026), rope of 1 m, radius 6.35 mm, 700 kg/m^3, E = 2e5 Pa;
# stick of 0.65 m. Not published, and chosen here: the rope's damping, by a retardation time of 0.1 s; the stick's mass,
# that of 16 mm of beech, 700 kg/m^3; that air does not brake the rope.

_RADIUS, _DENSITY, _YOUNG, _RETARDATION = 6.35e-3, 700.0, 2e5, 0.1
STICK = {"length": 0.65, "mass": 0.09}


def rope(N: int = 20, *, joints: Literal["rod", "universal"] = "rod") -> WhipParameters:
    """Return the rope as N rods, which bend alike all around, as a rope does.

    Universal nodes in their place have a cord's moment of inertia about themselves, m r^2 / 2.
    """
    stiffness = _YOUNG * math.pi * _RADIUS**4 / 4  # EI of a round section
    density = _DENSITY * math.pi * _RADIUS**2
    profile = WhipProfile(
        length=1.0,
        linear_density=density,
        bending_stiffness=stiffness,
        bending_damping=_RETARDATION * stiffness,
    )
    inertia = density / N * _RADIUS**2 / 2 if joints == "universal" else 0.0
    return profile.lump(N, joints=joints, node_inertia=inertia)


# ---------------------------------------------------------------------------------------------------------------------
# Universal Robots UR5e. Joints: the maker's Denavit-Hartenberg parameters, as in ur_description's
# ur5e/default_kinematics.yaml (d1 .1625, a2 -.425, a3 -.3922, d4 .1333, d5 .0997, d6 .0996). Masses, centres and
# inertias: ur5e/physical_parameters.yaml, after the maker's page of parameters for dynamics. Limits:
# ur5e/joint_limits.yaml, after the user manual and the maker's page of joint torques; accelerations are not published.
# Rotor inertia and friction are not published: none. The base frame is `base_link`, the flange's is `tool0`.

_UR5E_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_UR5E_PLACES = (  # position [m], rotation
    ((0, 0, 0.1625), ((-1, 0, 0), (0, -1, 0), (0, 0, 1))),  # base_link to base_link_inertia: half a turn about z
    ((0, 0, 0), _roll(1)),
    ((-0.425, 0, 0), IDENTITY),
    ((-0.3922, 0, 0.1333), IDENTITY),
    ((0, -0.0997, 0), _roll(1)),
    ((0, 0.0996, 0), _roll(-1)),
)
_UR5E_BODIES = (  # mass [kg], centre of mass [m], quarter turns about x of the inertia's axes, inertia [kg m^2]
    (3.761, (0, -0.00193, -0.02561), 1,
     (0.00700210, 0.00648091, 0.00657286, 0.00000073, -0.00001053, 0.00049994)),
    (8.058, (-0.2125, 0, 0.11336), 0,
     (0.01505885, 0.33388086, 0.33247207, -0.00005400, 0.00000563, -0.00000181)),
    (2.846, (-0.2422, 0, 0.0265), 0,
     (0.00399632, 0.07879254, 0.07848510, -0.00001365, 0.00137272, -0.00000660)),
    (1.37, (0, -0.01634, -0.0018), 1,
     (0.00165491, 0.00135962, 0.00126279, -0.00000282, -0.00000438, 0.00010157)),
    (1.3, (0, 0.01634, -0.0018), -1,
     (0.00135617, 0.00127827, 0.00096614, -0.00000274, 0.00000444, -0.00005048)),
    (0.365, (0, 0, -0.001159), 0,
     (0.00018694, 0.00018908, 0.00025756, 0.00000006, -0.00000017, -0.00000092)),
)  # fmt: skip
# Capsules: the collision shapes of MuJoCo Menagerie's universal_robots_ur5e/ur5e.xml, moved into these frames; the
# flange, a cylinder there, has a capsule's round ends here. The base, which has none there: as
# thick as its footprint (149 mm, the maker's technical details of the UR5e; the mesh of the UR5's base, which has the
# same footprint, in ur_description's meshes/ur5/collision/base.stl, is 147 mm wide, except a plug that stands out by
# 36 mm), 0.1 m high, where the shoulder begins.
_UR5E_BASE = Capsule((0, 0, 0), (0, 0, 0.025), 0.0745)
_UR5E_CAPSULES = (  # segment from, to [m], radius [m]
    (Capsule((0, 0, -0.1), (0, 0, 0.02), 0.06),),
    (Capsule((0, 0, 0.038), (0, 0, 0.158), 0.06), Capsule((0, 0, 0.138), (-0.4, 0, 0.138), 0.05)),
    (Capsule((0, 0, 0.027), (0, 0, 0.147), 0.055), Capsule((-0.01, 0, 0.007), (-0.39, 0, 0.007), 0.038)),
    (Capsule((0, 0, -0.1463), (0, 0, -0.0063), 0.04),),
    (
        Capsule((0, 0.0007, -0.1197), (0, 0.0007, 0.0003), 0.04),
        Capsule((0, -0.0193, 0.0003), (0, 0.0607, 0.0003), 0.04),
    ),
    (Capsule((0, 0, -0.0389), (0, 0, 0.0011), 0.04),),
)
_UR5E_TORQUES = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)  # [N m]


def _turned(inertia: tuple[float, ...], rotation: Matrix) -> tuple[float, ...]:
    """Return an inertia given in turned axes in those that they are turned from."""
    xx, yy, zz, xy, xz, yz = inertia
    R = np.array(rotation)
    moments = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T
    return tuple(moments[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist())


def _ur5e() -> SpatialArm:
    links = []
    for name, (position, rotation), (mass, com, quarters, inertia), torque, capsules in zip(
        _UR5E_JOINTS, _UR5E_PLACES, _UR5E_BODIES, _UR5E_TORQUES, _UR5E_CAPSULES, strict=True
    ):
        farthest = math.pi if name == "elbow" else 2 * math.pi  # [rad]
        limits = JointLimits(position=(-farthest, farthest), velocity=math.pi, torque=torque)
        about_com = _turned(inertia, _roll(quarters))
        links.append(SpatialLink(mass, com, about_com, _Z, position, rotation, limits=limits, capsules=capsules))
    return SpatialArm(tuple(links), _UR5E_JOINTS, hand_rotation=_HALF_X, base=(_UR5E_BASE,))


# ---------------------------------------------------------------------------------------------------------------------
# Franka Emika Panda, without its gripper. Joints: franka_description's fer/kinematics.yaml. Masses, centres and
# inertias, which the maker does not publish: identified by Gaz et al. 2019 (RA-L 4(4), 4147-4154), as in
# franka_description and MuJoCo Menagerie. Limits: the maker's "Control parameters specifications", limits for Panda.

_PANDA_PLACES = (  # position [m], quarter turns about x
    ((0, 0, 0.333), 0),
    ((0, 0, 0), -1),
    ((0, -0.316, 0), 1),
    ((0.0825, 0, 0), 1),
    ((-0.0825, 0.384, 0), -1),
    ((0, 0, 0), 1),
    ((0.088, 0, 0), 1),
)
_PANDA_FLANGE = (0.0, 0.0, 0.107)  # [m]
_PANDA_BODIES = (  # mass [kg], centre of mass [m], inertia [kg m^2]
    (4.970684, (0.003875, 0.002081, -0.04762), (0.70337, 0.70661, 0.0091170, -0.00013900, 0.0067720, 0.019169)),
    (0.646926, (-0.003141, -0.02872, 0.003495), (0.0079620, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704)),
    (3.228604, (0.027518, 0.039252, -0.066502), (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805)),
    (3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641)),
    (1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229)),
    (1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341)),
    (0.735522, (0.010517, -0.004252, 0.061597), (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741)),
)
_PANDA_LIMITS = (  # lowest, highest [rad], velocity [rad/s], acceleration [rad/s^2], jerk [rad/s^3], torque [N m]
    (-2.8973, 2.8973, 2.1750, 15.0, 7500.0, 87.0),
    (-1.7628, 1.7628, 2.1750, 7.5, 3750.0, 87.0),
    (-2.8973, 2.8973, 2.1750, 10.0, 5000.0, 87.0),
    (-3.0718, -0.0698, 2.1750, 12.5, 6250.0, 87.0),
    (-2.8973, 2.8973, 2.6100, 15.0, 7500.0, 12.0),
    (-0.0175, 3.7525, 2.6100, 20.0, 10000.0, 12.0),
    (-2.8973, 2.8973, 2.6100, 20.0, 10000.0, 12.0),
)
_PANDA_TORQUE_RATE = 1000.0  # [N m/s], of every joint
# Capsules: the maker's coarse shapes of the robot's own check of self-collision, franka_description's
# robots/common/franka_arm.xacro; the last of them is turned by 45 degrees there. Links 1 and 3, whose
# capsules meet at the end of joint 2, are not compared, as in panda_moveit_config's config/panda_arm.xacro.
_HALF_ROOT = 0.055 / math.sqrt(2), 0.065 / math.sqrt(2)
_PANDA_BASE = Capsule((-0.09, 0, 0.06), (-0.06, 0, 0.06), 0.06)
_PANDA_CAPSULES = (  # segment from, to [m], radius [m]
    (Capsule((0, 0, -0.333), (0, 0, -0.05), 0.06),),
    (Capsule((0, 0, -0.06), (0, 0, 0.06), 0.06),),
    (Capsule((0, 0, -0.22), (0, 0, -0.07), 0.06),),
    (Capsule((0, 0, -0.06), (0, 0, 0.06), 0.06),),
    (Capsule((0, 0, -0.31), (0, 0, -0.21), 0.06), Capsule((0, 0.08, -0.2), (0, 0.08, -0.06), 0.025)),
    (Capsule((0, 0, -0.07), (0, 0, 0.01), 0.05),),
    (
        Capsule((0, 0, -0.06), (0, 0, 0.08), 0.04),
        Capsule((_HALF_ROOT[0], _HALF_ROOT[0], 0.082), (_HALF_ROOT[1], _HALF_ROOT[1], 0.082), 0.03),
    ),
)


def _panda() -> SpatialArm:
    links = []
    for (position, quarters), (mass, com, inertia), (low, high, velocity, acceleration, jerk, torque), capsules in zip(
        _PANDA_PLACES, _PANDA_BODIES, _PANDA_LIMITS, _PANDA_CAPSULES, strict=True
    ):
        limits = JointLimits((low, high), velocity, acceleration, jerk, torque, _PANDA_TORQUE_RATE)
        rotation = _roll(quarters)
        links.append(SpatialLink(mass, com, inertia, _Z, position, rotation, limits=limits, capsules=capsules))
    return SpatialArm(
        tuple(links),
        hand_position=_PANDA_FLANGE,
        hand_rotation=_HALF_X,
        base=(_PANDA_BASE,),
        never_touch=(("joint1", "joint3"),),
    )


UR5E_ARM, PANDA_ARM = _ur5e(), _panda()  # without a tool
UR5E = Model(name="ur5e", arm=with_stick(UR5E_ARM, **STICK), whip=rope())
PANDA = Model(name="panda", arm=with_stick(PANDA_ARM, **STICK), whip=rope())
