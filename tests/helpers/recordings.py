"""Recordings and files of them, as other people's writers make them."""

import json
import shutil

import numpy as np

from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording

T, FPS = 30, 60.0
STRIKE = Strike((-1.3, 0.4), (1.7, 1.4), 0.9)
TABLE = {"q_i": [-1.3, 0.4], "q_f": [1.7, 1.4], "D": 0.9}
H = np.array([[0.004, 1e-4, -1.7], [2e-4, -0.004, 1.0], [1e-5, 2e-5, 1.0]])  # pixel -> metre


def times() -> np.ndarray:
    return np.arange(T) / FPS


def places(seed: int = 0, d: int = 2) -> np.ndarray:
    """Two markers, one of them hidden for three frames."""
    points = np.random.default_rng(seed).normal(size=(T, 2, d))
    points[4:7, 1] = np.nan
    return points


def full() -> StrikeRecording:
    """Every field has a value."""
    rng = np.random.default_rng(1)
    return StrikeRecording(
        t=times(),
        points=places(),
        markers=("tip", "handle"),
        sigma=rng.uniform(1e-3, 2e-3, (T, 2)),
        t_points=times()[:, None] + rng.uniform(0, 0.01, (T, 2)),
        exposure=0.004,
        strike=STRIKE,
        controller={"law": "oiac", "a": 1.3e-4, "D": [[1.0, 0.0], [0.0, 1.0]]},
        joints_t=np.arange(50) / 100 - 0.05,
        joints_q=rng.normal(size=(50, 2)),
        target=(1.2, 0.1),
        t_stay=0.4,
        camera="infra, 848x480 at 90/s",
        source="somewhere",
        sha256="ab" * 32,
    )


def write_lerobot(folder, *, whip=True, info=None, episodes=None, data=None) -> None:
    """Two episodes in one Parquet file and one video; the second is the strike."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    shutil.rmtree(folder, ignore_errors=True)
    for place in ("meta/episodes/chunk-000", "data/chunk-000", "videos/observation.images.front/chunk-000"):
        (folder / place).mkdir(parents=True)
    names = ["tip_x", "tip_y", "handle_x", "handle_y"]
    number = {"dtype": "float32", "shape": [1], "names": None}
    features = {
        "observation.images.front": {"dtype": "video", "shape": [48, 64, 3], "names": ["height", "width", "channels"]},
        "observation.state": {"dtype": "float32", "shape": [2], "names": {"motors": ["shoulder", "elbow"]}},
        "action": {"dtype": "float32", "shape": [2], "names": ["shoulder", "elbow"]},
        "timestamp": number,
        "episode_index": {**number, "dtype": "int64"},
    }
    features |= {"observation.whip": {"dtype": "float32", "shape": [4], "names": names}} if whip else {}
    (folder / "meta/info.json").write_text(json.dumps({
        "codebase_version": "v3.0", "fps": FPS, "total_episodes": 2, "features": features,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4", **(info or {}),
    }))  # fmt: skip
    video = "videos/observation.images.front"
    rows = {
        "episode_index": [0, 1], "length": [T, T], "data/chunk_index": [0, 0], "data/file_index": [0, 0],
        f"{video}/chunk_index": [0, 0], f"{video}/file_index": [0, 0], f"{video}/from_timestamp": [0.0, T / FPS],
        f"{video}/to_timestamp": [T / FPS, 2 * T / FPS], "tasks": [["idle"], ["strike"]], **(episodes or {}),
    }  # fmt: skip
    pq.write_table(pa.table(rows), folder / "meta/episodes/chunk-000/file-000.parquet")
    flat = np.concatenate([np.zeros((T, 4)), places().reshape(T, 4)]).astype(np.float32)
    state = np.stack([np.arange(2 * T) / 50, np.ones(2 * T)], 1).astype(np.float32)
    columns = {
        "observation.state": list(state), "action": list(state), "timestamp": np.tile(times(), 2).astype(np.float32),
        "episode_index": np.repeat([0, 1], T), **({"observation.whip": list(flat)} if whip else {}), **(data or {}),
    }  # fmt: skip
    pq.write_table(pa.table(columns), folder / "data/chunk-000/file-000.parquet")
