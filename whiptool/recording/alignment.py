"""How two records of one motion lie to each other: offset and rate of their clocks, rotation, shift and scale.

The speeds of both are correlated over all offsets. From the best one a least-squares fit goes on:

    place at (offset + middle + rate (time - middle)) = scale R (hand + lever) + shift

The rate has a prior of 1 +- 0.002, which covers crystals and 59.94 frames for 60; the lever, from the hand to the
marker in the hand's axes, one of 0 +- 0.1 m. Standard errors are those of the residuals' scatter, with their
autocorrelation.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import correlate, savgol_filter
from scipy.spatial.transform import Rotation

RATE_PRIOR = 2e-3  # standard error of a clock's rate
LEVER_PRIOR = 0.1  # [m] from the hand to a marker
LEAST = 0.8  # correlation of the speeds below which the two show no common motion
OVERLAP = 0.5  # of a track's motion that has to be within the other record
WINDOW = 7  # samples of the polynomial whose slope is the speed
FEWEST = 20  # places
GRID = 20_000  # samples of the correlation, at most
SPEED = 0.05  # [m/s] that has to be reached


@dataclass(frozen=True, eq=False)
class Path:
    """A path through time."""

    t: np.ndarray  # times [s], (T,), strictly increasing
    places: np.ndarray  # [m], (T, 2 or 3), finite
    rotations: np.ndarray | None = None  # of the body that moves along it, (T, 3, 3)


@dataclass(frozen=True, eq=False)
class Alignment:
    """How a second record of a motion lies to the first, with standard errors."""

    offset: float  # to add to the second's time for the first's, in the middle of the motion [s]
    rate: float  # seconds of the first's clock in one of the second's
    scale: float  # unit of the second's places in that of the first's
    rotation: np.ndarray  # from the second's axes to the first's, (3, 3)
    shift: np.ndarray  # place of the second's origin in the first's axes, (d,)
    errors: dict[str, float]  # standard errors of these five by name; of `rotation` [rad], of `shift` the largest
    correlation: float  # of the two speeds
    rms: float  # root mean square of the distances that are left, in the first's unit
    span: tuple[float, float]  # first and last time of the places that were compared, by the first's clock [s]


def align(first: Path, second: Path) -> Alignment | None:
    """Return how the places of the hand, or of the same marker, in `second` lie to those of a marker in `first`; None
    if they show no common motion. Both are planar or both in space."""
    if min(len(first.t), len(second.t)) < FEWEST:
        return None
    begun = float(first.t[0]), float(second.t[0])  # stamps since 1970 have too few digits for slopes
    near, far = (dataclasses.replace(path, t=path.t - path.t[0]) for path in (first, second))
    found = correlated(near, far)
    if found is None or found[1] < LEAST:
        return None
    fitted = _Fit(near, far, found[0]).solved(found[1])
    if fitted is None:
        return None
    low, high = fitted.span
    return dataclasses.replace(
        fitted, offset=fitted.offset + begun[0] - begun[1], span=(low + begun[0], high + begun[0])
    )


def correlated(first: Path, second: Path) -> tuple[float, float] | None:
    """Return the offset [s] at which the speeds of two paths agree best, and their correlation at it; None if one of
    them does not move.
    """
    spans = [float(path.t[-1] - path.t[0]) for path in (first, second)]
    dt = max(*(float(np.median(np.diff(path.t))) for path in (first, second)), max(spans) / GRID)
    a, b = (speeds(path, dt) for path in (first, second))
    if min(len(a), len(b)) < WINDOW or min(a.max(), b.max()) == 0 or a.max() < SPEED:
        return None
    # of each lag the parts that overlap
    ones_a, ones_b = np.ones_like(a), np.ones_like(b)
    products, energy_a, energy_b = correlate(a, b), correlate(a**2, ones_b), correlate(ones_a, b**2)
    enough = energy_a > OVERLAP * (a**2).sum()
    count = correlate(ones_a, ones_b)
    sums_a, sums_b = correlate(a, ones_b), correlate(ones_a, b)
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = products - sums_a * sums_b / count
        variance = (energy_a - sums_a**2 / count) * (energy_b - sums_b**2 / count)
        value = np.where(enough & (variance > 1e-12 * variance.max()), covariance / np.sqrt(variance), -1.0)
    best = int(np.nanargmax(value))
    lag = best - (len(b) - 1)
    return float(first.t[0] + lag * dt - second.t[0]), float(value[best])


def speeds(path: Path, dt: float) -> np.ndarray:
    """Return the speed [m/s] of a path on an even grid, dt [s] apart, from its first time on; empty if it is short."""
    grid = np.arange(path.t[0], path.t[-1], dt)
    if len(grid) < WINDOW:
        return np.zeros(0)
    places = np.column_stack([np.interp(grid, path.t, x) for x in path.places.T])
    return np.linalg.norm(np.asarray(savgol_filter(places, WINDOW, 2, deriv=1, delta=dt, axis=0)), axis=1)


class _Fit:
    """Least-squares fit of offset, rate, scale, rotation, shift and lever."""

    def __init__(self, first: Path, second: Path, offset: float) -> None:
        margin = 0.1
        inside = (first.t - offset >= second.t[0] + margin) & (first.t - offset <= second.t[-1] - margin)
        self.t, self.x = first.t[inside], first.places[inside]
        self.d = first.places.shape[1]
        self.middle = float(self.t.mean() - offset) if len(self.t) else 0.0
        self._path = CubicSpline(second.t, _padded(second.places))
        turned = second.rotations
        self._turned = None if turned is None else CubicSpline(second.t, turned.reshape(-1, 9))
        self._start, self._offset = np.eye(3), offset
        self.enough = len(self.t) >= FEWEST
        if self.enough:
            self._place()

    def _place(self) -> None:
        """Start from the rotation, scale and shift that fit best at the offset (Kabsch, Umeyama)."""
        h, x = self._path(self.t - self._offset), _padded(self.x)
        a, b = x - x.mean(axis=0), h - h.mean(axis=0)
        U, S, V = np.linalg.svd(a.T @ b)
        sign = np.array([1.0, 1.0, float(np.sign(np.linalg.det(U @ V)))])
        self._start = U @ np.diag(sign) @ V
        self._scale = max(float((S * sign).sum() / (b**2).sum()), 1e-6)

    def residuals(self, p: np.ndarray) -> np.ndarray:
        """Distances over their scatter, then the priors."""
        off = (self.predicted(p) - self.x).ravel() / self._sigma
        prior = [p[1] / RATE_PRIOR, *(p[3:6] / 3.0), *(p[6 + self.d :] / LEVER_PRIOR)]
        return np.concatenate([off, prior])

    def predicted(self, p: np.ndarray) -> np.ndarray:
        """Places of the marker, (K, d)."""
        at = self.middle + (self.t - self._offset - p[0] - self.middle) / (1 + p[1])
        h = self._path(at)
        if self._turned is not None:
            h = h + self._turned(at).reshape(-1, 3, 3) @ p[6 + self.d :]
        R = Rotation.from_rotvec(p[3:6]).as_matrix() @ self._start
        return self._scale * math.exp(p[2]) * (h @ R.T)[:, : self.d] + p[6 : 6 + self.d]

    def solved(self, correlation: float) -> Alignment | None:
        """The alignment; None if too few places are compared, or the fit does not hold."""
        if not self.enough:
            return None
        lever = 0 if self._turned is None else 3
        p = np.zeros(6 + self.d + lever)
        self._sigma = 1.0
        p[6 : 6 + self.d] = (self.x - self.predicted(p)).mean(axis=0)
        size = float(np.linalg.norm(self.x - self.x.mean(axis=0), axis=1).max())
        self._sigma = 0.05 * size
        for _ in range(2):  # the second time with the scatter that the first one left
            found = least_squares(self.residuals, p, method="trf", x_scale="jac", max_nfev=200)
            p = found.x
            off = self.predicted(p) - self.x
            self._sigma = max(math.sqrt(float((off**2).mean())), 1e-6 * size)
        found = least_squares(self.residuals, p, method="trf", x_scale="jac", max_nfev=50)
        p, off = found.x, self.predicted(found.x) - self.x
        covariance = np.linalg.pinv(found.jac.T @ found.jac) * _inflation(off)
        error = np.sqrt(np.diag(covariance))
        scale = self._scale * math.exp(p[2])
        d = self.d
        errors = {"offset": error[0], "rate": error[1], "scale": scale * error[2]}
        errors |= {"rotation": float(np.linalg.norm(error[3:6])), "shift": float(error[6 : 6 + d].max())}
        return Alignment(
            offset=self._offset + float(p[0]),
            rate=1 + float(p[1]),
            scale=scale,
            rotation=Rotation.from_rotvec(p[3:6]).as_matrix() @ self._start,
            shift=p[6 : 6 + d],
            errors={name: float(x) for name, x in errors.items()},
            correlation=correlation,
            rms=math.sqrt(float((off**2).sum(axis=1).mean())),
            span=(float(self.t[0]), float(self.t[-1])),
        )


def _padded(places: np.ndarray) -> np.ndarray:
    """Places (T, 3): those in a plane with a third coordinate of 0."""
    return places if places.shape[1] == 3 else np.pad(places, ((0, 0), (0, 1)))


def _inflation(off: np.ndarray) -> float:
    """By how much the autocorrelation of residuals (K, d) enlarges variances: that of a first-order autoregression."""
    off = off - off.mean(axis=0)
    total = float((off**2).sum())
    rho = float((off[1:] * off[:-1]).sum()) / total if total else 0.0
    rho = min(max(rho, 0.0), 0.98)
    return (1 + rho) / (1 - rho)
