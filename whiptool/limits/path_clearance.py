"""Clearance of an arm on its commanded path, as smooth functions of the strike: what a search keeps beforehand."""

from __future__ import annotations

import numpy as np

from whiptool.models.kinematics import arm_poses
from whiptool.models.parameters import Model
from whiptool.models.scene import Scene

FRACTIONS = np.linspace(0.0, 1.0, 16)  # of the way, at which the arm is looked at
SPARE = 5e-3  # [m] that a search keeps besides, for what lies between and for how joints depart from the command


class PathClearance:
    """Constraints on the distance of an arm without its whip from itself and the floor, on its commanded path.

    The joints move along a straight line from `q_i` to `q_f`, so the path does not depend on the duration.

    Args:
        model: Model with an arm in space.
        floor: Height of the floor [m]; None: no floor.
        least: Smallest allowed distance [m].
    """

    def __init__(self, model: Model, floor: float | None = None, least: float = 0.0) -> None:
        self._arm = model.arm.in_space()
        self._turns = model.arm.turns
        self._scene = Scene(model, floor, ("close", "apart"))
        pairs = zip(self._scene.kinds, map(self._scene.links_of, self._scene.pairs), strict=True)
        of_pairs = [(0.0 if kind == "close" else least + SPARE, *links) for kind, links in pairs]
        kept = sorted(set(of_pairs))  # what each two links keep, and which they are
        self._groups = np.array([kept.index(each) for each in of_pairs], int)
        self._least, self._links = np.array([x[0] for x in kept]), np.array([x[1:] for x in kept], int).reshape(-1, 2)

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return for each pair of links (or link and floor) the allowed distance minus the smallest one [m].

        Args:
            strike: Strike vector, (2 a + 1,).

        Returns:
            The functions (m,), at most 0 if the distance is kept, and their derivatives (m, 2 a + 1). A function has a
            kink where another instant or capsule becomes the nearest.
        """
        a, m = self._arm.n, len(self._links)
        if not m:
            return np.zeros(0), np.zeros((0, 2 * a + 1))
        q = self._path(strike)
        contacts = [x for x in self._scene.contacts(q, self._groups, [np.inf] * m) if x is not None]
        at = np.array([contact.instant for contact in contacts])
        normals = np.stack([contact.normal for contact in contacts])
        points = np.stack([contact.points for contact in contacts])
        by_q = self._slopes(q[at], points, np.stack([normals, -normals], axis=1))
        share = FRACTIONS[at, None]
        values = self._least - np.array([contact.distance for contact in contacts])
        return values, np.hstack([(1 - share) * by_q, share * by_q, np.zeros((m, 1))])

    def kept(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether the arm keeps the distances in strikes (B, 2 a + 1), (B,)."""
        found = [self._scene.contacts(self._path(strike), self._groups, self._least.tolist()) for strike in strikes]
        near = [[np.inf if x is None else x.distance for x in contacts] for contacts in found]
        return np.all(np.reshape(near, (len(strikes), len(self._least))) >= self._least, axis=1)

    def _path(self, strike: np.ndarray) -> np.ndarray:
        """Return positions of the joints on the commanded path, (T, a)."""
        a = self._arm.n
        return strike[:a] + FRACTIONS[:, None] * (strike[a : 2 * a] - strike[:a])

    def _slopes(self, q: np.ndarray, points: np.ndarray, toward: np.ndarray) -> np.ndarray:
        """Return how fast points of two links approach each other, by each joint's position, (m, a).

        The base and the floor, whose numbers are negative, do not move.

        Args:
            q: States, (m, a).
            points: One of each link, (m, 2, 3).
            toward: Directions from each to the other, (m, 2, 3).
        """
        origins, rotations = arm_poses(self._arm, q)
        axes = np.einsum("mjik,jk->mji", rotations[:, :-1], self._arm.per_link("axis"))[:, None]
        arms = points[:, :, None] - origins[:, None, :-1]  # (m, 2, a, 3)
        velocities = np.where(self._turns[:, None], np.cross(axes, arms), axes)
        moved = np.arange(self._arm.n) <= self._links[:, :, None]  # (m, 2, a)
        return (np.einsum("meji,mei->mej", velocities, toward) * moved).sum(axis=1)
