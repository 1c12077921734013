"""What a model stands in, in MuJoCo: light, floor, board, target, materials and cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whiptool.models.parameters import Model
from whiptool.rollout.mujoco_import import mujoco

FLOOR = 1.12  # how far the floor is below the base, in reaches

# Colour-blind safe (Okabe-Ito)
_BLUE, _ORANGE, _VERMILION = (0.0, 0.45, 0.70, 1), (0.90, 0.62, 0.0, 1), (0.84, 0.37, 0.0, 1)

_PALE_ORANGE, _GREY, _DARK = (0.88, 0.70, 0.36, 1), (0.35, 0.35, 0.4, 1), (0.13, 0.13, 0.16, 1)


_VISUAL = {"contype": 0, "conaffinity": 0, "mass": 0.0}  # shapes that are seen and do nothing


def add_capsule(body: mujoco.MjsBody, end: Sequence[float], radius: float, material: str) -> None:
    """Add a capsule of a radius [m] from the body's origin to a point in its frame (3,) [m]."""
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
