"""Recordings and files of them, as other people's writers make them."""

import csv
import dataclasses
import json
import shutil

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from whiptool.errors import WhiptoolError
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


def write_lerobot(folder, *, whip=True, info=None, episodes=None, data=None, features=None) -> None:
    """Two episodes in one Parquet file and one video; the second is the strike."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    shutil.rmtree(folder, ignore_errors=True)
    for place in ("meta/episodes/chunk-000", "data/chunk-000", "videos/observation.images.front/chunk-000"):
        (folder / place).mkdir(parents=True)
    names = ["tip_x", "tip_y", "handle_x", "handle_y"]
    number = {"dtype": "float32", "shape": [1], "names": None}
    more = features or {}
    features = {
        "observation.images.front": {"dtype": "video", "shape": [48, 64, 3], "names": ["height", "width", "channels"]},
        "observation.state": {"dtype": "float32", "shape": [2], "names": {"motors": ["shoulder", "elbow"]}},
        "action": {"dtype": "float32", "shape": [2], "names": ["shoulder", "elbow"]},
        "timestamp": number,
        "episode_index": {**number, "dtype": "int64"},
    }
    features |= {"observation.whip": {"dtype": "float32", "shape": [4], "names": names}} if whip else {}
    features |= more
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


def same(a: StrikeRecording, b: StrikeRecording, but: tuple[str, ...] = ()) -> None:
    """All fields are, except for those named, and what was told of how a file was read."""
    for f in dataclasses.fields(a):
        if f.name not in (*but, "notes"):
            np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name), err_msg=f.name)


def write_rows(path, rows) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def to_pixels(points: np.ndarray) -> np.ndarray:
    h = np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1) @ np.linalg.inv(H).T
    return h[..., :2] / h[..., 2:]


def images(count: int = T, shape: tuple[int, int] = (48, 64)) -> list[np.ndarray]:
    """A white square that moves two pixels an image, over black."""
    made = [np.zeros((*shape, 3), np.uint8) for _ in range(count)]
    for k, image in enumerate(made):
        image[20:28, k : k + 8] = 255
    return made


def write_video(path, made, fourcc="MJPG") -> None:
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*fourcc), FPS, made[0].shape[1::-1])
    for image in made:
        writer.write(image)
    writer.release()


@st.composite
def damage(draw):
    """Cut off, some bytes changed (often near the head or the tail, where the structure is), or anything at all."""
    kind = draw(st.sampled_from(["cut", "flip", "flip", "random"]))
    if kind == "random":
        junk = draw(st.binary(max_size=600))
        keep = draw(st.sampled_from([0, 0, 16, 128, 512]))
        return lambda data: data[:keep] + junk
    if kind == "cut":
        share = draw(st.floats(0, 1))
        return lambda data: data[: int(share * len(data))]
    changes = draw(st.lists(st.tuples(st.floats(0, 1), st.sampled_from([0, 1, 2]), st.integers(0, 255)), min_size=1))

    def flip(data):
        made = bytearray(data)
        for share, where, value in changes:
            reach = len(made) if where == 0 else min(len(made), 700)
            i = min(int(share * reach), reach - 1)
            made[i if where < 2 else len(made) - 1 - i] = value
        return bytes(made)

    return flip


FUZZ = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}


def survives(read) -> None:
    """It reads, or says in one line why not."""
    said = ""
    try:
        read()
    except WhiptoolError as error:
        said = str(error)
    assert "\n" not in said


def fuzz(file, examples: int, read) -> None:
    whole = file.read_bytes()
    read()  # undamaged it reads

    @settings(max_examples=examples, **FUZZ)
    @given(change=damage())
    def run(change):
        file.write_bytes(change(whole))
        survives(read)

    run()


def plain_rows(d: int = 2) -> list[list]:
    names = [f"{m}_{a}" for m in ("tip", "handle") for a in "xyz"[:d]]
    return [["t", *names]] + [[t, *p.ravel()] for t, p in zip(times(), places(d=d))]
