"""Recordings from files: tracks become a `StrikeRecording`, images a `VideoSource` for the tracker.

The module of each format describes it: `tracks` (CSV), `angles`, `mat`, of motion capture `c3d`, `motive`, `nexus`,
`qualisys`, `trc`, of pose estimation `deeplabcut`, `sleap`, `anipose`, `nwb`, of films `tracker`, `rosbag`, `footage`,
of robots `lerobot`, `bag_tracks`, and `StrikeRecording.save` (NPZ); `sidecar` describes the TOML file next to a
recording.
"""

from __future__ import annotations

import glob
import inspect
import math
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from whiptool.errors import InputError, expect
from whiptool.extras import Registry
from whiptool.given_files import whole_file, without_number
from whiptool.recording.readers import programs
from whiptool.recording.readers.angles import holds_angles, read_angles
from whiptool.recording.readers.anipose import read_anipose
from whiptool.recording.readers.bag_files import is_bag
from whiptool.recording.readers.bag_logs import read_bag_logs
from whiptool.recording.readers.bag_tracks import read_bag
from whiptool.recording.readers.c3d import read_c3d
from whiptool.recording.readers.deeplabcut import holds_table, read_deeplabcut
from whiptool.recording.readers.footage import SUFFIXES, VideoSource, read_video, video_frames
from whiptool.recording.readers.hdf5 import read_hdf5
from whiptool.recording.readers.joint_log import Logs, holds_log, read_csv_logs
from whiptool.recording.readers.keys import refuse_unheard
from whiptool.recording.readers.lerobot import lerobot_video, read_lerobot, read_lerobot_logs
from whiptool.recording.readers.lerobot_dataset import lerobot_episode
from whiptool.recording.readers.mat import read_mat
from whiptool.recording.readers.motive import read_motive
from whiptool.recording.readers.nexus import read_nexus
from whiptool.recording.readers.qualisys import read_qualisys
from whiptool.recording.readers.rosbag import db3_frames, db3_topics, read_db3
from whiptool.recording.readers.sleap import read_sleap
from whiptool.recording.readers.tracker import read_tracker
from whiptool.recording.readers.tracks import JOINT_LOG, read_csv, write_csv
from whiptool.recording.readers.trc import read_trc
from whiptool.recording.strike_recording import StrikeRecording


@dataclass(frozen=True)
class Format:
    """A file format of recordings.

    Args:
        what: Description of the format.
        matches: Function of a path and its first bytes (empty for a folder) that returns whether it has this format.
        tracks: Function that reads tracks, if the format can contain any.
        video: Function that reads images, if the format can contain any.
        logs: Function that reads logs of a robot, if the format can contain them without tracks.
        needs: Optional module with which the format is read, if any.
    """

    what: str
    matches: Callable[[Path, bytes], bool]
    tracks: Callable[..., StrikeRecording] | None = None
    video: Callable[..., VideoSource] | None = None
    logs: Callable[..., Logs] | None = None
    needs: str = ""


def _named(*suffixes: str) -> Callable[[Path, bytes], bool]:
    return lambda path, _: path.is_file() and path.suffix.lower() in suffixes


def _log(path: Path, head: bytes) -> bool:
    """Whether a CSV file with these first bytes is a log of a robot's joints or hand."""
    if path.suffix.lower() not in (".csv", ".txt", ".log"):
        return False
    first = head.decode("utf-8-sig", "replace").lstrip().partition("\n")[0].strip()
    names = [name.strip().strip('"') for name in re.split("[,;\t]" if re.search("[,;\t]", first) else " ", first)]
    return path.name.endswith(JOINT_LOG) or holds_log(names)


def _read_npz(path: Path) -> StrikeRecording:
    """Read a recording of whiptool's own, which states all itself."""
    fix = "move it away; the CSV file that whiptool.recording convert writes has a sidecar that is read"
    refuse_unheard(Path(path), "an NPZ file of whiptool", fix)
    return StrikeRecording.load(path)


