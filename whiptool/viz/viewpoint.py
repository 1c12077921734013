"""A camera in perspective: where in its picture a place in space is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from whiptool.rollout.mujoco_import import mujoco


@dataclass(frozen=True)
class Viewpoint:
    """A pinhole camera.

    Args:
        place: Place of the pinhole [m], (3,).
        axes: Unit vectors to the right, up and back from where it looks, (3, 3).
        fovy: Angle between the lower and the upper edge of the picture [deg].
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
        """Half the picture's height at a depth of 1 m [m]."""
        return float(np.tan(np.deg2rad(self.fovy) / 2))

    def seen(self, places: np.ndarray) -> np.ndarray:
        """Return where places (..., 3) [m] are in the picture, (..., 3); NaN behind the camera.

        To the right and up from the picture's middle, in half heights of it, and how many of these a metre is there.
        """
        right, up, back = np.moveaxis((places - self.place) @ self.axes.T, -1, 0)
        size = 1 / (self.slope * np.where(back < 0, -back, np.nan))
        return np.stack([right * size, up * size, size], axis=-1)

    def fitted(self, places: np.ndarray, aspect: float, *, filled: float = 0.9) -> Viewpoint:
        """Return the camera moved, not turned, to the nearest place from which it sees all places.

        Args:
            places: (..., 3) [m]
            aspect: Width of the picture over its height.
            filled: Share of the picture, from its middle, that they may take.
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
