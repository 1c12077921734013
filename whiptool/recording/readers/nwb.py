"""Pose estimation in NWB files (Neurodata Without Borders), as the extension ndx-pose stores it.

Read are the series of one `PoseEstimation`; of several (animals, cameras) the key `individual` names one. The file
states times or a rate, the unit of positions and the confidence of each point. Positions in pixels need the way to
metres; those in space are in the file's unit, and `axes` have to be stated.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.readers import mocap, poses
from whiptool.recording.readers.mocap import Capture
from whiptool.recording.readers.poses import Poses
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import StrikeRecording

SERIES = "PoseEstimationSeries"
WHAT = "an NWB file"
PIXELS = ("pixel", "pixels", "px")
SAME = 1e-3  # of the step between frames, within which two times are one


def of_nwb(file: Any) -> dict[str, np.ndarray] | None:
    """Return the pose estimations of an open NWB file: `animals`, and of the animal number i `i.parts`, `i.points`
    (T, M, d), `i.unit`, `i.t` (T,) [s], `i.clock` and, if there are any, `i.scores` (T, M); None: it is no NWB file."""
    if "nwb_version" not in file.attrs:
        return None
    found: dict[str, list[Any]] = {}

    def look(name: str, item: Any) -> None:
        kind = item.attrs.get("neurodata_type", b"")
        if _text(kind) == SERIES:
            found.setdefault(name.rpartition("/")[0], []).append(item)

    file.visititems(look)
    if not found:
        raise InputError("NWB", "no PoseEstimation", "a PoseEstimation of ndx-pose", "see ndx-pose, or export CSV")
    read: dict[str, np.ndarray] = {"animals": np.array([name.rpartition("/")[2] for name in found], dtype=str)}
    for i, (name, series) in enumerate(found.items()):
        read |= {f"{i}.{key}": value for key, value in _estimation(name, series).items()}
    return read


def _estimation(name: str, series: list[Any]) -> dict[str, np.ndarray]:
    """Parts, positions, unit, times and scores of the series of one PoseEstimation."""
    clocks = [_times(one) for one in series]
    t = clocks[0][0]
    if not all(
        np.array_equal(own, t, equal_nan=True) for own, _ in clocks
    ):  # sleap-io leaves out the frames without a body part
        every = np.unique(np.concatenate([own for own, _ in clocks]))
        step = min((float(np.diff(own).min()) for own, _ in clocks if len(own) > 1), default=0.0)
        t = every[np.diff(every, prepend=-np.inf) > SAME * step]
        if not np.diff(t).min(initial=np.inf) > step / 2 >= 0:
            raise InputError(name, "series with different times", "times of one clock for all body parts")
    rows = [np.arange(len(t)) if own is t else np.searchsorted(t, own, "right") - 1 for own, _ in clocks]

    def spread(values: list[np.ndarray]) -> np.ndarray:
        found = np.full((len(t), len(values), *values[0].shape[1:]), np.nan)
        for i, (at, of_part) in enumerate(zip(rows, values, strict=True)):
            found[at, i] = of_part
        return found

    data = [one["data"] for one in series]
    units = {_text(x.attrs.get("unit", "")).lower() for x in data}
    if len(units) > 1:
        raise InputError(name, f"units {', '.join(sorted(units))}", "one unit")
    points = [x[:] * x.attrs.get("conversion", 1.0) + x.attrs.get("offset", 0.0) for x in data]
    read = {
        "parts": np.array([one.name.rpartition("/")[2] for one in series], dtype=str),
        "points": spread(points),
        "unit": np.array(units.pop()),
        "t": t,
        "clock": np.array(clocks[0][1]),
    }
    if all("confidence" in one for one in series):
        read["scores"] = spread([one["confidence"][:] for one in series])
    return read


def _text(value: Any) -> str:
    """A text attribute, which MATLAB writes as bytes."""
    return value.decode() if isinstance(value, bytes) else str(value)


def _times(series: Any) -> tuple[np.ndarray, str]:
    """Times of a series [s], and a sentence on their source."""
    if "timestamps" in series:
        return np.asarray(series["timestamps"][:], float), "the file's timestamps"
    begin = series["starting_time"]
    rate = float(begin.attrs["rate"])
    return float(begin[()]) + np.arange(len(series["data"])) / rate, f"the file's rate, {rate:g} a second"


def recorded(path: Path, options: dict[str, Any], read: dict[str, np.ndarray]) -> StrikeRecording:
    """Return the recording of what `of_nwb` found."""
    animals = [str(x) for x in read["animals"]]
    side = Sidecar.of(path, options, *dict.fromkeys((*poses.KEYS, *mocap.KEYS)))
    i = poses.individual(side, animals, WHAT)
    points, t, clock, unit = (read[f"{i}.{key}"] for key in ("points", "t", "clock", "unit"))
    parts, scores = [str(x) for x in read[f"{i}.parts"]], read.get(f"{i}.scores")
    if str(unit) in PIXELS and points.shape[2] == 2:
        found = Poses(WHAT, points, parts, scores, stamps=t, of=str(clock))
        if np.median(np.diff(t)) == 1:  # as sleap-io writes without a rate
            if "fps" not in side.table:
                raise side.refuse("fps", "frames per second, for the file has a frame a second, or counts frames")
            found = replace(found, numbers=t, stamps=None)
        return poses.recorded(path, side, found)
    if scores is not None and "likelihood" in side.table:
        points = np.where((scores < side.number("likelihood", 0.0, low=0.0))[..., None], np.nan, points)
    capture = Capture(
        what=WHAT,
        t=t,
        clock=f"times [s] from {clock}",
        points=points,
        labels=parts,
        units=mocap.unit_of(str(unit), "unit of the positions", side),
        axes="the file does not state them" if points.shape[2] == 3 else "x is taken as forward, y as up",
    )
    return mocap.recorded(path, side, capture)
