"""Do cameras still stand where they were calibrated? One look of all at the board tells.

`track_agreement` asks the same of the markers that they saw.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.space_camera import SpaceCamera
from whiptool.vision.boards import Board, Corners
from whiptool.vision.space_calibration import FEWEST, Lens, Pose, board_pose, rms


@dataclass(frozen=True)
class Agreement:
    """How well cameras agree on where a board is.

    Args:
        misfit: Root mean square distance of its corners from where all see them, at the pose that they agree on best
            [pixels].
        without: The same without one of them, by its name: of three or more, the one without which the others agree
            was moved. Empty for two.
    """

    misfit: float
    without: dict[str, float]


def agree(cameras: Mapping[str, SpaceCamera], views: Mapping[str, Corners | None], board: Board) -> Agreement:
    """Return whether cameras still stand as they were calibrated, from one look of all at the board.

    Args:
        cameras: As they were calibrated.
        views: What each sees of the board now, at one instant; None where it does not.
        board: The board.

    Raises:
        InputError: Fewer than two cameras see enough of the board, or a name belongs to no camera.
    """
    if unknown := set(views) - set(cameras):
        raise InputError("views", ", ".join(sorted(unknown)), f"the cameras: {', '.join(cameras)}")
    seen = {name: view for name, view in views.items() if view is not None and len(view.ids) >= FEWEST}
    if len(seen) < 2:
        given = ", ".join(seen) or "none"
        raise InputError("views", given, f"two cameras or more that see {FEWEST} corners or more of the board")
    without = {name: _misfit({n: cameras[n] for n in seen if n != name}, seen, board) for name in seen}
    together = _misfit({name: cameras[name] for name in seen}, seen, board)
    return Agreement(together, without if len(seen) > 2 else {})


def _misfit(cameras: Mapping[str, SpaceCamera], views: Mapping[str, Corners], board: Board) -> float:
    """Return the root mean square distance in the images at the pose of the board that cameras agree on best."""
    name, first = next(iter(cameras.items()))
    lens = Lens(first.width, first.height, first.camera_matrix, first.distortion)
    in_camera = board_pose(lens, views[name], board)
    back = Rotation.from_matrix(first.rotation.T)
    start = Pose(back, first.position) @ in_camera

    def misses(x: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec(x[:3]) * start.rotation
        places = turned.apply(board.points) + start.position + x[3:]
        each = [c.project(places[views[n].ids]) - views[n].pixels for n, c in cameras.items()]
        return np.concatenate(each).ravel()

    best = least_squares(misses, np.zeros(6), method="lm", x_scale="jac")
    return rms(best.fun.reshape(-1, 2))