READERS: Registry[Format] = Registry(
    "readers",
    Format,
    {
        "motive": Format("CSV of OptiTrack Motive", programs.MOTIVE.matches, read_motive),
        "nexus": Format("CSV of Vicon Nexus", programs.NEXUS.matches, read_nexus),
        "qualisys": Format("TSV of Qualisys Track Manager", programs.QUALISYS.matches, read_qualisys),
        "trc": Format("TRC of OpenSim", programs.TRC.matches, read_trc),
        "tracker": Format("text of Tracker", programs.TRACKER.matches, read_tracker),
        "anipose": Format("CSV of Anipose", programs.ANIPOSE.matches, read_anipose),
        "sleap": Format("CSV of SLEAP", programs.SLEAP.matches, read_sleap),
        "hdf5": Format("HDF5 of DeepLabCut, SLEAP or NWB", programs.POSES.matches, read_hdf5, needs="h5py"),
        "deeplabcut": Format("DeepLabCut CSV", holds_table, read_deeplabcut),
        "angles": Format("angles of a free arm's links, CSV or NPZ", holds_angles, read_angles),
        "log": Format("log of a robot's joints or hand, CSV", _log, logs=read_csv_logs),
        "csv": Format("CSV with columns t, tip_x, tip_y, ...", _named(".csv"), read_csv),
        "npz": Format("NPZ of whiptool", _named(".npz"), _read_npz),
        "mat": Format("MAT version 5, also of Qualisys Track Manager", _named(".mat"), read_mat),
        "c3d": Format("C3D motion capture", _named(".c3d"), read_c3d, needs="ezc3d"),
        "lerobot": Format(
            "folder of a LeRobotDataset v2 or v3",
            lambda p, _: (p / "meta/info.json").is_file(),
            read_lerobot,
            lerobot_video,
            read_lerobot_logs,
            needs="pyarrow",
        ),
        "rosbag": Format(
            "ROS bag (.bag, .db3, .mcap, or its folder)", is_bag, read_bag, read_db3, read_bag_logs, needs="rosbags"
        ),
        "video": Format("video (" + ", ".join(SUFFIXES) + ")", _named(*SUFFIXES), video=read_video, needs="cv2"),
    },
    what="format",
)

LACKING = ("features", "topics")  # what an error names where a file holds other things than were read
_OWN = frozenset(READERS)


def find_format(path: Path | str) -> str:
    """Return the key in `READERS` of a recording's format, by its name and first bytes."""
    expect(str, PathLike, path=path)
    path = Path(path)
    head = b""
    try:
        if not path.exists():
            raise InputError("recording", str(path), "a file or folder that exists")
        if not path.is_dir():
            path = whole_file(path, largest=math.inf)
            head = programs.beginning(path)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("recording", str(path)[:200], "a path that can be read", f"reason: {error}") from None
    try:
        programs.refuse_others(path, head)
    except InputError:
        if installed := _installed_format(path, head):
            return installed
        raise
    for name, form in READERS.items():
        if form.matches(path, head):
            return name
    if installed := _installed_format(path, head):
        return installed
    rule = "one of the formats of docs/file-formats.md: CSV, TSV, TRC, MAT, C3D, HDF5, NPZ, a film, a ROS bag, LeRobot"
    raise InputError("recording", str(path), rule, _other_file(path))


def _other_file(path: Path) -> str:
    """What was probably meant by a path of unknown format; empty if that is unknown, too."""
    if path.suffix == ".toml":
        of = next((x.name for x in sorted(path.parent.glob(f"{glob.escape(path.stem)}.*")) if x.name != path.name), "")
        return f"it is a sidecar, which is read with {of or 'its recording'}: leave it out"
    if not (path / "config.toml").is_file():
        return ""
    for held, words in (("recording.npz", "recording.npz"), ("recordings", "recordings/*.npz")):
        if (path / held).exists():
            return f"it is a run folder; did you mean {path / words}?"
    return "it is a run folder, which holds no recording"


