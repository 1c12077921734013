"""Tracks of SLEAP: its analysis file (HDF5), its CSV export, and its projects (`.slp`).

Positions are pixels of the video, rows of the CSV and of projects are frames of the video by their number. SLEAP leaves
out points below its own threshold, so that its scores drop none more unless the key `likelihood` says so. The sidecar
has the keys of `whiptool.recording.readers.poses`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, whole_file
from whiptool.recording.readers import poses
from whiptool.recording.readers.mocap import numbers, text_rows
from whiptool.recording.readers.poses import Poses
from whiptool.recording.readers.programs import SLEAP
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.readers.table import LARGEST_TABLE
from whiptool.recording.strike_recording import StrikeRecording

ORDER = ("track", "xy", "node", "frame")  # of the axes of an analysis file that does not say them
COORDS = (".x", ".y", ".score")


def read_sleap(path: Path | str, **options: Any) -> StrikeRecording:
    """Read a CSV file of SLEAP; `options` are keys of its sidecar, whose values they override."""
    path = whole_file(path, largest=LARGEST_TABLE)
    side = Sidecar.of(path, options, *poses.KEYS)
    with parsing(path, "SLEAP CSV"):
        rows = text_rows(path, ",")
        head = rows[0]
        nodes = [name.removesuffix(".x") for name in head if name.endswith(".x")]
        wanted = [head.index(node + coord) for node in nodes for coord in COORDS]
        table = numbers(rows, 1, [head.index("frame_idx"), *wanted], len(head))
        names = [row[0] for row in rows[1:] if row]
        animals = list(dict.fromkeys(names))
        chosen = animals[poses.individual(side, animals, SLEAP.what)]
        of = np.array(names) == chosen
        frames, points = table[of, 0], table[of, 1:].reshape(of.sum(), len(nodes), 3)
        found = Poses(SLEAP.what, points[..., :2], nodes, points[..., 2], numbers=frames)
        return poses.recorded(path, side, found)


def of_analysis(file: Any) -> dict[str, np.ndarray] | None:
    """Return the tracks of an open analysis file: `pixels` (T, animals, M, 2), `scores` (T, animals, M), and the names
    of `parts` and `animals`; None: it is no such file.
    """
    if "tracks" not in file or "node_names" not in file:
        return None
    tracks = file["tracks"]
    order = json.loads(tracks.attrs["dims"]) if "dims" in tracks.attrs else ORDER
    pixels = tracks[:].transpose([list(order).index(name) for name in ("frame", "track", "node", "xy")])
    found = {"pixels": pixels, "parts": _texts(file["node_names"])}
    if "point_scores" in file:
        rest = [name for name in order if name != "xy"]
        found["scores"] = file["point_scores"][:].transpose([rest.index(name) for name in ("frame", "track", "node")])
    animals = _texts(file["track_names"]) if "track_names" in file else np.array([], dtype=str)
    count = pixels.shape[1]
    found["animals"] = animals if len(animals) == count else np.array([str(i) for i in range(count)], dtype=str)
    return found


USER, LOOSE = 0, -1  # type of an instance that a person labelled; track of an instance without one
CENTRED = 1.1  # format from which (0, 0) is the centre of the first pixel, not its corner


def of_project(file: Any) -> dict[str, np.ndarray] | None:
    """Return the tracks of an open project, as `of_analysis`, and the `numbers` (T,) of the frames; None: it is no
    project.

    Where a person corrected what was predicted, the correction counts.
    """
    if "pred_points" not in file or "instances" not in file or "metadata" not in file:
        return None
    said = json.loads(file["metadata"].attrs["json"])
    nodes = [said["nodes"][node["id"]]["name"] for node in said["skeletons"][0]["nodes"]]
    frames, instances = np.sort(file["frames"][:], order="frame_idx"), file["instances"][:]
    kinds = file["points"][:], file["pred_points"][:]
    if len(set(frames["video"].tolist())) > 1:
        raise InputError("videos", "frames of several videos", "frames of one video", "export one video's tracks")
    animals = [json.loads(x)[-1] for x in file["tracks_json"][:]] if "tracks_json" in file else []
    animals = animals if (instances["track"] != LOOSE).any() else ["0"]
    values = np.full((len(frames), len(animals), len(nodes), 3), np.nan)
    for row, frame in zip(values, frames):
        these = instances[int(frame["instance_id_start"]) : int(frame["instance_id_end"])]
        for user in (False, True):
            some = these[(these["instance_type"] == USER) == user]
            tracks = np.where(some["track"] == LOOSE, 0, some["track"]) if animals == ["0"] else some["track"]
            if len(set(tracks.tolist())) < len(tracks):
                given = f"several instances of one track in frame {frame['frame_idx']}"
                raise InputError("instances", given, "one of each track", "track them, or export the analysis file")
            for track, one in zip(tracks, some):
                if track != LOOSE:
                    row[track] = _placed(kinds[not user], int(one["point_id_start"]), len(nodes))
    shift = 0.5 if float(file["metadata"].attrs["format_id"]) < CENTRED else 0.0
    return {
        "pixels": values[..., :2] - shift,
        "scores": values[..., 2],
        "parts": np.array(nodes, dtype=str),
        "animals": np.array(animals, dtype=str),
        "numbers": frames["frame_idx"].astype(float),
    }


def _placed(points: np.ndarray, first: int, count: int) -> np.ndarray:
    """Pixels and scores of an instance's points (M, 3), NaN where they are not visible."""
    found = points[first : first + count]
    score = found["score"] if "score" in (points.dtype.names or ()) else np.ones(count)
    return np.where(found["visible"][:, None], np.stack([found["x"], found["y"], score], axis=1), np.nan)


def _texts(names: Any) -> np.ndarray:
    return np.array([x.decode() if isinstance(x, bytes) else str(x) for x in names[:]], dtype=str)


def of_animal(side: Sidecar, what: str, read: dict[str, np.ndarray]) -> Poses:
    """Return the tracks of one animal of those that `of_analysis` found."""
    animals = [str(x) for x in read["animals"]]
    i = poses.individual(side, animals, what)
    scores = read["scores"][:, i] if "scores" in read else None
    parts = [str(x) for x in read["parts"]]
    return Poses(what, read["pixels"][:, i], parts, scores, numbers=read.get("numbers"))
