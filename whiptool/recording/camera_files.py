"""Calibrated cameras as a TOML file: a table for each, by its name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import tomli_w

from whiptool.errors import InputError
from whiptool.models.tables import build_from, read_toml
from whiptool.recording.space_camera import SpaceCamera
from whiptool.whole_files import write_whole

TABLE = "cameras"


def write_cameras(path: str | Path, cameras: Mapping[str, SpaceCamera]) -> None:
    """Write cameras to a file, to the last digit."""
    tables = {name: {key: x for key, x in camera.table().items() if key != "name"} for name, camera in cameras.items()}
    write_whole(Path(path), tomli_w.dumps({TABLE: tables}))


def read_cameras(path: str | Path) -> dict[str, SpaceCamera]:
    """Return the cameras of a file, by name.

    Raises:
        InputError: It is not a TOML file, has no table of cameras, or one of them lacks a key, has one too many, or is
            not a camera.
    """
    try:
        table = read_toml(Path(path))
    except InputError as error:
        raise error.renamed("cameras") from None
    cameras = table.get(TABLE)
    if set(table) != {TABLE} or not isinstance(cameras, dict) or not cameras:
        raise InputError(str(path), ", ".join(table) or "nothing", f"tables [{TABLE}.NAME], one for each camera")
    for name, of_camera in cameras.items():
        if not isinstance(of_camera, dict) or "name" in of_camera:
            raise InputError(f"{TABLE}.{name}", of_camera, "a table of a camera, whose name stands in its head")
    return {name: camera_of(f"{TABLE}.{name}", {**of_camera, "name": name}) for name, of_camera in cameras.items()}


def camera_of(place: str, table: object) -> SpaceCamera:
    """Return the camera of a table, as `SpaceCamera.table` writes it.

    Args:
        place: Place of the table, for error messages.
        table: By the names of the fields.

    Raises:
        InputError: It is not a table, lacks a key, has one too many, or is not a camera.
    """
    try:
        return build_from(SpaceCamera, table, f"{place}.")
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(place, str(error), "numbers, in arrays where `write_cameras` writes arrays") from None
