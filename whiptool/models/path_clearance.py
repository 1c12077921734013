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
        self._turns = np.array([link.kind == "revolute" for link in model.arm.links])
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
        origins = np.stack([frame.origin for frame in frames], axis=1)  # (T, a, 3)
        along = [f.rotation @ np.array(link.axis) for f, link in zip(frames, self._arm.links, strict=True)]
        axes = np.stack(along, axis=1)
        values, slopes = [], []
        for part in self._parts:
            for value, k, ends in part.nearest(q):
                by_q = sum((self._towards(axes[k], origins[k], *end) for end in ends), np.zeros(a))
                values.append(value)
                slopes.append(np.r_[(1 - FRACTIONS[k]) * by_q, FRACTIONS[k] * by_q, 0.0])
        return np.array(values), np.array(slopes).reshape(-1, 2 * a + 1)

    def _towards(
        self, axes: np.ndarray, origins: np.ndarray, link: int, point: np.ndarray, outward: np.ndarray
    ) -> np.ndarray:
        """Return how fast a point of a link moves along a direction, by each joint's position, (a,).

        Args:
            axes, origins: Of the joints, (a, 3) each.
            link: Its number; the base and the floor, whose numbers are negative, do not move.
            point, outward: (3,) each.
        """
        velocities = np.where(self._turns[:, None], np.cross(axes, point - origins), axes)
        return np.where(np.arange(len(axes)) <= link, velocities @ outward, 0.0)


class _Part:
    """Pairs of links that keep the same distance.

    Args:
        scene: What is compared.
        least: Distance to be kept [m].
    """

    def __init__(self, scene: Scene, least: float) -> None:
        self._scene, self._least = scene, least
        links = [scene.links_of(pair) for pair in scene.pairs]
        self._links = sorted(set(links))
        self._groups = np.array([self._links.index(both) for both in links], int)

    def nearest(self, q: np.ndarray) -> Iterator[tuple[float, int, _Ends]]:
        """Yield of each two links how much nearer they come than they may [m], at which state, and where.

        Args:
            q: States, (T, a).
        """
        contacts = self._scene.contacts(q, self._groups) if self._links else []
        for (one, other), contact in zip(self._links, contacts, strict=True):
            ends = ((one, contact.points[0], contact.normal), (other, contact.points[1], -contact.normal))
            yield self._least - contact.distance, contact.instant, ends
