"""Similarity of two tip paths: the paper's measure (Eq. 23), and others for errors to which it is insensitive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from whiptool.errors import InputError
from whiptool.recording.filmed_approach import FilmedApproach, approach_of_path

_LAGS = 0.1  # [s] within which the delay is sought
_RATE = 1000.0  # [1/s] of the comparison of delays


@dataclass(frozen=True)
class Similarity:
    """Comparison of a simulated tip path with a measured one.

    Args:
        rho: For each coordinate the mean of `1 - |measured - simulated| / |measured|` over the samples (Eq. 23 of the
            paper, which prints the sum): 1 if the paths are equal. It depends on the origin, here the shoulder.
        rho_mean: Mean of `rho` over the coordinates.
        left_out: Number of measured coordinates that are 0, by which `rho` cannot divide; they are left out of it.
        rmse: Root mean square distance [m].
        nrmse: `rmse` divided by the diagonal of the measured path's bounding box.
        largest: Largest distance [m].
        delay: Time by which the simulated path lags [s], from the largest cross-correlation of velocities.
        frechet: Discrete Frechet distance of the two curves, regardless of time [m].
        hit_point, hit_time, hit_speed: Distance between the two closest approaches to the target [m], and the
            differences of their times [s] and speeds [m/s], simulated minus measured; None without a target.
    """

    rho: tuple[float, ...]
    rho_mean: float
    left_out: int
    rmse: float
    nrmse: float
    largest: float
    delay: float
    frechet: float
    hit_point: float | None
    hit_time: float | None
    hit_speed: float | None


def similarity(
    t: np.ndarray, measured: np.ndarray, simulated: np.ndarray, *, target: tuple[float, ...] | None = None
) -> Similarity:
    """Compare two paths at the same times.

    Args:
        t: Times [s], (T,), increasing, at least five of them.
        measured, simulated: Tip positions relative to the shoulder [m], (T, d); frames in which either is NaN are left
            out.
        target: Target of the tip [m], (d,).

    Raises:
        InputError: Shapes differ, times do not increase, or fewer than five frames have both positions.
    """
    t, P, S = (np.asarray(x, float) for x in (t, measured, simulated))
    if P.ndim != 2 or P.shape != S.shape or t.shape != P.shape[:1]:
        raise InputError("paths", (t.shape, P.shape, S.shape), "times (T,) and two paths (T, d)")
    both = np.isfinite(P).all(axis=1) & np.isfinite(S).all(axis=1)
    t, P, S = t[both], P[both], S[both]
    if len(t) < 5 or not (np.diff(t) > 0).all():
        raise InputError("t", f"{len(t)} frames that hold both paths", "five or more, in increasing order")
    defined = P != 0
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(defined, 1 - np.sqrt((P - S) ** 2 / P**2), 0.0)  # Eq. 23
    rho = terms.sum(axis=0) / np.maximum(defined.sum(axis=0), 1)
    distance = np.linalg.norm(P - S, axis=1)
    rmse = float(np.sqrt(np.mean(distance**2)))
    size = float(np.linalg.norm(np.ptp(P, axis=0)))
    near = [None if target is None else approach_of_path(t, path, target) for path in (P, S)]
    return Similarity(
        rho=tuple(map(float, rho)),
        rho_mean=float(rho.mean()),
        left_out=int((~defined).sum()),
        rmse=rmse,
        nrmse=rmse / size if size > 0 else float("inf") if rmse else 0.0,
        largest=float(distance.max()),
        delay=_delay(t, P, S),
        frechet=frechet(P, S),
        **_apart(*near),
    )


def _apart(measured: FilmedApproach | None, simulated: FilmedApproach | None) -> dict[str, float | None]:
    """Return the numbers of a `Similarity` that say how two closest approaches differ."""
    if measured is None or simulated is None:
        return dict.fromkeys(("hit_point", "hit_time", "hit_speed"))
    return {
        "hit_point": float(np.linalg.norm(simulated.place - measured.place)),
        "hit_time": simulated.time - measured.time,
        "hit_speed": simulated.speed - measured.speed,
    }


def _delay(t: np.ndarray, P: np.ndarray, S: np.ndarray) -> float:
    """Lag of S behind P at which their velocities correlate best [s], refined by a parabola."""
    grid = np.arange(t[0], t[-1], 1 / _RATE)
    vP, vS = (CubicSpline(t, path)(grid, 1) for path in (P, S))
    most = min(int(_LAGS * _RATE), len(grid) // 2)
    lags = np.arange(-most, most + 1)

    def together(lag: int) -> float:  # the cosine of what overlaps
        a, b = (vP[: len(grid) - lag], vS[lag:]) if lag >= 0 else (vP[-lag:], vS[: len(grid) + lag])
        scale = np.linalg.norm(a) * np.linalg.norm(b)
        return float((a * b).sum() / scale) if scale > 0 else 0.0

    c = np.array([together(int(lag)) for lag in lags])
    i = int(c.argmax())
    if i in (0, len(c) - 1):
        return float(lags[i] / _RATE)
    bend = c[i - 1] - 2 * c[i] + c[i + 1]
    shift = 0.5 * (c[i - 1] - c[i + 1]) / bend if bend < 0 else 0.0
    return float((lags[i] + shift) / _RATE)


def frechet(P: np.ndarray, S: np.ndarray) -> float:
    """Return the discrete Frechet distance of two curves (T, d), (U, d) [m]; Eiter and Mannila (1994)."""
    distance = np.linalg.norm(P[:, None] - S[None], axis=2)
    reach = np.empty_like(distance)
    reach[0] = np.maximum.accumulate(distance[0])
    reach[:, 0] = np.maximum.accumulate(distance[:, 0])
    for i in range(1, len(P)):
        for j in range(1, len(S)):
            reach[i, j] = max(min(reach[i - 1, j], reach[i, j - 1], reach[i - 1, j - 1]), distance[i, j])
    return float(reach[-1, -1])
