"""Tracks as CSV, which can be written by hand or with any tool.

`NAME.csv` has one row of column names and one row per frame:

    t, tip_x, tip_y[, tip_z][, tip_sigma][, tip_t], handle_x, handle_y, ...

`t` [s] is the frame's time (`time`, or `t [ms]`, will do), 0 the command's start; `_x`, `_y`, `_z` [m] a marker's
position in the strike plane (x forward, y up, origin at the shoulder), empty or NaN if missing; `_sigma` [m] its
standard error per coordinate; `_t` [s] the middle of its exposure, if it differs from that of the frame. `NAME.toml`
next to it can have the keys of `whiptool.recording.readers.sidecar`, and `units`, `axes`, `origin`, and `sigma` for all
points.

A recording of one camera in space has columns in pixels, `tip_u`, `tip_v`[, `tip_sigma`], ..., and its sidecar names
the camera, `camera = "left"`, and the file of the cameras, `cameras = "cameras.toml"`. `t` is then the middle of the
first row's exposure. For a camera that measures depth, `_depth` [m] is the distance of the marker along the optical
axis, 0 or empty if missing, and `_depth_sigma` [m] the standard error. Without the latter the error is that of a D435,
or of a stereo pair with the sidecar's `baseline` [m] and `subpixel`, the standard error of its disparity [pixels]
(`Camera.depth_error`). `depth_units = "mm"` states that depths are in millimetres.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.given_files import parsing, whole_file
from whiptool.models.pose_columns import POSE
from whiptool.recording.camera import BASELINE, SUBPIXEL, Camera, write_cameras
from whiptool.recording.logs import TIME, Column
from whiptool.recording.readers.footage import clock_of_rows
from whiptool.recording.readers.joint_log import PREFIX, Logs, reads_back
from whiptool.recording.readers.sidecar import SPACE, UNITS, VIEW, Sidecar
from whiptool.recording.readers.table import (
    AXES,
    read_columns,
    split_columns,
    stacked,
    time_column,
    without_repeated_rows,
)
from whiptool.recording.strike_recording import DEFAULT_PIXELS, StrikeRecording

JOINT_LOG = ".joints.csv"  # in place of a recording's suffix
UV = ("u", "v")  # to the right, down
DEPTH = ("depth", "depth_sigma")


def read_csv(path: Path | str, **options: Any) -> StrikeRecording:
    """Read a CSV file of tracks; `options` are keys of its sidecar, whose values they override."""
    path = whole_file(path)
    names, table = read_columns(path)
    in_pixels = any(name.endswith("_u") for name in names)
    side = Sidecar.of(path, options, *(VIEW if in_pixels else (*SPACE, "sigma")))
    view = side.view() if in_pixels else None
    with parsing(path, "CSV"):
        at, unit, note = time_column(names)
        if Column.of(names[at]).kind != TIME:
            raise InputError("columns", ", ".join(names)[:80], "a column t [s]")
        table, repeated = without_repeated_rows(table)
        clock = clock_of_rows(side, table[:, at] * unit, note, names[at])
        stamps, table = table[clock.keep, at] * unit, np.delete(table[clock.keep], at, axis=1)
        names = [name for i, name in enumerate(names) if i != at]
        read = _places(names, table, stamps, side) if view is None else _pixels(names, table, side, view)
        notes = [*clock.notes]
        notes[1:1] = [f"left out {repeated} rows that repeat the one before"] if repeated else []
        return side.recording(path, notes=notes, t=clock.times, view=view, **read)


def _places(names: list[str], table: np.ndarray, stamps: np.ndarray, side: Sidecar) -> dict[str, Any]:
    """Markers, places, their errors and times, of the columns without that of the time."""
    columns = split_columns(names, ("sigma", "t"))
    return {
        "t_points": stacked(table, columns, "t", stamps[:, None]) - side.start,
        **side.places(columns, table),
    }


def _pixels(names: list[str], table: np.ndarray, side: Sidecar, view: Camera) -> dict[str, Any]:
    """Markers, pixels and their errors, and depths and theirs, of what one camera in space saw."""
    columns = split_columns(names, ("sigma", *DEPTH), axes=UV)
    for marker, found in columns.items():
        if "depth_sigma" in found and "depth" not in found:
            given = ", ".join(names[i] for i in found.values())
            raise InputError(f"marker {marker}", given, f"{marker}_depth together with its sigma")
    stated = all("sigma" in found for found in columns.values())
    sigma = np.nan if stated else side.number("sigma", DEFAULT_PIXELS, low=1e-6, high=100.0)
    return {
        "markers": tuple(columns),
        "points": np.stack([stacked(table, columns, axis) for axis in UV], axis=2),
        "sigma": stacked(table, columns, "sigma", sigma),
        "sigma_assumed": "" if stated or "sigma" in side.table else "sigma",
        **(_depths(columns, table, side, view) if any("depth" in found for found in columns.values()) else {}),
    }


def _depths(columns: dict[str, dict[str, int]], table: np.ndarray, side: Sidecar, view: Camera) -> dict[str, Any]:
    """Depths of the markers and their errors."""
    unit = UNITS[side.word("depth_units", UNITS, "m")]
    depth, usual = stacked(table, columns, "depth", unit=unit), np.full((len(table), len(columns)), np.nan)
    if not all("depth_sigma" in found for found in columns.values() if "depth" in found):
        baseline = side.number("baseline", BASELINE, low=1e-3, high=10.0)
        usual = view.depth_error(
            depth, baseline=baseline, subpixel=side.number("subpixel", SUBPIXEL, low=1e-4, high=10.0)
        )
    return {"depth": depth, "depth_sigma": stacked(table, columns, "depth_sigma", usual, unit=unit)}


def write_csv(recording: StrikeRecording, path: Path | str) -> list[Path]:
    """Write a recording as `NAME.csv`, `NAME.toml` and, with a joint log, `NAME.joints.csv`, at full precision.

    For a recording in pixels, the camera is written as `NAME.cameras.toml`, and the times of points are computed from
    the camera's rows.

    Angles of a free arm's links become a table of angles, see `whiptool.recording.readers.angles`.

    The original source is not written; when read back, the source is this file.

    Returns:
        The written files.

    Raises:
        InputError: The name does not end in .csv, a marker's name cannot be a column, or a file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".csv":
        raise InputError("path", str(path), "a name that ends in .csv")
    bad = [m for m in recording.markers if m != m.strip() or f"{m}_x" == "t" or any(c in m for c in '\r\n",')]
    if bad:
        raise InputError("marker", bad[0], "a name without commas, quotes, line breaks or outer blanks")
    table = _said(recording)
    files = [path, path.with_suffix(".toml")]
    columns = _angles(recording) if recording.angular else _columns(recording)
    try:
        if (view := recording.view) is not None:
            files.append(path.with_suffix(".cameras.toml"))
            table |= {"camera": view.name, "cameras": files[-1].name}
            write_cameras(files[-1], {view.name: view})
        _write_columns(path, *columns)
        for key, suffix, names, log in _logs(recording):
            files.append(path.with_suffix(suffix))
            table[key] = files[-1].name
            _write_columns(files[-1], names, log)
        files[1].write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as error:
        raise InputError("path", str(path), "a file that can be written", f"reason: {error.strerror}") from None
    return files


