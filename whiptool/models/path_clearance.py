"""Clearance of an arm on its commanded path, as smooth functions of the strike: what a search keeps beforehand."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np

from whiptool.models.kinematics import arm_frames
from whiptool.models.parameters import Model
from whiptool.models.scene import Scene
from whiptool.models.spatial_arm import SpatialArm

FRACTIONS = np.linspace(0.0, 1.0, 16)  # of the way, at which the arm is looked at
SPARE = 5e-3  # [m] that a search keeps besides, for what lies between and for what joints do beside the command

_Ends: TypeAlias = tuple[tuple[int, np.ndarray, np.ndarray], ...]  # link, its nearest point, way towards the other


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
        self._arm = model.arm
        self._parts = [_Part(Scene(model, floor, "close"), 0.0), _Part(Scene(model, floor, "apart"), least + SPARE)]

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return, of each pair of links (or link and floor), how much nearer they come than they may [m].

        Args:
            strike: Vector, (2 a + 1,).

        Returns:
            The functions (m,), <= 0 where the distance is kept, and their derivatives (m, 2 a + 1). Where another
            instant or capsule becomes the nearest, a function has a kink.
        """
        a = self._arm.n
        q = strike[:a] + FRACTIONS[:, None] * (strike[a : 2 * a] - strike[:a])
        frames = arm_frames(self._arm, q)[:a]
        axes = [
            f.rotation @ np.array(link.axis) for f, link in zip(frames, self._arm.links, strict=True)
        ]  # (T, 3) each
        values, slopes = [], []
        for part in self._parts:
            for value, k, ends in part.nearest(q):
                by_q = np.zeros(a)
                for link, point, outward in ends:
                    for j in range(link + 1):  # none, of the base and the floor
                        turns = self._arm.links[j].kind == "revolute"
                        velocity = np.cross(axes[j][k], point - frames[j].origin[k]) if turns else axes[j][k]
                        by_q[j] += outward @ velocity
                values.append(value)
                slopes.append(np.r_[(1 - FRACTIONS[k]) * by_q, FRACTIONS[k] * by_q, 0.0])
        return np.array(values), np.array(slopes).reshape(-1, 2 * a + 1)


class _Part:
    """Pairs of links that keep the same distance.

    Args:
        scene: What is compared.
        least: Distance to be kept [m].
    """

    def __init__(self, scene: Scene, least: float) -> None:
        self._scene, self._least = scene, least
        links = [scene.links_of(pair) for pair in scene.pairs]
        self._members = {both: [p for p, x in enumerate(links) if x == both] for both in sorted(set(links))}

    def nearest(self, q: np.ndarray) -> Iterator[tuple[float, int, _Ends]]:
        """Yield of each two links how much nearer they come than they may [m], at which state, and where.

        Args:
            q: States, (T, a).
        """
        if not self._members:
            return
        distances, points, normals = self._scene.distances(q)
        for (one, other), pairs in self._members.items():
            k, i = np.unravel_index(distances[:, pairs].argmin(), (len(q), len(pairs)))
            p, towards = pairs[i], normals[k, pairs[i]]
            ends = ((one, points[k, p, 0], towards), (other, points[k, p, 1], -towards))
            yield self._least - distances[k, p], int(k), ends
