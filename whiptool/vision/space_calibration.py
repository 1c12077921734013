"""Calibration of lenses, and of the poses of several cameras, from images of a board that is moved in front of them.

`agree` checks these poses with a board; `track_agreement` checks them with tracked markers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, distort, opencv
from whiptool.vision.calibration import Board, Corners

FEWEST = 6  # corners of a view: four fix a pose, more say whether it is right
VIEWS = 5  # of a lens: three fix it in theory, tilted differently
LOOSEST = 0.01  # standard error of a focal length, of the focal length: by as much are distances wrong


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics of a camera, and the quality of their calibration."""

    width: int  # of the images [pixels]
    height: int  # of the images [pixels]
    camera_matrix: np.ndarray  # [pixels], (3, 3)
    distortion: tuple[float, ...] = ()  # OpenCV's coefficients k1, k2, p1, p2, k3
    residual: float | None = None  # root mean square reprojection error of the corners [pixels]; None: not calibrated
    sigma: np.ndarray | None = None  # standard errors of fx, fy, cx, cy [pixels], (4,); None: not calibrated


@dataclass(frozen=True)
class Pose:
    """Position and orientation of a body in another frame."""

    rotation: Rotation  # from the body's axes to the other frame's
    position: np.ndarray  # of the body's origin in the other frame [m], (3,)

    def __matmul__(self, other: Pose) -> Pose:
        """Return the pose in this body's outer frame of a body whose pose in this body is `other`."""
        return Pose(self.rotation * other.rotation, self.position + self.rotation.apply(other.position))

    def inverse(self) -> Pose:
        """Return the pose of the other frame in the body."""
        back = self.rotation.inv()
        return Pose(back, -back.apply(self.position))


@dataclass(frozen=True, eq=False)
class SpaceCalibration:
    """Calibrated cameras in a common world frame, and the quality of the calibration."""

    cameras: dict[str, Camera]  # by name
    residual: dict[str, float]  # root mean square reprojection error of each camera [pixels]
    views: dict[str, dict[int, float]]  # this error by instant; far above others: wrong detection or moving board
    boards: dict[int, Pose]  # pose of the board in the world, by instant


def calibrate_lens(views: Sequence[Corners], board: Board, *, width: int, height: int) -> Lens:
    """Calibrate the lens of one camera from images of a board at different angles all over the image.

    Args:
        views: Corners of the board in each image; images with fewer than six are left out.
        board: The board.
        width, height: Width and height of the images [pixels].

    Raises:
        InputError: Fewer than five views show enough of the board, or they do not determine the focal lengths to 1 %.
    """
    enough = [view for view in views if len(view.ids) >= FEWEST]
    if len(enough) < VIEWS:
        allowed = f"{VIEWS} or more in which the board is seen, with {FEWEST} corners or more"
        raise InputError("views", f"{len(enough)} of {len(views)}", allowed)
    on_board = [board.points[view.ids].astype(np.float32) for view in enough]
    seen = [view.pixels.astype(np.float32) for view in enough]
    cv2 = opencv()
    found = cv2.calibrateCameraExtended(on_board, seen, (width, height), None, None)
    residual, K, distortion, sigma = found[0], found[1], np.ravel(found[2])[:5], np.ravel(found[5])[:4]
    if not (sigma[:2] < LOOSEST * np.diag(K)[:2]).all():
        focal = ", ".join(f"{f:.0f} +- {s:.0f}" for f, s in zip(np.diag(K)[:2], sigma[:2], strict=True))
        fix = "tilt the board by 30 to 45 degrees, in all directions, at several distances"
        raise InputError(
            "views", f"focal lengths of {focal} pixels", f"views that determine them to {LOOSEST:.0%}", fix
        )
    return Lens(width, height, K, tuple(distortion.tolist()), float(residual), sigma)


