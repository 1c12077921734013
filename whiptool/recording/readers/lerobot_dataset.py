"""Files of LeRobotDataset v2 and v3: the rows of one episode, and where its images are.

Of v3 these are `meta/info.json` (version, rate, names of features), `meta/episodes/chunk-*/file-*.parquet` (places of
an episode's rows and images), its rows of `data/chunk-*/file-*.parquet`, and the MP4 files that `video_path` names,
which hold several episodes each. Of v2.0 and v2.1 they are `meta/info.json`, `meta/episodes.jsonl`, and a Parquet file
and MP4 files for each episode.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsing, read_json, read_text, whole_file
from whiptool.recording.readers.joint_log import JointLog, joint_log

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
DATA_2 = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO_2 = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
CHUNK_2 = 1000  # episodes in a folder of v2, unless `chunks_size` says otherwise
STATE = "observation.state"
NORMALIZED = 100.0  # of LeRobot's motors, whose normalized positions run from -100 to 100
_OLD = "main_"  # before a joint's name: LeRobot until 0.2, whose motors were in degrees


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode of a dataset, of T rows."""

    t: np.ndarray  # times [s], (T,), 0 at the episode's first row
    columns: dict[str, np.ndarray]  # numeric features by name, (T, n), such as `observation.state` and `action`
    names: dict[str, list[str]]  # of the n columns of each feature, if `info.json` states them
    videos: dict[str, tuple[Path, float]]  # MP4 file of each camera, and when the episode begins in it [s]
    fps: float  # rate of rows and images [1/s]
    files: tuple[Path, ...]  # that were read
    version: str  # of the dataset's format


def lerobot_episode(folder: Path | str, episode: int = 0) -> Episode:
    """Read the rows of an episode of a dataset of version 2 or 3, and the location of its images."""
    folder = Path(folder)
    info_file = whole_file(folder / "meta/info.json")
    parquet = optional("pyarrow.parquet", "LeRobot datasets")
    with parsing(info_file, "LeRobot info.json"):
        info = read_json(info_file)
        version, fps, features = (info.get(key) for key in ("codebase_version", "fps", "features"))
        match = re.fullmatch(r"v?(2|3)\.\d+", str(version))
        if match is None:
            raise InputError("codebase_version", version, "v2.0, v2.1 or v3.0", "convert it with LeRobot's converter")
        if isinstance(fps, bool) or not isinstance(fps, (int, float)) or not 1 <= fps <= 1e5:
            raise InputError("fps", fps, "rows per second from 1 to 100000")
        if not isinstance(features, dict) or not all(isinstance(x, dict) for x in features.values()):
            raise InputError("features", str(features)[:80], "a table of features")
    second = match[1] == "2"
    row, index_file = _row_of_2(folder, info, episode) if second else _episode_row(parquet, folder, episode)
    data, video = (DATA_2, VIDEO_2) if second else (DATA, VIDEO)
    data_file = whole_file(_inside(folder, info.get("data_path", data), row, "data"))
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
        name: (_inside(folder, info.get("video_path", video), row, f"videos/{name}", name), _time(row, name))
        for name, kind in kinds.items()
        if kind == "video" and (second or f"videos/{name}/chunk_index" in row)
    }
    return Episode(
        t=columns.pop("timestamp")[:, 0],
        columns=columns,
        names={name: _names(feature.get("names")) for name, feature in features.items()},
        videos=videos,
        fps=float(fps),
        files=(info_file, index_file, data_file),
        version=str(version),
    )


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


def _row_of_2(folder: Path, info: dict[str, Any], episode: int) -> tuple[dict[str, Any], Path]:
    """The row of an episode in `meta/episodes.jsonl` of v2, with its chunk, and that file."""
    path = whole_file(folder / "meta/episodes.jsonl")
    size = info.get("chunks_size", CHUNK_2)
    if not isinstance(size, int) or size < 1:
        raise InputError(f"{folder}: chunks_size", size, "a whole number of episodes")
    with parsing(path, "JSON lines"):
        rows = [json.loads(line) for line in read_text(path, "JSON lines").splitlines() if line.strip()]
        known = [row.get("episode_index") if isinstance(row, dict) else None for row in rows]
    if episode not in known:
        given = f"one of {len(known)} episodes" + (f", {known[:8]}" if known else "")
        raise InputError(f"{folder}: episode", episode, given)
    return {**rows[known.index(episode)], "episode_chunk": episode // size, "episode_index": episode}, path


def _inside(folder: Path, template: object, row: dict[str, Any], prefix: str, key: str = "") -> Path:
    """The file that a template of `info.json` names; it must lie in the folder."""
    fields = {"chunk_index": row.get(f"{prefix}/chunk_index"), "file_index": row.get(f"{prefix}/file_index")}
    if "episode_chunk" in row:
        fields = {name: row[name] for name in ("episode_chunk", "episode_index")}
    # format strings can do more than is wanted
    plain = r"(?:[^{}]|\{(?:(?:(?:chunk|file)_index|episode_chunk|episode_index)(?::0\dd)?|video_key)\})+"
    if not isinstance(template, str) or not re.fullmatch(plain, template):
        raise InputError(f"{folder}: path template", template, DATA)
    if not all(isinstance(x, int) and 0 <= x < 10**6 for x in fields.values()):
        raise InputError(f"{folder}: {prefix}/chunk_index, file_index", list(fields.values()), "two indices")
    try:
        path = folder / template.format(**fields, video_key=key)
    except KeyError as error:
        given = f"{template}, without {error}"
        raise InputError(f"{folder}: path template", given, DATA_2 if "episode_chunk" in row else DATA) from None
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{folder}: path template", template, "a path inside the dataset")
    return path


def _time(row: dict[str, Any], camera: str) -> float:
    """When the episode begins in the camera's file [s]."""
    value = 0.0 if "episode_chunk" in row else row.get(f"videos/{camera}/from_timestamp")
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


def joints_of(data: Episode, feature: str, asked: Any = None, *, stated: bool = False) -> JointLog:
    """Return the log of joints in a feature of an episode, such as `observation.state`, with the unit that names or
    numbers state; if they do not, and the user has not `stated` it, joints of LeRobot's motors are refused. For `asked`
    see `whiptool.recording.readers.joint_log.joint_log`.

    Motors of LeRobot are in degrees or normalized, which no file says: joints called `main_...` were written by LeRobot
    before its motors could be normalized, and what goes beyond 100 is not normalized; both are in degrees.
    """
    table, names = data.columns[feature], data.names.get(feature, [])
    names = names if len(names) == table.shape[1] else []
    log = joint_log(data.t, table, names, asked, feature, of="timestamp")
    said = f"joints: from {feature} of the dataset (LeRobot {data.version})"
    motors = any(name.endswith(".pos") or name.startswith(_OLD) for name in log.columns)
    if motors and not log.unit and not stated:
        if all(name.startswith(_OLD) for name in log.columns):
            said += f", in degrees, as LeRobot wrote joints called {_OLD}... before its motors could be normalized"
        elif np.abs(log.q).max(initial=0.0) > NORMALIZED:
            said += f", in degrees, for normalized positions of its motors do not go beyond {NORMALIZED:g}"
        else:
            rule = (
                "deg, or normalized with joint_ranges: the dataset does not say in which units LeRobot drove its motors"
            )
            raise InputError("joint_units", None, rule, "state it in the sidecar, whiptool.toml in the folder")
        log = replace(log, unit="deg")
    return replace(log, notes=(said, *log.notes))
