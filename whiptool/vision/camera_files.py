"""Calibrated cameras as a TOML file: a table for each, by its name."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.models.tables import build_from, read_toml
from whiptool.vision.space_camera import SpaceCamera
from whiptool.whole_files import write_whole

TABLE = "cameras"


def write_cameras(path: str | Path, cameras: Mapping[str, SpaceCamera]) -> None:
    """Write cameras to a file, to the last digit."""
    keys = [field.name for field in dataclasses.fields(SpaceCamera) if field.name != "name"]
    tables = {
        name: {key: np.asarray(getattr(camera, key)).tolist() for key in keys} for name, camera in cameras.items()
    }
    write_whole(Path(path), tomli_w.dumps({TABLE: tables}))


def read_cameras(path: str | Path) -> dict[str, SpaceCamera]:
    """Return the cameras of a file, by name.

    Raises:
        InputError: It is no TOML file, has no table of cameras, or one of them lacks a key, has one too many, or is no
            camera.
    """
    table = read_toml(Path(path))
    cameras = table.get(TABLE)
    if set(table) != {TABLE} or not isinstance(cameras, dict) or not cameras:
        raise InputError(str(path), ", ".join(table) or "nothing", f"tables [{TABLE}.NAME], one for each camera")
    return {name: _camera(name, of_camera) for name, of_camera in cameras.items()}


def _camera(name: str, table: object) -> SpaceCamera:
    if not isinstance(table, dict) or "name" in table:
        raise InputError(f"{TABLE}.{name}", table, "a table of a camera, whose name stands in its head")
    try:
        return build_from(SpaceCamera, table, f"{TABLE}.{name}.", name=name)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{TABLE}.{name}", str(error), "numbers, in arrays where `write_cameras` writes arrays"
        ) from None
