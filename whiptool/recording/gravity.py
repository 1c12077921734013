"""What gravity says of a recording's axes and units: whips that hang at rest, markers that fall, whips that swing.

A whip at rest hangs straight down, so that the line from its highest to its lowest marker is the vertical. A marker in
free fall is accelerated by 9.81 m/s^2, which states the vertical and the unit. A whip that swings below a hand at rest
does so with the period of a pendulum: a chain's is that of a point at 0.69 of its length (Bessel's first zero), a
point's at its end that of its whole length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import lombscargle

from whiptool.recording.finding import DOUBTFUL, MEASURED, Finding
from whiptool.recording.readers.sidecar import UNITS
from whiptool.recording.strike_recording import StrikeRecording

G = 9.81  # [m/s^2]
STILL = 6.0  # standard errors that a marker at rest stays within; and a part of its whole way:
STILL_WAY = 0.01
RESTS, FEWEST = (0.05, 0.2), 4  # [s] at the start, where strikes begin at rest, and at the end; frames
UPRIGHT = math.radians(5.0)  # within which an axis is the vertical
SHORTEST_FALL = 0.2  # [s]
FALL_OFF, FALL_ERROR = 0.05, 0.03  # relative: from 9.81 m/s^2, and the standard error, at most
EVEN_FALL = 0.1  # of the acceleration, that it may change over a fall
PERIODS = (0.2, 5.0)  # [1/s] of swings
SWUNG = 0.7  # part of a swing that one sinusoid explains, at least
FACTOR = 1.6  # within which a unit explains a size
CHAIN = 1.2  # length over that of the point pendulum with the same period: 1 for a point, 1.45 for a chain


@dataclass(frozen=True)
class Hanging:
    """A whip at rest."""

    up: np.ndarray  # unit vector from its lowest to its highest marker, (d,)
    length: float  # distance between the two, in the recording's unit
    error: float  # standard error of the direction [rad]
    span: tuple[float, float]  # first and last time of the rest [s]
    markers: tuple[str, str]  # the highest and the lowest marker
    bend: float  # largest distance of a marker between them from their line, relative to the length

    @property
    def axis(self) -> tuple[str, float]:
        """The axis that is nearest to the vertical, such as `-y`, and the angle between them [rad]."""
        i = int(np.abs(self.up).argmax())
        return ("-" if self.up[i] < 0 else "") + "xyz"[i], math.acos(min(1.0, abs(float(self.up[i]))))


def hanging(recording: StrikeRecording) -> list[Hanging]:
    """Return how the whip hangs where the recording begins and ends with it at rest; empty if it does not, or only one
    marker of the whip is seen.
    """
    if recording.view is not None or recording.angular:
        return []
    found = (_hanging(recording, rest) for rest in rests(recording))
    return [one for one in found if one is not None]


def folded(recording: StrikeRecording) -> str:
    """Return which markers, of different places along the whip, are on one place while it is at rest and are apart
    later, so that the vertical, along which a whip hangs, is not among the axes; empty if none are.
    """
    if recording.view is not None or recording.angular or recording.points.shape[2] != 2:
        return ""
    along = sorted((place, m) for m, name in enumerate(recording.markers) if not math.isnan(place := _place(name)))
    for rest in rests(recording):
        there = [m for _, m in along if recording.seen[rest, m].sum() >= FEWEST]
        if len(there) < 2:
            continue
        apart = np.linalg.norm(recording.points[:, there[0]] - recording.points[:, there[-1]], axis=1)
        limit = STILL * float(np.nanmedian(recording.sigma))
        if np.nanmedian(apart[rest]) < limit and np.nanmax(apart) > 10 * limit:
            return f"{recording.markers[there[0]]} and {recording.markers[there[-1]]}"
    return ""


def rests(recording: StrikeRecording) -> list[np.ndarray]:
    """Return masks (T,) of the frames at the start and the end in which all markers are at rest."""
    found, seen = [], recording.seen
    for order, shortest in zip((slice(None), slice(None, None, -1)), RESTS, strict=True):
        there = seen[order][: FEWEST + 1].any(axis=0)  # the others say nothing
        if not there.any():
            continue
        points, t = recording.points[order][:, there], recording.t[order]
        way = np.nanmax(points, axis=0) - np.nanmin(points, axis=0)  # (M, d)
        error = np.nanmedian(recording.sigma[:, there], axis=0)
        limit = np.maximum(STILL * error, STILL_WAY * np.linalg.norm(way, axis=1))
        first = np.nanmedian(points[: FEWEST + 1], axis=0)
        off = np.linalg.norm(points - first, axis=2) > limit  # NaN: not off
        still = ~np.maximum.accumulate(off.any(axis=1))
        if still.sum() >= FEWEST and np.ptp(t[still]) >= shortest:
            found.append(still[order])
    return found[:1] if len(found) > 1 and found[0].all() else found


def _place(marker: str) -> float:
    """Where along the whip a marker is; NaN if it is not on it."""
    number = marker.removeprefix("node")
    return {"handle": 0.0, "tip": math.inf}.get(marker, float(number) if number.isdigit() else math.nan)


def _hanging(recording: StrikeRecording, rest: np.ndarray) -> Hanging | None:
    along = sorted((place, m) for m, name in enumerate(recording.markers) if not math.isnan(place := _place(name)))
    there = [m for _, m in along if recording.seen[rest, m].sum() >= FEWEST]
    if len(there) < 2:
        return None
    places = np.nanmean(recording.points[rest][:, there], axis=0)  # (markers, d)
    line = places[0] - places[-1]
    length = float(np.linalg.norm(line))
    sigma = float(np.nanmedian(recording.sigma[rest]))
    if length < STILL * sigma:
        return None
    up = line / length
    between = places[1:-1] - places[-1]
    bend = np.linalg.norm(between - np.outer(between @ up, up), axis=1).max(initial=0.0) / length
    t = recording.t[rest]
    names = recording.markers[there[0]], recording.markers[there[-1]]
    # places of markers are off by as much as they scatter, frame by frame alike
    return Hanging(up, length, math.sqrt(2) * sigma / length, (float(t[0]), float(t[-1])), names, float(bend))


@dataclass(frozen=True)
class Fall:
    """A marker in free fall."""

    marker: str  # its name
    span: tuple[float, float]  # first and last time [s]
    acceleration: np.ndarray  # in the recording's unit, (d,)
    error: float  # standard error of its size

    @property
    def size(self) -> float:
        """Size of the acceleration."""
        return float(np.linalg.norm(self.acceleration))


def falling(recording: StrikeRecording) -> Fall | None:
    """Return the longest free fall of a marker; None without one of at least 0.2 s.

    It is a span in which the acceleration is the same throughout, is along an axis of the recording, and has the size
    of gravity in one of the units.
    """
    if recording.view is not None or recording.angular:
        return None
    best = None
    for m, name in enumerate(recording.markers):
        seen = recording.seen[:, m]
        t, x, sigma = recording.t_points[seen, m], recording.points[seen, m], recording.sigma[seen, m]
        if len(t) < 10:
            continue
        count = max(10, math.ceil(SHORTEST_FALL / float(np.median(np.diff(t)))))
        for first in range(0, len(t) - count, max(1, count // 8)):
            found = _fall(name, t[first : first + count], x[first : first + count], float(np.median(sigma)))
            if found is not None and (best is None or found.error / found.size < best.error / best.size):
                best = found
    return best


def _fall(name: str, t: np.ndarray, x: np.ndarray, sigma: float) -> Fall | None:
    """The fall of a marker over a span; None if it is not one."""
    span = float(t[-1] - t[0])
    s = 2 * (t - t.mean()) / span  # -1 to 1
    V = np.vander(s, 4, increasing=True)
    c, *_ = np.linalg.lstsq(V, x, rcond=None)
    scatter = math.sqrt(float(((x - V @ c) ** 2).sum()) / max(x.size - c.size, 1))
    sag = float(np.linalg.norm(c[2]))
    if scatter > 2 * sigma or sag < 20 * sigma or 3 * np.linalg.norm(c[3]) > EVEN_FALL * sag:
        return None
    spread = math.sqrt(float(np.linalg.inv(V.T @ V)[2, 2])) * max(scatter, sigma)
    acceleration = 8 * c[2] / span**2
    fall = Fall(name, (float(t[0]), float(t[-1])), acceleration, 8 * spread / span**2)
    near = min(abs(fall.size * a / b / G - 1) for a in UNITS.values() for b in UNITS.values())
    vertical = math.acos(min(1.0, float(np.abs(acceleration).max()) / fall.size)) < 2 * UPRIGHT
    return fall if near < FALL_OFF and vertical and fall.error / fall.size < FALL_ERROR else None


def swing_length(recording: StrikeRecording) -> tuple[float, float] | None:
    """Return the length [m] of the point pendulum with the period of the whip's swing, and that of the whip in the
    recording's unit; None if the hand does not stay still while the tip swings.
    """
    if recording.view is not None or recording.angular or not {"tip", "handle"} <= set(recording.markers):
        return None
    tip, handle = (recording.marker(name) for name in ("tip", "handle"))
    both = np.isfinite(tip).all(axis=1) & np.isfinite(handle).all(axis=1)
    t, away, handle = recording.t[both], (tip - handle)[both], handle[both]
    if len(t) < 20:
        return None
    length = float(np.median(np.linalg.norm(away, axis=1)))
    sigma = float(np.nanmedian(recording.sigma))
    still = np.linalg.norm(handle - handle[-1], axis=1) < max(0.02 * length, STILL * sigma)
    last = len(t) - int(np.argmin(still[::-1])) if not still.all() else 0  # the first frame of the rest at the end
    t, away = t[last:], away[last:]
    if len(t) < 20:
        return None
    along = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)[2][0]
    x = (away - away.mean(axis=0)) @ along
    rates = 2 * np.pi * np.linspace(*PERIODS, 2000)
    power = lombscargle(t, x, rates, normalize=True, floating_mean=True)
    best = int(power.argmax())
    periods = (t[-1] - t[0]) * rates[best] / (2 * np.pi)
    if power[best] < SWUNG or periods < 1.0 or np.ptp(x) < 0.02 * length or np.ptp(x) > 1.0 * length:
        return None
    return G / float(rates[best]) ** 2, length


def gravity_findings(recording: StrikeRecording, units: str | None = "m") -> Iterator[Finding]:
    """Yield what gravity says of axes and units of a recording, and how certain it is; `units` is the unit from which
    its places were converted to metres, None one that the reader knows."""
    yield from _of_hanging(recording)
    fall = falling(recording)
    if fall is not None:
        yield from _of_fall(fall, units)
    swing = swing_length(recording)
    if swing is not None and fall is None:
        pendulum, length = swing
        ratio = length / (CHAIN * pendulum)
        value = f"a swing of {2 * math.pi * math.sqrt(pendulum / G):.2f} s is that of a whip of about "
        value += f"{CHAIN * pendulum:.2f} m; handle and tip are {length:.3g} m apart"
        yield _unit(ratio, units, value, "the hand is at rest, and the tip swings; good to a factor of 1.5")


def _of_hanging(recording: StrikeRecording) -> Iterator[Finding]:
    found = hanging(recording)
    if not found:
        return
    first = found[0]
    axis, off = first.axis
    d = len(first.up)
    degrees, error = math.degrees(off), math.degrees(first.error)
    when = f"at rest from {first.span[0]:.2f} to {first.span[1]:.2f} s"
    again = [math.acos(np.clip(float(one.up @ first.up), -1, 1)) for one in found[1:]]
    agree = f", and at the end {math.degrees(again[0]):.1f} deg from that" if again else ""
    value = f"{axis} is up: {first.markers[1]} hangs {first.length:.3f} m below {first.markers[0]}, "
    value += f"{degrees:.1f} +- {error:.1f} deg off that axis"
    reason = f"{when}{agree}" + (f"; bent by {100 * first.bend:.0f} % of its length" if first.bend > 0.05 else "")
    numbers = {"up": first.up.tolist(), "angle": off, "error": first.error, "length": first.length}
    if off > UPRIGHT:
        value = f"no axis: the line from {first.markers[1]} to {first.markers[0]} is {degrees:.0f} deg off {axis}"
        fix = "is the frame tilted, was the hand moving, or is the whip a stiff rod?"
        yield Finding("up", value, DOUBTFUL, reason, fix, numbers)
        return
    expected = (recording.up or "z", "y") if d == 3 else ("y",)
    fix = ""
    if axis not in expected and recording.up:  # the reader turned the file's axes
        fix = 'the file has other axes than were taken: say up = "y" or up = "z" in the sidecar, or axes'
    elif axis not in expected:
        fix = f"say {_axes(axis, d)} in the sidecar"
    elif d == 3 and axis == "y" and not recording.up:
        fix = 'as for a model in the plane; for one in space say up = "y" in the sidecar'
    yield Finding("up", value, MEASURED if axis in expected else DOUBTFUL, reason, fix, numbers)


def _axes(up: str, d: int) -> str:
    """The key `axes` for a file in which `up` points up, for a model in the plane (d = 2) or in space."""
    forward = "x" if up[-1] != "x" else "y"
    if d == 2:
        return f'axes = ["{forward}", "{up}"]'
    e = np.eye(3)
    left = np.cross((-1 if up[0] == "-" else 1) * e["xyz".index(up[-1])], e["xyz".index(forward)])
    i = int(np.abs(left).argmax())
    return f'axes = ["{forward}", "{"-" if left[i] < 0 else ""}{"xyz"[i]}", "{up}"] (for a model in space)'


def _of_fall(fall: Fall, units: str | None) -> Iterator[Finding]:
    """Yield the vertical and the unit of a marker that falls."""
    value = f"{fall.marker} falls with {fall.size:.4g} +- {fall.error:.2g} m/s^2"
    reason = f"from {fall.span[0]:.2f} to {fall.span[1]:.2f} s its acceleration is even"
    yield _unit(fall.size / G, units, value, reason)
    i = int(np.abs(fall.acceleration).argmax())
    up = ("-" if fall.acceleration[i] > 0 else "") + "xyz"[i]
    expected = ("y",) if len(fall.acceleration) == 2 else ("y", "z")
    fix = "" if up in expected else f"say {_axes(up, len(fall.acceleration))} in the sidecar"
    yield Finding("up", f"{up} is up, against the fall", DOUBTFUL if fix else MEASURED, reason, fix)


def _unit(ratio: float, units: str | None, value: str, reason: str) -> Finding:
    """What gravity says of a unit by which sizes are `ratio` times what they should be."""
    if units is None:
        if 1 / FACTOR < ratio < FACTOR:
            return Finding("units", f"the unit agrees with gravity: {value}", MEASURED, reason)
        fix = "the unit of the file was taken wrongly: state units in the sidecar"
        value = f"places are {ratio:.3g} times as far apart as they are: {value}"
        return Finding("units", value, DOUBTFUL, reason, fix)
    found = min(UNITS, key=lambda name: abs(math.log(ratio * UNITS[name] / UNITS[units])))
    left = ratio * UNITS[found] / UNITS[units]
    if not 1 / FACTOR < left < FACTOR:
        value = f"no unit agrees with gravity: {value}"
        return Finding("units", value, DOUBTFUL, reason, "are all places of one scale, and the times in s?")
    if found == units:
        return Finding("units", f"{units} agrees with gravity: {value}", MEASURED, reason, numbers={"units": units})
    fix = f'say units = "{found}" in the sidecar'
    return Finding("units", f"{found}, not {units}: {value}", DOUBTFUL, reason, fix, {"units": found})
