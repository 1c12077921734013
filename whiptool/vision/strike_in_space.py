"""Markers in space from what several cameras saw of one strike, where a path is needed and no model is fitted.

Adaptation judges a strike by the tip's path. A fit alone needs none of this: it compares with each camera's own pixels.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.camera_track import CameraTrack
from whiptool.vision.track_agreement import APART, CLEARLY, compare
from whiptool.vision.triangulation import triangulate


def strike_in_space(recordings: Sequence[StrikeRecording]) -> StrikeRecording:
    """Triangulate the markers of one strike that two or more cameras recorded.

    Positions are those at the first camera's instants; the other cameras' pixels are interpolated by monotone cubics.
    Clocks are assumed to agree, unless the lines of sight meet significantly better with a delay. Points whose lines of
    sight do not meet, such as wrong detections, are left out. Standard errors are propagated from the pixels' and the
    interpolation's, averaged over directions; an error of the delay is not included. Measured depths are not used.

    Args:
        recordings: One recording in pixels of each camera, of the same command. The joint log is taken from the first.

    Raises:
        InputError: There are fewer than two recordings, one is not in pixels or of another command, no marker was seen
            by two cameras, or lines of sight do not meet at any delay.
    """
    _check(recordings)
    first, *others = recordings
    delays = [_delay(first, other) for other in others]
    found = [_marker(first, others, delays, name) for name in first.markers]
    points, sigma = (np.stack(x, axis=1) for x in zip(*found, strict=True))
    if not np.isfinite(points).any():
        raise InputError(first.source or "recordings", "no marker that two cameras saw", "the same markers in both")
    return dataclasses.replace(
        first,
        points=points,
        sigma=sigma,
        view=None,
        depth=None,
        depth_sigma=None,
        camera=" and ".join(r.camera for r in recordings),
        source=" and ".join(r.source for r in recordings if r.source),
        notes=tuple(f"{r.camera}: {note}" for r in recordings for note in r.notes),
    )


def _check(recordings: Sequence[StrikeRecording]) -> None:
    """Refuse what is not one strike by several cameras."""
    if len(recordings) < 2:
        raise InputError("recordings", len(recordings), "two or more, one of each camera")
    for recording in recordings:
        if recording.view is None:
            raise InputError(
                recording.source or "recording", "places", "pixels of a camera (tip_u, tip_v), with its view"
            )
    names = [r.view.name for r in recordings if r.view is not None]
    if len(set(names)) < len(names):
        raise InputError("recordings", f"by {', '.join(names)}", "one of each camera")
    strikes = {tuple(r.strike.vector.tolist()) for r in recordings if r.strike is not None}
    if len(strikes) > 1:
        raise InputError("recordings", f"{len(strikes)} commands", "one strike")


def _delay(first: StrikeRecording, second: StrikeRecording) -> float:
    """The second camera's times less the first's [s]."""
    best = compare(first, second)
    if best.apart > APART and best.errors > CLEARLY:
        allowed = f"lines of sight that meet within {APART:g} pixel"
        raise InputError("recordings", f"{best}", allowed, "was a camera moved, or are they of different strikes?")
    return best.delay


def _marker(
    first: StrikeRecording, others: Sequence[StrikeRecording], delays: Sequence[float], name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 3) of one marker at the first camera's instants, NaN where it is not known; standard errors (T,)."""
    m = first.markers.index(name)
    t = first.t_points[:, m]
    seen = [(first.points[:, m], first.sigma[:, m])]
    cameras = [first.view]
    for other, delay in zip(others, delays, strict=True):
        if name in other.markers:
            seen.append(CameraTrack(other, name).at(t + delay))
            cameras.append(other.view)
    unknown = np.full((len(t), 3), np.nan), np.full(len(t), np.nan)
    if len(cameras) < 2:
        return unknown
    pixels, sigma = (np.stack(x) for x in zip(*seen, strict=True))
    found = triangulate([c for c in cameras if c is not None], pixels)
    known = np.isfinite(pixels[..., 0])
    squares = np.where(known, sigma, 0.0) ** 2
    sigma = np.sqrt(squares.sum(axis=0) / np.maximum(known.sum(axis=0), 1))  # [pixels]
    meets = found.residual <= np.maximum(APART, CLEARLY * sigma)
    spread = np.sqrt(np.trace(found.covariance, axis1=1, axis2=2) / 3)  # [m/pixel]
    return np.where(meets[:, None], found.points, np.nan), np.where(meets, spread * sigma, np.nan)
