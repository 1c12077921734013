"""Rendering of a strike in MuJoCo for a virtual camera, by rectangles of its image."""

from __future__ import annotations

import numpy as np

from whiptool.errors import WhiptoolError
from whiptool.models.parameters import Model
from whiptool.recording.camera import Camera
from whiptool.rollout.mujoco_import import mujoco
from whiptool.rollout.mujoco_model import add_ball, build_spec
from whiptool.viz.opengl import gl_context

# Red, green, blue of the markers, as bright tape shows them; the tip's hue is a quarter turn from the target's and from
# the arm's, so that neither shows in the strength of the tip's colour. And the brightness of everything in infrared,
# where the tip throws the camera's own light back and the target half of it.
TIP_COLOR, TARGET_COLOR = (0.15, 0.88, 0.10), (0.95, 0.38, 0.10)
_INFRARED = {"board": 0.10, "floor": 0.07, "arm": 0.15, "joint": 0.2, "whip": 0.03, "tip": 0.97, "target": 0.42}
_WHIP = (0.010, 0.003)  # radius at the handle and at the tip [m]; a thick end would hide part of the marker
_SHARE_OF_LIGHT = 0.12  # of the markers' brightness that depends on how the lamps fall on them
_LARGEST = 1024  # pixels that can be drawn at once, in each direction
_NEAR, _FAR = 0.05, 40.0  # [m]


class StrikeDrawing:
    """Renders rectangles of a camera's image of arm, whip, tip marker and target, with the radius [m] of the tip's ball
    and of the target around its centre, (2,) or (3,) [m].

    The target is a disc in the strike plane itself, so that its image has no parallax; the tip's ball stands out of it.
    In space the target is a ball.
    """

    def __init__(
        self,
        settings: Camera,
        model: Model,
        *,
        target: np.ndarray | None,
        marker_radius: float,
        target_radius: float,
    ) -> None:
        self.settings = settings
        spec = build_spec(model)
        for geom in spec.geoms:
            if geom.material == "tip":
                geom.size = [marker_radius, 0, 0]
        whip = [geom for geom in spec.geoms if geom.material == "whip"]
        for geom, radius in zip(whip, np.linspace(*_WHIP, len(whip)), strict=True):
            geom.size = [radius, 0, 0]
        if target is not None and len(target) == 3:
            add_ball(spec.worldbody, target_radius, "target", target.tolist())
        elif target is not None:
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CYLINDER,
                fromto=[float(target[0]), 0, float(target[1]), float(target[0]), 1e-3, float(target[1])],
                size=[target_radius, 0, 0],
                material="target",
                contype=0,
                conaffinity=0,
                mass=0.0,
            )
        spec.visual.global_.offwidth = spec.visual.global_.offheight = _LARGEST
        spec.visual.quality.offsamples = 0  # what moves is sampled many times anyway
        spec.visual.quality.numslices, spec.visual.quality.numstacks = 24, 16
        self._mj = spec.compile()
        self._dress()
        self._data = mujoco.MjData(self._mj)
        try:
            self._context = gl_context(_LARGEST, _LARGEST)
            self._context.make_current()
            self._gl = mujoco.MjrContext(self._mj, 50)
        except Exception as error:  # drivers and MuJoCo fail in many ways
            raise WhiptoolError(f"the virtual camera needs OpenGL ({error}): try MUJOCO_GL=egl or osmesa") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._gl)
        self._scene = mujoco.MjvScene(self._mj, maxgeom=200)
        for flag in ("SHADOW", "REFLECTION", "SKYBOX", "HAZE"):  # each costs time
            self._scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = False

    def _dress(self) -> None:
        markers = {"tip": TIP_COLOR, "target": TARGET_COLOR}
        names = ("board", "floor", "arm", "joint", "whip", "tip", "target")
        for name in names:
            material = self._mj.mat(name)
            material.specular = 0  # matt: highlights would be taken for markers
            rgb = markers.get(name, material.rgba[:3]) if self.settings.kind == "color" else (_INFRARED[name],) * 3
            if name in markers:  # mostly emitted light, so that it looks the same from all sides
                material.emission = (1 - _SHARE_OF_LIGHT) / _SHARE_OF_LIGHT
                rgb = np.array(rgb) * _SHARE_OF_LIGHT
            material.rgba[:3] = rgb

    def draw(self, q: np.ndarray | None, region: tuple[float, float, int, int], scale: int = 1) -> np.ndarray:
        """Return a rectangle (left, top, width w, height h) [pixels] of the image, at `scale` samples per pixel in each
        direction, (h scale, w scale, 3) uint8, with joint positions q (n,) [rad], or None for the static parts only."""
        s, (left, top, width, height) = self.settings, region
        self._context.make_current()
        if q is not None:
            self._data.qpos[:] = q
        mujoco.mj_kinematics(self._mj, self._data)
        mujoco.mjv_updateScene(
            self._mj,
            self._data,
            mujoco.MjvOption(),
            None,
            mujoco.MjvCamera(),
            mujoco.mjtCatBit.mjCAT_STATIC if q is None else mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        (_, down, forward), (cx, cy), (fx, fy) = s.rotation, s.principal_point, s.focal_lengths
        x = (np.array([left, left + width]) - 0.5 - cx) / fx * _NEAR
        y = -(np.array([top, top + height]) - 0.5 - cy) / fy * _NEAR
        for camera in self._scene.camera:  # one per eye; a picture for one eye is drawn from between the two
            camera.pos[:] = s.position
            camera.forward[:], camera.up[:] = forward, -down
            camera.orthographic = 0
            camera.frustum_near, camera.frustum_far = _NEAR, _FAR
            camera.frustum_center, camera.frustum_width = x.mean(), (x[1] - x[0]) / 2
            camera.frustum_top, camera.frustum_bottom = y
        rect = mujoco.MjrRect(0, 0, width * scale, height * scale)
        pixels = np.empty((height * scale, width * scale, 3), np.uint8)
        mujoco.mjr_render(rect, self._scene, self._gl)
        mujoco.mjr_readPixels(pixels, None, rect, self._gl)
        return pixels[::-1]

    def largest_scale(self, width: int, height: int, wanted: int) -> int:
        """Return the largest `scale` up to `wanted` at which a rectangle of this size [pixels] can be drawn."""
        return max(1, min(wanted, _LARGEST // max(width, height)))

    def is_tip(self, pixels: np.ndarray) -> np.ndarray:
        """Return whether samples (..., 3) uint8 show the tip's marker, whose colour nothing else has."""
        if self.settings.kind == "infrared":
            return pixels[..., 0] > 255 * 0.7
        red, green, blue = (pixels[..., i].astype(np.float32) for i in range(3))
        return (green > 2 * red) & (green > 2 * blue) & (green > 100)

    def close(self) -> None:
        """Free the memory of the graphics card."""
        self._context.make_current()
        self._gl.free()
        self._context.free()
