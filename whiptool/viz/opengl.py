"""Drawing with MuJoCo: OpenGL contexts, and objects that are added to a scene."""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from collections.abc import Sequence

import numpy as np

from whiptool.rollout.mujoco_import import mujoco


def gl_context(width: int, height: int):
    """Return an off-screen OpenGL context, chosen by the environment variable MUJOCO_GL, or EGL if there is no display.

    MuJoCo itself reads the variable only when it is imported, and without it requires a display.
    """
    backend = os.environ.get("MUJOCO_GL", "").strip().lower()
    if backend in ("disable", "disabled", "off", "false", "0"):
        raise RuntimeError(f"MUJOCO_GL={backend}")
    if not backend and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        backend = "egl"
    module = f"mujoco.{backend}" if backend in ("egl", "osmesa", "glfw", "cgl") else "mujoco.gl_context"
    return importlib.import_module(module).GLContext(width, height)


def draws_in_software() -> bool:
    """Whether the current OpenGL context renders in software, without a graphics card."""
    from OpenGL.raw.GL.VERSION.GL_1_0 import GL_RENDERER, glGetString

    name = ctypes.string_at(glGetString(GL_RENDERER)).decode()
    return name.lower().startswith(("llvmpipe", "softpipe", "swrast"))


def add_bar(scene: mujoco.MjvScene, ends: np.ndarray, y: float, thickness: float, rgb: Sequence[float]) -> None:
    """Add a flat bar to a scene: far cheaper to render than a capsule.

    Args:
        scene: Scene that has room for another object.
        ends: Ends [m], (2, 2), in the strike plane.
        y: Distance behind the plane [m].
        thickness: Thickness [m].
        rgb: Colour, (3,), 0 to 1.
    """
    along = ends[1] - ends[0]
    length = np.hypot(*along)
    dx, dz = along / length if length else (1.0, 0.0)
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_BOX,
        np.array([length + thickness, 2e-4, thickness]) / 2,
        np.insert(ends.mean(axis=0), 1, y),
        np.array([dx, 0, -dz, 0, 1, 0, dz, 0, dx]),
        np.array([*rgb, 1], np.float32),
    )
    geom.specular = 0
    scene.ngeom += 1


def add_path(scene: mujoco.MjvScene, segments: np.ndarray, rgb: np.ndarray, reach: float) -> None:
    """Add the path of a tip to a scene: as bars behind the strike plane, or in space as rods.

    Args:
        scene: Scene that has room for as many objects.
        segments: Ends of the path's segments [m], (S, 2, d).
        rgb: Their colours, (S, 3), 0 to 1.
        reach: Reach of the model, for the thickness [m].
    """
    for ends, color in zip(segments, rgb, strict=True):
        if segments.shape[-1] == 2:
            add_bar(scene, ends, 0.03 * reach, 0.01 * reach, color)
        else:
            add_rod(scene, ends, 0.004 * reach, color)


def add_rod(scene: mujoco.MjvScene, ends: np.ndarray, radius: float, rgb: Sequence[float]) -> None:
    """Add a round rod to a scene.

    Args:
        scene: Scene that has room for another object.
        ends: Ends [m], (2, 3), in space.
        radius: Radius [m].
        rgb: Colour, (3,), 0 to 1.
    """
    geom = scene.geoms[scene.ngeom]
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), np.array([*rgb, 1], np.float32))
    mujoco.mjv_connector(geom, kind, radius, ends[0], ends[1])
    scene.ngeom += 1


def add_ball(scene: mujoco.MjvScene, radius: float, rgb: Sequence[float]) -> None:
    """Add a ball of a radius [m] and a colour (3,), 0 to 1, to a scene that has room for it, at its origin."""
    size, color = np.full(3, radius), np.array([*rgb, 1], np.float32)
    mujoco.mjv_initGeom(
        scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_SPHERE, size, np.zeros(3), np.eye(3).ravel(), color
    )
    scene.ngeom += 1
