"""The strike, and the time to start it, whose tip meets a moving target."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.target import HIT_RADIUS, checked_radius
from whiptool.interception.aiming import Aim, Interception, TargetCamera
from whiptool.interception.library import Library
from whiptool.interception.tracks import TargetTrack, fit_track
from whiptool.models.parameters import number

LATENCY = 0.02  # [s] from a decision to the arm's first motion
PLAN_TIME, REFRESH_TIME = 0.25, 0.1  # [s] that computing takes, benchmarks/moving.py measures them
HORIZON = 2.5  # [s] from the decision to the latest contact
LONGEST = 60.0  # [s] of a horizon
_SHIFTS = 12  # such steps of t0 alone: they need no new rollout


def plan(
    track: TargetTrack,
    library: Library,
    *,
    now: float,
    rng: np.random.Generator,
    hit_radius: float = HIT_RADIUS,
    latency: float = LATENCY,
    horizon: float = HORIZON,
    camera: TargetCamera | None = None,
    polished: int = 8,
    steps: int = 3,
    samples: int = 128,
) -> Interception | None:
    """The strike and start of the largest probability of a hit.

    With t0 free, the tip's path has only to cross the target's; where paths of the library come near it, the crossings
    are ranked by the squared miss that is expected there: that of the paths, and that of the track's covariance across
    the relative velocity (an error along it is only a matter of when). The best of different strikes are brought onto
    the target by Gauss-Newton steps of strike, t0 and time of contact, along exact derivatives; of them, the one that
    hits most of the tracks that are still possible is chosen.

    Args:
        track: TargetTrack of the target.
        library: Strikes of the whip.
        now: Time of the decision [s], on the track's clock, no sooner than its last frame.
        rng: Random generator for samples of the track.
        hit_radius: Hit radius [m].
        latency: The strike starts no sooner than `now + latency` [s].
        horizon: It hits no later than `now + horizon` [s], at most `LONGEST`.
        camera: It goes on seeing the target, and the strike will be aimed again (`refresh`) until it starts: doubt is
            counted as it will be then. Default: as it is now.
        polished: Crossings that are looked into.
        steps: Steps of Gauss-Newton.
        samples: Tracks that are still possible, which choose; the probability is stated from others.

    Returns:
        None where no strike of the library comes near the track in time.

    Raises:
        InputError: A number is out of range.
    """
    began = time.perf_counter()
    for name, value in (("polished", polished), ("samples", samples)):
        number(name, value, low=0, strict=True)
    number("horizon", horizon, low=0, high=LONGEST, strict=True)
    _check(track, now, hit_radius, latency)
    aim = Aim(track, library, now + latency, now + horizon, hit_radius, now, camera)
    which, start, tau = aim.crossings(polished)
    if not len(which):
        return None
    rough = library.strikes[which], start, tau
    fine = aim.steer(*rough, free=library.free, steps=steps)
    tried = tuple(np.concatenate(pair) for pair in zip(rough, fine, strict=True))
    return aim.best(*tried, rng=rng, samples=samples, began=began)


def refresh(
    interception: Interception,
    track: TargetTrack,
    library: Library,
    *,
    now: float,
    rng: np.random.Generator,
    aim: bool = True,
    hit_radius: float = HIT_RADIUS,
    latency: float = LATENCY,
    camera: TargetCamera | None = None,
    steps: int = 2,
    samples: int = 32,
) -> Interception:
    """The same strike with a newer track: started at another time and, if `aim`, moved a little.

    The arm is at `q_i` already, so that only `q_f` and D move. What would hit less probably than the interception as
    it is, is not taken.

    Args:
        interception: Interception that has not started yet.
        track, library, now, rng, hit_radius, latency, camera, steps, samples: As in `plan`.
        aim: Whether the strike may change, or t0 alone.

    Raises:
        InputError: The strike has started, or a number is out of range.
    """
    began = time.perf_counter()
    _check(track, now, hit_radius, latency)
    if interception.start < now + latency - 1e-9:
        raise InputError("now", now, f"before {interception.start - latency:.3f} s", "this strike has started")
    slack = interception.contact + 0.5  # the contact does not move far
    judge = Aim(track, library, now + latency, slack, hit_radius, now, camera)
    as_is = (
        interception.strike.vector[None],
        np.array([interception.start]),
        np.array([interception.contact - interception.start]),
    )
    none = np.zeros(len(library.free), bool)
    ways = [as_is, judge.steer(*as_is, free=none, steps=_SHIFTS)]
    if aim:
        fixed = library.free.copy()
        fixed[: library.rollout.model.arm.n] = False
        ways.append(judge.steer(*as_is, free=fixed, steps=steps))
    tried = tuple(np.concatenate(column) for column in zip(*ways, strict=True))
    return judge.best(*tried, rng=rng, samples=samples, began=began)


def intercept(
    frames: Iterable[tuple[float, np.ndarray]],
    library: Library,
    *,
    decide: float,
    rng: np.random.Generator,
    camera: TargetCamera | None = None,
    motion: str = "auto",
    pivot: tuple[float, float] | None = None,
    update: str = "aim",
    hit_radius: float = HIT_RADIUS,
    latency: float = LATENCY,
    horizon: float = HORIZON,
    plan_time: float = PLAN_TIME,
    refresh_time: float = REFRESH_TIME,
) -> Iterator[Interception | None]:
    """Watch a target, plan, and keep the plan up to date until the strike has to start.

    Args:
        frames: (t, position (2,)) as they come [s], [m]; NaN where the target is not seen.
        library: Strikes of the whip.
        decide: The first frame at or after this time is planned on [s]; while there is no plan, so is the next one that
            comes when the planner is free again.
        rng: As in `plan`.
        camera: Its standard error is that of the frames; default: `TargetCamera()`.
        motion, pivot: As in `fit_track`; what is chosen at the first plan is kept.
        update: Quantities that later frames change: `aim` (strike and t0), `time` (t0 alone), `none`.
        hit_radius, latency, horizon: As in `plan`.
        plan_time, refresh_time: Computing times [s]: no strike starts sooner than that (and the latency) after
            the frame that it is computed from, and frames that come in the meantime wait.

    Yields:
        The plan, or None as long as none was made, after every frame that it was made or refreshed from; the last is
        the one to strike.

    Raises:
        InputError: `update` is unknown, or an argument breaks the rule of `plan` or `fit_track`.
    """
    if update not in ("aim", "time", "none"):
        raise InputError("update", update, "aim, time, none")
    number("decide", decide)
    number("plan_time", plan_time, low=0)
    number("refresh_time", refresh_time, low=0)
    camera = camera or TargetCamera()
    chosen: Interception | None = None
    times, points, free = [], [], decide
    common = {"rng": rng, "hit_radius": hit_radius, "camera": camera if update == "aim" else None}
    for t, point in frames:
        if chosen is not None and (update == "none" or t + refresh_time + latency > chosen.start):
            return  # this frame comes too late
        times.append(t)
        points.append(point)
        if t < free - 1e-9:
            continue
        track = fit_track(np.array(times), np.array(points), sigma=camera.sigma, motion=motion, pivot=pivot)
        if chosen is None:
            chosen = plan(track, library, now=t, latency=plan_time + latency, horizon=horizon, **common)
            motion, free = motion if chosen is None else track.motion.name, t + plan_time
        else:
            late = refresh_time + latency
            chosen = refresh(chosen, track, library, now=t, latency=late, aim=update == "aim", **common)
            free = t + refresh_time
        yield chosen


def _check(track: TargetTrack, now: float, hit_radius: float, latency: float) -> None:
    """What a plan and a refreshed one have in common."""
    checked_radius(hit_radius)
    number("latency", latency, low=0)
    number("now", now)
    if now < track.last - 1e-9:
        raise InputError("now", now, f"a time [s] from the track's last frame on, {track.last:g} s")
