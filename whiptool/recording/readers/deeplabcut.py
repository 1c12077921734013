"""Tracks as DeepLabCut writes them: CSV with the header rows scorer, bodyparts and coords, in pixels.

Keys of the sidecar in addition to the common ones: the clock (`fps`, or `timestamps` with one time per row), the way to
metres (`homography`, `known_points`, or `scale` and `origin`), `markers` (which body parts are what, as in `{tip =
"whip_end"}`; default: all by their own names), `likelihood` (below it a point is missing; default 0.6, as DeepLabCut's
own plots), `sigma_pixels` (standard error per coordinate; default 1), and, for a rolling shutter, `readout` with
`rows`, the height of the image.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, whole_file
from whiptool.recording.homography import metres_per_pixel, to_plane
from whiptool.recording.readers.frame_clock import frame_clock
from whiptool.recording.readers.sidecar import CLOCK, PIXELS, Sidecar
from whiptool.recording.readers.table import cells, csv_rows
from whiptool.recording.strike_recording import StrikeRecording

COORDS = ("x", "y", "likelihood")


def read_deeplabcut(path: Path | str, **options: Any) -> StrikeRecording:
    """Read the tracks in a CSV file that DeepLabCut wrote for one animal.

    Args:
        path: The CSV file.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: The header is not DeepLabCut's, a cell is not a number, the times or the conversion to metres are
            missing, or a value is not allowed.
    """
    path = whole_file(path)
    side = Sidecar.of(path, options, *CLOCK, *PIXELS, "markers", "likelihood", "sigma_pixels", "rows")
    with parsing(path, "DeepLabCut CSV"):
        rows = csv_rows(path)
        parts = _body_parts(rows)
        table = cells(rows, 3, len(rows[0]))  # (T, 1 + 3 parts)
        if len(table) < 2:
            raise InputError("rows", len(table), "at least two frames")
        names = side.names("markers") or {part: part for part in parts}
        for part in names.values():
            if part not in parts:
                raise InputError("markers", part, "one of the body parts " + ", ".join(parts))
        columns = np.array([parts[part] for part in names.values()])  # (M,) first column of each
        pixels = np.stack([table[:, columns], table[:, columns + 1]], axis=2)  # (T, M, 2)
        threshold = side.number("likelihood", 0.6, low=0.0, high=1.0)
        pixels[~(table[:, columns + 2] >= threshold)] = np.nan
        if (homography := side.homography()) is None:
            raise InputError(
                "homography", None, "homography, known_points, or scale and origin", "write them into the sidecar .toml"
            )
        clock = frame_clock(side, len(table), numbers=_numbers(side, table[:, 0]))
        pixels, t = pixels[clock.keep], clock.times
        readout = side.readout()
        if readout and "rows" not in side.table:
            raise InputError("rows", None, "the height of the image [pixels], together with readout")
        height = side.number("rows", 2.0, low=2, high=1e5)
        late = readout * pixels[..., 1] / (height - 1)  # [s] a row's exposure after the first's
        return side.recording(
            path,
            notes=clock.notes,
            t=t,
            points=to_plane(homography, pixels),
            markers=tuple(names),
            sigma=side.number("sigma_pixels", 1.0, low=1e-6, high=1e3) * metres_per_pixel(homography, pixels),
            t_points=t[:, None] + late,
        )


def _numbers(side: Sidecar, frames: np.ndarray) -> np.ndarray | None:
    """The number of each frame (T,), from the first column; None where each has its own timestamp."""
    if "timestamps" in side.table:
        return None
    if not (np.isfinite(frames).all() and (frames >= 0).all() and (frames < 1e7).all() and (frames % 1 == 0).all()):
        raise InputError("first column", frames[:3].tolist(), "the numbers of the frames")
    return frames


def _body_parts(rows: list[list[str]]) -> dict[str, int]:
    """The first column of each body part."""
    if any(row[0].strip() == "individuals" for row in rows[:4]):
        raise InputError("header", "individuals", "tracks of one animal", "export one individual")
    for row, first in zip(rows[:3] + [[]] * 3, ("scorer", "bodyparts", "coords")):
        if not row or row[0].strip() != first or len(row) != len(rows[0]):
            raise InputError("header", ",".join(row)[:60], f"a row that begins with {first}, as long as the first")
    names, coords = rows[1][1:], [x.strip() for x in rows[2][1:]]
    if not names or len(names) % 3 or coords != list(COORDS) * (len(names) // 3):
        raise InputError("coords", ",".join(coords)[:60], "x, y, likelihood for each body part")
    parts = {name: 1 + 3 * i for i, name in enumerate(names[::3])}
    if len(parts) < len(names) // 3 or any(len(set(names[i : i + 3])) > 1 for i in range(0, len(names), 3)):
        raise InputError("bodyparts", ",".join(names)[:60], "each name over its three columns, once")
    return parts
