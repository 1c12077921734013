"""Tracks as CSV, the format to write by hand or from any tool.

`NAME.csv` has one row of column names and one row per frame:

    t, tip_x, tip_y[, tip_z][, tip_sigma][, tip_t], handle_x, handle_y, ...

`t` [s] is the frame's time (`time`, or `t [ms]`, will do), 0 the command's start; `_x`, `_y`, `_z` [m] a marker's
place in the strike plane (x forward, y up, origin at the shoulder), empty or NaN where it is missing; `_sigma` [m] its
standard error per coordinate; `_t` [s] the middle of its exposure, where it is not the frame's. `NAME.toml` next to it
may hold what `whiptool.recording.readers.sidecar` lists, and `units`, `axes`, `origin`, and `sigma` for all points.

What one camera in space saw has columns in pixels, `tip_u`, `tip_v`[, `tip_sigma`], ..., and its sidecar says which
camera it was, `camera = "left"`, and in which file the cameras stand, `cameras = "cameras.toml"`. `t` is then the
middle of the first row's exposure. Of a camera that measures depth, `_depth` [m] is how far the marker is along its
optical axis, 0 or empty where that is missing, and `_depth_sigma` [m] the standard error. Without the latter the error
is that of a D435, or of a stereo pair with the sidecar's `baseline` [m] and `subpixel`, the standard error of its
disparity [pixels] (`whiptool.recording.depth_noise`). `depth_units = "mm"` where depths are in millimetres.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.models.joint_trajectory import POSE
from whiptool.recording.camera import Camera, write_cameras
from whiptool.recording.clock import good_stamps
from whiptool.recording.depth_noise import BASELINE, SUBPIXEL, depth_error
from whiptool.recording.joint_columns import TIME, Column
from whiptool.recording.parsing import parsing, sha256, whole_file
from whiptool.recording.readers.joint_log import PREFIX
from whiptool.recording.readers.sidecar import SPACE, UNITS, VIEW, Sidecar
from whiptool.recording.readers.table import read_columns, time_column, without_repeated_rows
from whiptool.recording.strike_recording import DEFAULT_PIXELS, StrikeRecording

AXES = ("x", "y", "z")
JOINT_LOG = ".joints.csv"  # in place of a recording's suffix
PIXELS = ("u", "v")  # to the right, down
DEPTH = ("depth", "depth_sigma")


def read_csv(path: Path | str, **options: Any) -> StrikeRecording:
    """Read tracks and their sidecar.

    Args:
        path: The CSV file.
        options: Keys of the sidecar, which they override.

    Raises:
        InputError: A column is missing or unknown, a cell is not a number, or what they say breaks a rule.
    """
    path = whole_file(path)
    names, table = read_columns(path)
    if any(name.endswith("_u") for name in names):
        return _read_view(path, names, table, options)
    side = Sidecar.of(path, options, *SPACE, "sigma")
    with parsing(path, "CSV"):
        t, names, table, notes = _timed(path, names, table, side)
        markers, columns = split_columns(names, ("sigma", "t"))
        pick = lambda marker, what: table[:, names.index(columns[marker][what])]  # noqa: E731
        dimension = len(columns[markers[0]].keys() & set(AXES))
        points = np.stack([np.stack([pick(m, axis) for axis in AXES[:dimension]], 1) for m in markers], 1)
        unit = UNITS[side.word("units", UNITS, "m")]
        default = side.number("sigma", 1e-3, low=1e-9, high=1.0)
        sigma = [pick(m, "sigma") * unit if "sigma" in columns[m] else np.full(len(t), default) for m in markers]
        times = [pick(m, "t") - side.start if "t" in columns[m] else t for m in markers]
        return StrikeRecording(
            t=t,
            points=side.metres(points),
            markers=tuple(markers),
            sigma=np.stack(sigma, 1),
            t_points=np.stack(times, 1),
            source=str(path),
            sha256=sha256(path),
            **side.fields(notes),
        )


def _read_view(path: Path, names: list[str], table: np.ndarray, options: dict[str, Any]) -> StrikeRecording:
    """Read what one camera in space saw, in pixels."""
    side = Sidecar.of(path, options, *VIEW)
    view, default = side.view(), side.number("sigma", DEFAULT_PIXELS, low=1e-6, high=100.0)
    with parsing(path, "CSV"):
        t, names, table, notes = _timed(path, names, table, side)
        markers, columns = split_columns(names, ("sigma", *DEPTH), axes=PIXELS)
        pick = lambda marker, what: table[:, names.index(columns[marker][what])]  # noqa: E731
        sigma = [pick(m, "sigma") if "sigma" in columns[m] else np.full(len(t), default) for m in markers]
        depths = [_depths(m, columns[m], pick, side, view) for m in markers]
        return StrikeRecording(
            t=t,
            points=np.stack([np.stack([pick(m, axis) for axis in PIXELS], 1) for m in markers], 1),
            markers=tuple(markers),
            sigma=np.stack(sigma, 1),
            depth=np.stack([depth for depth, _ in depths], 1),
            depth_sigma=np.stack([error for _, error in depths], 1),
            source=str(path),
            sha256=sha256(path),
            view=view,
            **side.fields(notes),
        )


def _depths(
    marker: str, columns: dict[str, str], pick: Callable[[str, str], np.ndarray], side: Sidecar, view: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Depths of a marker and their standard errors [m], (T,) each; NaN without columns of depth."""
    baseline = side.number("baseline", BASELINE, low=1e-3, high=10.0)
    subpixel = side.number("subpixel", SUBPIXEL, low=1e-4, high=10.0)
    unit = UNITS[side.word("depth_units", UNITS, "m")]
    if "depth" not in columns:
        if "depth_sigma" in columns:
            raise InputError(f"marker {marker}", ", ".join(columns.values()), f"{marker}_depth together with its sigma")
        nowhere = np.full(len(pick(marker, "u")), np.nan)
        return nowhere, nowhere
    depth = unit * pick(marker, "depth")
    if "depth_sigma" in columns:
        return depth, unit * pick(marker, "depth_sigma")
    return depth, depth_error(depth, view.focal_lengths[0], baseline=baseline, subpixel=subpixel)


