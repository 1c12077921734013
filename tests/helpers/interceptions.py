"""One plan, one refreshed plan, or all plans for a stream of frames, of an interceptor with some options."""

from __future__ import annotations

from whiptool.interception.interceptor import LATENCY, Interception, Interceptor
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import TargetTrack

FOLLOWED = ("decide", "rng", "motion", "pivot", "update")


def plan(track: TargetTrack, library: Library, *, now, rng, latency: float = LATENCY, **options) -> Interception | None:
    """Of the time for computing nothing is counted, only the latency."""
    return Interceptor(library, **options).plan(track, now=now, rng=rng, earliest=now + latency)


def refresh(
    old: Interception, track: TargetTrack, library: Library, *, now, rng, aim=True, latency: float = LATENCY, **options
) -> Interception | None:
    """Likewise."""
    return Interceptor(library, **options).refresh(old, track, now=now, rng=rng, aim=aim, earliest=now + latency)


def intercept(frames, library: Library, **options):
    """All plans, as they come."""
    here = {name: options.pop(name) for name in FOLLOWED if name in options}
    return Interceptor(library, **options).follow(frames, **here)
