"""What is understood of a file before any fit: its format, clock, rate, markers, gaps, axes, units and logs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_toml
from whiptool.recording.finding import ASSUMED, DOUBTFUL, MEASURED, STATED, Finding
from whiptool.recording.gravity import UPRIGHT, folded, hanging
from whiptool.recording.log_findings import logs_in, of_logged, of_logs, rate_of
from whiptool.recording.logs import ClocksApart, gaps
from whiptool.recording.readers import READERS, VideoSource, find_format, log_alone, open_any, split_episode
from whiptool.recording.readers.joint_log import Logs
from whiptool.recording.readers.log_keys import LOGS
from whiptool.recording.readers.sidecar import UNSTATED
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.recording.track_findings import IN_METRES, clock_of, of_tracks, taken

GUESSES: dict[str, tuple[str, dict[str, Any]]] = {  # of keys of the sidecar, to show what lacks them
    "units": ("units", {"m": "m", "mm": "mm"}),
    "axes": ("axes", {"x, y, z": ["x", "y", "z"]}),
    "fps": ("rate", {"60 frames a second": 60.0}),
    "homography": ("units", {"a millimetre a pixel": [[1e-3, 0, 0], [0, -1e-3, 0], [0, 0, 1]]}),
}


@dataclass(frozen=True, eq=False)
class Understood:
    """A file as it was understood."""

    path: str  # as it was given; `FOLDER#3` is episode 3 of a dataset
    format: str  # key of the file's format in `READERS`
    found: StrikeRecording | VideoSource | Logs  # tracks, images, or logs of a robot
    findings: tuple[Finding, ...]  # in the order in which they are shown
    said: Mapping[str, Any] = field(default_factory=dict)  # what the sidecar says
    logs: Logs | None = None  # logs of tracks, by the frames' clock as read, or their own where it differs
    starts: Mapping[str, float] = field(default_factory=dict)  # starts subtracted from `joints`, `hand` [s]

    @property
    def table(self) -> dict[str, Any]:
        """What was understood, as plain data."""
        kinds = {StrikeRecording: "tracks", VideoSource: "images", Logs: "logs"}
        return {
            "file": self.path,
            "format": self.format,
            "kind": kinds[type(self.found)],
            "findings": [finding.table for finding in self.findings],
        }


def understand(path: str, **options: Any) -> Understood:
    """Read a file or folder of any of `READERS` (`FOLDER#3` is episode 3 of a dataset), and return what is understood
    of it; `options` are keys of the sidecar file, whose values they override."""
    file, episode = split_episode(path)
    form = find_format(file)
    said = {} if form in IN_METRES else _said(Path(file), episode.get("episode", 0)) | options
    findings = [Finding("format", READERS[form].what, STATED, "by its name and first bytes", numbers={"format": form})]
    apart: Logs | None = None
    lacking: dict[str, Finding] = {}
    try:
        found, guessed = _opened(path, options, lacking)
        said |= guessed
    except ClocksApart as error:
        found = open_any(path, **{**options, "joints": False, "hand": False})  # whose clocks are to be found
        apart = logs_in(error.logs)
        reason = f"{error.name.rpartition(' ')[2]} {error.given}, and the frames do not overlap"
        findings.append(Finding("clocks", "the logs have another clock than the frames", DOUBTFUL, reason))
    if isinstance(found, StrikeRecording):
        findings += _upright(of_tracks(found, form, said), found, path, options, said)
    elif isinstance(found, VideoSource):
        findings += _of_images(found)
    else:
        findings += of_logs(found, log_alone(file).fix)
    logs, starts = apart, {}
    if apart is None and isinstance(found, StrikeRecording):
        logs = logs_in(vars(found.upright("z")))
        starts = {what: said.get(f"{what}_start", found.start) for what in LOGS}
    shown = tuple(lacking.pop(finding.topic, finding) for finding in findings)
    return Understood(path, form, found, shown, said, logs, starts)


def _opened(path: str, options: Mapping[str, Any], lacking: dict[str, Finding], **guessed: Any) -> tuple[Any, Any]:
    """Return what a file holds, and guesses of the keys that nothing states and without which only `show` reads it; the
    findings on them are put into `lacking`."""
    try:
        return open_any(path, **{**options, **guessed}), guessed
    except InputError as error:
        key = next((key for key, fix in UNSTATED.items() if error.fix == fix and key not in guessed), "")
        topic, guesses = GUESSES.get(key, ("", {}))
        for words, guess in guesses.items():
            with suppress(InputError):
                found = _opened(path, options, lacking, **guessed, **{key: guess})
                fix = f"state {key} in the sidecar: {error.allowed}"
                unread = key == "units" and error.given  # which the file states
                reason = f"{error.name} says {error.given!r}" if unread else "nothing states it"
                reason += ", and no fit is made without"
                lacking[topic] = Finding(topic, f"unknown, shown as if {words}", DOUBTFUL, reason, fix)
                return found
        raise


def _upright(
    findings: Iterable[Finding], found: StrikeRecording, path: str, options: Mapping[str, Any], said: Mapping[str, Any]
) -> Iterator[Finding]:
    """Yield findings of tracks; where the axes that the sidecar states leave out the vertical, or the direction of the
    motion, with the right ones."""
    markers = folded(found) if "axes" in said else ""
    moves = "" if markers else _moves_across(path, options, list(said.get("axes", ())))
    for finding in findings:
        if markers and finding.topic == "axes":
            reason = f"{markers} are on one place while the whip hangs at rest: the vertical is not among them"
            fix = _axes_with_vertical(path, options, list(said["axes"]))
            yield replace(finding, certainty=DOUBTFUL, reason=reason, fix=fix)
        elif moves and finding.topic == "axes":
            fix = f'say axes = ["{moves}", "{said["axes"][1]}"] in the sidecar'
            if len(found.markers) == 1:  # which shows no vertical
                fix = "state as axes the one along which the whip moves, then the one that points up"
            reason = f"the markers move farther along {moves}, which is left out, than along {said['axes'][0]}"
            yield replace(finding, certainty=DOUBTFUL, reason=reason, fix=fix)
        elif markers and finding.topic == "labels" and finding.fix:
            yield replace(finding, fix="correct the axes first")
        else:
            yield finding


def _axes_with_vertical(path: str, options: Mapping[str, Any], axes: list[str]) -> str:
    """What to state as axes, by how the whip hangs in the file's own axes."""
    try:
        whole = open_any(path, **{**options, "axes": ["x", "y", "z"]})
        (up, off) = hanging(whole)[0].axis if isinstance(whole, StrikeRecording) else ("", math.pi)
    except (InputError, IndexError):  # a file of two axes, or a whip that is not seen to hang
        up, off = "", math.pi
    forward = [axis for axis in axes if axis[-1] != up[-1:]]
    if off > UPRIGHT or not forward:
        return "name the file's axis that points up as the second of axes"
    return f'say axes = ["{forward[0]}", "{up}"] in the sidecar'


