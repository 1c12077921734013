"""Arm, whip and scene in MuJoCo: bodies, light, floor, board, target, materials and cameras."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import IDENTITY, SpatialArm, is_possible
from whiptool.models.whip import WhipParameters
from whiptool.rollout.mujoco_import import mujoco

FLOOR = 1.12  # how far the floor is below the base, in reaches

# Colour-blind safe (Okabe-Ito)
_BLUE, _ORANGE, _VERMILION = (0.0, 0.45, 0.70, 1), (0.90, 0.62, 0.0, 1), (0.84, 0.37, 0.0, 1)

_PALE_ORANGE, _GREY, _DARK = (0.88, 0.70, 0.36, 1), (0.35, 0.35, 0.4, 1), (0.13, 0.13, 0.16, 1)


_SHORTEST = 1e-9  # [m] of a link that is drawn: MuJoCo has no capsules without length
_VISUAL = {"contype": 0, "conaffinity": 0, "mass": 0.0}  # shapes that are seen and do nothing


def add_capsule(body: mujoco.MjsBody, end: Sequence[float], radius: float, material: str) -> None:
    """Add a capsule of a radius [m] from the body's origin to a point in its frame (3,) [m], unless that is there."""
    if np.linalg.norm(end) < _SHORTEST:
        return
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, *end],
        size=[radius, 0, 0],
        material=material,
        **_VISUAL,
    )


