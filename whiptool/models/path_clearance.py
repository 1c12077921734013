"""Clearance of an arm on its commanded path, as smooth functions of the strike: what a search keeps beforehand."""

from __future__ import annotations

import numpy as np

from whiptool.models.kinematics import arm_frames
from whiptool.models.parameters import Model
from whiptool.models.scene import Scene
from whiptool.models.spatial_arm import SpatialArm

FRACTIONS = np.linspace(0.0, 1.0, 16)  # of the way, at which the arm is looked at
SPARE = 5e-3  # [m] that a search keeps besides, for what lies between and for what joints do beside the command


class PathClearance:
    """How near an arm without its whip comes to itself and to the floor where its joints are commanded to go.

    Joints move together along a straight line from `q_i` to `q_f`, so that the way does not depend on the duration.

    Args:
        model: With an arm in space.
        floor: Its height [m]; None: there is none.
        least: Distance to be kept [m].
    """

    def __init__(self, model: Model, floor: float | None = None, least: float = 0.0) -> None:
        assert isinstance(model.arm, SpatialArm)
        self._arm, self._least = model.arm, least + SPARE
        self._scene = Scene(model, floor, of_whip=False)
        links = [self._scene.links_of(pair) for pair in self._scene.pairs]
        self._links = sorted(set(links))
        self._group = np.array([self._links.index(x) for x in links], int)  # of each pair of bodies

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return, of each pair of links (or link and floor), how much nearer they come than they may [m].

        Args:
            strike: Vector, (2 a + 1,).

        Returns:
            The functions (m,), <= 0 where the distance is kept, and their derivatives (m, 2 a + 1). Where another
            instant or capsule becomes the nearest, a function has a kink.
        """
        a = self._arm.n
        values, slopes = np.zeros(len(self._links)), np.zeros((len(self._links), 2 * a + 1))
        if not len(values):
            return values, slopes
        q = strike[:a] + FRACTIONS[:, None] * (strike[a : 2 * a] - strike[:a])
        distances, points, normals = self._scene.distances(q)
        frames = arm_frames(self._arm, q)[:a]
        axes = [
            f.rotation @ np.array(link.axis) for f, link in zip(frames, self._arm.links, strict=True)
        ]  # (T, 3) each
        for g, (one, other) in enumerate(self._links):
            members = np.flatnonzero(self._group == g)
            k, i = np.unravel_index(distances[:, members].argmin(), (len(q), len(members)))
            pair = members[i]
            values[g] = self._least - distances[k, pair]
            by_q = np.zeros(a)
            for link, point, sign in ((one, points[k, pair, 0], 1), (other, points[k, pair, 1], -1)):
                for j in range(link + 1):  # none, of the base and the floor
                    turns = self._arm.links[j].kind == "revolute"
                    velocity = np.cross(axes[j][k], point - frames[j].origin[k]) if turns else axes[j][k]
                    by_q[j] += sign * normals[k, pair] @ velocity
            slopes[g, :a], slopes[g, a : 2 * a] = (1 - FRACTIONS[k]) * by_q, FRACTIONS[k] * by_q
        return values, slopes