def _moves_across(path: str, options: Mapping[str, Any], axes: list[str]) -> str:
    """The axis of a file in space that two stated axes leave out, if its markers move farther along it than along the
    first of the two; empty otherwise."""
    if len(axes) != 2:
        return ""
    try:
        whole = open_any(path, **{**options, "axes": ["x", "y", "z"]})
    except InputError:  # a file of two axes
        return ""
    if not isinstance(whole, StrikeRecording) or whole.points.shape[2] != 3:
        return ""
    way = np.nanstd(whole.points, axis=(0, 1))
    (out,) = set("xyz") - {axis[-1] for axis in axes}
    return out if way["xyz".index(out)] > way["xyz".index(axes[0][-1])] else ""


def _said(path: Path, episode: int) -> dict[str, Any]:
    """What the sidecar of a file says, of a dataset that of an episode."""
    file = path / "whiptool.toml" if path.is_dir() else path.with_suffix(".toml")
    table = read_toml(file) if file.is_file() else {}
    of_episodes = table.pop("episode", {})
    return table | (of_episodes.get(str(episode), {}) if isinstance(of_episodes, dict) else {})


def _of_images(film: VideoSource) -> Iterator[Finding]:
    """Yield what was understood of images."""
    notes = list(film.about.get("notes", ()))
    yield clock_of(film.times, taken(notes, "times"), started=True)
    yield rate_of("rate", film.times, "images")
    yield Finding("gaps", "; ".join(gaps("images", film.times)) or "none", MEASURED)
    height, width = film.shape
    yield Finding("images", f"{width} x {height} pixels", MEASURED, numbers={"width": width, "height": height})
    if film.view is not None:
        yield Finding("units", f"pixels of the camera {film.view.name} in space", STATED, "file of cameras")
    elif film.homography is not None:
        yield Finding("units", "metres in the strike plane, from pixels", STATED, "the sidecar's calibration")
    else:
        fix = "calibrate it: homography, known_points, or scale and origin; or camera and cameras"
        yield Finding("units", "unknown: pixels", DOUBTFUL, "no way to metres is stated", fix)
    shutter = f"rolling, {1e3 * film.readout:.3g} ms from the first row to the last" if film.readout else "global"
    yield Finding("shutter", shutter, STATED if film.readout else ASSUMED, numbers={"readout": film.readout})
    yield Finding("exposure", f"{1e3 * film.exposure:.3g} ms", STATED if film.exposure else ASSUMED)
    yield Finding("markers", "not tracked yet", STATED, "identify tracks the tip")
    yield from of_logged(film.about, notes)
    for note in notes:
        yield Finding("note", note, ASSUMED)