def _timed(
    path: Path, names: list[str], table: np.ndarray, side: Sidecar
) -> tuple[np.ndarray, list[str], np.ndarray, list[str]]:
    """Times of the frames from the command's start [s], the other columns' names and numbers, and what to tell."""
    at, unit, note = time_column(names)
    if Column.of(names[at]).kind != TIME:
        raise InputError("columns", ", ".join(names)[:80], "a column t [s]")
    table, repeated = without_repeated_rows(table)
    notes = [note, f"left out {repeated} rows that repeat the one before"] if repeated else [note]
    keep, bad = good_stamps(table[:, at] * unit, names[at])
    rest = [i for i in range(len(names)) if i != at]
    return table[keep, at] * unit - side.start, [names[i] for i in rest], table[keep][:, rest], [*notes, *bad]


def split_columns(
    names: list[str], more: tuple[str, ...] = (), *, axes: tuple[str, ...] = AXES
) -> tuple[list[str], dict[str, dict[str, str]]]:
    """Markers in order of appearance, and for each its columns by what they hold (`x`, `y`, `z` and `more`).

    Args:
        names: Names of the columns.
        more: Further columns of a marker besides its coordinates; of two that end alike, the longer is meant.
        axes: Names of its coordinates.

    Raises:
        InputError: A name does not end in `_x`, ..., a marker lacks one of the first two axes, or only some have a z.
    """
    columns: dict[str, dict[str, str]] = {}
    for name in names:
        what = max((x for x in (*axes, *more) if name.endswith("_" + x)), key=len, default="")
        marker = name.removesuffix("_" + what)
        if not what or not marker:
            endings = ", ".join("_" + x for x in (*axes, *more))
            raise InputError("column", name, f"MARKER with one of {endings}", f"as in tip_{axes[0]}, tip_{axes[1]}")
        columns.setdefault(marker, {})[what] = name
    if not columns:
        raise InputError("columns", "no markers", "at least tip_x and tip_y")
    for marker, found in columns.items():
        if not set(axes[:2]) <= found.keys():
            both = f"{marker}_{axes[0]} and {marker}_{axes[1]}"
            raise InputError(f"marker {marker}", ", ".join(found.values()), both)
    if len({"z" in found for found in columns.values()}) > 1:
        raise InputError("columns", ", ".join(names)[:80], "_z for all markers or for none")
    return list(columns), columns


