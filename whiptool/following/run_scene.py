"""The scene of a run that is followed: the studio's scene, and points of the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from whiptool.following.run_view import ShownMotion
from whiptool.impedance.controller import default_controller
from whiptool.live_page.scene import PageScene, rgb
from whiptool.live_page.session import Shown, StudioSettings
from whiptool.models.kinematics import arm_poses, upright
from whiptool.viz.style import COLORS

if TYPE_CHECKING:
    from viser import ClientHandle, LineSegmentsHandle

_MEASURED = 0.008  # of the reach, thickness of the line of a measured arm
_POINT = 0.006  # of the reach, size of a point


class RunScene:
    """Arm, whip, target and points of a run.

    Args:
        client: The user's browser.
        motion: The first strike.
    """

    def __init__(self, client: ClientHandle, motion: ShownMotion) -> None:
        self._api = client.scene
        self._scene = PageScene(client.scene, motion.model, lambda target, begins: None, motion.looks)
        client.camera.position, client.camera.look_at = self._scene.camera(client.camera.aspect)
        self._number = 0
        self._measured: LineSegmentsHandle | None = None
        self._arm = motion.model.arm.in_space()

    def show(self, motion: ShownMotion) -> None:
        """Show the path of a strike and its target."""
        model, target = motion.model, motion.target
        near = motion.trajectory.approach(np.array(target.position))
        hit = bool(target.goals.hit_by(near)[0])
        self._number += 1
        settings = StudioSettings(model.name, model, default_controller(model), target)
        self._scene.show(Shown(settings, model, motion.trajectory, near, hit, None, "", self._number), None)

    @property
    def duration(self) -> float:
        """Duration of the strike that is shown [s]."""
        return 0.0 if self._scene.postures is None else float(self._scene.postures.t[-1])

    def pose(self, t: float) -> None:
        """Show arm and whip at a time of the strike [s]."""
        if self._scene.postures is not None:
            self._scene.pose(self._scene.postures.at(t))

    def show_measured(self, q: np.ndarray) -> None:
        """Show a real arm, whose joints are at q, (a,), as a line from joint to joint to the hand."""
        origins, _ = arm_poses(self._arm, q[None])
        line = np.stack([origins[0, :-1], origins[0, 1:]], axis=1).astype(np.float32)
        if self._measured is None:
            color, wide = rgb(COLORS["vermilion"]), _MEASURED * self._scene.reach
            self._measured = self._api.add_line_segments("/measured", line, color, thickness=wide)
        self._measured.points = line

    def show_points(self, points: Mapping[str, np.ndarray]) -> None:
        """Show points (K, d) [m] by what they are."""
        for i, places in enumerate(points.values()):
            self._api.add_point_cloud(
                f"/points/{i}",
                upright(places).astype(np.float32),
                rgb(COLORS["sky"]),
                point_size=_POINT * self._scene.reach,
                point_shape="circle",
            )
