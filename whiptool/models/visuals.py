"""What a robot looks like: the visual shapes of its file, whose meshes its maker draws, in the frames of its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from whiptool.models.capsules import Capsule

GREY = (0.62, 0.64, 0.68)  # of what has no colour in its file


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh in the frame of its link."""

    vertices: np.ndarray  # positions [m], (V, 3)
    triangles: np.ndarray  # indices of the vertices of each triangle, (F, 3)
    color: tuple[float, float, float] = GREY  # red, green and blue, 0 to 1

    @property
    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and triangles."""
        return self.vertices, self.triangles

    def turned(self, R: np.ndarray) -> Surface:
        """Return the mesh turned about the origin by a rotation (3, 3)."""
        return Surface(self.vertices @ R.T, self.triangles, self.color)


Look: TypeAlias = Sequence[Surface | Capsule]  # of one frame
