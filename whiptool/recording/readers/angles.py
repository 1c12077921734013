"""Angles of the links of a freely swinging arm, measured by encoders.

`NAME.npz` holds `angle`, (T, links) or, of several swings, (swings, T, links), `t` (T,) or the step `dt` [s], and
optionally `velocity` like `angle`. `NAME.csv` has one row of column names and one row per sample: `t, angle1, angle2,
...`, and optionally `velocity1, ...`. Angles are those between each link and the vertical. `NAME.toml` next to it may
hold

    zero = 3.14159265               # the angle at which a link hangs straight down; default 0, or pi if fastest there
    angle_units = "rad"             # or "deg"
    relative = false                # true: each angle is counted from the link before
    sigma = 0.002                   # standard error of an angle [rad]
    every = 12                      # take every so many samples
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, read_arrays, read_toml, sha256, whole_file
from whiptool.models.numbers import float_array, number, whole
from whiptool.recording.readers.table import read_columns
from whiptool.recording.strike_recording import StrikeRecording

SIDECAR = ("zero", "angle_units", "relative", "sigma", "every")  # keys of the file next to a recording
_SIGMA = 1e-3  # [rad]
_SHORT = 0.015  # [s] through which an angle is a parabola
_COLUMN = re.compile(r"(angle|velocity)[1-9]\d*")


def holds_angles(path: Path, head: bytes) -> bool:
    """Whether a file with these first bytes holds angles of links."""
    if path.suffix.lower() == ".csv":
        names = re.split(r"[,;\t]", head.partition(b"\n")[0].decode("utf-8-sig", "replace").strip())
        names = [name.strip().strip('"') for name in names]
        return "angle1" in names and all(name == "t" or _COLUMN.fullmatch(name) for name in names)
    if path.suffix.lower() == ".npz":
        # of a damaged file its reader says what is wrong
        with suppress(InputError), parsing(path, "NPZ"), zipfile.ZipFile(path) as archive:
            return "angle.npy" in archive.namelist()
    return False


def read_angles(path: Path | str, *, episode: int = 0) -> StrikeRecording:
    """Return one swing of a pendulum, its links' angles measured by encoders, from an NPZ or CSV file, whose layout the
    module describes; `episode` is the number of the swing, from 0, in a file of several."""
    swings = read_swings(path)
    if not 0 <= episode < len(swings):
        raise InputError("episode", episode, f"a number from 0 to {len(swings) - 1}, of a swing in {path}")
    return swings[episode]


def read_swings(path: Path | str) -> list[StrikeRecording]:
    """Return all swings of an NPZ or CSV file; several are named `FILE#0`, `FILE#1`, ...

    The points of each are angles, (T, links, 1) [rad], of the markers `link1`, `link2`, ...
    """
    path = whole_file(path)
    side = read_toml(path.with_suffix(".toml")) if path.with_suffix(".toml").is_file() else {}
    for key in side:
        if key not in SIDECAR:
            raise InputError(f"{path.with_suffix('.toml')}: {key}", side[key], "one of the keys " + ", ".join(SIDECAR))
    with parsing(path, path.suffix[1:].upper()):
        t, angle, velocity = (_from_csv if path.suffix.lower() == ".csv" else _from_npz)(path)
        rates = [None] * len(angle) if velocity is None else list(velocity)
        sources = [f"{path}#{i}" for i in range(len(angle))] if len(angle) > 1 else [str(path)]
        swings = [_recording(t, q, v, side) for q, v in zip(angle, rates, strict=True)]
        digest = sha256(path)
        return [replace(one, source=source, sha256=digest) for one, source in zip(swings, sources, strict=True)]


def first_state(t: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return angles and rates at the first sample, (2, links) [rad, rad/s], by a parabola through the first of the
    angles (T, links) [rad] at times t (T,) [s]."""
    few = slice(0, min(len(t), max(4, int(np.searchsorted(t - t[0], _SHORT)))))
    return np.polynomial.polynomial.polyfit((t - t[0])[few], angles[few], 2)[:2]


def _from_npz(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Times (T,), angles and, if they are there, velocities, (swings, T, links)."""
    data = read_arrays(path, "recording")
    if "angle" not in data or not {"t", "dt"} & set(data):
        raise InputError("key", ", ".join(data)[:80], "angle, and t (T,) [s] or dt [s]")
    angle = float_array("angle", data["angle"])
    velocity = float_array("velocity", data["velocity"]) if "velocity" in data else None
    if angle.ndim not in (2, 3) or (velocity is not None and velocity.shape != angle.shape):
        raise InputError("angle", angle.shape, "(T, links) or (swings, T, links), and velocity like it")
    t = float_array("t", data["t"]) if "t" in data else np.arange(angle.shape[-2]) * float_array("dt", data["dt"])
    many = (-1, *angle.shape[-2:])
    return t, angle.reshape(many), None if velocity is None else velocity.reshape(many)


def _from_csv(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """The same of a CSV file, which holds one swing."""
    names, table = read_columns(path)
    links = sum(name.startswith("angle") for name in names)
    angles, rates = ([f"{what}{i + 1}" for i in range(links)] for what in ("angle", "velocity"))
    if not links or not {"t", *angles} <= set(names):
        raise InputError("columns", ", ".join(names)[:80], "t, angle1, angle2, ...")
    columns = [table[None, :, [names.index(x) for x in each]] for each in (angles, rates) if set(each) <= set(names)]
    return table[:, names.index("t")], columns[0], columns[1] if len(columns) > 1 else None


def _recording(
    t: np.ndarray, angle: np.ndarray, velocity: np.ndarray | None, side: Mapping[str, Any]
) -> StrikeRecording:
    """A swing with angles in radians, each against the vertical."""
    units = side.get("angle_units", "rad")
    if units not in ("rad", "deg"):
        raise InputError("angle_units", units, "rad or deg")
    every = whole("every", side.get("every", 1))
    zero = number("zero", side.get("zero", 0.0))
    sigma = number("sigma", side.get("sigma", _SIGMA), low=0, strict=True)
    relative, factor = side.get("relative", False), np.pi / 180 if units == "deg" else 1.0
    q = angle - (zero * np.eye(1, angle.shape[1])[0] if relative else zero)
    q, v = (None if x is None else factor * (x.cumsum(axis=1) if relative else x) for x in (q, velocity))
    assert q is not None
    notes: tuple[str, ...] = ()
    if "zero" not in side and np.sum(np.diff(q, axis=0) ** 2 * np.cos(q[1:])) < 0:  # links are fastest where they hang
        q, notes = (
            q - np.pi,
            ("zero: taken as half a turn, where the links are fastest: say zero if they hang elsewhere",),
        )
    begun = first_state(t, q) if v is None else np.array([q[0], v[0]])
    markers = tuple(f"link{i + 1}" for i in range(q.shape[1]))
    return StrikeRecording(t[::every], q[::every, :, None], markers, sigma, first_state=begun, notes=notes)
