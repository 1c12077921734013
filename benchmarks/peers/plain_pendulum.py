"""The plain fit of a pendulum: the textbook's equations of one or two rigid links with viscous friction, least squares
by SciPy on the readings, Runge-Kutta steps in NumPy for all recordings at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import norm

from whiptool.recording.strike_recording import StrikeRecording

KNOWN = 0.1  # share of a held-out recording to which its initial state is fitted
STEP = 6.5e-3  # [s], at most, of a Runge-Kutta step
NOISE = 1e-3  # [rad] of a reading
_quiet = np.errstate(all="ignore")  # of steps that diverge


def one_link(q: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Accelerations (B, 1): gravity over effective length, viscous friction over inertia."""
    return -p[:, :1] * np.sin(q) - p[:, 1:] * v


def two_links(q: np.ndarray, v: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Accelerations (B, 2) of absolute angles: inertias alpha, beta, 1, weights, two viscous frictions."""
    alpha, beta, weight1, weight2, friction1, friction2 = p.T
    c, s = np.cos(q[:, 0] - q[:, 1]), np.sin(q[:, 0] - q[:, 1])
    between = friction2 * (v[:, 0] - v[:, 1])
    f = -beta * s * v[:, 1] ** 2 - weight1 * np.sin(q[:, 0]) - friction1 * v[:, 0] - between
    g = beta * s * v[:, 0] ** 2 - weight2 * np.sin(q[:, 1]) + between
    determinant = alpha - (beta * c) ** 2
    return np.stack([f - beta * c * g, alpha * g - beta * c * f], axis=1) / determinant[:, None]


# a first guess: uniform rods of 0.3 m; two of 0.2 m and equal masses, over the second one's inertia
SYSTEMS: dict[int, tuple[Callable, np.ndarray]] = {
    1: (one_link, np.array([49.0, 0.1])),
    2: (two_links, np.array([4.0, 1.5, 220.0, 73.6, 0.1, 0.1])),
}


def simulated(links: int, p: np.ndarray, start: np.ndarray, count: int, dt: float) -> np.ndarray:
    """Angles of B swings at `count` instants, (B, count, links); p (B, P), start (B, 2 links)."""
    accelerate = SYSTEMS[links][0]
    steps = int(np.ceil(dt / STEP))
    q, v, h = start[:, :links].copy(), start[:, links:].copy(), dt / steps
    found = [q]
    for _ in range(count - 1):
        for _ in range(steps):
            a = accelerate(q, v, p)
            v2, q2 = v + h / 2 * a, q + h / 2 * v
            b = accelerate(q2, v2, p)
            v3, q3 = v + h / 2 * b, q + h / 2 * v2
            c = accelerate(q3, v3, p)
            v4, q4 = v + h * c, q + h * v3
            d = accelerate(q4, v4, p)
            q = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v = v + h / 6 * (a + 2 * b + 2 * c + d)
        found.append(q)
    return np.stack(found, axis=1)


class PlainFit:
    """Least squares of the parameters and of each recording's initial state.

    Args:
        swings: Recordings of equal step; the shortest sets how many readings of each are used.
    """

    def __init__(self, swings: Sequence[StrikeRecording]) -> None:
        self.count, self.dt = min(len(r.t) for r in swings), float(np.median(np.diff(swings[0].t)))
        self.seen = np.stack([r.points[: self.count, :, 0] for r in swings])
        self.links = self.seen.shape[2]

    def starts(self) -> np.ndarray:
        """First guess of the initial states, (R, 2 links): a parabola through five readings."""
        t = self.dt * np.arange(5)
        both = np.polynomial.polynomial.polyfit(t, self.seen[:, :5].swapaxes(0, 1).reshape(5, -1), 2)[:2]
        return np.concatenate(both.reshape(2, len(self.seen), self.links), axis=1)

    def fit(self, p: np.ndarray | None = None, *, known: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return parameters (P,) and initial states (R, 2 links).

        Args:
            p: Parameters that are kept; None: they are fitted, from short stretches to whole recordings.
            known: Number of readings to use; None: all.
        """
        first, states = SYSTEMS[self.links][1], self.starts()
        shared = np.zeros(0) if p is not None else np.log(first)
        lengths = [known] if known else [min(25, self.count), min(60, self.count), self.count]
        x = np.concatenate([shared, states.ravel()])
        for count in lengths:
            x = least_squares(self._residuals, x, jac=self._slopes, args=(p, count), x_scale="jac", max_nfev=25).x
        P = len(shared)
        return (np.exp(x[:P]) if p is None else p), x[P:].reshape(len(self.seen), -1)

    def _split(self, x: np.ndarray, p: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        P = 0 if p is not None else len(SYSTEMS[self.links][1])
        return (np.exp(x[:P]) if p is None else p), x[P:].reshape(len(self.seen), -1)

    @_quiet
    def _residuals(self, x: np.ndarray, p: np.ndarray | None, count: int) -> np.ndarray:
        values, states = self._split(x, p)
        path = simulated(self.links, np.tile(values, (len(states), 1)), states, count, self.dt)
        return np.clip(np.nan_to_num((path - self.seen[:, :count]) / NOISE, nan=1e4), -1e4, 1e4).ravel()

    @_quiet
    def _slopes(self, x: np.ndarray, p: np.ndarray | None, count: int) -> np.ndarray:
        """Differences; a recording's state moves its readings only."""
        values, states = self._split(x, p)
        R, L = states.shape
        shared = 0 if p is not None else len(values)
        each = np.tile(values, (1 + shared + L, R, 1))
        moved = np.tile(states, (1 + shared + L, 1, 1))
        for k in range(shared):
            each[1 + k, :, k] *= np.exp(1e-6)
        for k in range(L):
            moved[1 + shared + k, :, k] += 1e-6
        path = simulated(self.links, each.reshape(-1, len(values)), moved.reshape(-1, L), count, self.dt)
        path = path.reshape(len(each), R, -1)
        change = (path[1:] - path[0]) / 1e-6 / NOISE
        J = np.zeros((R, path.shape[2], shared + R * L))
        J[:, :, :shared] = np.moveaxis(change[:shared], 0, 2)
        for r in range(R):
            J[r, :, shared + r * L : shared + (r + 1) * L] = change[shared:, r].T
        return np.nan_to_num(J.reshape(-1, J.shape[2]))


def plain_study(swings: Sequence[StrikeRecording], folds: Sequence[Sequence[int]]) -> list[tuple[np.ndarray, ...]]:
    """Fit each fold and predict what it left out: times after the last known reading [s], errors [rad], and half the
    widths of 50 and 90 % intervals, which are those of the fit's residuals."""
    found = []
    for held in folds:
        inside = PlainFit([r for i, r in enumerate(swings) if i not in held])
        p, states = inside.fit()
        path = simulated(inside.links, np.tile(p, (len(states), 1)), states, inside.count, inside.dt)
        spread = float(np.std(path - inside.seen))
        outside = PlainFit([swings[i] for i in held])
        known = int(np.ceil(KNOWN * outside.count))
        _, states = outside.fit(p, known=known)
        path = simulated(outside.links, np.tile(p, (len(states), 1)), states, outside.count, outside.dt)
        error = (path - outside.seen)[:, known:]
        after = np.broadcast_to(outside.dt * np.arange(1, error.shape[1] + 1)[:, None], error.shape[1:])
        for e in error:
            half, most = (np.full(e.size, norm.ppf((1 + level) / 2) * spread) for level in (0.5, 0.9))
            found.append((after.ravel(), e.ravel(), half, most))
    return found
