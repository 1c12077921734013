"""Choice of a strike and its start time such that the tip meets a moving target."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.target import HIT_RADIUS, Target, checked_radius
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import TargetTrack, fit_track
from whiptool.models.numbers import number
from whiptool.models.strike import Strike, strike_names
from whiptool.models.trajectory import closest_on_segments

LATENCY = 0.02  # [s] from a decision to the arm's first motion
PLAN_TIME, REFRESH_TIME = 0.25, 0.1  # [s] that computing takes, benchmarks/moving.py measures them
HORIZON = 2.5  # [s] from the decision to the latest contact
LONGEST = 60.0  # [s] of a horizon

FINE = 1000.0  # [1/s] of the paths that plans are judged on
_AHEAD = 100.0  # [1/s]: instants of the track that are looked at
_NEAR = 0.04  # [m] from the track to a path of the library
_POLISHED = 8  # crossings that are looked into
_STEPS, _STEPS_AGAIN = 3, 2  # of Gauss-Newton, for a plan and for one that is refreshed
_SHIFTS = 12  # such steps of t0 alone: they need no new rollout
_SAMPLES, _SAMPLES_AGAIN = 128, 32  # tracks that are still possible, which choose
_STATED = 512  # other tracks, from which the probability is stated: its standard error is 0.02 at most
_WINDOW = 0.1  # [s] before and after the contact, in which the tip may hit
_START, _CONTACT = 0.3, 0.1  # [s]: changes of t0 and of the contact that weigh as much as a strike number's whole range
_STEP = 0.15  # largest Gauss-Newton step, as a share of a strike number's range
_BIN = 0.1  # [s]: starts that lie as near see the target equally well
_PULL = 0.2  # probability that a metre of expected miss costs
_FAR = 0.5  # [m]: a miss beyond costs no more
_NONE = 0.005  # a smaller probability of a hit is no plan


@dataclass(frozen=True)
class TargetCamera:
    """A camera that observes the target until the strike starts.

    Args:
        rate: Frame rate [1/s].
        sigma: Standard error of each coordinate [m].
    """

    rate: float = 60.0
    sigma: float = 0.005

    def __post_init__(self) -> None:
        number("rate", self.rate, low=0, strict=True)
        number("sigma", self.sigma, low=0, strict=True)


@dataclass(frozen=True)
class Interception:
    """A strike and the time to start it.

    Args:
        strike: The strike.
        start: Start time t0 [s], on the clock of the track.
        contact: Time at which the tip meets the target [s], on the same clock.
        point: Position of the contact, (d,) [m].
        tip_speed: Speed of the tip at the contact [m/s].
        probability: Predicted hit probability, over tracks that were sampled independently of the choice of the strike.
        expected_miss: Mean miss distance over the same tracks [m]; distances above 0.5 m count as 0.5 m.
        mean_miss: Miss distance with the most probable track [m].
        warning: Warning of the track (`TargetTrack.warning`); empty: none.
        wall_time: Time that planning took [s].
    """

    strike: Strike
    start: float
    contact: float
    point: tuple[float, ...]
    tip_speed: float
    probability: float
    expected_miss: float
    mean_miss: float
    warning: str
    wall_time: float = field(compare=False)


@dataclass(frozen=True, eq=False)
class Interceptor:
    """Strikes at moving targets from a library of strikes.

    Args:
        library: Strikes of the whip.
        hit_radius: Hit radius [m].
        camera: Camera that observes the target until the strike starts, so that the strike can be refined (`refresh`);
            plans assume the covariance that the track will have then. None: they assume the present covariance.
        latency: Time from a decision to the arm's first motion [s].
        horizon: Largest time from the decision to the hit [s], at most `LONGEST`.
        plan_time, refresh_time: Computing times [s] of `plan` and `refresh`: no strike starts sooner than that (and the
            latency) after the frame that it is computed from.

    Raises:
        InputError: A number is out of range.
    """

    library: Library
    hit_radius: float = HIT_RADIUS
    camera: TargetCamera | None = None
    latency: float = LATENCY
    horizon: float = HORIZON
    plan_time: float = PLAN_TIME
    refresh_time: float = REFRESH_TIME

    def __post_init__(self) -> None:
        checked_radius(self.hit_radius)
        number("horizon", self.horizon, low=0, high=LONGEST, strict=True)
        for name in ("latency", "plan_time", "refresh_time"):
            number(name, getattr(self, name), low=0)

    def plan(
        self, track: TargetTrack, *, now: float, rng: np.random.Generator, earliest: float | None = None
    ) -> Interception | None:
        """Return the strike and start of the largest probability of a hit; None if no strike that keeps the limits
        comes near the target in time, or if the probability is below 0.005. The track ends where its most probable
        position reaches the floor.

        As the start time t0 is free, the tip's path only has to cross the target's path. Points at which paths of the
        library come near it are ranked by the expected squared miss: the squared distance of the two paths plus the
        track's variance, both perpendicular to the relative velocity. The best of different strikes are refined by
        Gauss-Newton steps of strike, t0 and time of contact along exact derivatives. The refined strike that hits most
        samples of the track is chosen.

        Args:
            track: Track of the target.
            now: Time of the decision [s], on the track's clock, no sooner than its last frame.
            rng: Random generator for samples of the track.
            earliest: Earliest start of the strike [s]; default: `plan_time` and `latency` after `now`.

        Raises:
            InputError: A time is out of range, or the track has other dimensions than the library.
        """
        began = time.perf_counter()
        aim = self._aim(track, now, now + self.plan_time + self.latency if earliest is None else earliest)
        which, start, tau = aim.crossings(_POLISHED)
        if not len(which):
            return None
        rough = self.library.strikes[which], start, tau
        fine = aim.steer(*rough, free=self.library.free, steps=_STEPS)
        return _hopeful(aim.best(*_joined([rough, fine]), rng=rng, samples=_SAMPLES, began=began))

    def refresh(
        self,
        interception: Interception,
        track: TargetTrack,
        *,
        now: float,
        rng: np.random.Generator,
        aim: bool = True,
        earliest: float | None = None,
    ) -> Interception | None:
        """Return the interception for a newer track: with another start time and, if `aim`, a slightly changed strike;
        None as in `plan`.

        The arm is at `q_i` already, so that only `q_f` and D change. If no change raises the hit probability, the
        interception is unchanged.

        Args:
            interception: Interception that has not started yet.
            track, now, rng, earliest: As in `plan`, with `refresh_time`.
            aim: Whether the strike may change, or t0 alone.

        Raises:
            InputError: The strike has started, or a time is out of range.
        """
        began = time.perf_counter()
        late = self.refresh_time + self.latency if earliest is None else earliest - now
        judge = self._aim(track, now, now + late, interception.contact + 0.5)  # the contact does not move far
        if interception.start < judge.earliest - 1e-9:
            raise InputError("now", now, f"before {interception.start - late:.3f} s", "this strike has started")
        start, tau = np.array([interception.start]), np.array([interception.contact - interception.start])
        as_is = interception.strike.vector[None], start, tau
        ways = [as_is, judge.steer(*as_is, free=np.zeros_like(self.library.free), steps=_SHIFTS)]
        if aim:
            free = self.library.free.copy()
            free[: self.library.striker.rollout.model.arm.n] = False
            ways.append(judge.steer(*as_is, free=free, steps=_STEPS_AGAIN))
        return _hopeful(judge.best(*_joined(ways), rng=rng, samples=_SAMPLES_AGAIN, began=began))

    def follow(
        self,
        frames: Iterable[tuple[float, np.ndarray]],
        *,
        decide: float,
        rng: np.random.Generator,
        motion: str = "auto",
        pivot: tuple[float, float] | None = None,
        update: str = "aim",
    ) -> Iterator[Interception | None]:
        """Watch a target, plan, and keep the plan up to date until the strike has to start.

        Frames that arrive during the computation of a plan are used afterwards. The standard error of the frames is the
        camera's, or that of `TargetCamera()`.

        Args:
            frames: Pairs (t [s], position (d,) [m]), as they arrive; NaN where the target is not seen.
            decide: Time of the first plan [s], which uses the first frame from then on. As long as there is no plan,
                planning is repeated with the next frame.
            rng: As in `plan`.
            motion, pivot: As in `fit_track`; the motion chosen for the first plan is kept.
            update: Quantities that later frames change: `aim` (strike and t0), `time` (t0 alone), `none`.

        Yields:
            The plan after every frame from which it was made or refreshed, or None without a plan: before the first,
            and after one that a newer track leaves no chance. The last is the one to strike.

        Raises:
            InputError: `update` is unknown, or an argument breaks the rule of `plan` or `fit_track`.
        """
        if update not in ("aim", "time", "none"):
            raise InputError("update", update, "aim, time, none")
        number("decide", decide)
        camera = self.camera or TargetCamera()
        one = replace(self, camera=camera if update == "aim" else None)
        chosen: Interception | None = None
        times, points, free = [], [], decide
        for t, point in frames:
            if chosen is not None and (update == "none" or t + self.refresh_time + self.latency > chosen.start):
                return  # this frame comes too late
            times.append(t)
            points.append(point)
            if t < free - 1e-9:
                continue
            track = fit_track(np.array(times), np.array(points), sigma=camera.sigma, motion=motion, pivot=pivot)
            if chosen is None:
                chosen = one.plan(track, now=t, rng=rng)
                motion, free = motion if chosen is None else track.motion.name, t + self.plan_time
            else:
                chosen = one.refresh(chosen, track, now=t, rng=rng, aim=update == "aim")
                free = t + self.refresh_time
            yield chosen

    def _aim(self, track: TargetTrack, now: float, earliest: float, latest: float | None = None) -> Aim:
        number("now", now)
        if now < track.last - 1e-9:
            raise InputError("now", now, f"a time [s] from the track's last frame on, {track.last:g} s")
        number("earliest", earliest, low=now)
        seen, planned = track.position(now).shape[1], self.library.points.shape[1]
        if seen != planned:
            rule = f"a target in {planned} dimensions, as the library's strikes"
            raise InputError("track", f"a target in {seen} dimensions", rule)
        return Aim(self, track, now, earliest, now + self.horizon if latest is None else latest)


class Aim:
    """Track, strikes and time window of a plan, and the steps of planning.

    Args:
        interceptor: Library of strikes, hit radius and camera.
        track: Track of the target.
        now: Time of the decision [s].
        earliest: Earliest start of a strike [s].
        latest: Latest contact [s].
    """

    def __init__(
        self, interceptor: Interceptor, track: TargetTrack, now: float, earliest: float, latest: float
    ) -> None:
        self.library, self.camera, self.track = interceptor.library, interceptor.camera, track
        ahead = np.arange(now, latest, 1 / _AHEAD)
        landed = ahead[self.track.position(ahead)[:, -1] < self.library.striker.limits.floor]
        self.now, self.earliest, self.latest = now, earliest, min([latest, *landed[:1]])
        dimension = interceptor.library.points.shape[1]
        self.goal = Target((0.0,) * dimension, interceptor.hit_radius).goals  # seen from the target
        self._seen: dict[int, TargetTrack] = {}

    def at_start(self, start: float) -> TargetTrack:
        """Return the track with the covariance that it will have at a strike's start [s], after further frames of the
        camera.
        """
        if self.camera is None or not self.track.covariance.any():
            return self.track
        bin = int((start - self.earliest) / _BIN + 1e-9)
        if bin not in self._seen:
            period = 1 / self.camera.rate
            frames = np.arange(self.now + period, self.now + bin * _BIN + 1e-9, period)
            self._seen[bin] = self.track.after(frames, self.camera.sigma) if len(frames) else self.track
        return self._seen[bin]

    def crossings(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find at most `count` strikes of the library whose tips can best meet the target, and where on their paths.

        Returns:
            Index in the library, start time [s], and time of contact after the start [s] of each, (B,).
        """
        lib = self.library
        t = np.arange(self.earliest, self.latest, 1 / _AHEAD)
        y, w = self.track.position(t), self.track.velocity(t)
        near = lib.tree.query_ball_point(y, _NEAR)
        at = np.repeat(np.arange(len(t)), [len(x) for x in near])
        point = np.concatenate([np.asarray(x, int) for x in near]) if len(near) else np.zeros(0, int)
        start = t[at] - lib.tau[point]
        soon = start >= self.earliest
        at, point, start = at[soon], point[soon], start[soon]
        relative = lib.velocities[point] - w[at]
        along = relative / np.maximum(np.linalg.norm(relative, axis=1, keepdims=True), 1e-9)
        across = np.eye(along.shape[1]) - along[:, :, None] * along[:, None, :]
        bins = ((start - self.earliest) / _BIN + 1e-9).astype(int)
        doubt = np.empty_like(across)
        for bin in np.unique(bins):
            doubt[bins == bin] = self.at_start(self.earliest + bin * _BIN).covariance_at(t)[at[bins == bin]]
        miss = np.einsum("nij,nj->ni", across, lib.points[point] - y[at])
        doubt = np.einsum("nij,nij->n", across, doubt)
        cost = (miss**2).sum(axis=1) + doubt + 1e-8 * t[at]  # rather sooner, all else equal
        order = np.argsort(cost, kind="stable")
        _, first = np.unique(lib.owner[point[order]], return_index=True)
        best = order[np.sort(first)[:count]]
        return lib.owner[point[best]], start[best], lib.tau[point[best]]

    def steer(
        self, x: np.ndarray, start: np.ndarray, tau: np.ndarray, *, free: np.ndarray, steps: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Change B strikes as little as possible, by Gauss-Newton, so that `tip(tau) = target(start + tau)`.

        Args:
            x: Strike vectors of an arm with `a` joints, (B, 2 a + 1).
            start, tau: Start of each strike, and time of contact after it [s], (B,).
            free: Whether each coordinate of a strike may change, (2 a + 1,).
            steps: Number of steps.

        Returns:
            The changed x, start and tau.
        """
        striker = self.library.striker
        names = [name for name, yes in zip(strike_names(striker.rollout.model.arm), free, strict=True) if yes]
        width, x = striker.widths[free], x.copy()
        path = slope = np.empty(0)
        for step in range(steps):
            if step == 0 or len(names):
                _, path, slope = striker.rollout.tip_path(x, t_stay=striker.t_stay, rate=FINE, names=names)
            tau = np.clip(tau, 2 / FINE, x[:, -1] + striker.t_stay - 2 / FINE)  # not beyond the path's end
            tip, v, J = _between(path, slope, tau)
            w = self.track.velocity(start + tau)
            gap = self.track.position(start + tau) - tip
            A = np.concatenate([J * width, -_START * w[..., None], _CONTACT * (v - w)[..., None]], axis=2)
            move = _smallest(A, gap)
            held = start + _START * move[:, -2] < self.earliest  # t0 cannot go there: without it
            A[held, :, -2] = 0
            move[held] = _smallest(A[held], gap[held])
            x[:, free] += width * move[:, :-2]
            x = striker.admissible(x) if len(names) else x
            start = np.maximum(start + _START * move[:, -2], self.earliest)
            tau = tau + _CONTACT * move[:, -1]
            start = np.minimum(start, np.maximum(self.latest - tau, self.earliest))
        return x, start, np.clip(tau, 2 / FINE, x[:, -1] + striker.t_stay - 2 / FINE)

    def best(
        self, x: np.ndarray, start: np.ndarray, tau: np.ndarray, *, rng: np.random.Generator, samples: int, began: float
    ) -> Interception | None:
        """Return of the strikes that keep the limits the one with the largest hit probability, computed from
        independently sampled tracks; None if none keeps them.

        `x`, `start` and `tau` are as for `steer`; `began` is `time.perf_counter()` at the start of the search.
        """
        possible, path = self.library.striker.paths(x, rate=FINE)
        t = np.arange(path.shape[1]) / FINE
        seed = int(rng.integers(2**63))  # the same tracks for every strike

        def outlook(i: int, rng: np.random.Generator, samples: int) -> _Outlook:
            window = np.abs(t - tau[i]) <= _WINDOW
            return self.outlook(path[i, window], start[i] + t[window], self.at_start(start[i]), rng, samples)

        seen = [outlook(i, np.random.default_rng(seed), samples) for i in range(len(x))]
        worth = np.array([o.probability - _PULL * o.expected_miss for o in seen])
        order = np.argsort(-worth, kind="stable")
        i = next((int(i) for i in order[possible[order]] if self.library.striker.keep(x[i : i + 1])[0]), None)
        if i is None:
            return None
        chosen = outlook(i, rng, max(samples, _STATED))
        tip, v, _ = _between(path[i : i + 1], np.empty((*path[:1].shape, 0)), tau[i : i + 1])
        return Interception(
            strike=Strike.from_vector(x[i]),
            start=float(start[i]),
            contact=float(start[i] + tau[i]),
            point=tuple(tip[0].tolist()),
            tip_speed=float(np.linalg.norm(v[0])),
            **chosen._asdict(),
            warning=self.track.warning,
            wall_time=time.perf_counter() - began,
        )

    def outlook(
        self, tip: np.ndarray, when: np.ndarray, track: TargetTrack, rng: np.random.Generator, samples: int
    ) -> _Outlook:
        """Return, for a tip path (T, d) [m] at times (T,) [s], the hit probability and mean miss distance over samples
        of the track, and the miss distance with the most probable track. Below the floor there is no target.
        """
        where = track.positions(np.vstack([track.numbers, track.sample(rng, samples)]), when)
        where = np.where(where[..., -1:] < self.library.striker.limits.floor, np.nan, where)
        miss = closest_on_segments(tip - where, np.zeros(tip.shape[1])).distance
        hit, expected = self.goal.hit(miss[1:]).mean(), np.minimum(miss[1:], _FAR).mean()
        return _Outlook(float(hit), float(expected), float(miss[0]))


class _Outlook(NamedTuple):
    """Probability of a hit, mean miss over possible tracks, and miss of the most probable one [m]."""

    probability: float
    expected_miss: float
    mean_miss: float


def _hopeful(chosen: Interception | None) -> Interception | None:
    """Return a plan, or None instead of one whose probability of a hit is stated as 0.00."""
    return None if chosen is None or chosen.probability < _NONE else chosen


def _smallest(A: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """The shortest moves that close the gaps (B, d), or so far as a step may go, (B, m); none where a path diverged."""
    known: np.ndarray = np.isfinite(A.sum(axis=(1, 2)) + gap.sum(axis=1))
    A, gap = np.where(known[:, None, None], A, 0.0), np.where(known[:, None], gap, 0.0)
    move = np.einsum("bmi,bi->bm", np.linalg.pinv(A, rcond=1e-3), gap)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return move * np.minimum(1.0, _STEP / np.maximum(length, 1e-12))


def _between(path: np.ndarray, slope: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and derivatives of paths (B, S, d) of rate FINE at times tau (B,)."""
    rows = np.arange(len(path))
    i = np.clip((tau * FINE).astype(int), 0, path.shape[1] - 2)
    s = (tau * FINE - i)[:, None]
    tip = path[rows, i] + s * (path[rows, i + 1] - path[rows, i])
    J = slope[rows, i] + s[..., None] * (slope[rows, i + 1] - slope[rows, i])
    return tip, FINE * (path[rows, i + 1] - path[rows, i]), J


def _joined(ways: Sequence[tuple[np.ndarray, ...]]) -> Iterator[np.ndarray]:
    """Return the strikes, starts and contacts of several ways together."""
    return map(np.concatenate, zip(*ways, strict=True))
