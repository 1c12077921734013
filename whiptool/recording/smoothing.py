"""Tracks that were smoothed before export, or whose gaps were filled: they lack the noise of independent readings.

Fourth differences hold little of a motion, and 8.4 times the standard error of independent readings. Successive ones
then differ in sign 80 times in 100; without visible noise they do so rarely.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.special import erf

from whiptool.recording.finding import DOUBTFUL, MEASURED, Finding
from whiptool.recording.strike_recording import StrikeRecording

_WINDOW = 12  # differences that are judged together
_LEAST = 6  # windows that have to be there
_QUIET = 0.6  # of the noise of independent readings is in the quietest quarter of their windows
_ALTERNATE = 0.55  # share of changes of sign above which differences are those of independent readings
_STATED = 0.25  # of a stated error: less noise than that is no noise of such readings
_COARSE = 0.1  # of an error: where values are rounded to more, nothing is told of their noise
_EXACT = 0.02  # of the noise: what successive points on a filled line differ from it at most
_CHANCE = 1e-6  # that independent readings lie so in some place of a recording
_TOGETHER = 3  # frames filled in a row that are claimed at least
_OFTEN = 0.2  # share of frames on a line through their neighbours, from which all such frames were interpolated
_REPEATED = 0.05  # share of values that are the one before, from which they are medians of several


def noise_of(recording: StrikeRecording) -> tuple[float, bool] | None:
    """Return the noise of tracks in their quietest quarter, in units of their errors, and whether it is independent
    from frame to frame; None for angles, and where frames are too few or values too coarsely rounded to tell."""
    size = np.array([np.median(s[seen]) for s, seen in zip(recording.sigma.T, recording.seen.T, strict=True)])
    step = _rounding(recording.points)
    if recording.angular or len(recording.t) < _WINDOW + 4 or step > _COARSE * size.min():
        return None
    differences = np.diff(recording.points / size[:, None], n=4, axis=0).reshape(len(recording.t) - 4, -1)
    whole = len(differences) // _WINDOW * _WINDOW
    windows = differences[:whole].T.reshape(-1, _WINDOW)
    windows = windows[np.isfinite(windows).all(axis=1)]
    if len(windows) < _LEAST:
        return None
    quiet = windows[np.argsort((windows**2).sum(axis=1))[: max(_LEAST, len(windows) // 4)]]
    level = float(np.sqrt(np.mean(quiet**2) / math.comb(8, 4))) / _QUIET
    alternate = float(np.mean(quiet[:, 1:] * quiet[:, :-1] < 0))
    return level, alternate > _ALTERNATE and level > step / 2 / size.min()


def is_smooth(recording: StrikeRecording) -> bool:
    """Whether tracks have no noise that independent readings with their errors would have."""
    if (found := noise_of(recording)) is None:
        return False
    level, independent = found
    step = _rounding(recording.points) / float(np.median(recording.sigma[recording.seen]))
    repeated = float(np.mean(np.diff(recording.points, axis=0) == 0))  # by a median of the neighbours
    if independent and repeated > max(_REPEATED, step / level):
        return True
    return level < _STATED and not (independent and recording.sigma_assumed)


def _rounding(points: np.ndarray) -> float:
    """Return the step to which points are rounded, a power of ten; 0 if they are not."""
    there = points[np.isfinite(points)]
    return next((10.0**-p for p in range(10) if np.abs(there - there.round(p)).max() < 1e-11), 0.0)


def filled(recording: StrikeRecording) -> np.ndarray:
    """Return which points lie on a line or cubic through their neighbours as readings with noise never do, (T, M)."""
    found = np.zeros_like(recording.seen)
    if (noise := noise_of(recording)) is None or not noise[1]:
        return found
    step = _rounding(recording.points)
    for m, sigma in enumerate(recording.sigma.T):
        level = noise[0] * float(np.median(sigma[recording.seen[:, m]]))
        for order in (2, 4):
            bound = max(_EXACT * level, 2.0 ** (order - 1) * step)
            size = np.abs(np.diff(recording.points[:, m], n=order, axis=0))
            on = (size <= bound).all(axis=1)  # NaN is on none
            chance = float(erf(bound / level / math.sqrt(2 * math.comb(2 * order, order)))) ** size.shape[1]
            least = max(_TOGETHER, math.ceil(math.log(_CHANCE / len(found)) / math.log(min(chance, 0.99))))
            least = 1 if on.mean() > max(_OFTEN, 4 * chance) else least  # every second frame was interpolated
            for first, end in _runs(on):
                if end - first >= least:
                    # the first and last points of a run were read
                    found[first + 1 : end + order - 1, m] = True
    return found


def _runs(on: np.ndarray) -> list[tuple[int, int]]:
    """Return the beginnings and ends of what is true in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def without_filled(recording: StrikeRecording) -> tuple[StrikeRecording, str]:
    """Return a recording without points that were filled in, and which these were as text, empty without any."""
    which = filled(recording)
    spans = [
        f"{name} from {recording.t[first]:.3f} to {recording.t[end - 1]:.3f} s"
        for name, on in zip(recording.markers, which.T, strict=True)
        for first, end in _runs(on)
    ]
    if not spans:
        return recording, ""
    points = np.where(which[..., None], np.nan, recording.points)
    return replace(recording, points=points), f"{', '.join(spans)}: points on a line or cubic without noise"


def smoothing_findings(recording: StrikeRecording) -> Iterator[Finding]:
    """Yield how much noise tracks have, and whether they seem to be smoothed or filled."""
    if (noise := noise_of(recording)) is None:
        return
    level, independent = noise
    value = f"{level:.2g} standard errors from frame to frame"
    numbers = {"level": level, "independent": independent}
    if is_smooth(recording):
        fix = "export the readings as they were taken, or fit with --per-recording smoothing"
        reason = "tracks were smoothed before export, or computed, or their errors are far smaller than stated"
        yield Finding("noise", value, DOUBTFUL, reason, fix, numbers)
    else:
        yield Finding("noise", value, MEASURED, "by fourth differences", numbers=numbers)
    if said := without_filled(recording)[1]:
        yield Finding("filled", said, DOUBTFUL, "no readings: a fit leaves them out", "export them as missing")
