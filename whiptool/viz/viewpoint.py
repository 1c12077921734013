"""A pinhole camera for drawings, and the projection of points into its picture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from whiptool.rollout.mujoco_import import mujoco


@dataclass(frozen=True)
class Viewpoint:
    """A pinhole camera for drawings.

    Args:
        place: Position of the pinhole [m], (3,).
        axes: Unit vectors of the camera's right, up and backward directions, in rows, (3, 3).
        fovy: Vertical field of view [deg].
    """

    place: np.ndarray
    axes: np.ndarray
    fovy: float

    @classmethod
    def of(cls, mj: mujoco.MjModel, name: str) -> Viewpoint:
        """Return a camera that is fixed in the world of a MuJoCo model."""
        i = mj.cam(name).id
        return cls(mj.cam_pos[i].copy(), mj.cam_mat0[i].reshape(3, 3).T.copy(), float(mj.cam_fovy[i]))

    @property
    def slope(self) -> float:
        """Half the visible height at a depth of 1 m [m]."""
        return float(np.tan(np.deg2rad(self.fovy) / 2))

    def seen(self, places: np.ndarray) -> np.ndarray:
        """Project points (..., 3) [m] into the picture, (..., 3); NaN behind the camera.

        The first two entries are the distances to the right and up from the picture's centre, in half heights of the
        picture; the third is the scale there [half heights per metre].
        """
        right, up, back = np.moveaxis((places - self.place) @ self.axes.T, -1, 0)
        size = 1 / (self.slope * np.where(back < 0, -back, np.nan))
        return np.stack([right * size, up * size, size], axis=-1)

    def fitted(self, places: np.ndarray, aspect: float, *, filled: float = 0.9) -> Viewpoint:
        """Return the camera translated to the nearest position from which it sees all points.

        Args:
            places: Points [m], (..., 3).
            aspect: Width of the picture over its height.
            filled: Fraction of the picture, around its centre, that the points may occupy.
        """
        right, up, back = (places.reshape(-1, 3) @ self.axes.T).T
        # seen where |right - x| <= tall aspect (z - back), |up - y| <= tall (z - back), for the pinhole at x, y, z
        tall = filled * self.slope
        x, z_wide = _between(right, back, tall * aspect)
        y, z_tall = _between(up, back, tall)
        return replace(self, place=np.array([x, y, max(z_wide, z_tall)]) @ self.axes)


def _between(across: np.ndarray, back: np.ndarray, slope: float) -> tuple[float, float]:
    """Middle, and the least distance back, from which two edges of a slope hold all points."""
    high, low = (across + slope * back).max(), (-across + slope * back).max()
    return (high - low) / 2, (high + low) / (2 * slope)
