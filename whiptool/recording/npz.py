"""Recordings as NPZ files, as `StrikeRecording.save` writes them (its docstring lists the keys); never pickle."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, read_arrays, sha256
from whiptool.models.strike import Strike
from whiptool.recording.camera import camera_of

R = TypeVar("R")
REQUIRED = ("t", "points", "markers")
SCALARS = ("exposure", "t_stay")
TEXTS = ("camera", "source", "sha256", "up")


def read_npz(path: Path | str, build: Callable[..., R], keys: Sequence[str], *, layout: int) -> R:
    """Read an NPZ file; `t`, `points` and `markers` must be there, the other keys may be.

    A file that does not say where it came from comes from itself.

    Args:
        path: The file.
        build: Makes a recording of the values, by their keys.
        keys: Allowed keys.
        layout: Number of the layout that is read.

    Raises:
        InputError: It is damaged, holds pickled objects, a key is unknown or missing, or a value is not allowed.
    """
    path = Path(path)
    values: dict[str, Any] = read_arrays(path, "recording")
    with parsing(path, "NPZ"):
        for key in values:
            if key not in (*keys, "format"):
                raise InputError("key", key, "one of " + ", ".join(keys))
        for key in REQUIRED:
            if key not in values:
                raise InputError("key", None, f"{key}; there must be " + ", ".join(REQUIRED))
        if (number := int(values.pop("format", layout))) != layout:
            raise InputError("format", number, f"{layout}", "it was written by another version of whiptool")
        for key in SCALARS:
            if key in values:
                values[key] = float(values[key])
        for key in TEXTS:
            if key in values:
                values[key] = str(values[key])
        for key in ("markers", "joint_names", "notes"):
            if key in values:
                values[key] = tuple(str(name) for name in np.atleast_1d(values[key]).ravel())
        if "strike" in values:
            values["strike"] = Strike.from_vector(values["strike"])
        if "controller" in values:
            values["controller"] = json.loads(str(values["controller"]))
        if "view" in values:
            values["view"] = camera_of("view", json.loads(str(values["view"])))
        if not values.get("sha256"):
            values |= {"source": values.get("source") or str(path), "sha256": sha256(path)}
        return build(**values)
