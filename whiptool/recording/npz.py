"""Recordings as NPZ files, never pickled: the keys are the fields of `StrikeRecording`, with those that are None or
empty left out, and `format`, the number of the layout (1). `markers`, `joint_names` and `notes` are arrays of strings,
`strike` the vector `[q_i, q_f, D]`, `controller` and `view` JSON texts."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, read_arrays, sha256
from whiptool.models.strike import Strike
from whiptool.recording.camera import camera_of
from whiptool.whole_files import write_npz as write_arrays

LAYOUT = 1  # raised when a key changes its meaning
REQUIRED = ("t", "points", "markers")
NAMES = ("markers", "joint_names", "notes")
_WRITTEN = {"strike": lambda strike: strike.vector, "controller": json.dumps, "view": lambda x: json.dumps(x.table())}
_READ = {
    **dict.fromkeys(("exposure", "t_stay"), float),
    **dict.fromkeys(("camera", "source", "sha256", "up"), str),
    **dict.fromkeys(NAMES, lambda value: tuple(str(name) for name in np.atleast_1d(value).ravel())),
    "strike": Strike.from_vector,
    "controller": lambda value: json.loads(str(value)),
    "view": lambda value: camera_of("view", json.loads(str(value))),
}


def write_npz(recording: Any, path: Path | str) -> None:
    """Write a recording.

    Raises:
        InputError: The file cannot be written.
    """
    arrays: dict[str, Any] = {"format": np.int64(LAYOUT)}
    for field in dataclasses.fields(recording):
        value = getattr(recording, field.name)
        if value is not None and not (field.name in ("joint_names", "notes", "joints_listed", "up") and not value):
            arrays[field.name] = np.asarray(_WRITTEN.get(field.name, np.asarray)(value))
    try:
        write_arrays(Path(path), arrays)
    except OSError as error:
        raise InputError("recording", str(path), f"a file that can be written ({error.strerror})") from None


def read_npz(path: Path | str, build: type) -> Any:
    """Read a recording; the keys `t`, `points` and `markers` are required, all others optional.

    If the file does not state its source, the source is the file itself.

    Raises:
        InputError: The file is damaged or contains pickled objects, a key is unknown or missing, or a value is not
            allowed.
    """
    path, keys = Path(path), [field.name for field in dataclasses.fields(build)]
    values: dict[str, Any] = read_arrays(path, "recording")
    with parsing(path, "NPZ"):
        for key in values:
            if key not in (*keys, "format"):
                raise InputError("key", key, "one of " + ", ".join(keys))
        for key in REQUIRED:
            if key not in values:
                raise InputError("key", None, f"{key}; there must be " + ", ".join(REQUIRED))
        if (number := int(values.pop("format", LAYOUT))) != LAYOUT:
            raise InputError("format", number, f"{LAYOUT}", "it was written by another version of whiptool")
        values = {key: _READ.get(key, lambda value: value)(value) for key, value in values.items()}
        if not values.get("sha256"):
            values |= {"source": values.get("source") or str(path), "sha256": sha256(path)}
        return build(**values)