def _said(recording: StrikeRecording) -> dict[str, Any]:
    """What the sidecar of a recording says, except for the files that belong to it."""
    if recording.angular:
        return {"sigma": float(recording.sigma.flat[0])}
    table: dict[str, Any] = {"units": "m"} if recording.view is None else {}
    table |= {"up": recording.up} if recording.up else {}
    table |= {"hand_up": "y"} if recording.up == "y" and recording.hand_pose is not None else {}
    if recording.joints_q is not None:
        table["joint_units"] = "rad"
        if (names := recording.joint_names) and recording.joints_listed:
            table["joint_columns"] = list(names)
        elif names and not reads_back(names):
            table["joint_columns"] = {name: f"q_{i + 1}" for i, name in enumerate(names)}
    table |= {"t_stay": recording.t_stay, "exposure": recording.exposure}
    table |= {"camera": recording.camera} if recording.camera else {}
    table |= {} if recording.target is None else {"target": list(recording.target)}
    if (s := recording.strike) is not None:
        table["strike"] = {"q_i": list(s.q_i), "q_f": list(s.q_f), "D": s.D}
    return table | ({} if recording.controller is None else {"controller": recording.controller})


def _angles(recording: StrikeRecording) -> tuple[list[str], np.ndarray]:
    """Names and numbers (T, columns) of the times and angles of links, and of their rates, which are at the start."""
    links = len(recording.markers)
    names = ["t", *(f"angle{i + 1}" for i in range(links))]
    table = np.column_stack([recording.t, recording.points[..., 0]])
    begun = recording.first_state
    if begun is None or (begun[0] != recording.points[0, :, 0]).any():  # the rates were computed from the angles
        return names, table
    rates = np.full((len(table), links), np.nan)
    rates[0] = begun[1]
    return [*names, *(f"velocity{i + 1}" for i in range(links))], np.column_stack([table, rates])


