"""Recordings of pose estimation: body parts in the pixels of one camera, frame by frame.

Each format's reader makes `Poses` of what its file holds, and `recorded` makes the recording of it. Keys of the sidecar
of all these formats, in addition to the common ones: the clock (`fps`, or `timestamps` with one time per row; not
needed where the file has times), the way to metres (`homography`, `known_points`, or `scale` and `origin`), `markers`
(which body parts are what, as in `{tip = "whip_end"}`; default: all by their own names), `individual` (which animal, if
there are several), `likelihood` (below it a point is missing), `sigma_pixels` (standard error per coordinate; default
1), and, for a rolling shutter, `readout` with `rows`, the height of the image.

In place of the way to metres `camera` and `cameras` may state the camera in space that saw them; the recording then
holds pixels, and the camera's own exposure and readout count where the sidecar states none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import to_plane
from whiptool.recording.homography import metres_per_pixel
from whiptool.recording.readers.footage import frame_clock
from whiptool.recording.readers.sidecar import CLOCK, FILM, PIXELS, UNSTATED, Sidecar
from whiptool.recording.strike_recording import POSE_PIXELS, StrikeRecording
from whiptool.words import counted

KEYS = (*CLOCK, *PIXELS, *FILM, "markers", "individual", "likelihood", "sigma_pixels", "rows")  # of the sidecar
WAYS = "homography, known_points, or scale and origin of the strike plane; or camera and cameras of one in space"
HIGH = 1e6  # the largest limit of a likelihood; SLEAP's scores may exceed 1


@dataclass(frozen=True, eq=False)
class Poses:
    """What a file of pose estimation holds of one animal."""

    what: str  # description of the format, for messages
    pixels: np.ndarray  # (u to the right, v down) of the body parts, NaN where missing, (T, M, 2)
    parts: Sequence[str]  # names of the body parts, (M,)
    likelihood: np.ndarray | None = None  # or score of each point, (T, M); None: the file has none
    usual: float | None = None  # likelihood below which a point is missing if the sidecar does not say; None: none is
    numbers: np.ndarray | None = None  # of the frames, (T,); None: from 0 on
    stamps: np.ndarray | None = None  # time stamps in the file [s], (T,); None: it has none
    of: str = ""  # source of the stamps
    notes: tuple[str, ...] = ()  # assumptions, and data that were left out


def recorded(path: Path, side: Sidecar, poses: Poses) -> StrikeRecording:
    """Return the recording of a file of pose estimation."""
    parts = list(poses.parts)
    if not parts:
        raise InputError(str(path), f"{poses.what} without body parts", "at least one body part")
    if len(poses.pixels) < 2:
        raise InputError(str(path), f"{poses.what} with {len(poses.pixels)} frames", "at least two frames")
    names = side.names("markers") or {part: part for part in parts}
    for part in names.values():
        if part not in parts:
            raise InputError("markers", part, "one of the body parts " + ", ".join(parts)[:300])
    which = [parts.index(part) for part in names.values()]
    pixels, notes = poses.pixels[:, which].copy(), list(poses.notes)
    if poses.likelihood is not None and (poses.usual is not None or "likelihood" in side.table):
        least = side.number("likelihood", poses.usual or 0.0, low=0.0, high=HIGH)
        unlikely = (poses.likelihood[:, which] < least) & np.isfinite(pixels).all(axis=2)
        pixels[unlikely] = np.nan
        if count := int(unlikely.sum()):
            notes.append(f"{counted(count, 'point')} with a likelihood below {least:g} taken as missing")
    if not np.isfinite(pixels).all(axis=2).any():
        raise InputError(str(path), f"{poses.what} in which no body part was seen", "at least one position")
    homography, view = side.homography(), side.filmed_by
    if (homography is None) == (view is None):
        given = None if view is None else "together with cameras"
        raise InputError("homography", given, WAYS, UNSTATED["homography"])
    clock = frame_clock(side, len(pixels), stamps=poses.stamps, of=poses.of, numbers=_numbers(side, poses))
    pixels, t = pixels[clock.keep], clock.times
    readout, sigma = side.readout(), side.number("sigma_pixels", POSE_PIXELS, low=1e-6, high=1e3)
    assumed = "" if "sigma_pixels" in side.table else "sigma_pixels"
    if view is not None:
        timed = readout * view.height / max(view.height - 1, 1)  # to the row after the last
        view = replace(view, exposure=side.exposure(), readout=timed)
        seen = {"points": pixels, "markers": tuple(names), "sigma": sigma, "sigma_assumed": assumed, "view": view}
        return side.recording(path, notes=[*clock.notes, *notes], t=t, **seen)
    assert homography is not None
    notes.append("units: pixels, taken to metres in the strike plane as the sidecar says")
    if readout and "rows" not in side.table:
        raise InputError(
            "rows", None, "the height of the image [pixels], with the key readout", "state it in the sidecar"
        )
    height = side.number("rows", 2.0, low=2, high=1e5) if readout else 2.0
    late = readout * pixels[..., 1] / (height - 1)  # [s] a row's exposure after the first's
    return side.recording(
        path,
        notes=[*clock.notes, *notes],
        t=t,
        points=to_plane(homography, pixels),
        markers=tuple(names),
        sigma=sigma * metres_per_pixel(homography, pixels),
        sigma_assumed=assumed,
        t_points=t[:, None] + late,
    )


def _numbers(side: Sidecar, poses: Poses) -> np.ndarray | None:
    """The number of each frame (T,); None where each has its own timestamp."""
    frames = poses.numbers
    if frames is None or poses.stamps is not None or "timestamps" in side.table:
        return None
    if not (np.isfinite(frames).all() and (frames >= 0).all() and (frames < 1e7).all() and (frames % 1 == 0).all()):
        raise InputError("first column", frames[:3].tolist(), "the numbers of the frames")
    return frames


def individual(side: Sidecar, known: Sequence[str], what: str) -> int:
    """Return the index of the animal to read: that of the key `individual`, or the only one."""
    if "individual" in side.table:
        return list(known).index(side.word("individual", tuple(known), ""))
    if len(known) != 1:
        given = f"{what} of {len(known)} individuals, {', '.join(known)}"
        raise InputError("individual", given[:300], "one individual", "state individual in the sidecar file")
    return 0