def _installed_format(path: Path, head: bytes) -> str | None:
    """Return the key of the format of a path that an installed package reads; None: no package does."""
    READERS.add_installed()
    return next((name for name in READERS if name not in _OWN and READERS[name].matches(path, head)), None)


def needed_for(paths: Iterable[Path | str]) -> tuple[str, ...]:
    """Return the optional modules with which these recordings are read; files of unknown format are skipped."""
    found = []
    for path in paths:
        with suppress(InputError):
            found.append(READERS[find_format(path)].needs)
    return tuple(module for module in found if module)


def read_recording(path: Path | str, *, format: str | None = None, **options: Any) -> StrikeRecording:
    """Read the tracks of a strike from a file or folder of any format with tracks.

    Args:
        path: The file or folder.
        format: A key of `READERS`; None to choose by name and first bytes.
        options: Options of the format's reader: keys of the sidecar file, whose values they override.

    Raises:
        InputError: The format is unknown or holds images (see `open_video`), the file is damaged, empty, in wrong
            units, or has another value that is not allowed, or an option is unknown.
    """
    expect(str, PathLike, path=path)
    form = _format(path, format)
    if form.tracks is None and form.logs is not None:
        raise log_alone(path)
    if form.tracks is None:
        raise InputError(
            "recording", str(path), "tracks, or images that were tracked first", f"this is {form.what}; track it"
        )
    return form.tracks(path, **_checked(form.tracks, options))


def open_video(path: Path | str, *, format: str | None = None, **options: Any) -> VideoSource:
    """Open the images of a strike from a file or folder; `format` is a key of `READERS`, by default chosen by name and
    first bytes, and `options` are keys of the sidecar file, whose values they override."""
    form = _format(path, format)
    if form.video is None:
        raise InputError("recording", str(path), "images", f"this is {form.what}; read it with read_recording")
    return form.video(path, **_checked(form.video, options))


def log_alone(path: Path | str) -> InputError:
    """Return the error for a log of a robot that was given as a recording."""
    name = Path(path).name
    fix = f'leave it out, and name it in the sidecar of the tracks: joints = "{name}", or hand = "{name}"'
    if name.endswith(JOINT_LOG):
        fix = f"leave it out: it is read together with {name.removesuffix(JOINT_LOG)}.csv"
    elif is_bag(Path(path), b""):
        side = f"{name}/whiptool.toml" if Path(path).is_dir() else Path(name).with_suffix(".toml")
        fix = f'say in {side} which topics are markers, as markers = {{tip = "/TOPIC"}}; or {fix}'
    return InputError(str(path), "a joint log", "a recording with tracks or images", fix)


def split_episode(path: str) -> tuple[str, dict[str, Any]]:
    """Return the file or folder of `PATH#3`, and its reader's options; other paths as they are, without options."""
    file, number = without_number(Path(path))
    return (path, {}) if number is None else (str(file), {"episode": number})


def open_any(path: str, **options: Any) -> StrikeRecording | VideoSource | Logs:
    """Return what a file or folder holds: tracks, else images in which the tip still has to be tracked, else a robot's
    logs. `FOLDER#3` is episode 3 of a dataset; `options` are keys of the sidecar file, whose values they override."""
    path, episode = split_episode(path)
    form = READERS[find_format(path)]
    given, refused = {**episode, **options}, None
    for reader in (form.tracks, form.video, form.logs):
        if reader is None:
            continue
        try:
            return reader(Path(path), **_checked(reader, given))
        except InputError as error:
            if not error.name.endswith(LACKING):
                raise
            refused = refused or error
    assert refused is not None
    raise refused


def _format(path: Path | str, name: str | None) -> Format:
    name = find_format(path) if name is None else name
    return READERS.find(name)


def _checked(reader: Callable[..., Any], options: dict[str, Any]) -> dict[str, Any]:
    """The options, if the reader takes them; readers with a sidecar check their names themselves."""
    parameters = inspect.signature(reader).parameters
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return options
    for key in set(options) - set(parameters):
        raise InputError("option " + key, options[key], "none, because this format has no options")
    return options