def _columns(recording: StrikeRecording) -> tuple[list[str], np.ndarray]:
    """Names and numbers (T, columns) of the times and of all that was seen of each marker."""
    what = {
        axis: recording.points[..., i]
        for i, axis in enumerate(UV if recording.view else AXES[: recording.points.shape[2]])
    }
    what["sigma"] = recording.sigma
    what |= {"t": recording.t_points} if recording.view is None else {}
    what |= {} if recording.depth is None else {"depth": recording.depth, "depth_sigma": recording.depth_sigma}
    names, columns = ["t"], [recording.t]
    for j, marker in enumerate(recording.markers):
        names += [f"{marker}_{name}" for name in what]
        columns += [values[:, j] for values in what.values()]
    return names, np.stack(columns, 1)


def _logs(recording: StrikeRecording) -> Iterator[tuple[str, str, list[str], np.ndarray]]:
    """What was logged in addition to the frames: its key, the suffix of its file, names and numbers of its columns."""
    if recording.joints_t is not None and recording.joints_q is not None:
        angles = recording.joints_q
        yield "joints", JOINT_LOG, _joint_columns(recording), np.column_stack([recording.joints_t, angles])
    if recording.hand_t is not None and recording.hand_pose is not None:
        yield "hand", ".hand.csv", ["t", *POSE], np.column_stack([recording.hand_t, recording.hand_pose])


def _joint_columns(recording: StrikeRecording) -> list[str]:
    """Names of the columns of a recording's joint log."""
    assert recording.joints_q is not None
    names = recording.joint_names
    if names and recording.joints_listed:
        return ["t", *names]
    if names and reads_back(names):
        return ["t", *(PREFIX + name for name in names)]
    return ["t", *(f"q_{i + 1}" for i in range(recording.joints_q.shape[1]))]


def write_logs(logs: Logs, path: Path | str) -> list[Path]:
    """Write a robot's logs as `NAME.csv`, and poses of the hand at other times than the joints' as `NAME.hand.csv`;
    return the files. Joints must be in rad or degrees."""
    path, joints, hand = Path(path), logs.joints, logs.hand
    files: list[tuple[Path, list[str], np.ndarray]] = []
    if joints is not None:
        q = np.deg2rad(joints.q) if joints.unit == "deg" else joints.q
        named = [PREFIX + name for name in joints.names] or [f"q_{i + 1}" for i in range(q.shape[1])]
        files.append((path, ["t", *named], np.column_stack([joints.t, q])))
    if hand is not None and joints is not None and np.array_equal(hand.t, joints.t):
        file, names, table = files.pop()
        files.append((file, [*names, *POSE], np.column_stack([table, hand.q])))
    elif hand is not None:
        place = path if joints is None else path.with_suffix(".hand.csv")
        files.append((place, ["t", *POSE], np.column_stack([hand.t, hand.q])))
    try:
        for file, names, table in files:
            _write_columns(file, names, table)
    except OSError as error:
        raise InputError("path", str(path), f"a file that can be written ({error.strerror})") from None
    return [file for file, _, _ in files]


def _write_columns(path: Path, names: list[str], table: np.ndarray) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([["" if np.isnan(x) else repr(float(x)) for x in row] for row in table])
