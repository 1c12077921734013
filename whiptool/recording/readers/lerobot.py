"""Folders of LeRobotDataset v3: one episode as a recording, or its cameras as images for the tracker.

The reader uses `meta/info.json` (version, rate, names of features), `meta/episodes/chunk-*/file-*.parquet` (positions
of an episode's rows and images), its rows of `data/chunk-*/file-*.parquet`, and the MP4 files that `video_path` names,
which hold several episodes each. Features, besides `timestamp` and `episode_index`:

- `observation.state`: joints of the arm, by their `names` in `info.json`, without those of grippers. Names that end
  with `.pos` are those of LeRobot's motors, whose units `joint_units` has to state: `deg`, or `normalized` (-100 to
  100).
- `observation.whip` (or `observation.markers`): positions of markers; its `names` in `info.json` are columns such as
  `tip_x, tip_y, handle_x, handle_y`, optionally with `tip_sigma`. Without it the images have to be tracked.

The sidecar is `whiptool.toml` in the folder, with a table `[episode.3]` for values that differ in an episode. Its keys
in addition to the common keys: `markers_feature`, `joints_feature`, `units`, `axes`, `origin`, `sigma`, and for cameras
those of `whiptool.recording.readers.footage`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsing, read_json, read_toml, sha256, whole_file
from whiptool.recording.readers.footage import VideoSource, clock_of_rows, frame_clock, segment, source, video_frames
from whiptool.recording.readers.sidecar import CLOCK, PIXELS, SPACE, Sidecar
from whiptool.recording.readers.table import JointLog, joint_log, split_columns
from whiptool.recording.strike_recording import StrikeRecording

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
MARKERS = ("observation.whip", "observation.markers")
KEYS = (*SPACE, *CLOCK, *PIXELS, "sigma", "markers_feature", "joints_feature")


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode of a dataset, of T rows.

    Args:
        t: Times (`timestamp`) [s], (T,), 0 at the episode's first row.
        columns: Numeric features by name, (T, n), such as `observation.state` and `action`.
        names: Names of the n columns of each feature, if `info.json` states them.
        videos: For each camera its MP4 file, and the time at which the episode begins in it [s].
        fps: Rate of rows and images [1/s].
        files: Files that were read.
    """

    t: np.ndarray
    columns: dict[str, np.ndarray]
    names: dict[str, list[str]]
    videos: dict[str, tuple[Path, float]]
    fps: float
    files: tuple[Path, ...]


def lerobot_episode(folder: Path | str, episode: int = 0) -> Episode:
    """Read the rows of an episode, and the location of its images.

    Raises:
        InputError: The folder is not a dataset of version 3, is damaged, or has no such episode; or pyarrow is not
            installed.
    """
    folder = Path(folder)
    info_file = whole_file(folder / "meta/info.json")
    parquet = optional("pyarrow.parquet", "LeRobot datasets")
    with parsing(info_file, "LeRobot info.json"):
        info = read_json(info_file)
        version, fps, features = (info.get(key) for key in ("codebase_version", "fps", "features"))
        if not re.fullmatch(r"v?3\.\d+", str(version)):
            raise InputError("codebase_version", version, "v3.0", "convert it with LeRobot's own converter to v3.0")
        if isinstance(fps, bool) or not isinstance(fps, (int, float)) or not 1 <= fps <= 1e5:
            raise InputError("fps", fps, "rows per second from 1 to 100000")
        if not isinstance(features, dict) or not all(isinstance(x, dict) for x in features.values()):
            raise InputError("features", str(features)[:80], "a table of features")
    row, index_file = _episode_row(parquet, folder, episode)
    data_file = whole_file(_inside(folder, info.get("data_path", DATA), row, "data"))
    with parsing(data_file, "Parquet"):
        kinds = {name: str(feature.get("dtype")) for name, feature in features.items()}
        numbers = [name for name, kind in kinds.items() if re.fullmatch(r"(float|int|uint)\d+", kind)]
        present = set(parquet.read_schema(data_file).names)
        for name in ("timestamp", "episode_index"):
            if name not in present:
                raise InputError("columns", ", ".join(sorted(present))[:120], f"a column {name}")
        wanted = sorted(present & {*numbers, "timestamp", "episode_index"})
        table = parquet.read_table(data_file, columns=wanted, filters=[("episode_index", "=", episode)])
        if table.num_rows < 2 or table.num_rows != int(row.get("length", table.num_rows)):
            raise InputError("rows", table.num_rows, f"{row.get('length', 'at least 2')}, as in the table of episodes")
        columns = {name: _matrix(name, table.column(name)) for name in wanted}
    videos = {
        name: (_inside(folder, info.get("video_path", VIDEO), row, f"videos/{name}", name), _time(row, name))
        for name, kind in kinds.items()
        if kind == "video" and f"videos/{name}/chunk_index" in row
    }
    return Episode(
        t=columns.pop("timestamp")[:, 0],
        columns=columns,
        names={name: _names(feature.get("names")) for name, feature in features.items()},
        videos=videos,
        fps=float(fps),
        files=(info_file, index_file, data_file),
    )


def read_lerobot(folder: Path | str, *, episode: int = 0, **options: Any) -> StrikeRecording:
    """Read one episode of a dataset that contains marker positions.

    Args:
        folder: The dataset.
        episode: Index of the episode.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: See `lerobot_episode`; or the dataset has no markers (its images must be tracked), or a value is not
            allowed.
    """
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
        return side.recording(folder, notes=clock.notes, log=_joints(data, side), files=data.files, **read)


