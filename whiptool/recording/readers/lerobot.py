"""Folders of LeRobotDataset v2 and v3: one episode as a recording, or its cameras as images for the tracker.

For the files of a dataset see `whiptool.recording.readers.lerobot_dataset`. Features, besides `timestamp` and
`episode_index`:

- `observation.state`: joints of the arm, by their `names` in `info.json`, without those of grippers. Names that end
  with `.pos` are those of LeRobot's motors, whose units `joint_units` has to state: `deg`, or `normalized` (-100 to
  100), unless positions beyond 100, or names that begin with `main_`, say that they are in degrees.
- `observation.whip` (or `observation.markers`): positions of markers; its `names` in `info.json` are columns such as
  `tip_x, tip_y, handle_x, handle_y`, optionally with `tip_sigma`. Without it the images have to be tracked.

The sidecar is `whiptool.toml` in the folder, with a table `[episode.3]` for values that differ in an episode. Its keys
in addition to the common keys: `markers_feature`, `joints_feature`, `units`, `axes`, `origin`, `sigma`, and for cameras
those of `whiptool.recording.readers.footage`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, read_toml, sha256
from whiptool.recording.readers.footage import VideoSource, clock_of_rows, frame_clock, segment, source, video_frames
from whiptool.recording.readers.joint_log import JointLog, Logs
from whiptool.recording.readers.keys import refuse_unheard
from whiptool.recording.readers.lerobot_dataset import STATE, Episode, joints_of, lerobot_episode
from whiptool.recording.readers.sidecar import CLOCK, PIXELS, SPACE, Sidecar
from whiptool.recording.readers.table import split_columns
from whiptool.recording.strike_recording import StrikeRecording

MARKERS = ("observation.whip", "observation.markers")
KEYS = (*SPACE, *CLOCK, *PIXELS, "sigma", "markers_feature", "joints_feature")


def read_lerobot(folder: Path | str, *, episode: int = 0, **options: Any) -> StrikeRecording:
    """Read one episode, by its index, of a dataset that contains marker positions; `options` are keys of the sidecar
    file, whose values they override."""
    folder = Path(folder)
    side = _sidecar(folder, episode, options)
    data = lerobot_episode(folder, episode)
    with parsing(folder, "LeRobot dataset"):
        feature = _feature(data, side, "markers_feature", MARKERS)
        if feature is None:
            fix = f"track one of its cameras: {', '.join(data.videos)}" if data.videos else ""
            raise InputError("features", ", ".join(data.columns)[:120], " or ".join(MARKERS), fix)
        names, table = data.names.get(feature, []), data.columns[feature]
        if len(names) != table.shape[1]:
            raise InputError(f"names of {feature}", names, f"{table.shape[1]} names, as tip_x, tip_y")
        columns = split_columns(names, ("sigma",))
        clock = clock_of_rows(side, data.t, "times from the dataset's timestamps", "timestamp")
        read = {"t": clock.times, "source": f"{folder}, episode {episode}"}
        read |= side.places(columns, table[clock.keep])
        others = (*CLOCK, *PIXELS) if data.videos else ()
        log = _joints(data, side)
        return side.recording(folder, notes=clock.notes, log=log, files=data.files, others=others, **read)


def lerobot_video(folder: Path | str, *, camera: str | None = None, episode: int = 0, **options: Any) -> VideoSource:
    """Return one camera's images of one episode, by its index, with the measured joints in `about`. `camera` is a
    feature such as `observation.images.front`, by default the only camera; `options` are keys of the sidecar file,
    whose values they override."""
    folder = Path(folder)
    side = _sidecar(folder, episode, options)
    data = lerobot_episode(folder, episode)
    if camera is None and len(data.videos) == 1:
        camera = next(iter(data.videos))
    if camera not in data.videos:
        known = ", ".join(data.videos) or "(it has none)"
        raise InputError("camera" if data.videos else "features", camera, f"one of the cameras {known}")
    path, first = data.videos[camera]
    count = len(data.t)
    stream = video_frames(path)
    image = next(stream, None)
    stream.close()
    if image is None:
        raise InputError(str(path), "no image that can be decoded", "a whole video file")
    clock = frame_clock(side, count, stamps=data.t, of="the dataset's timestamps")
    with parsing(folder, "LeRobot dataset"):
        log = _joints(data, side)
    frames = lambda: segment(path, first, count, data.fps)  # noqa: E731
    others = (*SPACE, "sigma", "markers_feature") if _feature(data, side, "markers_feature", MARKERS) else ()
    return source(side, frames, clock, image.shape, path, sha256(path), log, others=others)


def _sidecar(folder: Path, episode: int, options: dict[str, Any]) -> Sidecar:
    """The folder's sidecar, with the episode's own table over it, and the options over both."""
    if not isinstance(episode, (int, np.integer)) or isinstance(episode, bool) or episode < 0:
        raise InputError("episode", episode, "an index, 0 or more")
    refuse_unheard(folder, "a dataset", "move it into the folder, as whiptool.toml")
    file = folder / "whiptool.toml"
    table = read_toml(file) if file.is_file() else {}
    episodes = table.pop("episode", {})
    own = episodes.get(str(episode), {}) if isinstance(episodes, dict) else None
    if not isinstance(own, dict):
        raise InputError(f"{file}: episode", str(own)[:80], f"tables, as [episode.{episode}]")
    return Sidecar.of(folder, options, *KEYS, file=file, table={**table, **own})


def _feature(data: Episode, side: Sidecar, key: str, default: tuple[str, ...]) -> str | None:
    """The feature that a key names, or the first default that is there."""
    if key in side.table:
        return side.word(key, tuple(data.columns), "")
    return next((name for name in default if name in data.columns), None)


def _joints(data: Episode, side: Sidecar) -> JointLog | None:
    """Return the joint log of an episode, if it has one."""
    if "joints" in side.table:
        return None
    if (feature := _feature(data, side, "joints_feature", (STATE,))) is None:
        return None
    try:
        return joints_of(data, feature, side.joint_columns, stated="joint_units" in side.table)
    except InputError as error:
        raise (error.within(side.place) if error.name == "joint_units" else error) from None


def read_lerobot_logs(folder: Path | str, *, episode: int = 0) -> Logs:
    """Read the log of joints of one episode of a dataset without markers and images."""
    data = lerobot_episode(folder, episode)
    with parsing(Path(folder), "LeRobot dataset"):
        log = _joints(data, _sidecar(Path(folder), episode, {}))
    if log is None:
        raise InputError(f"{folder}: features", ", ".join(data.columns)[:120], "markers, images or joints")
    return Logs(log)
