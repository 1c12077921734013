"""The closest approach of a filmed tip: its frames joined by a smooth path, with or without what no frame shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.models.trajectory import closest_on_curve
from whiptool.recording.strike_recording import StrikeRecording

GAP = 2.5  # usual distances of frames in time, beyond which some are missing
LEAST = 4  # frames that a path is joined from, at least
_BETWEEN = 20  # instants that are looked at from frame to frame


@dataclass(frozen=True, eq=False)
class FilmedApproach:
    """Closest approach of a filmed tip to a target.

    Args:
        distance: Distance of the tip from the target [m].
        time: Time of the closest approach [s].
        place: Position of the tip at this time, (d,) [m].
        velocity: Velocity of the tip at this time, (d,) [m/s].
    """

    distance: float
    time: float
    place: np.ndarray
    velocity: np.ndarray

    @property
    def speed(self) -> float:
        """Speed of the tip at the closest approach [m/s]."""
        return float(np.linalg.norm(self.velocity))


def tip_seen(recording: StrikeRecording, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times (F,) [s] and positions (F, d) [m] of the tip in the F frames that show it; F may be 0.

    Raises:
        InputError: The recording has no marker `tip`.
    """
    points = recording.marker("tip")[:, :dimension]
    seen = np.isfinite(points).all(axis=1)
    return recording.t_points[seen, recording.markers.index("tip")], points[seen]


def approach_seen(recording: StrikeRecording, target: Sequence[float] | np.ndarray) -> FilmedApproach | None:
    """Return the closest approach of a recorded tip to a target (d,) [m], or None if too few frames show the tip.

    The path is not interpolated where two or more frames in a row are missing.

    Raises:
        InputError: The recording has no marker `tip`.
    """
    gap = GAP * float(np.median(np.diff(recording.t)))
    return approach_of_path(*tip_seen(recording, len(target)), target, gap=gap)


def approach_of_path(
    t: np.ndarray, points: np.ndarray, target: Sequence[float] | np.ndarray, *, gap: float = math.inf
) -> FilmedApproach | None:
    """Return the closest approach of a path through given positions to a target; None for fewer than `LEAST` positions.

    The path is a monotone cubic interpolant (Fritsch and Carlson 1980).

    Args:
        t: Times of the positions [s], (F,), increasing.
        points: Positions [m], (F, d).
        target: Target [m], (d,).
        gap: Longest time between two positions over which the path is interpolated [s].
    """
    if len(t) < LEAST:
        return None
    from scipy.interpolate import PchipInterpolator, PPoly  # a third of what a command imports

    place, path, nearest = np.asarray(target, float), PchipInterpolator(t, points), None
    for piece in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > gap) + 1):
        first, last = piece[0], piece[-1]
        when = float(t[first])
        if last > first:
            curve = PPoly(path.c[:, first:last], path.x[first : last + 1])
            when = closest_on_curve(curve, place, samples=_BETWEEN * len(piece))
        distance = float(np.linalg.norm(path(when) - place))
        if nearest is None or distance < nearest.distance:
            nearest = FilmedApproach(distance, when, path(when), path(when, 1))
    return nearest


def nearest_frame(recording: StrikeRecording, target: Sequence[float], *, end: float = math.inf) -> float | None:
    """Return the time [s] of the frame, up to `end` [s], that shows the tip nearest to a target (d,) [m]; None if none
    shows it.
    """
    i, d = recording.markers.index("tip"), len(target)
    away = np.linalg.norm(recording.points[:, i, :d] - np.asarray(target), axis=1)
    distance = np.where(recording.seen[:, i] & (recording.t <= end), away, np.inf)
    frame = int(distance.argmin())
    return float(recording.t[frame]) if np.isfinite(distance[frame]) else None
