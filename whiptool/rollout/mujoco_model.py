"""The model in MuJoCo, built through MjSpec: MuJoCo's x is our x, its z our y."""

from __future__ import annotations

import numpy as np

from whiptool.models.parameters import Model
from whiptool.rollout.mujoco_import import mujoco

# MuJoCo refuses masses without inertia. This much [kg m^2] on a node of 12 g at 72 mm changes its inertia by 2e-8.
NODE_INERTIA = 1e-12

# Colour-blind safe (Okabe-Ito)
_BLUE, _ORANGE, _VERMILION = (0.0, 0.45, 0.70, 1), (0.90, 0.62, 0.0, 1), (0.84, 0.37, 0.0, 1)
_PALE_ORANGE, _GREY, _DARK = (0.88, 0.70, 0.36, 1), (0.35, 0.35, 0.4, 1), (0.13, 0.13, 0.16, 1)


def not_native(model: Model) -> list[str]:
    """What MuJoCo's file format cannot hold of this model, in words; the reference rollout adds it as forces."""
    missing = []
    if model.whip.per_node("drag").any():
        missing.append("quadratic air drag of the nodes")
    if model.whip.per_node("dry_friction").any():
        missing.append("smoothed dry friction of the joints")
    return missing


def build_spec(
    model: Model, *, target: np.ndarray | None = None, target_radius: float = 0.06, node_inertia: float = NODE_INERTIA
) -> mujoco.MjSpec:
    """Arm, whip and scene; joints are `shoulder`, `elbow`, `whip1` .. `whipN`, the tip is the site `tip`.

    Args:
        model: Whip, arm, gravity.
        target: Position (2,) [m] of a target to show; it takes no part in the dynamics.
        target_radius: [m]
        node_inertia: Inertia of each whip node [kg m^2], > 0.
    """
    spec = mujoco.MjSpec()
    spec.modelname = model.name
    spec.option.gravity = [0, 0, -model.gravity]
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    spec.option.timestep = 1e-4
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    _scene(spec, model)
    if target is not None:
        _add_target(spec, target, target_radius, model.reach)

    arm, whip = model.arm, model.whip
    parent, at = spec.worldbody, [0.0, 0.0, 0.0]
    for i, (name, link) in enumerate(zip(arm.joints, arm.links, strict=True)):
        assert link.com is not None
        assert link.inertia is not None
        thickness = (0.025 - 0.004 * i / arm.n) * model.reach
        body = _link(
            parent, name, at, mass=link.mass, com=link.com, inertia=max(link.inertia, node_inertia), tiny=node_inertia
        )
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0], damping=link.friction)
        _capsule(body, link.length, thickness, "arm")
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[thickness * 1.25, 0, 0], material="joint", **_VISUAL)
        actuator = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        actuator.set_to_motor()
        parent, at = body, [0.0, 0.0, -link.length]
    if whip.hinge_mass:
        grip = parent.add_body(
            name="grip", pos=at, mass=whip.hinge_mass, ipos=[0, 0, 0], inertia=[node_inertia] * 3, explicitinertial=True
        )
        grip.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.016 * model.reach, 0, 0], material="joint", **_VISUAL)
    l, m, k, b, rest, cubic = (whip.per_node(x) for x in ("l", "m", "k", "b", "rest_angle", "cubic_stiffness"))
    for i in range(whip.N):
        thickness = (0.011 - 0.005 * i / whip.N) * model.reach
        body = _link(parent, f"whip{i + 1}", at, mass=m[i], com=l[i], inertia=node_inertia, tiny=node_inertia)
        body.add_joint(
            name=f"whip{i + 1}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, -1, 0],
            stiffness=[k[i], 0, cubic[i]],  # MuJoCo's polynomial
            damping=b[i],
            springref=rest[i],
        )
        _capsule(body, l[i], thickness, "whip")
        parent, at = body, [0.0, 0.0, -l[i]]
    parent.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=at, size=[0.02 * model.reach, 0, 0], material="tip", **_VISUAL
    )
    parent.add_site(name="tip", pos=at, size=[0.005, 0, 0])
    return spec


_VISUAL = {"contype": 0, "conaffinity": 0, "mass": 0.0}


def _link(parent, name: str, at: list[float], *, mass: float, com: float, inertia: float, tiny: float):
    """A body whose inertia matters about the hinge axis (y) only."""
    return parent.add_body(
        name=name, pos=at, mass=mass, ipos=[0, 0, -com], inertia=[inertia, inertia, tiny], explicitinertial=True
    )


def _capsule(body, length: float, radius: float, material: str) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, 0, 0, -length],
        size=[radius, 0, 0],
        material=material,
        **_VISUAL,
    )


def _add_target(spec: mujoco.MjSpec, target: np.ndarray, radius: float, reach: float) -> None:
    """A disc just behind the strike plane, so that it never hides the tip."""
    body = spec.worldbody.add_body(name="target", pos=[float(target[0]), 0, float(target[1])])
    for material, size, y in (("target_zone", radius, 0.048), ("target", radius / 4, 0.044)):
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=[0, y * reach, 0, 0, 0.05 * reach, 0],
            size=[size, 0, 0],
            material=material,
            **_VISUAL,
        )


def _scene(spec: mujoco.MjSpec, model: Model) -> None:
    """Light, board, floor, materials, and a camera that sees the whole reach from the side."""
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
    ):
        spec.add_material(name=name, rgba=rgba, specular=0.3, shininess=0.4)
    # Plain colours: a texture over the whole picture would triple the time that software rendering takes.
    for name, rgba in (("board", (0.87, 0.885, 0.91, 1)), ("floor", (0.62, 0.66, 0.72, 1))):
        spec.add_material(name=name, rgba=rgba, specular=0, shininess=0)
    spec.worldbody.add_light(
        pos=[0, -reach, 2 * reach],
        dir=[0.15, 0.6, -1],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.45] * 3,
    )
    floor, board = -1.12 * reach, 0.06 * reach
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[4 * reach, 4 * reach, 0.1],
        pos=[0, 0, floor],
        material="floor",
        **_VISUAL,
    )
    spec.worldbody.add_geom(
        name="board",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[4 * reach, 4 * reach, 0.1],
        pos=[0, board, 0],
        zaxis=[0, -1, 0],
        material="board",
        **_VISUAL,
    )
    # A side view, x to the right and z up; orthographic, so that lengths read true (fovy is the height in m)
    spec.worldbody.add_camera(
        name="side",
        pos=[0, -3 * reach, 0],
        xyaxes=[1, 0, 0, 0, 0, 1],
        fovy=2.14 * reach,
        proj=mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC,
    )


def set_posture(model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray) -> None:
    """Put the chain into joint positions q (n,) and update what depends on them."""
    data.qpos[:] = q
    mujoco.mj_forward(model, data)


def export_xml(model: Model, *, target: np.ndarray | None = None) -> tuple[str, list[str]]:
    """MJCF text that MuJoCo's viewer loads, and what it cannot hold, in words."""
    spec = build_spec(model, target=target)
    missing = [*not_native(model), "the controller: joints are driven by plain motors"]
    spec.comment = "Written by whiptool. Not in this file: " + "; ".join(missing) + "."
    spec.compile()
    return spec.to_xml(), missing
