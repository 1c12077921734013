"""How a strike is brought onto a moving target: crossings, Gauss-Newton, tracks that are still possible."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from whiptool.goals.target import Target
from whiptool.interception.library import Library
from whiptool.interception.tracks import TargetTrack
from whiptool.models.closest import closest_on_segments
from whiptool.models.parameters import number
from whiptool.models.strike import Strike, strike_names

FINE = 1000.0  # [1/s] of the paths that plans are judged on


@dataclass(frozen=True)
class Aiming:
    """How crossings of a track are found, mended and judged.

    Args:
        ahead: Instants of the track that are looked at, a second [1/s].
        near: Distance of a path of the library from the track [m].
        window: Before and after the contact, in which the tip may hit [s].
        start: Scale of t0, a change that weighs as much as a strike number's whole range [s].
        contact: Likewise of the contact [s].
        step: Largest Gauss-Newton step, as a share of a strike number's range.
        bin: Starts that see the target equally well lie as near [s].
        pull: Probability that a metre of expected miss costs.
        far: A miss beyond costs no more [m].
        stated: Tracks, at least, that a plan's probability is stated from: its standard error is 0.02 at most.
    """

    ahead: float = 100.0
    near: float = 0.04
    window: float = 0.1
    start: float = 0.3
    contact: float = 0.1
    step: float = 0.15
    bin: float = 0.1
    pull: float = 0.2
    far: float = 0.5
    stated: int = 512


_AIMING = Aiming()


@dataclass(frozen=True)
class TargetCamera:
    """What goes on seeing the target until the strike starts.

    Args:
        rate: Frames a second [1/s].
        sigma: Standard error of each coordinate [m].
    """

    rate: float = 60.0
    sigma: float = 0.005

    def __post_init__(self) -> None:
        number("rate", self.rate, low=0, strict=True)
        number("sigma", self.sigma, low=0, strict=True)


@dataclass(frozen=True)
class Interception:
    """A strike and when to start it.

    Args:
        strike: Which.
        start: t0 [s], on the clock of the track.
        contact: When the tip meets the target [s], on the same clock.
        point: Position of the contact (x, y) [m].
        tip_speed: There [m/s].
        probability: Predicted probability of a hit, over tracks other than those that chose the strike.
        expected_miss: Mean over the same tracks, each at most half a metre [m].
        mean_miss: Miss on the most probable track [m].
        warning: Warning of the track that it is planned on (`TargetTrack.warning`); empty: none.
        wall_time: Time that planning took [s].
    """

    strike: Strike
    start: float
    contact: float
    point: tuple[float, float]
    tip_speed: float
    probability: float
    expected_miss: float
    mean_miss: float
    warning: str
    wall_time: float = field(compare=False)


class Aim:
    """What is known when a plan is made, and what can be done with it.

    Args:
        track, library, hit_radius, now, camera: As in `whiptool.interception.planning.plan`.
        earliest: Start of a strike [s].
        latest: Contact [s].
    """

    def __init__(
        self,
        track: TargetTrack,
        library: Library,
        earliest: float,
        latest: float,
        hit_radius: float,
        now: float,
        camera: TargetCamera | None,
    ) -> None:
        self.track, self.library, self.earliest, self.latest = track, library, earliest, latest
        self.goal, self.now, self.camera = Target((0.0, 0.0), hit_radius).goals, now, camera  # seen from the target
        self._seen: dict[int, TargetTrack] = {}

    def at_start(self, start: float) -> TargetTrack:
        """The track as certain as it will be when a strike starts."""
        if self.camera is None or not self.track.covariance.any():
            return self.track
        bin = int((start - self.earliest) / _AIMING.bin + 1e-9)
        if bin not in self._seen:
            period = 1 / self.camera.rate
            frames = np.arange(self.now + period, self.now + bin * _AIMING.bin + 1e-9, period)
            self._seen[bin] = self.track.after(frames, self.camera.sigma) if len(frames) else self.track
        return self._seen[bin]

    def crossings(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Strike, t0 and time of contact of the most promising crossings, of a different strike each."""
        lib = self.library
        t = np.arange(self.earliest, self.latest, 1 / _AIMING.ahead)
        y, w = self.track.position(t), self.track.velocity(t)
        near = lib.tree.query_ball_point(y, _AIMING.near)
        at = np.repeat(np.arange(len(t)), [len(x) for x in near])
        point = np.concatenate([np.asarray(x, int) for x in near]) if len(near) else np.zeros(0, int)
        start = t[at] - lib.tau[point]
        soon = start >= self.earliest
        at, point, start = at[soon], point[soon], start[soon]
        relative = lib.velocities[point] - w[at]
        across = np.stack([-relative[:, 1], relative[:, 0]], axis=1)
        across /= np.maximum(np.hypot(*across.T), 1e-9)[:, None]
        bins = ((start - self.earliest) / _AIMING.bin + 1e-9).astype(int)
        doubt = np.empty((len(at), 2, 2))
        for bin in np.unique(bins):
            doubt[bins == bin] = self.at_start(self.earliest + bin * _AIMING.bin).covariance_at(t)[at[bins == bin]]
        miss = np.einsum("ni,ni->n", across, lib.points[point] - y[at])
        doubt = np.einsum("ni,nij,nj->n", across, doubt, across)
        cost = miss**2 + doubt + 1e-8 * t[at]  # rather sooner, all else equal
        order = np.argsort(cost, kind="stable")
        _, first = np.unique(lib.owner[point[order]], return_index=True)
        best = order[np.sort(first)[:count]]
        return lib.owner[point[best]], start[best], lib.tau[point[best]]

    def steer(
        self, x: np.ndarray, start: np.ndarray, tau: np.ndarray, *, free: np.ndarray, steps: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gauss-Newton of the smallest change towards `tip(tau) = target(start + tau)`, for B strikes at once."""
        lib, (lower, upper) = self.library, self.library.box
        names = [name for name, yes in zip(strike_names(lib.rollout.model.arm), free, strict=True) if yes]
        width, x = (upper - lower)[free], x.copy()
        path = slope = np.empty(0)
        for step in range(steps):
            if step == 0 or len(names):
                _, path, slope = lib.rollout.tip_path(x, t_stay=lib.t_stay, rate=FINE, names=names)
            tau = np.clip(tau, 2 / FINE, x[:, -1] + lib.t_stay - 2 / FINE)  # not beyond the path's end
            tip, v, J = _between(path, slope, tau)
            w = self.track.velocity(start + tau)
            gap = self.track.position(start + tau) - tip
            A = np.concatenate([J * width, -_AIMING.start * w[..., None], _AIMING.contact * (v - w)[..., None]], axis=2)
            move = _smallest(A, gap)
            held = start + _AIMING.start * move[:, -2] < self.earliest  # t0 cannot go there: without it
            A[held, :, -2] = 0
            move[held] = _smallest(A[held], gap[held])
            x[:, free] = np.clip(x[:, free] + width * move[:, :-2], lower[free], upper[free])
            start = np.maximum(start + _AIMING.start * move[:, -2], self.earliest)
            tau = tau + _AIMING.contact * move[:, -1]
            start = np.minimum(start, np.maximum(self.latest - tau, self.earliest))
        return x, start, np.clip(tau, 2 / FINE, x[:, -1] + lib.t_stay - 2 / FINE)

    def best(
        self, x: np.ndarray, start: np.ndarray, tau: np.ndarray, *, rng: np.random.Generator, samples: int, began: float
    ) -> Interception:
        """The strike that hits most probably; what it promises is found on tracks that did not choose it."""
        lib = self.library
        t, path, _ = lib.rollout.tip_path(x, t_stay=lib.t_stay, rate=FINE)
        allowed = lib.possible(x)
        seed = int(rng.integers(2**63))  # the same tracks for every strike

        def outlook(i: int, rng: np.random.Generator, samples: int) -> _Outlook:
            window = np.abs(t - tau[i]) <= _AIMING.window
            return self.outlook(path[i, window], start[i] + t[window], self.at_start(start[i]), rng, samples)

        seen = [outlook(i, np.random.default_rng(seed), samples) for i in range(len(x))]
        worth = [o.probability - _AIMING.pull * o.expected_miss for o in seen]
        score = [x - (0 if a else 10) for x, a in zip(worth, allowed, strict=True)]
        i = int(np.argmax(score))
        chosen = outlook(i, rng, max(samples, _AIMING.stated))
        tip, v, _ = _between(path[i : i + 1], np.empty((1, path.shape[1], 2, 0)), tau[i : i + 1])
        return Interception(
            strike=Strike.from_vector(x[i]),
            start=float(start[i]),
            contact=float(start[i] + tau[i]),
            point=(float(tip[0, 0]), float(tip[0, 1])),
            tip_speed=float(np.hypot(*v[0])),
            probability=chosen.probability,
            expected_miss=chosen.expected_miss,
            mean_miss=chosen.mean_miss,
            warning=self.track.warning,
            wall_time=time.perf_counter() - began,
        )

    def outlook(
        self, tip: np.ndarray, when: np.ndarray, track: TargetTrack, rng: np.random.Generator, samples: int
    ) -> _Outlook:
        """What a path of the tip (T, 2) [m] at times (T,) [s] does to tracks that are still possible."""
        numbers = np.vstack([track.numbers, track.sample(rng, samples)])
        miss = closest_on_segments(tip - track.positions(numbers, when), np.zeros(2)).distance
        hit, expected = self.goal.hit(miss[1:]).mean(), np.minimum(miss[1:], _AIMING.far).mean()
        return _Outlook(float(hit), float(expected), float(miss[0]))


@dataclass(frozen=True)
class _Outlook:
    """Probability of a hit, mean miss over possible tracks, and miss of the most probable one [m]."""

    probability: float
    expected_miss: float
    mean_miss: float


def _smallest(A: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """The shortest moves that close the gaps (B, 2), or so far as a step may go, (B, m); none where a path diverged."""
    known: np.ndarray = np.isfinite(A.sum(axis=(1, 2)) + gap.sum(axis=1))
    A, gap = np.where(known[:, None, None], A, 0.0), np.where(known[:, None], gap, 0.0)
    move = np.einsum("bmi,bi->bm", np.linalg.pinv(A, rcond=1e-3), gap)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return move * np.minimum(1.0, _AIMING.step / np.maximum(length, 1e-12))


def _between(path: np.ndarray, slope: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and derivatives of paths (B, S, 2) of rate FINE at times tau (B,)."""
    rows = np.arange(len(path))
    i = np.clip((tau * FINE).astype(int), 0, path.shape[1] - 2)
    s = (tau * FINE - i)[:, None]
    tip = path[rows, i] + s * (path[rows, i + 1] - path[rows, i])
    J = slope[rows, i] + s[..., None] * (slope[rows, i + 1] - slope[rows, i])
    return tip, FINE * (path[rows, i + 1] - path[rows, i]), J
