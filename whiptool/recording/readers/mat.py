"""Recordings in MAT files of version 5 (MATLAB's `save -v6` or `-v7`), as variables or as the fields of one struct.

| variable | what |
|---|---|
| `t` (T) or `fps` | times [s], or frames per second, the first at 0 |
| `points` (T, M, 2 or 3), or `x`, `y` and optionally `z`, each (T, M) | positions, NaN if missing |
| `markers` | cell array of M names; default: `tip` if M = 1 |
| `units` | of the positions: m, cm, mm, in; default m |
| `sigma` | standard error, a number or (T, M), in the same units; default 1 mm |
| `joint_names` | cell array of the names of the columns of `joints_q`; default: they are in the arm's order |
| `t_points`, `exposure`, `joints_t` (S), `joints_q` (S, a), `target`, `t_stay`, `camera` | as in `StrikeRecording` |
| `strike` | `[q_i, q_f, D]`, or a struct with these fields |

Other variables are ignored. A file that Qualisys Track Manager wrote is read as `whiptool.recording.readers.qualisys`
says. The sidecar can have the common keys, `fps`, `units`, `axes`, `origin` and `markers` (a
list of M names).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsed_apart, parsing, whole_file
from whiptool.models.numbers import float_array
from whiptool.models.strike import Strike
from whiptool.recording.readers.footage import clock_of_rows
from whiptool.recording.readers.joint_log import JointLog, joint_log
from whiptool.recording.readers.programs import HDF5
from whiptool.recording.readers.qualisys import labelled, recording_of_mat
from whiptool.recording.readers.sidecar import SPACE, UNITS, Sidecar
from whiptool.recording.strike_recording import StrikeRecording

SPREAD = ("sigma", "t_points")  # variables with one number for each point, or for all


def read_mat(path: Path | str, **options: Any) -> StrikeRecording:
    """Read a MAT file of version 5 (7.3 is HDF5); `options` are keys of its sidecar, whose values they override."""
    path = whole_file(path)
    _check_version(path)
    flat = parsed_apart(path, "mat", parse)
    with parsing(path, "MAT"):
        if "qualisys" in flat:
            return recording_of_mat(path, options, flat)
        side = Sidecar.of(path, options, *SPACE, "markers", "fps")
        data = _one_struct(flat)
        points = _points(data)
        count, n = points.shape[:2]
        t, note = _times(data, side, count)
        if len(t) != count:
            raise InputError("points", f"shape {points.shape}", f"as many rows as there are times, {len(t)}")
        if isinstance(side.values.get("markers"), Mapping):
            raise side.refuse("markers", f"a list of {n} names, one per marker")
        names = side.names("markers") or [str(x).strip() for x in data.get("markers", np.array("tip")).ravel()]
        if len(names) != n:
            raise InputError("markers", list(names), f"{n} names, one per marker")
        units = str(data["units"].item()) if "units" in data else "m"
        if units not in UNITS:
            raise InputError("units", units, "one of " + ", ".join(UNITS))
        clock = clock_of_rows(side, t, note, "t")
        scale = {"sigma": UNITS[side.word("units", UNITS, units)]}
        read: dict[str, Any] = {key: float_array(key, data[key]) * scale.get(key, 1.0) for key in SPREAD if key in data}
        read = {key: x[clock.keep] if x.ndim and len(x) == count else x for key, x in read.items()}
        if "t_points" in read:
            read["t_points"] = read["t_points"] - side.start
        read |= {key: float_array(key, data[key]).item() for key in ("exposure", "t_stay") if key in data}
        read |= {"target": tuple(float_array("target", data["target"]).ravel())} if "target" in data else {}
        read |= {"camera": str(data["camera"].item())} if "camera" in data else {}
        return side.recording(
            path,
            notes=clock.notes,
            log=_joints(data, side),
            t=clock.times,
            points=side.metres(points[clock.keep], units),
            markers=tuple(names),
            strike=_strike(data),
            **read,
        )


def _check_version(path: Path) -> None:
    """Refuse what is not MAT version 5."""
    with path.open("rb") as file:
        head = file.read(520)
    version, fix = "MAT version 5", "in MATLAB: save(name, '-v7', ...)"
    if head[:8] == HDF5 or head[512:520] == HDF5 or head.startswith(b"MATLAB 7.3"):
        raise InputError(str(path), "MAT version 7.3 (HDF5)", version, fix)
    if not head.startswith(b"MATLAB 5.0"):
        raise InputError(str(path), "no header of MAT version 5", version, fix)


def _times(data: dict[str, np.ndarray], side: Sidecar, count: int) -> tuple[np.ndarray, str]:
    """Times [s] by the file's own clock, and where they come from."""
    if "t" in data:
        return float_array("t", data["t"]).ravel(), "times [s] from the variable t"
    if "fps" in data or "fps" in side.table:
        rate = side.number("fps", float_array("fps", data["fps"]).item() if "fps" in data else 0.0, low=1.0, high=1e5)
        return np.arange(count) / rate, f"times by frame number at {rate:g} a second"
    raise InputError("t", None, "the variable t, times [s], or fps")


