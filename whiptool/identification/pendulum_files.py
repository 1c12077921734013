"""Free swings of a pendulum as encoders saw them, and the pendulum itself in a TOML file.

`NAME.npz` holds `angle`, (T, links) or, of several swings, (swings, T, links), `t` (T,) or the step `dt` [s], and
perhaps `velocity` like `angle`. `NAME.csv` has one row of column names and one row per sample: `t, angle1, angle2,
...`, and perhaps `velocity1, ...`. Angles are each link's own against the vertical. `NAME.toml` next to it may hold

    zero = 3.14159265               # the angle at which a link hangs straight down; default 0
    angle_units = "rad"             # or "deg"
    relative = false                # true: each angle is counted from the link before
    sigma = 0.002                   # standard error of an angle [rad]
    every = 12                      # take every so many samples

A pendulum's file holds one table `[[links]]` per link with `mass`, `length`, and perhaps `com`, `inertia`, `friction`
(viscous), `dry_friction`, `drag`; in addition `gravity` and `friction_velocity`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.given_files import parsing, read_arrays, whole_file
from whiptool.identification.pendulum import AngleRecording, Pendulum
from whiptool.models.parameters import ArmLink, number, whole
from whiptool.models.tables import read_toml
from whiptool.recording.readers.table import read_columns
from whiptool.whole_files import write_whole

# keys of the file next to a recording, and of a pendulum's file: of a link, and of the whole pendulum
SIDECAR = ("zero", "angle_units", "relative", "sigma", "every")
LINK = ("mass", "length", "com", "inertia", "friction")
EACH = ("dry_friction", "drag")
SHARED = ("gravity", "friction_velocity")
_SIGMA = 1e-3  # [rad]


def read_pendulum(path: Path | str) -> Pendulum:
    """A pendulum from its TOML file.

    Raises:
        InputError: The file cannot be read, a key is unknown or missing, or a value is not allowed.
    """
    table = read_toml(Path(path))
    links = table.get("links")
    for key in table:
        if key not in ("links", *SHARED):
            raise InputError(f"{path}: {key}", table[key], "one of the keys links, " + ", ".join(SHARED))
    if not isinstance(links, list) or not links or not all(isinstance(link, Mapping) for link in links):
        raise InputError(f"{path}: links", links, "one table [[links]] per link, or more")
    for i, link in enumerate(links):
        for key in link:
            if key not in (*LINK, *EACH):
                raise InputError(f"{path}: links[{i}].{key}", link[key], "one of " + ", ".join((*LINK, *EACH)))
        for key in ("mass", "length"):
            if key not in link:
                raise InputError(f"{path}: links[{i}].{key}", None, "a number > 0", "it is missing")
    try:
        made = tuple(ArmLink(**{key: x for key, x in link.items() if key in LINK}) for link in links)
        each: dict[str, Any] = {key: tuple(link.get(key, 0.0) for link in links) for key in EACH}
        return Pendulum(made, **each, **{key: table[key] for key in SHARED if key in table})
    except InputError as error:
        raise error.within(f"{path}: ") from None


def write_pendulum(pendulum: Pendulum, path: Path | str) -> None:
    """Write a pendulum as a TOML file that `read_pendulum` reads back the same."""
    links = [
        {key: getattr(link, key) for key in LINK} | {key: getattr(pendulum, key)[i] for key in EACH}
        for i, link in enumerate(pendulum.links)
    ]
    table = {**{key: getattr(pendulum, key) for key in SHARED}, "links": links}
    write_whole(Path(path), tomli_w.dumps(table))


def read_angles(path: Path | str) -> list[AngleRecording]:
    """All swings of an NPZ or CSV file, named `FILE#0`, `FILE#1`, ... where there are several.

    Raises:
        InputError: The file cannot be read or has another format, a key is unknown, or numbers break a rule.
    """
    path = whole_file(path)
    if path.suffix.lower() not in (".npz", ".csv"):
        raise InputError("recording", str(path), "angles as .npz or .csv")
    side = read_toml(path.with_suffix(".toml")) if path.with_suffix(".toml").is_file() else {}
    for key in side:
        if key not in SIDECAR:
            raise InputError(f"{path.with_suffix('.toml')}: {key}", side[key], "one of " + ", ".join(SIDECAR))
    with parsing(path, path.suffix[1:].upper()):
        t, angle, velocity = (_from_npz if path.suffix.lower() == ".npz" else _from_csv)(path)
        count = len(angle)
        names = [f"{path}#{i}" if count > 1 else str(path) for i in range(count)]
        rates = [None] * count if velocity is None else list(velocity)
        return [_recording(t, q, v, side, name) for q, v, name in zip(angle, rates, names, strict=True)]


def _from_npz(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Times (T,), angles and, if they are there, velocities, (swings, T, links)."""
    data = read_arrays(path, "recording")
    if "angle" not in data:
        raise InputError("key", ", ".join(data)[:80], "angle, and t or dt")
    angle = np.array(data["angle"], float)
    velocity = np.array(data["velocity"], float) if "velocity" in data else None
    if angle.ndim not in (2, 3) or (velocity is not None and velocity.shape != angle.shape):
        raise InputError("angle", angle.shape, "(T, links) or (swings, T, links), and velocity like it")
    if "t" not in data and "dt" not in data:
        raise InputError("key", ", ".join(data)[:80], "t (T,) [s], or dt [s]")
    t = np.array(data["t"], float) if "t" in data else np.arange(angle.shape[-2]) * float(data["dt"])
    many = (-1, *angle.shape[-2:])
    return t, angle.reshape(many), None if velocity is None else velocity.reshape(many)


def _from_csv(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """The same of a CSV file, which holds one swing."""
    names, table = read_columns(path)
    for name in names:
        if name != "t" and not re.fullmatch(r"(angle|velocity)[1-9]\d*", name):
            raise InputError("column", name, "t, angle1, angle2, ..., velocity1, ...")
    links = sum(name.startswith("angle") for name in names)
    wanted = [[f"{what}{i + 1}" for i in range(links)] for what in ("angle", "velocity")]
    if "t" not in names or not links or not set(wanted[0]) <= set(names):
        raise InputError("columns", ", ".join(names)[:80], "t, angle1, angle2, ...")
    angle, velocity = (
        table[None, :, [names.index(x) for x in each]] if set(each) <= set(names) else None for each in wanted
    )
    assert angle is not None
    return table[:, names.index("t")], angle, velocity


def _recording(
    t: np.ndarray, angle: np.ndarray, velocity: np.ndarray | None, side: Mapping[str, Any], name: str
) -> AngleRecording:
    units = side.get("angle_units", "rad")
    if units not in ("rad", "deg"):
        raise InputError("angle_units", units, "rad or deg")
    every = whole("every", side.get("every", 1))
    zero = number("zero", side.get("zero", 0.0))
    sigma = number("sigma", side.get("sigma", _SIGMA), low=0, strict=True)
    q = angle - zero if not side.get("relative", False) else angle - zero * np.eye(1, angle.shape[1])[0]
    q, v = (np.deg2rad(x) if units == "deg" and x is not None else x for x in (q, velocity))
    assert q is not None
    if side.get("relative", False):
        q, v = q.cumsum(axis=1), None if v is None else v.cumsum(axis=1)
    recording = AngleRecording(t, q, np.array([np.nan_to_num(q[0]), np.zeros(q.shape[1])]), sigma, name)
    start = recording.parabola if v is None else np.array([q[0], v[0]])
    return AngleRecording(t[::every], q[::every], start, sigma, name)