def lerobot_video(folder: Path | str, *, camera: str | None = None, episode: int = 0, **options: Any) -> VideoSource:
    """Return one camera's images of one episode, with the measured joints in `about`.

    Args:
        folder: The dataset.
        camera: Name of the feature, such as `observation.images.front`; None: the only camera.
        episode: Index of the episode.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: See `lerobot_episode`; or the camera does not exist, its file is missing or too short, or a value is
            not allowed; or OpenCV is not installed.
    """
    folder = Path(folder)
    side = _sidecar(folder, episode, options)
    data = lerobot_episode(folder, episode)
    if camera is None and len(data.videos) == 1:
        camera = next(iter(data.videos))
    if camera not in data.videos:
        raise InputError("camera", camera, "one of the cameras " + (", ".join(data.videos) or "(it has none)"))
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
    return source(side, frames, clock, image.shape, path, sha256(path), log)


def _sidecar(folder: Path, episode: int, options: dict[str, Any]) -> Sidecar:
    """The folder's sidecar, with the episode's own table over it, and the options over both."""
    if not isinstance(episode, (int, np.integer)) or isinstance(episode, bool) or episode < 0:
        raise InputError("episode", episode, "an index, 0 or more")
    file = folder / "whiptool.toml"
    table = read_toml(file) if file.is_file() else {}
    episodes = table.pop("episode", {})
    own = episodes.get(str(episode), {}) if isinstance(episodes, dict) else None
    if not isinstance(own, dict):
        raise InputError(f"{file}: episode", str(own)[:80], f"tables, as [episode.{episode}]")
    given = {key: value for key, value in options.items() if value is not None}
    side = Sidecar.of(folder, {**table, **own, **given}, *KEYS, file=folder / "meta" / "none.toml")
    return Sidecar(side.table, folder, f"{file if table or own else folder}: ")


def _episode_row(parquet: Any, folder: Path, episode: int) -> tuple[dict[str, Any], Path]:
    """The row of an episode in `meta/episodes`, and its file."""
    files = sorted((folder / "meta/episodes").glob("chunk-*/file-*.parquet"))
    known: list[int] = []
    for path in files:
        with parsing(path, "Parquet"):
            wanted = [x for x in parquet.read_schema(path).names if not x.startswith("stats/")]
            if "episode_index" not in wanted:
                raise InputError("columns", ", ".join(wanted)[:120], "a column episode_index")
            indices = parquet.read_table(path, columns=["episode_index"]).column(0).to_pylist()
            known += indices
            if episode in indices:
                table = parquet.read_table(path, columns=wanted).slice(indices.index(episode), 1)
                return table.to_pylist()[0], path
    if not files:
        raise InputError(str(folder / "meta/episodes"), "no files", "chunk-000/file-000.parquet and so on")
    raise InputError(
        f"{folder}: episode", episode, f"one of {len(known)} episodes" + (f", {known[:8]}" if known else "")
    )


def _inside(folder: Path, template: object, row: dict[str, Any], prefix: str, key: str = "") -> Path:
    """The file that a template of `info.json` names; it must lie in the folder."""
    fields = {"chunk_index": row.get(f"{prefix}/chunk_index"), "file_index": row.get(f"{prefix}/file_index")}
    plain = r"(?:[^{}]|\{(?:(?:chunk|file)_index(?::0\dd)?|video_key)\})+"  # format strings can do more than is wanted
    if not isinstance(template, str) or not re.fullmatch(plain, template):
        raise InputError(f"{folder}: path template", template, DATA)
    if not all(isinstance(x, int) and 0 <= x < 10**6 for x in fields.values()):
        raise InputError(f"{folder}: {prefix}/chunk_index, file_index", list(fields.values()), "two indices")
    path = folder / template.format(**fields, video_key=key)
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{folder}: path template", template, "a path inside the dataset")
    return path


def _time(row: dict[str, Any], camera: str) -> float:
    """When the episode begins in the camera's file [s]."""
    value = row.get(f"videos/{camera}/from_timestamp")
    if not isinstance(value, (int, float)) or not 0 <= value < 1e7:
        raise InputError(f"videos/{camera}/from_timestamp", value, "a time in s, 0 or more")
    return float(value)


def _matrix(name: str, column: Any) -> np.ndarray:
    """A column of numbers or of lists of one length as (T, n)."""
    try:
        table = np.array(column.to_pylist(), float)
    except (TypeError, ValueError):
        raise InputError(name, "rows of different lengths, or no numbers", "as many numbers in each row") from None
    return table.reshape(len(table), -1)


def _names(names: object) -> list[str]:
    """Names of columns; LeRobot has them as a list, or as lists in a table."""
    if isinstance(names, dict):
        names = [name for listed in names.values() if isinstance(listed, list) for name in listed]
    return [str(x) for x in names] if isinstance(names, list) else []


def _feature(data: Episode, side: Sidecar, key: str, default: tuple[str, ...]) -> str | None:
    """The feature that a key names, or the first default that is there."""
    if key in side.table:
        return side.word(key, tuple(data.columns), "")
    return next((name for name in default if name in data.columns), None)


def _joints(data: Episode, side: Sidecar) -> JointLog | None:
    """Return the joint log of an episode, if it has one."""
    feature = _feature(data, side, "joints_feature", ("observation.state",))
    if feature is None or "joints" in side.table:
        return None
    table, names = data.columns[feature], data.names.get(feature, [])
    names = names if len(names) == table.shape[1] else []
    log = joint_log(data.t, table, names, side.joint_columns, feature, of="timestamp")
    if any(name.endswith(".pos") for name in log.columns) and "joint_units" not in side.table:
        rule = "deg, or normalized with joint_ranges: the dataset does not say in which units LeRobot drove its motors"
        raise InputError(f"{side.place}joint_units", None, rule, "state it in the sidecar, whiptool.toml in the folder")
    return log
