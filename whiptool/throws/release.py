"""Release of a thing along the path of a tip or hand: the best instant, and what a late or early release costs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from whiptool.models.trajectory import closest_on_segments
from whiptool.throws.flight import EXACT, Landing, land
from whiptool.throws.passage import Opening

RATE = 1000.0  # [Hz] of the samples between which states are interpolated by cubics
BAND = 2.0  # standard deviations of the release time to either side: 95 % of normal releases
NODES = 5  # instants of the band that are judged
FARTHEST = 100.0  # [m]; a thing that misses by more counts as missing by this
_STRIDE = 4  # samples between those from which the search for the best instant begins
_COARSE = 1e-5  # [m], error of a step of a flight while the best instant is looked for
_POWER = 8  # of the mean over the band; the larger, the nearer to the largest miss
_ROUNDS, _EXACT = 20, 1e-14  # of the search for the root of a slope, and its last step [s]


@dataclass(frozen=True, eq=False)
class Release:
    """Releases of B things along S samples of their paths.

    The miss of a release is that of the thing at its landing. If the release time has an error, it is
    `(sum_j d_j^8)^(1/8)` over `NODES` instants of a band of `BAND` standard deviations to either side: at least the
    largest of their misses d_j, and differentiable.

    Args:
        states: Positions and velocities, (B, S, 2 d); NaN after a path's end.
        opening: Openings of the boxes when the strikes begin, with centres (B, d).
        gravity: Gravity [m/s^2].
        drag: Drag per mass of the thing [1/m].
        noise: Standard deviation of the release time [s].
    """

    states: np.ndarray
    opening: Opening
    gravity: float
    drag: float
    noise: float = 0.0

    @cached_property
    def lags(self) -> np.ndarray:
        """Instants of the band relative to the intended one, (J,) [s]."""
        return BAND * self.noise * np.linspace(-1, 1, NODES) if self.noise else np.zeros(1)

    @cached_property
    def last(self) -> np.ndarray:
        """Index of the last sample of each path, (B,)."""
        return np.isfinite(self.states[:, :, 0]).sum(axis=1) - 1

    def best(self) -> np.ndarray:
        """Return the time of the release with the smallest miss, (B,) [s]."""
        B, S = self.states.shape[:2]
        rows, seen = np.arange(B), np.arange(0, S, _STRIDE)
        flat = np.repeat(rows, len(seen)), np.tile(seen / RATE, B)
        offsets = self._land(*flat, tolerance=_COARSE).offset.reshape(B, len(seen), -1)
        offsets[seen[None] > self.last[:, None]] = np.nan
        begin = _STRIDE * self._nearest(offsets, _STRIDE)
        near = np.clip(begin[:, None] + np.arange(-_STRIDE, 2 * _STRIDE + 1), 0, np.maximum(self.last, 0)[:, None])
        misses = self.miss(np.repeat(rows, near.shape[1]), near.ravel() / RATE, tolerance=_COARSE).reshape(near.shape)
        at = near[rows, misses.argmin(axis=1)]
        end = self.last / RATE
        return self._root(np.maximum(at - 1, 0) / RATE, np.minimum((at + 1) / RATE, np.maximum(end, 0)))

    def _nearest(self, offsets: np.ndarray, stride: int) -> np.ndarray:
        """Return the sample before the smallest miss, (B,), of offsets (B, K, d) at every so many samples."""
        if not self.noise:
            return closest_on_segments(offsets, np.zeros(offsets.shape[2])).segment
        misses = np.linalg.norm(offsets, axis=2)
        shifts = np.round(self.lags * RATE / stride).astype(int)
        known = np.clip(np.arange(misses.shape[1])[:, None] + shifts, 0, (self.last // stride)[:, None, None])
        worst = np.take_along_axis(misses[:, :, None], known, axis=1).max(axis=2)
        return np.where(np.isnan(worst), np.inf, worst).argmin(axis=1)

    def _root(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Return where the miss is smallest between two times (B,) [s], by the Illinois form of regula falsi."""
        of_low, of_high = (self.half_slope(t) for t in (low, high))
        at, side = np.where(of_low >= 0, low, high), np.zeros(len(low))
        within = (of_low < 0) & (of_high > 0)
        for _ in range(_ROUNDS):
            rise = np.where(within, of_high - of_low, 1.0)
            before, at = at, np.where(within, np.clip(high - of_high * (high - low) / rise, low, high), at)
            if np.abs(at - before).max(initial=0.0) < _EXACT:
                break
            slope = self.half_slope(at)
            above, below = within & (slope > 0), within & (slope <= 0)
            of_low = np.where(above & (side > 0), of_low / 2, np.where(below, slope, of_low))
            of_high = np.where(below & (side < 0), of_high / 2, np.where(above, slope, of_high))
            high, low = np.where(above, at, high), np.where(below, at, low)
            side = np.where(above, 1.0, -1.0)
        return at

    def at(self, rows: np.ndarray, times: np.ndarray, values: np.ndarray | None = None) -> list[np.ndarray]:
        """Return values (R, ...) of paths at times (R,) [s], and their rates.

        Between samples positions are polynomials of the fifth degree, with the samples' positions and velocities, and
        with accelerations from the neighbouring samples. Velocities that had kinks at samples would draw the best
        release to one, and leave it there whatever the strike.

        Args:
            rows: Indices of the paths, (R,).
            times: Times [s].
            values: Positions and velocities (B, S, 2 d, ...); None: the states.

        Returns:
            Positions and velocities (R, 2 d, ...), and velocities and accelerations (R, 2 d, ...).
        """
        values = self.states if values is None else values
        d, last = values.shape[2] // 2, np.maximum(self.last[rows], 0)
        first = np.clip((times * RATE).astype(int), 0, np.maximum(last - 1, 0))
        s = (times * RATE - first).reshape((-1,) + (1,) * (values.ndim - 2))
        ends = [(x, x > 0, x < last) for x in (first, np.minimum(first + 1, last))]
        (p0, v0, a0), (p1, v1, a1) = (self._sample(values, rows, i, before, after, d) for i, before, after in ends)
        gap, into, out = p1 - p0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
        c3, c4, c5 = 10 * gap - 4 * into + out / 2, -15 * gap + 7 * into - out, 6 * gap - 3 * into + out / 2
        place = p0 + s * (v0 + s * (a0 / 2 + s * (c3 + s * (c4 + s * c5))))
        along = RATE * (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5))))
        bend = RATE**2 * (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5)))
        return [np.concatenate([place, along], axis=1), np.concatenate([along, bend], axis=1)]

    @staticmethod
    def _sample(
        values: np.ndarray, rows: np.ndarray, i: np.ndarray, before: np.ndarray, after: np.ndarray, d: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position, velocity and acceleration (R, d, ...) of samples i (R,), per interval.

        Accelerations have errors of the fourth order of the interval; at a path's ends, which lack a neighbour on one
        side, as `before` and `after` say, of the second.
        """
        near = [values[rows, j] for j in (i - before, i, i + after)]
        (pb, vb), (p, v), (pa, va) = ((x[:, :d], x[:, d:] / RATE) for x in near)
        shape = (-1,) + (1,) * (p.ndim - 1)
        back, ahead = (6 * (pb - p) + 2 * vb + 4 * v), (6 * (pa - p) - 4 * v - 2 * va)
        both = 2 * (pa - 2 * p + pb) - (va - vb) / 2
        one_side = np.where(before.reshape(shape), back, np.where(after.reshape(shape), ahead, 0.0))
        return p, v, np.where((before & after).reshape(shape), both, one_side)

    def landing(self, states: np.ndarray, rows: np.ndarray, times: np.ndarray, **how) -> Landing:
        """Return the landings of things released in states (R, 2 d) at times (R,) [s]; `how` is passed on to `land`."""
        centres = self.opening.centres[rows] + self.opening.drift * times[:, None]
        opening = replace(self.opening, centres=centres)
        return land(states, opening, gravity=self.gravity, drag=self.drag, **how)

    def _land(self, rows: np.ndarray, times: np.ndarray, **how) -> Landing:
        return self.landing(self.at(rows, times)[0], rows, times, **how)

    def band(self, rows: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return paths and instants of the band around release times (R,) [s], (R J,) each, kept within the path."""
        asked = (times[:, None] + self.lags).ravel()
        each = np.repeat(rows, len(self.lags))
        return each, np.clip(asked, 0, np.maximum(self.last[each], 0) / RATE)

    def miss(self, rows: np.ndarray, times: np.ndarray, *, tolerance: float = EXACT) -> np.ndarray:
        """Return the misses of releases at times (R,) [s] along paths `rows` (R,), (R,) [m]."""
        offsets = self._land(*self.band(rows, times), tolerance=tolerance).offset
        return together(np.linalg.norm(offsets, axis=1).reshape(len(rows), -1))[0]

    def half_slope(self, times: np.ndarray, *, tolerance: float = EXACT) -> np.ndarray:
        """Return the derivatives of half the squared misses by the times of release (B,) [s], (B,)."""
        rows, instants = self.band(np.arange(len(times)), times)
        states, rates = self.at(rows, instants)
        return self.half_slope_of(states, rates, rows, instants, tolerance=tolerance)

    def half_slope_of(
        self, states: np.ndarray, rates: np.ndarray, rows: np.ndarray, instants: np.ndarray, *, tolerance: float = EXACT
    ) -> np.ndarray:
        """Return the derivatives of half the squared misses by time, of states (B J, 2 d) that change at `rates`."""
        found = self.landing(states, rows, instants, slopes=True, tolerance=tolerance)
        by_time = self.by_time(found, rates)
        weights = together(np.linalg.norm(found.offset, axis=1).reshape(-1, len(self.lags)))[1]
        return (weights * (found.offset * by_time).sum(axis=1).reshape(weights.shape)).sum(axis=1)

    def by_time(self, found: Landing, rates: np.ndarray) -> np.ndarray:
        """Return the derivatives of offsets by the times of release, (R, d) [m/s], of states that change at `rates`."""
        assert found.slopes is not None
        d = found.offset.shape[1]
        seen = rates - np.r_[self.opening.drift, np.zeros(d)]  # from the box
        return np.einsum("rij,rj->ri", found.slopes[:, :d, : 2 * d], seen)


def together(misses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the miss of a band of misses (R, J), (R,) [m], and the weights of their half squares in its, (R, J)."""
    largest = misses.max(axis=1, keepdims=True)
    shares = np.divide(misses, largest, out=np.ones_like(misses), where=largest > 0)
    if misses.shape[1] == 1:
        return misses[:, 0], shares
    norm = (shares**_POWER).sum(axis=1, keepdims=True) ** (1 / _POWER)
    return (largest * norm)[:, 0], (shares / norm) ** (_POWER - 2)
