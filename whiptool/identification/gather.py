"""Recordings for a fit from whatever there is: tracks are read, images are tracked."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.readers import READERS, VideoSource, find_format, open_video, read_recording
from whiptool.recording.readers.angles import read_swings
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.markers import Marker


def each_episode(paths: tuple[str, ...]) -> tuple[str, ...]:
    """Return the paths, those of several swings of an arm replaced by `FILE#0`, `FILE#1` and so on."""
    found: list[str] = []
    for path in paths:
        angles = Path(path).is_file() and find_format(path) == "angles"
        found += [swing.source for swing in read_swings(path)] if angles else [path]
    return tuple(found)


def opened(path: str, *, handle: bool = False, cameras: Path | None = None) -> StrikeRecording | VideoSource:
    """Return a recording, or the video in which the tip still has to be tracked.

    Args:
        path: A file or folder of any of `READERS`; `FOLDER#3` is episode 3 of a dataset.
        cameras: File of the calibrated cameras, for films and recordings in pixels in space; default: the file that
            each recording names.
        handle: Whether the handle's path is needed, which is not tracked in images.

    Raises:
        InputError: The file is not a recording or is damaged; or the handle is needed and the recording is a film.
    """
    options: dict[str, Any] = {}
    if (episode := re.fullmatch(r"(.+)#(\d+)", path)) and not Path(path).exists():
        path, options["episode"] = episode[1], int(episode[2])
    form = READERS[find_format(path)]
    if cameras is not None and (in_pixels(path) or form.tracks is None):
        options["cameras"] = cameras
    if form.tracks is not None:
        try:
            return read_recording(path, **options)
        except InputError as error:
            if form.video is None or not error.name.endswith("features"):
                raise
    if handle:
        raise InputError(
            "drive handle",
            path,
            "tracks that hold a marker handle: in images the tip alone is tracked",
            "track both elsewhere (DeepLabCut, CSV), or drive passive, for a hand that stays still",
        )
    return open_video(path, **options)


def may_be_filmed(path: str) -> bool:
    """Whether a recording has a format that can contain images."""
    if (episode := re.fullmatch(r"(.+)#(\d+)", path)) and not Path(path).exists():
        path = episode[1]
    return READERS[find_format(path)].video is not None


def in_pixels(path: str) -> bool:
    """Whether a recording is a CSV file with a camera's pixel coordinates of markers."""
    if not Path(path).is_file() or find_format(path) != "csv":
        return False
    with Path(path).open(encoding="utf-8-sig", errors="replace") as file:
        return any(name.strip().strip('"').endswith("_u") for name in file.readline().split(","))


def tracked(
    found: StrikeRecording | VideoSource, *, name: str, tip: Marker | None = None
) -> tuple[StrikeRecording, bool]:
    """Return one recording; a film is tracked (with progress on stderr) on the strike plane, or in pixels of a camera
    in space.

    Args:
        found: Result of `opened`.
        name: Name of the file.
        tip: Appearance of the tip's marker; default: as in the virtual camera's images.

    Returns:
        The recording, and whether it states that it is synthetic.

    Raises:
        InputError: The film has neither a calibrated strike plane nor a camera in space, or never shows the tip.
    """
    if isinstance(found, StrikeRecording):
        return found, False
    from whiptool.progress import Progress
    from whiptool.vision.recorded import RecordedCamera
    from whiptool.vision.source import frames_of
    from whiptool.vision.tracking import track, track_view

    camera = RecordedCamera(found)
    frames = Progress(
        frames_of(camera),
        total=len(camera),
        unit=" frames",
        file=sys.stderr,
        desc=f"tracking {Path(name).name}",
        dynamic_ncols=True,
        leave=False,
    )
    try:
        if found.view is None:
            return track(frames, calibration=camera.calibration, tip=tip).to_recording(**found.about), found.synthetic
        about: dict[str, Any] = dict(found.about)
        if found.synthetic:
            about["camera"] = f"{found.view.name} (virtual)"
        distance = float(np.linalg.norm(found.view.position))  # markers are about as far away as the arm's base
        return track_view(frames, tip=tip, distance=distance, **about), found.synthetic
    except InputError as error:
        raise (error if name in error.name else error.within(f"{name}: ")) from None
