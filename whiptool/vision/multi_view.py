"""Several cameras that recorded one strike: triangulation of points, and a check of the camera poses.

Triangulation is used for display, for frames that no model of the whip explains, and for adaptation, which needs the
tip's path. A fit needs none, as it compares the model with the pixels of each camera at that camera's times.

Two lines of sight to one marker meet, unless a camera was moved or rotated. A shift within the plane of both lines is
not detected: a board is better (`space_calibration.agree`), but tracks are always available.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.interpolate import PchipInterpolator

from whiptool.errors import InputError
from whiptool.recording.camera import Camera
from whiptool.recording.strike_recording import StrikeRecording

_ROUNDS = 6  # Gauss-Newton from the point nearest to all sights: quadratic, so that these do
_NARROWEST = 1e-4  # smallest eigenvalue over the number of sights: about the squared sine of half the angle between two


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Triangulated points in space, and their accuracy."""

    points: np.ndarray  # [m], (..., 3); NaN if fewer than two cameras saw it, or all from nearly one direction
    residual: np.ndarray  # root mean square reprojection error [pixels], (...)
    covariance: np.ndarray  # [m^2], (..., 3, 3), for errors of one pixel per coordinate of each camera


def triangulate(cameras: Sequence[Camera], pixels: np.ndarray) -> Triangulated:
    """Return the points that minimise the squared reprojection errors, summed over the cameras.

    Args:
        cameras: C cameras, at least two.
        pixels: Measured pixels of the points in each camera, with lens distortion, (C, ..., 2); NaN where not seen.

    Raises:
        InputError: There are fewer than two cameras, or `pixels` has another shape.
    """
    pixels = np.asarray(pixels, float)
    if len(cameras) < 2:
        raise InputError("cameras", len(cameras), "two or more")
    if pixels.ndim < 2 or len(pixels) != len(cameras) or pixels.shape[-1] != 2:
        raise InputError("pixels", f"shape {pixels.shape}", f"shape ({len(cameras)}, ..., 2), one row per camera")
    shape = pixels.shape[1:-1]
    flat = pixels.reshape(len(cameras), -1, 2)
    seen = np.asarray(np.isfinite(flat).all(axis=-1))  # (C, P)
    straight = np.stack(
        [c.undistorted(np.where(s[:, None], p, 0.0)) for c, p, s in zip(cameras, flat, seen, strict=True)]
    )
    points, wide = _nearest_to_sights(cameras, flat, seen)
    known = wide & (seen.sum(axis=0) > 1)
    points[~known] = np.nan
    for _ in range(_ROUNDS):
        r, J = _residuals(cameras, points, straight, seen)
        points = points + np.linalg.solve(_normal(J, known), -np.einsum("cpij,cpi->pj", J, r)[..., None])[..., 0]
    r, J = _residuals(cameras, points, straight, seen)
    covariance = np.where(known[:, None, None], np.linalg.inv(_normal(J, known)), np.nan)
    residual = np.where(known, np.sqrt((r**2).sum(axis=(0, 2)) / np.maximum(seen.sum(axis=0), 1)), np.nan)
    points[~known] = np.nan
    return Triangulated(points.reshape(*shape, 3), residual.reshape(shape), covariance.reshape(*shape, 3, 3))