def write_csv(recording: StrikeRecording, path: Path | str) -> list[Path]:
    """Write a recording as `NAME.csv`, `NAME.toml` and, with a joint log, `NAME.joints.csv`; all numbers exact.

    With a view, the camera is written as `NAME.cameras.toml`, and times of points are those of the camera's rows.

    Provenance is not written: read back, the recording comes from this file.

    Returns:
        The files.

    Raises:
        InputError: The name does not end in .csv, a marker's name cannot be a column, or a file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".csv":
        raise InputError("path", str(path), "a name that ends in .csv")
    bad = [m for m in recording.markers if m != m.strip() or f"{m}_x" == "t" or any(c in m for c in '\r\n",')]
    if bad:
        raise InputError("marker", bad[0], "a name without commas, quotes, line breaks or outer blanks")
    d, view = recording.points.shape[2], recording.view
    axes = AXES[:d] if view is None else PIXELS
    header, columns = ["t"], [recording.t]
    for j, marker in enumerate(recording.markers):
        header += [f"{marker}_{what}" for what in (*axes, "sigma")]
        columns += [*recording.points[:, j].T, recording.sigma[:, j]]
        if view is None:
            header.append(f"{marker}_t")
            columns.append(recording.t_points[:, j])
        if recording.depth is not None:
            header += [f"{marker}_{what}" for what in DEPTH]
            columns += [recording.depth[:, j], recording.depth_sigma[:, j]]
    table: dict[str, Any] = {"units": "m"} if view is None else {}
    table |= {"t_stay": recording.t_stay, "exposure": recording.exposure}
    table |= {"camera": recording.camera} if recording.camera else {}
    table |= {} if recording.target is None else {"target": list(recording.target)}
    files = [path, path.with_suffix(".toml")]
    try:
        if view is not None:
            files.append(path.with_suffix(".cameras.toml"))
            table |= {"camera": view.name, "cameras": files[-1].name}
            write_cameras(files[-1], {view.name: view})
        _write_columns(path, header, np.stack(columns, 1))
        if recording.joints_t is not None and recording.joints_q is not None:
            files.append(path.with_suffix(JOINT_LOG))
            table["joints"] = files[-1].name
            angles = recording.joints_q
            named = [PREFIX + name for name in recording.joint_names]
            names = ["t", *(named or [f"q_{i + 1}" for i in range(angles.shape[1])])]
            _write_columns(files[-1], names, np.column_stack([recording.joints_t, angles]))
        if recording.hand_t is not None and recording.hand_pose is not None:
            files.append(path.with_suffix(".hand.csv"))
            table["hand"] = files[-1].name
            _write_columns(files[-1], ["t", *POSE], np.column_stack([recording.hand_t, recording.hand_pose]))
        if recording.strike is not None:
            s = recording.strike
            table["strike"] = {"q_i": list(s.q_i), "q_f": list(s.q_f), "D": s.D}
        if recording.controller is not None:
            table["controller"] = recording.controller
        files[1].write_text(tomli_w.dumps(table), encoding="utf-8")
    except OSError as error:
        raise InputError("path", str(path), f"a file that can be written ({error.strerror})") from None
    return files


def _write_columns(path: Path, names: list[str], table: np.ndarray) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([["" if np.isnan(x) else repr(float(x)) for x in row] for row in table])