def add_ball(body: mujoco.MjsBody, radius: float, material: str, position: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    """Add a ball of a radius [m] at a point in the body's frame (3,) [m]."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=list(position), size=[radius, 0, 0], material=material, **_VISUAL
    )


def add_target(spec: mujoco.MjSpec, target: np.ndarray, radius: float, reach: float) -> None:
    """Add a target: a disc just behind the strike plane, so that it never hides the tip; in space two concentric
    balls."""
    if len(target) == 3:
        body = spec.worldbody.add_body(name="target", pos=[float(x) for x in target])
        add_ball(body, radius / 4, "target")
        add_ball(body, radius, "target_zone_clear")
        return
    body = spec.worldbody.add_body(name="target", pos=[float(target[0]), 0, float(target[1])])
    for material, size, y in (("target_zone", radius, 0.048), ("target", radius / 4, 0.044)):
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=[0, y * reach, 0, 0, 0.05 * reach, 0],
            size=[size, 0, 0],
            material=material,
            **_VISUAL,
        )


def add_scene(spec: mujoco.MjSpec, model: Model) -> None:
    """Add light, floor, materials and cameras that see the whole reach; in the plane also a board behind it."""
    reach = model.reach
    spec.stat.center, spec.stat.extent = [0.0, 0, 0], 1.2 * reach
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.visual.quality.shadowsize = 2048
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.4] * 3
    spec.visual.headlight.specular = [0.2] * 3
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.97, 0.98, 1.0],
        rgb2=[0.80, 0.85, 0.92],
        width=256,
        height=256,
    )
    for name, rgba in (
        ("arm", _BLUE),
        ("joint", _GREY),
        ("whip", _DARK),
        ("tip", _VERMILION),
        ("target", _ORANGE),
        ("target_zone", _PALE_ORANGE),
        ("target_zone_clear", (*_PALE_ORANGE[:3], 0.35)),
    ):
        spec.add_material(name=name, rgba=rgba, specular=0.3, shininess=0.4)
    # Plain colours: a texture over the whole picture would triple the time that software rendering takes.
    pale = (0.87, 0.885, 0.91, 1)
    for name, rgba in (("board", pale), ("floor", pale if model.dimension == 3 else (0.62, 0.66, 0.72, 1))):
        spec.add_material(name=name, rgba=rgba, specular=0, shininess=0)
    spec.worldbody.add_light(
        pos=[0, -reach, 2 * reach],
        dir=[0.15, 0.6, -1],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.45] * 3,
    )
    floor, board = -FLOOR * reach, 0.06 * reach
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[4 * reach, 4 * reach, 0.1] if model.dimension == 2 else [0, 0, 0.1],  # 0: without end
        pos=[0, 0, floor],
        material="floor",
        **_VISUAL,
    )
    if model.dimension == 3:
        _add_cameras(spec, reach)
        return
    spec.worldbody.add_geom(
        name="board",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[4 * reach, 4 * reach, 0.1],
        pos=[0, board, 0],
        zaxis=[0, -1, 0],
        material="board",
        **_VISUAL,
    )
    _add_camera(spec, "side", *_VIEWS["side"], reach=reach)


# Direction that a camera looks from; its right and its up: orthographic, so that lengths read true
_VIEWS = {
    "side": ([0, -3, 0], [1, 0, 0, 0, 0, 1]),  # x to the right, z up
    "top": ([0, 0, 3], [0, -1, 0, 1, 0, 0]),  # x up, y to the left
    "front": ([3, 0, 0], [0, 1, 0, 0, 0, 1]),  # y to the right, z up
}


def _add_cameras(spec: mujoco.MjSpec, reach: float) -> None:
    """Three projections, and `view`, in perspective from the front left above."""
    for name, (direction, axes) in _VIEWS.items():
        _add_camera(spec, name, direction, axes, reach=reach)
    spec.worldbody.add_camera(
        name="view",
        pos=[1.8 * reach, -2.2 * reach, 1.1 * reach],
        xyaxes=[0.774, 0.633, 0, -0.228, 0.279, 0.933],
        fovy=34,
    )


def _add_camera(spec: mujoco.MjSpec, name: str, direction: list[int], axes: list[int], *, reach: float) -> None:
    spec.worldbody.add_camera(
        name=name,
        pos=[x * reach for x in direction],
        xyaxes=axes,
        fovy=2.14 * reach,  # the height of what it sees [m]
        proj=mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC,
    )


# MuJoCo refuses masses without inertia. This much [kg m^2] on a node of 12 g at 72 mm changes its inertia by 2e-8.
NODE_INERTIA = 1e-12

STAND_IN = 0.1  # [kg m^2 or kg] at joints of an arm of unknown inertia, which MuJoCo could not move without any
_LIGHT = 1e-6  # [kg] of its bodies without mass, which MuJoCo cannot have

_ENDINGS = {1: ("",), 2: ("x", "y")}  # of the names of a node's hinges, by their number


def not_native(model: Model) -> list[str]:
    """Return descriptions of quantities that MJCF cannot represent; `ReferenceRollout` applies them as forces."""
    missing = []
    if model.whip.per_node("drag").any():
        missing.append("quadratic air drag of the nodes")
    if model.whip.per_node("dry_friction").any():
        missing.append("smoothed dry friction of the joints")
    if not model.whip.kind.hinges:
        missing.append("bending stiffness and damping of the rods")
    return missing


def build_spec(
    model: Model, *, target: np.ndarray | None = None, target_radius: float = 0.06, node_inertia: float = NODE_INERTIA
) -> mujoco.MjSpec:
    """Return arm, whip and scene as an MjSpec.

    The arm's joints keep their names; the whip's joints are `whip1` .. `whipN`, for universal joints `whip1x`, `whip1y`
    and so on, for rods ball joints without stiffness and damping. The nodes' bodies are `whip1` .. `whipN`, and the tip
    is the site `tip`.

    Args:
        model: Model of arm and whip.
        target: Position (2,) or, in space, (3,) [m] of a target to show, without effect on the dynamics.
        target_radius: Radius of the target [m].
        node_inertia: Least moment of inertia of each whip node [kg m^2], > 0.

    Raises:
        InputError: A whip of rods is on an arm whose last link has no mass, or no body can have the inertia of a link.
    """
    spec = mujoco.MjSpec()
    spec.modelname = model.name
    spec.option.gravity = [0, 0, -model.gravity]
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    spec.option.timestep = 1e-4
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    add_scene(spec, model)
    if target is not None:
        add_target(spec, target, target_radius, model.reach)
    hand = _add_arm(spec, model.arm.in_space(), model.reach, node_inertia)
    if model.whip.hinge_mass:
        point = (node_inertia, node_inertia, node_inertia, 0, 0, 0)
        grip = hand.add_body("grip", mass=model.whip.hinge_mass, com=(0, 0, 0), inertia=point, least=node_inertia)
        add_ball(grip, 0.016 * model.reach, "joint")
        hand = _Place(grip)
    _add_whip(hand, model.whip, model.reach, node_inertia)
    return spec


@dataclass(frozen=True)
class _Joint:
    """A joint that no body has yet, and where it is in the frame of the body before."""

    name: str
    axis: np.ndarray  # (3,), in the frame of the body before
    position: np.ndarray  # (3,)
    options: dict[str, Any]


@dataclass(frozen=True)
class _Place:
    """Where the next body is, in the frame of the one before, and the joints that it will move about.

    MuJoCo has no bodies without mass; a body has the joints of the massless links before it.
    """

    body: Any
    position: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))
    joints: tuple[_Joint, ...] = ()

    def carried(self, position: Sequence[float], rotation: Sequence[Sequence[float]] = IDENTITY) -> _Place:
        """Farther, by a placement in its own frame."""
        at = self.position + self.rotation @ np.array(position)
        return dataclasses.replace(self, position=at, rotation=self.rotation @ np.array(rotation))

    def with_joint(self, name: str, axis: Sequence[float], **options: Any) -> _Place:
        """With one more joint there."""
        joint = _Joint(name, self.rotation @ np.array(axis), self.position, options)
        return dataclasses.replace(self, joints=(*self.joints, joint))

    def add_body(
        self, name: str, *, mass: float, com: Sequence[float], inertia: Sequence[float], least: float
    ) -> mujoco.MjsBody:
        """A body with all joints that wait for it: its mass [kg], centre of mass [m], inertia about that as in
        `SpatialLink` [kg m^2], and the least principal moment that it gets."""
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, self.rotation.ravel())
        moments = _at_least(name, inertia, least)
        kind = {"fullinertia": moments} if any(moments[3:]) else {"inertia": moments[:3]}
        body = self.body.add_body(
            name=name, pos=self.position, quat=quaternion, mass=mass, ipos=list(com), explicitinertial=True, **kind
        )
        for joint in self.joints:
            at, axis = self.rotation.T @ (joint.position - self.position), self.rotation.T @ joint.axis
            body.add_joint(name=joint.name, pos=at, axis=axis, **joint.options)
        return body


def _at_least(name: str, inertia: Sequence[float], least: float) -> list[float]:
    """Moments of inertia whose principal ones are not below the least, nor the largest above the sum of the others,
    where rounding made it so: MuJoCo refuses that."""
    xx, yy, zz, xy, xz, yz = inertia
    if diagonal := not any(inertia[3:]):
        moments, axes = np.array([xx, yy, zz]), np.eye(3)
    else:
        moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    raised = np.maximum(moments, least)
    a, b, c = np.sort(raised)
    if not is_possible((a, b, c)):
        given = f"principal moments of {a:.4g}, {b:.4g} and {c:.4g} kg m2"
        raise InputError(f"inertia of {name}", given, "three of which none is above the sum of the others")
    if a + b < c * (1.0 if diagonal else 1 + 1e-12):
        raised += np.where(raised < c, (c - a - b) / 2 + 1e-9 * c, 0.0)
    if (raised == moments).all():
        return list(inertia)
    I = (axes * raised) @ axes.T
    return [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]


def _add_arm(spec: mujoco.MjSpec, arm: SpatialArm, reach: float, least: float) -> _Place:
    """Links, joints and motors; returns the place of the hand."""
    place, ends = _Place(spec.worldbody), [link.position for link in arm.links[1:]] + [arm.hand_position]
    stand_in = STAND_IN if arm.weightless else 0.0
    add_capsule(spec.worldbody, arm.links[0].position, 0.025 * reach, "arm")
    for i, (name, link, end) in enumerate(zip(arm.joints, arm.links, ends, strict=True)):
        kind = mujoco.mjtJoint.mjJNT_HINGE if link.kind == "revolute" else mujoco.mjtJoint.mjJNT_SLIDE
        options = {"type": kind, "damping": link.friction, "armature": link.armature + stand_in}
        if np.isfinite(link.limits.position).all():
            options["range"] = link.limits.position
        place = place.carried(link.position, link.rotation).with_joint(name, link.axis, **options)
        if mass := link.mass or (_LIGHT if arm.weightless else 0.0):  # no mass: the joint waits for a body that has
            body = place.add_body(name, mass=mass, com=link.com, inertia=link.inertia, least=least)
            thickness = (0.025 - 0.004 * i / arm.n) * reach
            add_capsule(body, end, thickness, "arm")
            add_ball(body, thickness * 1.25, "joint")
            place = _Place(body)
        actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        actuator.set_to_motor()
    return place.carried(arm.hand_position, arm.hand_rotation)


def _add_whip(place: _Place, whip: WhipParameters, reach: float, least: float) -> None:
    hinges = whip.kind.hinges
    if not hinges and place.joints:
        raise InputError("arm.links", "a last link without mass", "a last link with mass, for a whip of rods in MuJoCo")
    names = ("l", "m", "k", "b", "cubic_stiffness", "node_inertia")
    slack = iter(whip.rest_angles)
    for i, (l, m, k, b, cubic, own) in enumerate(zip(*(whip.per_node(name) for name in names), strict=True)):
        stiffness = [k, 0, cubic]  # MuJoCo's polynomial
        if not hinges:
            place = place.with_joint(f"whip{i + 1}", (0, 0, 1), type=mujoco.mjtJoint.mjJNT_BALL)
        for ending, axis in zip(_ENDINGS.get(len(hinges), ()), hinges, strict=True):
            place = place.with_joint(
                f"whip{i + 1}{ending}",
                axis,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                stiffness=stiffness,
                damping=b,
                springref=next(slack),
            )
        body = place.add_body(f"whip{i + 1}", mass=m, com=(0, 0, -l), inertia=(own,) * 3 + (0.0,) * 3, least=least)
        add_capsule(body, (0, 0, -l), (0.011 - 0.005 * i / whip.N) * reach, "whip")
        place = _Place(body).carried((0, 0, -l))
    add_ball(place.body, 0.02 * reach, "tip", place.position.tolist())
    place.body.add_site(name="tip", pos=place.position, size=[0.005, 0, 0])


def set_posture(model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray) -> None:
    """Set the joint positions q (n,) and update all quantities that depend on them."""
    data.qpos[:] = q
    mujoco.mj_forward(model, data)


def export_xml(model: Model, *, target: np.ndarray | None = None) -> tuple[str, list[str]]:
    """Return MJCF text for MuJoCo's viewer, and descriptions of quantities that it cannot represent."""
    spec = build_spec(model, target=target)
    missing = [*not_native(model), "the controller: joints are driven by plain motors"]
    spec.comment = "Written by whiptool. Not in this file: " + "; ".join(missing) + "."
    spec.compile()
    return spec.to_xml(), missing