def _nearest_to_sights(
    cameras: Sequence[Camera], pixels: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (P, 3) nearest to all lines of sight, by squares, and which are fixed by them (P,)."""
    A, b = np.zeros((pixels.shape[1], 3, 3)), np.zeros((pixels.shape[1], 3))
    for camera, at, here in zip(cameras, pixels, seen, strict=True):
        d = camera.sights(np.where(here[:, None], at, 0.0))
        across = here[:, None, None] * (np.eye(3) - d[:, :, None] * d[:, None, :])
        A += across
        b += across @ camera.position
    wide = np.linalg.eigvalsh(A)[:, 0] > _NARROWEST * np.maximum(seen.sum(axis=0), 1)
    A[~wide] = np.eye(3)
    return np.linalg.solve(A, b[..., None])[..., 0], wide


def _residuals(
    cameras: Sequence[Camera], points: np.ndarray, straight: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return images less what was seen, without distortion [pixels], (C, P, 2), and their derivatives (C, P, 2, 3).

    Of a camera that did not see the point, both are zero.
    """
    r, J = np.zeros((*seen.shape, 2)), np.zeros((*seen.shape, 2, 3))
    for c, camera in enumerate(cameras):
        x, y, z = np.moveaxis(camera.to_camera(points), -1, 0)
        flat = np.stack([x / z, y / z], axis=-1)
        r[c] = flat * camera.focal_lengths + camera.principal_point - straight[c]
        by_camera = np.zeros((len(points), 2, 3))
        by_camera[:, 0, 0] = by_camera[:, 1, 1] = 1 / z
        by_camera[:, :, 2] = -flat / z[:, None]
        J[c] = camera.focal_lengths[:, None] * (by_camera @ camera.rotation)
    left_out = ~seen | ~np.isfinite(r).all(axis=-1)
    r[left_out], J[left_out] = 0, 0
    return r, J


def _normal(J: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the normal equations' matrices (P, 3, 3); of points that are not known, the unit matrix."""
    matrix = np.einsum("cpij,cpik->pjk", J, J)
    matrix[~known] = np.eye(3)
    return matrix


GAP = 2.5  # frames without a marker over which its track is not drawn on


class CameraTrack:
    """Path of one marker in the images of one camera, from its recording with a view, interpolated between frames."""

    def __init__(self, recording: StrikeRecording, marker: str) -> None:
        assert recording.view is not None
        m = recording.markers.index(marker)
        seen = recording.seen[:, m]
        self.camera, self.t = recording.view, recording.t_points[seen, m]
        self.pixels, self.sigma = recording.points[seen, m], recording.sigma[seen, m]
        self.gap = GAP * float(np.median(np.diff(recording.t)))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the marker's pixels (T, 2) at times t (T,) [s], NaN if not tracked, and their standard errors (T,)."""
        unseen = np.full((len(t), 2), np.nan), np.full(len(t), np.nan)
        if len(self.t) < 4:
            return unseen
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        inside = (t >= self.t[0]) & (t <= self.t[-1]) & (self.t[after] - self.t[after - 1] < self.gap)
        smooth = PchipInterpolator(self.t, self.pixels)(t)
        straight = np.stack([np.interp(t, self.t, x) for x in self.pixels.T], axis=1)
        between = np.linalg.norm(smooth - straight, axis=1)  # what a curve between two frames may be wrong by
        pixels = np.where(inside[:, None], smooth, np.nan)
        return pixels, np.hypot(np.interp(t, self.t, self.sigma), between)

    def beside(self, other: CameraTrack, delay: float) -> tuple[np.ndarray, np.ndarray]:
        """Return by how far this and the other camera's lines of sight to the marker miss each other, as distances in
        the image [pixels], and their standard errors [pixels], (P,) each: at those P of this camera's frames in which
        both see the marker. `delay` is the time of the other camera's clock minus this one's [s]."""
        seen, sigma = other.at(self.t + delay)
        found = triangulate([self.camera, other.camera], np.stack([self.pixels, seen]))
        apart = 2 * found.residual  # the point between two lines of sight is half as far from either
        known = np.isfinite(apart) & np.isfinite(sigma)
        return apart[known], np.hypot(self.sigma[known], sigma[known])

    def error(self, other: CameraTrack) -> float:
        """Return the standard error of the result of `beside` due to the pixel errors of both cameras [pixels]."""
        return float(np.hypot(np.median(self.sigma), np.median(other.sigma)))


LATEST = 0.1  # [s] between two cameras' clocks
FEWEST = 10  # points that say whether two cameras agree
APART = 1.0  # [pixels] of lines of sight that do not meet: calibrations leave less
CLEARLY = 4.0  # standard errors likewise
CAP = 5.0  # standard errors that a sight counts as at most: a marker may be lost
_NORMAL = 0.6745  # median of the size of a standard normal number


@dataclass(frozen=True)
class Disagreement:
    """Two cameras whose lines of sight to the same markers do not meet."""

    cameras: tuple[str, str]  # their names
    apart: float  # median distance between the two lines of sight in an image [pixels]
    errors: float  # median distance in units of the stated errors
    delay: float  # second clock minus first at which they agree best [s]

    def __str__(self) -> str:
        return f"{self.cameras[0]} and {self.cameras[1]} by {self.apart:.1f} pixels"


def disagreements(recordings: Sequence[StrikeRecording]) -> list[Disagreement]:
    """Return the pairs of cameras that disagree on the positions of markers, of recordings with a view. Recordings with
    the same joint log are of one strike; without joint logs, so are the k-th recordings of the same command by
    different cameras."""
    found = []
    for strike in _by_strike([r for r in recordings if r.view is not None]):
        for pair in combinations(strike, 2):
            disagreement = compare(*pair)
            if disagreement.apart > APART and disagreement.errors > CLEARLY:
                found.append(disagreement)
    return found


def moved(found: Iterable[Disagreement]) -> str | None:
    """Return the only camera that is part of all disagreements; None if there is not exactly one."""
    sets = [set(one.cameras) for one in found]
    common = set.intersection(*sets) if sets else set()
    return common.pop() if len(common) == 1 else None


def compare(first: StrikeRecording, second: StrikeRecording) -> Disagreement:
    """Return the disagreement of two cameras on the same markers, at the best delay between their clocks.

    The delay minimises the squared distances, each limited to `CAP` standard errors; it is 0 unless another is
    significantly better. Delays with which less than half of the points overlap are not tried.
    """
    assert first.view is not None
    assert second.view is not None
    names = first.view.name, second.view.name
    at_once, width, best = _Sights(first, second, 0.0), LATEST, 0.0
    tried, costs = {0.0: at_once}, dict[float, float]()
    for _ in range(4):
        for delay in best + width * np.linspace(-1, 1, 41):
            tried[float(delay)] = _Sights(first, second, float(delay))
        fewest = max(FEWEST, max(sights.count for sights in tried.values()) / 2)
        costs = {delay: sights.cost for delay, sights in tried.items() if sights.count >= fewest}
        if not costs:
            return Disagreement(names, 0.0, 0.0, 0.0)
        best, width = min(costs, key=lambda delay: costs[delay]), width / 20
    if 0.0 in costs and at_once.count * (costs[0.0] - costs[best]) < CLEARLY**2:
        best = 0.0
    return Disagreement(names, tried[best].apart, tried[best].errors, best)


class _Sights:
    """The lines of sight of two cameras to the markers that both saw, at a delay [s]."""

    def __init__(self, first: StrikeRecording, second: StrikeRecording, delay: float) -> None:
        shared = [name for name in first.markers if name in second.markers]
        tracks = [(CameraTrack(first, name), CameraTrack(second, name)) for name in shared]
        parts = [(*one.beside(other, delay), one.error(other)) for one, other in tracks]
        self._apart = np.concatenate([np.zeros(0), *(apart for apart, _, _ in parts)])
        self._errors = np.concatenate([np.zeros(0), *(apart / sigma for apart, sigma, _ in parts)])
        self._steady = np.concatenate([np.zeros(0), *(apart / error for apart, _, error in parts)])

    @property
    def count(self) -> int:
        """Number of points that both saw."""
        return len(self._apart)

    @property
    def cost(self) -> float:
        """Mean square of how far they pass each other, in standard errors of the pixels alone, each at most `CAP`.

        Errors of what lies between frames are left out: they would favour delays that lie between frames.
        """
        return float(np.mean(np.minimum(self._steady, CAP) ** 2))

    @property
    def apart(self) -> float:
        """Median of how far they pass each other [pixels]."""
        return float(np.median(self._apart))

    @property
    def errors(self) -> float:
        """The same in standard errors."""
        return float(np.median(self._errors)) / _NORMAL


def _by_strike(recordings: Sequence[StrikeRecording]) -> list[list[StrikeRecording]]:
    """Return the recordings of each strike that several cameras saw."""
    groups: dict[tuple, list[StrikeRecording]] = {}
    counted: dict[tuple, int] = {}
    for recording in recordings:
        assert recording.view is not None
        name = recording.view.name
        vector = None if recording.strike is None else recording.strike.vector
        of = vector if recording.joints_q is None else recording.joints_q
        key = None if of is None else of.tobytes()
        number = 0 if recording.joints_q is not None else counted.get((key, name), 0)
        counted[key, name] = number + 1
        groups.setdefault((key, number), []).append(recording)
    return [group for group in groups.values() if len(group) > 1]


def strike_in_space(recordings: Sequence[StrikeRecording]) -> StrikeRecording:
    """Triangulate the markers of one strike that two or more cameras recorded.

    Positions are those at the first camera's instants; the other cameras' pixels are interpolated by monotone cubics.
    Clocks are assumed to agree, unless the lines of sight meet significantly better with a delay. Points whose lines of
    sight do not meet, such as wrong detections, are left out. Standard errors are propagated from the pixels' and the
    interpolation's, averaged over directions; an error of the delay is not included. Measured depths are not used.

    Args:
        recordings: One recording in pixels of each camera, of the same command. The joint log is taken from the first.

    Raises:
        InputError: There are fewer than two recordings, one is not in pixels or of another command, no marker was seen
            by two cameras, or lines of sight do not meet at any delay.
    """
    _check(recordings)
    first, *others = recordings
    delays = [_delay(first, other) for other in others]
    found = [_marker(first, others, delays, name) for name in first.markers]
    points, sigma = (np.stack(x, axis=1) for x in zip(*found, strict=True))
    if not np.isfinite(points).any():
        raise InputError(first.source or "recordings", "no marker that two cameras saw", "the same markers in both")
    return dataclasses.replace(
        first,
        points=points,
        sigma=sigma,
        view=None,
        depth=None,
        depth_sigma=None,
        camera=" and ".join(r.camera for r in recordings),
        source=" and ".join(r.source for r in recordings if r.source),
        notes=tuple(f"{r.camera}: {note}" for r in recordings for note in r.notes),
    )


def _check(recordings: Sequence[StrikeRecording]) -> None:
    """Refuse what is not one strike by several cameras."""
    if len(recordings) < 2:
        raise InputError("recordings", len(recordings), "two or more, one of each camera")
    for recording in recordings:
        if recording.view is None:
            raise InputError(
                recording.source or "recording", "positions", "pixels of a camera (tip_u, tip_v), with its view"
            )
    names = [r.view.name for r in recordings if r.view is not None]
    if len(set(names)) < len(names):
        raise InputError("recordings", f"of the cameras {', '.join(names)}", "one recording of each camera")
    strikes = {tuple(r.strike.vector.tolist()) for r in recordings if r.strike is not None}
    if len(strikes) > 1:
        raise InputError("recordings", f"{len(strikes)} different commands", "recordings of one strike")


def _delay(first: StrikeRecording, second: StrikeRecording) -> float:
    """The second camera's times less the first's [s]."""
    best = compare(first, second)
    if best.apart > APART and best.errors > CLEARLY:
        allowed = f"lines of sight that meet within {APART:g} pixel"
        raise InputError("recordings", f"{best}", allowed, "was a camera moved, or are they of different strikes?")
    return best.delay


def _marker(
    first: StrikeRecording, others: Sequence[StrikeRecording], delays: Sequence[float], name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3) of one marker at the first camera's instants, NaN where it is not known; standard errors (T,)."""
    m = first.markers.index(name)
    t = first.t_points[:, m]
    seen = [(first.points[:, m], first.sigma[:, m])]
    cameras = [first.view]
    for other, delay in zip(others, delays, strict=True):
        if name in other.markers:
            seen.append(CameraTrack(other, name).at(t + delay))
            cameras.append(other.view)
    unknown = np.full((len(t), 3), np.nan), np.full(len(t), np.nan)
    if len(cameras) < 2:
        return unknown
    pixels, sigma = (np.stack(x) for x in zip(*seen, strict=True))
    found = triangulate([c for c in cameras if c is not None], pixels)
    known = np.isfinite(pixels[..., 0])
    squares = np.where(known, sigma, 0.0) ** 2
    sigma = np.sqrt(squares.sum(axis=0) / np.maximum(known.sum(axis=0), 1))  # [pixels]
    meets = found.residual <= np.maximum(APART, CLEARLY * sigma)
    spread = np.sqrt(np.trace(found.covariance, axis1=1, axis2=2) / 3)  # [m/pixel]
    return np.where(meets[:, None], found.points, np.nan), np.where(meets, spread * sigma, np.nan)