def board_pose(lens: Lens | Camera, view: Corners, board: Board) -> Pose:
    """Return the pose of a board in the axes of a camera (right, down, forward) that sees it."""
    cv2 = opencv()
    lens_model = (lens.camera_matrix, np.array(lens.distortion))
    found, turned, place = cv2.solvePnP(board.points[view.ids], view.pixels, *lens_model, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise InputError("view", f"{len(view.ids)} corners", "corners of a board that determine its pose")
    turned, place = cv2.solvePnPRefineLM(board.points[view.ids], view.pixels, *lens_model, turned, place)
    return Pose(Rotation.from_rotvec(np.ravel(turned)), np.ravel(place))


def calibrate_cameras(
    lenses: Mapping[str, Lens],
    views: Mapping[str, Sequence[Corners | None]],
    board: Board,
    *,
    instant: int = 0,
    rotation: np.ndarray | None = None,
    position: Sequence[float] = (0.0, 0.0, 0.0),
) -> SpaceCalibration:
    """Calibrate the poses of cameras from views of a board that several of them saw at the same instants.

    The poses of all cameras and of the board at all instants minimise the squared reprojection errors; the lenses are
    fixed.

    Args:
        lenses: Lenses by camera.
        views: Corners that each camera saw at each instant, None if it was not used; equally many for all cameras.
        board: The board.
        instant: Index of the instant at which the board's pose in the world is given.
        rotation: Rotation from the board's axes (x along its rows, y down its columns, z into it) to the world's at
            that instant, (3, 3); None: rows along x and columns along -y, for a board that lies face up on the floor.
        position: Position of the board's first corner in the world at that instant [m], (3,).

    Raises:
        InputError: Names differ, no camera saw the board at `instant`, or a camera shares no instant with the others.
    """
    if set(lenses) != set(views) or len(lenses) < 2:
        raise InputError("views", ", ".join(views), f"two cameras or more, those of `lenses`: {', '.join(lenses)}")
    counts = {len(of_camera) for of_camera in views.values()}
    if len(counts) != 1:
        raise InputError("views", f"{sorted(counts)} instants", "as many for every camera, None where it saw no board")
    seen = {
        (name, i): view
        for name, of_camera in views.items()
        for i, view in enumerate(of_camera)
        if view is not None and len(view.ids) >= FEWEST
    }
    flat = np.diag([1.0, -1.0, -1.0]) if rotation is None else np.asarray(rotation, float)
    placed = Pose(Rotation.from_matrix(flat), np.asarray(position, float))
    cameras, boards = _chained(seen, lenses, board, instant, placed)
    cameras, boards = _refined(seen, lenses, board, cameras, boards, instant)
    misses = {key: _missed(lenses[key[0]], cameras[key[0]] @ boards[key[1]], view, board) for key, view in seen.items()}
    own = {name: {i: rms(miss) for (other, i), miss in misses.items() if other == name} for name in lenses}
    together = {n: rms(np.concatenate([miss for (other, _), miss in misses.items() if other == n])) for n in lenses}
    return SpaceCalibration({n: _camera(n, lenses[n], cameras[n]) for n in lenses}, together, own, boards)


Seen = Mapping[tuple[str, int], Corners]


def _camera(name: str, lens: Lens, world: Pose) -> Camera:
    """Return the camera whose pose of the world, in its own axes, is this."""
    K = lens.camera_matrix.copy()
    K[0, 1] = 0.0
    R = world.rotation.as_matrix()
    return Camera(name, lens.width, lens.height, K, R, world.inverse().position, lens.distortion)


def _chained(
    seen: Seen, lenses: Mapping[str, Lens], board: Board, instant: int, placed: Pose
) -> tuple[dict[str, Pose], dict[int, Pose]]:
    """Return first poses: of the world in each camera, and of the board in the world, from one view to the next."""
    of_board = {key: board_pose(lenses[key[0]], view, board) for key, view in seen.items()}
    boards, cameras = {instant: placed}, dict[str, Pose]()
    for _ in range(len(lenses)):
        for (name, i), pose in of_board.items():
            if name not in cameras and i in boards:
                cameras[name] = pose @ boards[i].inverse()
        for (name, i), pose in of_board.items():
            if i not in boards and name in cameras:
                boards[i] = cameras[name].inverse() @ pose
    if not cameras:
        raise InputError("instant", instant, "an instant at which a camera saw the board")
    apart = [name for name in lenses if name not in cameras]
    if apart:
        raise InputError("views", ", ".join(apart), "cameras that saw the board at the same instants as the others")
    return cameras, boards


def _refined(
    seen: Seen,
    lenses: Mapping[str, Lens],
    board: Board,
    cameras: dict[str, Pose],
    boards: dict[int, Pose],
    instant: int,
) -> tuple[dict[str, Pose], dict[int, Pose]]:
    """Return the poses that leave the smallest squared distances in the images; the board's at `instant` is given."""
    moving = [*cameras, *(i for i in boards if i != instant)]
    rows = {i: row for row, i in enumerate(boards)}
    of_camera = {
        name: (
            np.concatenate([np.full(len(view.ids), rows[i]) for (other, i), view in seen.items() if other == name]),
            np.concatenate([board.points[view.ids] for (other, _), view in seen.items() if other == name]),
            np.concatenate([view.pixels for (other, _), view in seen.items() if other == name]),
        )
        for name in cameras
    }  # of every corner that it saw: at which instant, where on the board [m], where in the image

    def poses(x: np.ndarray) -> dict[str | int, Pose]:
        """Poses by camera and instant: each the first one, turned and moved by six small numbers."""
        found: dict[str | int, Pose] = {instant: boards[instant]}
        for key, (turn, shift) in zip(moving, x.reshape(-1, 2, 3), strict=True):
            before = cameras[key] if isinstance(key, str) else boards[key]
            found[key] = Pose(Rotation.from_rotvec(turn) * before.rotation, before.position + shift)
        return found

    def misses(x: np.ndarray) -> np.ndarray:
        at, missed = poses(x), []
        for name, (instants, on_board, pixels) in of_camera.items():
            turned = np.stack([at[i].rotation.as_matrix() for i in boards])
            moved = np.stack([at[i].position for i in boards])
            place = np.einsum("pij,pj->pi", turned[instants], on_board) + moved[instants]
            missed.append(_image(lenses[name], at[name], place) - pixels)
        return np.concatenate(missed).ravel()

    best = least_squares(misses, np.zeros(6 * len(moving)), method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12)
    at = poses(best.x)
    return {name: at[name] for name in cameras}, {i: at[i] for i in boards}


def _image(lens: Lens, pose: Pose, points: np.ndarray) -> np.ndarray:
    """Return the pixels (P, 2) of points (P, 3) [m] of a body with this pose in the camera's axes."""
    x, y, z = (pose.rotation.apply(points) + pose.position).T
    flat = distort(np.stack([x / z, y / z], axis=-1), lens.distortion)
    return flat * np.diag(lens.camera_matrix)[:2] + lens.camera_matrix[:2, 2]


def _missed(lens: Lens, pose: Pose, view: Corners, board: Board) -> np.ndarray:
    """Return how far the corners of a board in a camera's axes are from where they were seen [pixels], (P, 2)."""
    return _image(lens, pose, board.points[view.ids]) - view.pixels


def rms(misses: np.ndarray) -> float:
    """Return the root mean square length of vectors in an image, (P, 2) [pixels]."""
    return float(np.sqrt((misses**2).sum(axis=1).mean()))


@dataclass(frozen=True)
class Agreement:
    """Agreement of cameras on the pose of a board; if the others agree without a camera, that camera was moved."""

    misfit: float  # root mean square reprojection error over all cameras at the best common pose [pixels]
    without: dict[str, float]  # this error of the others without one camera, by its name; empty for two cameras


def agree(cameras: Mapping[str, Camera], views: Mapping[str, Corners | None], board: Board) -> Agreement:
    """Return the agreement of at least two calibrated cameras, by name, on the pose of a board that they see at the
    same time; a view is None if the camera does not see the board."""
    if unknown := set(views) - set(cameras):
        raise InputError("views", ", ".join(sorted(unknown)), f"the cameras: {', '.join(cameras)}")
    seen = {name: view for name, view in views.items() if view is not None and len(view.ids) >= FEWEST}
    if len(seen) < 2:
        given = ", ".join(seen) or "none"
        raise InputError("views", given, f"two cameras or more that see {FEWEST} corners or more of the board")
    without = {name: _misfit({n: cameras[n] for n in seen if n != name}, seen, board) for name in seen}
    together = _misfit({name: cameras[name] for name in seen}, seen, board)
    return Agreement(together, without if len(seen) > 2 else {})


def _misfit(cameras: Mapping[str, Camera], views: Mapping[str, Corners], board: Board) -> float:
    """Return the root mean square distance in the images at the pose of the board that cameras agree on best."""
    name, first = next(iter(cameras.items()))
    start = Pose(Rotation.from_matrix(first.rotation.T), first.position) @ board_pose(first, views[name], board)

    def misses(x: np.ndarray) -> np.ndarray:
        turned = Rotation.from_rotvec(x[:3]) * start.rotation
        places = turned.apply(board.points) + start.position + x[3:]
        each = [c.project(places[views[n].ids]) - views[n].pixels for n, c in cameras.items()]
        return np.concatenate(each).ravel()

    best = least_squares(misses, np.zeros(6), method="lm", x_scale="jac")
    return rms(best.fun.reshape(-1, 2))
