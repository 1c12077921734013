"""Readings of a path by a recording: marker, time, exposure, frame and clock, and camera.

Recorded positions and times are those of a camera or motion capture system with a scale, a rotation, a shift and a
clock:

    measured = scale R position + shift
    stamped  = clock_rate time + delay

In the plane R is a rotation by `rotation`, in space `R = Rz Ry Rx` of rotations about the axes. Tracks that were
smoothed before export are predicted as measured: through a zero-lag Butterworth filter of second order each way, the
usual one of motion capture (Winter 2009), whose edge is 1 / `smoothing`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.signal import butter, filtfilt

from whiptool.models.kinematics import rotation_about
from whiptool.recording.camera import Camera

POINTS = 6  # of the interpolating polynomial: sixth order in the sampling interval
_TO_POLYNOMIAL = np.linalg.inv(np.vander(np.arange(POINTS), increasing=True))  # values at 0..5 -> coefficients
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)  # of the exposure's average


class Samples:
    """Interpolates K readings from paths that are sampled at `count` points, from the time `start` on every `interval`
    [s], and are constant before and after. Each reading is the mean of the path over `exposure` [s] around its time
    `at` (K,) [s]."""

    def __init__(self, at: np.ndarray, *, exposure: float, start: float, interval: float, count: int) -> None:
        nodes, shares = (_NODES * exposure / 2, _WEIGHTS / 2) if exposure else (np.zeros(1), np.ones(1))
        place = (at[:, None] + nodes - start) / interval  # (K, E) on the grid
        inside = (place >= 0) & (place <= count - 1)
        place = np.clip(place, 0, count - 1)
        first = np.clip(np.floor(place).astype(int) - (POINTS // 2 - 1), 0, count - POINTS)
        x = (place - first)[..., None]
        powers = x ** np.arange(POINTS)
        rates = np.arange(POINTS) * x ** np.maximum(np.arange(POINTS) - 1, 0)
        self.index = first[..., None] + np.arange(POINTS)  # (K, E, 6)
        self.weight = powers @ _TO_POLYNOMIAL * shares[:, None]
        self.rate = rates @ _TO_POLYNOMIAL * (shares * inside)[..., None] / interval

    def value(self, path: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Return readings (..., K, d) of paths (..., S, M, d) of M markers on the grid of S points; `which` (K,) is the
        index of each reading's marker."""
        return np.einsum("...kepd,kep->...kd", path[..., self.index, which[:, None, None], :], self.weight)

    def velocity(self, path: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Return the derivatives of the readings by time [1/s], in the shape of `value`."""
        return np.einsum("...kepd,kep->...kd", path[..., self.index, which[:, None, None], :], self.rate)


PLACED = {
    2: ("scale", "rotation", "shift_x", "shift_y"),
    3: ("scale", "rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y", "shift_z"),
}  # by dimension
NUISANCE_IN = {1: (), **{d: ("delay", "clock_rate", *names) for d, names in PLACED.items()}}  # 1: angles of links
NUISANCE = ("delay", "clock_rate", *dict.fromkeys((*PLACED[2], *PLACED[3])))
NEUTRAL = {name: float(name in ("scale", "clock_rate")) for name in NUISANCE}

SMOOTHING = "smoothing"  # [s] of a recording's own unknowns: period of the edge of its filter; 0: none
_ORDER, _PADDED = 2, 9  # of the filter each way; frames by which it extends a track at either end
_HIGHEST = 0.49  # of the frame rate: a filter with a higher edge does nothing
_STEP = 1e-4  # of the edge, for its derivative


def low_pass(x: np.ndarray, edge: float) -> np.ndarray:
    """Return tracks x (..., T) through the zero-lag filter with an edge per frame rate; short ones unchanged."""
    if edge >= _HIGHEST or x.shape[-1] <= _PADDED:
        return x
    above, below = butter(_ORDER, 2 * edge)[:2]
    return np.asarray(filtfilt(above, below, x))


def placed(x: np.ndarray, given: Mapping[str, float]) -> np.ndarray:
    """Return positions x (..., d) [m] as measured, with the scale, rotations and shifts `PLACED[d]` in `given`."""
    d = x.shape[-1]
    shift = [given[f"shift_{axis}"] for axis in "xyz"[:d]]
    return given["scale"] * x @ _turned(given, d)[0].T + shift


def carried(dx: np.ndarray, given: Mapping[str, float]) -> np.ndarray:
    """Return the change of measured positions for a change dx (..., d) of the true positions."""
    return given["scale"] * dx @ _turned(given, dx.shape[-1])[0].T


def by_placement(x: np.ndarray, given: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the derivatives of the measured positions by each scale, rotation and shift `PLACED[d]`, (K, d) each, at
    true positions x (K, d) [m]."""
    d = x.shape[-1]
    R, slopes = _turned(given, d)
    found = {"scale": x @ R.T}
    found |= {name: given["scale"] * x @ dR.T for name, dR in slopes.items()}
    return found | {f"shift_{axis}": np.broadcast_to(np.eye(d)[i], x.shape) for i, axis in enumerate("xyz"[:d])}


def _turned(given: Mapping[str, float], d: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return R (d, d), and its derivative by each turn."""
    if d == 2:
        c, s = np.cos(given["rotation"]), np.sin(given["rotation"])
        return np.array([[c, -s], [s, c]]), {"rotation": np.array([[-s, -c], [c, -s]])}
    axes = np.eye(3).tolist()
    X, Y, Z = (rotation_about(axis, given[f"rotation_{name}"]) for axis, name in zip(axes, "xyz", strict=True))
    Kx, Ky, Kz = (np.cross(axis, -np.eye(3)) for axis in axes)
    return Z @ Y @ X, {"rotation_x": Z @ Y @ Kx @ X, "rotation_y": Z @ Ky @ Y @ X, "rotation_z": Kz @ Z @ Y @ X}


class Reading:
    """Measured readings of one recording, and their prediction from a simulated path.

    A camera's reading is the image of a marker's mean position during the exposure; the mean of its images differs by
    some hundredths of a pixel if the marker comes 10 cm nearer during an exposure. Depth is fitted as inverse depth,
    which is proportional to a stereo pair's disparity: its errors are normal and equally large at all distances. Errors
    of depth grow with the measured depth, so that depths measured too small would have too large a weight.

    Args:
        names, links: Names of M markers, and for each the index of the link at whose end it is, see `Drive.link_of`.
        t: Middle of each marker's exposure [s], (T, M).
        values, sigma: Measured values and their standard errors, (T, M, axes): positions [m], angles [rad], or pixels
            and inverse depth [1/m]; NaN if missing.
        exposure: Exposure time [s].
        view: Camera of a recording in pixels; None: positions or angles were measured.

    Attributes:
        measured, sigma: The K readings that are not missing, and their standard errors, (K,).
        channels: Frame, marker and axis of each reading, (K, 3).
    """

    def __init__(
        self,
        names: list[str],
        links: list[int],
        t: np.ndarray,
        values: np.ndarray,
        sigma: np.ndarray,
        exposure: float,
        view: Camera | None = None,
    ) -> None:
        seen = np.isfinite(values[..., 0])  # (T, M)
        frame, self.which = np.nonzero(seen)
        self.names, self.links, self.exposure, self.view = names, links, exposure, view
        self.axes = values.shape[2]
        self.at, self.width = t[seen], self.axes if view is None else 3
        self._there = np.isfinite(values[seen])  # (K', axes): a point may be seen whose depth was not measured
        self.measured, self.sigma = values[seen][self._there], sigma[seen][self._there]
        self._point, axis = np.nonzero(self._there)
        self.channels = np.stack([frame[self._point], self.which[self._point], axis], axis=1)
        series = self.channels[:, 1] * 8 + self.channels[:, 2]
        self._series = [np.flatnonzero(series == name) for name in np.unique(series)]
        self._grid: tuple | None = None

    def read(
        self, path: np.ndarray, dpath: np.ndarray, given: dict[str, float], *, start: float, interval: float
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], np.ndarray]:
        """Predict the readings from a simulated path as `_taken` does, smoothed if that is among the given."""
        value, by_path, nuisance, size = self._taken(path, dpath, given, start=start, interval=interval)
        if SMOOTHING not in given:
            return value, by_path, nuisance, size
        rows = np.vstack([value, by_path, *nuisance.values()])
        found, slope = np.empty_like(rows), np.zeros(len(value))
        for series in self._series:
            edge = float(np.median(np.diff(self.at[self._point[series]]))) / max(abs(given[SMOOTHING]), 1e-9)
            found[:, series] = low_pass(rows[:, series], edge)
            ends = [low_pass(value[series], edge * (1 + step)) for step in (_STEP, -_STEP)]
            slope[series] = (ends[1] - ends[0]) / (2 * _STEP * (given[SMOOTHING] or 1.0))
        by = dict(zip(nuisance, found[1 + len(by_path) :], strict=True)) | {SMOOTHING: slope}
        return found[0], found[1 : 1 + len(by_path)], by, size

    def _taken(
        self, path: np.ndarray, dpath: np.ndarray, given: dict[str, float], *, start: float, interval: float
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], np.ndarray]:
        """Predict the K readings from a simulated path (S, M, d) of the M markers and its derivatives by D unknowns;
        return them, their derivatives (D, K) and those by each nuisance parameter (K,), and the smallest displacement
        of a point that changes a reading by one unit, (K,)."""
        rate = given["clock_rate"]
        key = (given["delay"], rate, start, interval, len(path))
        if self._grid is None or self._grid[0] != key:  # most fits have no delay: the same grid again and again
            at = (self.at - given["delay"]) / rate
            self._grid = key, Samples(at, exposure=self.exposure, start=start, interval=interval, count=len(path))
        grid, at = self._grid[1], (self.at - given["delay"]) / rate
        x = grid.value(path, self.which)  # (K', width)
        dx = grid.value(dpath, self.which) if len(dpath) else np.zeros((0, *x.shape))
        one = np.ones(len(self.measured))
        velocity = grid.velocity(path, self.which)
        if self.width == 1:
            return x[self._there], dx[:, self._there], {"delay": -velocity[self._there]}, one
        late = -carried(velocity, given) / rate
        by = by_placement(x, given) | {"delay": late, "clock_rate": late * at[:, None]}
        place, changed = placed(x, given), carried(dx, given)
        if self.view is None:
            return place[self._there], changed[:, self._there], {k: d[self._there] for k, d in by.items()}, one
        value, slopes = _seen(self.view, place)
        value, slopes, point = value[:, : self.axes][self._there], slopes[:, : self.axes][self._there], self._point
        nuisance = {name: np.einsum("kj,kj->k", slopes, d[point]) for name, d in by.items()}
        return value, np.einsum("kj,dkj->dk", slopes, changed[:, point]), nuisance, 1 / np.linalg.norm(slopes, axis=-1)


def _seen(view: Camera, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pixels and inverse depths [1/m] of places (K', 3), (K', 3), and their derivatives by these, (K', 3, 3)."""
    inverse = 1 / view.depth(places)
    deeper = -(inverse**2)[:, None] * view.rotation[2]
    pixels, slopes = view.project(places), view.slopes(places)
    return np.column_stack([pixels, inverse]), np.concatenate([slopes, deeper[:, None]], axis=1)
