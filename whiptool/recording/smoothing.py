"""Tracks that were smoothed before export, or whose gaps were filled: they lack the noise of independent readings.

Fourth differences hold little of a motion, and 8.4 times the standard error of independent readings. Successive ones
then differ in sign 80 times in 100; without visible noise they do so rarely.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from whiptool.recording.finding import DOUBTFUL, MEASURED, Finding
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.words import counted

_WINDOW, _LEAST = 12, 6  # differences that are judged together, and windows that have to be there
_QUIET = 0.6  # of the noise of independent readings is in the quietest quarter of their windows
_ALTERNATE = 0.5  # share of changes of sign above which differences are those of independent readings
_LITTLE = 0.25  # of the stated errors: less noise is not that of readings with such errors
_MOTION = 5.0  # stated errors: more noise is motion between too few frames
_COARSE = 0.1  # of an error: where values are rounded to more, nothing is known of their noise
_EXACT = 0.02  # of the noise: what successive points on a filled line differ from it at most
_CHANCE = 1e-6  # that independent readings lie so anywhere in a recording
_OFTEN = 0.2  # share of frames on a line through their neighbours, from which all such frames were interpolated
_REPEATED = 0.05  # share of values that are the one before, from which they are medians of several


def noise_of(recording: StrikeRecording) -> tuple[float, bool, float] | None:
    """Return the noise of tracks in their quietest quarter, whether it is independent from frame to frame, and the step
    to which values are rounded, 0 if they are not, noise and step in units of the stated errors; None for angles, and
    where frames are too few or the step too large to tell."""
    if recording.angular or len(recording.t) < 4 + _WINDOW or not recording.seen.any():
        return None
    size = np.array(
        [np.median(s[seen]) if seen.any() else np.inf for s, seen in zip(recording.sigma.T, recording.seen.T)]
    )
    there = recording.points[np.isfinite(recording.points)]
    decimals = next((p for p in range(10) if np.abs(there - there.round(p)).max() < 1e-11), np.inf)
    step = float(10.0**-decimals / size.min())
    d = np.diff(recording.points / size[:, None], n=4, axis=0).reshape(len(recording.t) - 4, -1)
    windows = d[: len(d) // _WINDOW * _WINDOW].T.reshape(-1, _WINDOW)
    windows = windows[np.isfinite(windows).all(axis=1)]
    if len(windows) < _LEAST or step > _COARSE:
        return None
    quiet = windows[np.argsort((windows**2).sum(axis=1))[: max(_LEAST, len(windows) // 4)]]
    level = float(np.sqrt(np.mean(quiet**2) / math.comb(8, 4))) / _QUIET
    return level, bool(np.mean(quiet[:, 1:] * quiet[:, :-1] < 0) > _ALTERNATE and level > step / 2), step


def is_smooth(recording: StrikeRecording) -> bool:
    """Whether tracks have no noise that independent readings with their errors would have."""
    if (noise := noise_of(recording)) is None:
        return False
    level, independent, step = noise
    if independent and np.mean(np.diff(recording.points, axis=0) == 0) > max(_REPEATED, step / level):
        return True
    return level < _LITTLE and not (independent and recording.sigma_assumed)


def filled(recording: StrikeRecording) -> np.ndarray:
    """Return which points lie on a line or cubic through their neighbours as readings with noise never do, (T, M)."""
    found = np.zeros_like(recording.seen)
    if (noise := noise_of(recording)) is None or not noise[1] or noise[0] > _MOTION:
        return found
    level, _, step = noise
    for m, sigma in enumerate(recording.sigma.T):
        if not recording.seen[:, m].any():
            continue
        x = recording.points[:, m] / np.median(sigma[recording.seen[:, m]])
        for order in (2, 4):
            bound = max(_EXACT * level, 2 ** (order - 1) * step)
            on = (np.abs(np.diff(x, n=order, axis=0)) <= bound).all(axis=1)  # NaN is on none
            chance = math.erf(bound / level / math.sqrt(2 * math.comb(2 * order, order))) ** x.shape[1]
            least = max(3, math.ceil(math.log(_CHANCE / len(x)) / math.log(min(chance, 0.99))))
            least = 1 if on.mean() > max(_OFTEN, 4 * chance) else least  # every second frame was interpolated
            if least <= len(on):
                runs = np.convolve(on, np.ones(least), "valid") > least - 0.5
                found[1:-1, m] |= np.convolve(runs, np.ones(least + order - 2)) > 0  # ends of a run were read
    return found


def without_filled(recording: StrikeRecording) -> tuple[StrikeRecording, str]:
    """Return a recording without points that were filled in, and which these were as text, empty without any."""
    which = filled(recording)
    spans = [
        f"{counted(on.sum(), 'point')} of {name} from {recording.t[on][0]:.3f} to {recording.t[on][-1]:.3f} s"
        for name, on in zip(recording.markers, which.T, strict=True)
        if on.any()
    ]
    if not spans:
        return recording, ""
    points = np.where(which[..., None], np.nan, recording.points)
    return replace(recording, points=points), f"{', '.join(spans)}: on a line or cubic, without noise"


def smoothing_findings(recording: StrikeRecording) -> Iterator[Finding]:
    """Yield how much noise tracks have, and whether they seem to be smoothed or filled."""
    if (noise := noise_of(recording)) is None:
        return
    value = f"{noise[0]:.2g} standard errors from frame to frame"
    if is_smooth(recording):
        fix = "export the readings as they were taken, or fit with --per-recording smoothing"
        reason = "tracks were smoothed before export, or computed, or their errors are far smaller than stated"
        yield Finding("noise", value, DOUBTFUL, reason, fix, {"level": noise[0]})
    else:
        yield Finding("noise", value, MEASURED, "by fourth differences", numbers={"level": noise[0]})
    if said := without_filled(recording)[1]:
        yield Finding("filled", said, DOUBTFUL, "no readings: a fit leaves them out", "export them as missing")