def _strike(data: dict[str, np.ndarray]) -> Strike | None:
    """The strike, from its vector or from a struct."""
    if "strike" in data:
        return Strike.from_vector(float_array("strike", data["strike"]).ravel())
    if "strike.D" in data:
        q_i, q_f, D = (float_array(key, data[f"strike.{key}"]).ravel() for key in ("q_i", "q_f", "D"))
        return Strike(tuple(q_i), tuple(q_f), D.item())
    return None


def _joints(data: dict[str, np.ndarray], side: Sidecar) -> JointLog | None:
    """The joint log, if there is one."""
    if "joints_t" not in data or "joints_q" not in data:
        return None
    t, q = (float_array(key, data[key]) for key in ("joints_t", "joints_q"))
    t = t.ravel()
    if q.ndim != 2 or len(q) != len(t):
        raise InputError("joints_q", f"shape {q.shape}", f"shape ({len(t)}, number of joints), as joints_t has it")
    names = [str(name).strip() for name in data.get("joint_names", np.array([])).ravel()]
    return joint_log(t, q, names, side.joint_columns, "joint_names", of="joints_t")


def _one_struct(flat: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The variables of the recording: the plain ones, or the fields of the one struct that holds places."""
    if "points" in flat or "x" in flat:
        return flat
    structs = sorted({name.rpartition(".")[0] for name in flat if name.rpartition(".")[2] in ("points", "x")})
    if len(structs) != 1:
        found = ", ".join(structs or sorted(flat)) or "nothing"
        raise InputError("variables", found[:120], "points, or x and y, plain or in exactly one struct")
    prefix = structs[0] + "."
    return {name.removeprefix(prefix): value for name, value in flat.items() if name.startswith(prefix)}


def _points(data: dict[str, np.ndarray]) -> np.ndarray:
    """Places (T, M, d) as they stand in the file."""
    if "points" in data:
        points = float_array("points", data["points"])
        points = points[:, None, :] if points.ndim == 2 else points  # MATLAB drops no axis but the last; M = 1
        if points.ndim != 3 or points.shape[2] not in (2, 3):
            raise InputError("points", f"shape {points.shape}", "(T, M, 2), (T, M, 3), or for one marker (T, 2)")
        return points
    axes = [float_array(name, data[name]) for name in ("x", "y", "z") if name in data]
    axes = [axis.T if axis.shape[0] == 1 else axis for axis in axes]  # a row is one marker over time
    if len(axes) < 2 or len({axis.shape for axis in axes}) > 1 or axes[0].ndim != 2:
        raise InputError("x, y", ", ".join(str(axis.shape) for axis in axes), "x and y of the same shape (T, M)")
    return np.stack(axes, axis=2)


def parse(path: str) -> dict[str, np.ndarray]:
    """Return all variables by name, fields of structs as `struct.field`, cell arrays of texts as arrays.

    It runs in a separate process, as the parser may crash on damaged files.
    """
    from scipy.io import loadmat

    flat: dict[str, np.ndarray] = {}
    for name, value in loadmat(path).items():
        if not name.startswith("__"):
            if (tracks := labelled(value)) is not None:
                return {**tracks, "qualisys": np.array(name)}
            _flatten(name, value, flat)
    return flat


def _flatten(name: str, value: Any, flat: dict[str, np.ndarray]) -> None:
    if type(value) is not np.ndarray:  # SciPy's own classes stand for objects, functions, and sparse matrices
        raise InputError(name, type(value).__name__, "numbers, texts, structs of them, or cell arrays of texts")
    if value.dtype.names is not None:
        if value.size != 1:
            raise InputError(name, f"{value.size} structs", "one struct")
        for field in value.dtype.names:
            _flatten(f"{name}.{field}", value.item()[value.dtype.names.index(field)], flat)
    elif value.dtype.kind == "O":
        texts = [x for x in value.ravel() if isinstance(x, np.ndarray) and x.dtype.kind == "U" and x.size == 1]
        if len(texts) < value.size:
            raise InputError(name, "a cell array of other things", "a cell array of texts")
        flat[name] = np.array([x.item() for x in texts], dtype=str)
    elif value.dtype.kind in "biufU":
        flat[name] = value
    else:
        raise InputError(name, f"numbers of type {value.dtype}", "real numbers")
