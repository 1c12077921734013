"""The logs of one motion in the formats of other people's software, by their libraries or their specifications."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

JOINTS = tuple(f"{x}_joint" for x in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
S, RATE, EPOCH = 60, 100.0, 1_732_600_000.0


def log_times() -> np.ndarray:
    return np.arange(S) / RATE


def angles() -> np.ndarray:
    """Smooth motion of six joints [rad], (S, 6), of multiples of 2^-20 rad, which are exact in single precision."""
    t = log_times()[:, None]
    return np.round(2**20 * np.sin(2 * t + np.arange(6)) * np.linspace(0.4, 1.2, 6)) / 2**20


def poses() -> np.ndarray:
    """Smooth motion of a tool, (S, 7)."""
    t = log_times()[:, None]
    place = np.hstack([0.5 + 0.2 * np.sin(3 * t), 0.1 * np.cos(t), 0.8 + 0.3 * t])
    return np.hstack([place, Rotation.from_euler("xyz", t * [0.5, -1.0, 2.0]).as_quat()])


class BagWriter:
    """Messages of standard packages in a bag: `.bag` of ROS 1, or a folder with `.db3` or `.mcap` of ROS 2."""

    def __init__(self, path: Path) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros = 1 if path.suffix == ".bag" else 2
        self.types = get_typestore(Stores.ROS1_NOETIC if self.ros == 1 else Stores.ROS2_HUMBLE)
        if self.ros == 1:  # as in the package tf2_msgs of ROS 1
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.types.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        self._topics: dict[str, Any] = {}
        if self.ros == 1:
            from rosbags.rosbag1 import Writer

            self._writer: Any = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            plugin = StoragePlugin.MCAP if path.name.endswith("mcap") else StoragePlugin.SQLITE3
            self._writer = Writer(path, version=9, storage_plugin=plugin)

    def __enter__(self) -> BagWriter:
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def make(self, kind: str, *fields: Any) -> Any:
        return self.types.types[kind](*fields)

    def header(self, t: float, frame: str = "base_link") -> Any:
        ns = round(1e9 * t)
        stamp = self.make("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9)
        return self.make("std_msgs/msg/Header", *([7] if self.ros == 1 else []), stamp, frame)

    def pose(self, row: Sequence[float]) -> Any:
        x, y, z, qx, qy, qz, qw = map(float, row)
        point = self.make("geometry_msgs/msg/Point", x, y, z)
        return self.make("geometry_msgs/msg/Pose", point, self.make("geometry_msgs/msg/Quaternion", qx, qy, qz, qw))

    def transform(self, t: float, parent: str, child: str, row: Sequence[float]) -> Any:
        x, y, z, qx, qy, qz, qw = map(float, row)
        shift = self.make("geometry_msgs/msg/Vector3", x, y, z)
        moved = self.make(
            "geometry_msgs/msg/Transform", shift, self.make("geometry_msgs/msg/Quaternion", qx, qy, qz, qw)
        )
        return self.make("geometry_msgs/msg/TransformStamped", self.header(t, parent), child, moved)

    def write(self, topic: str, t: float, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._topics:
            self._topics[topic] = self._writer.add_connection(topic, kind, typestore=self.types)
        pack = self.types.serialize_ros1 if self.ros == 1 else self.types.serialize_cdr
        self._writer.write(self._topics[topic], round(1e9 * t), bytes(pack(message, kind)))

    def state(self, t: float, names: Sequence[str], q: Sequence[float]) -> Any:
        none = np.zeros(0)
        fields = (self.header(t), list(names), np.array(q, float), none, none)
        return self.make("sensor_msgs/msg/JointState", *fields)


def write_states(path: Path) -> None:
    """The joints in alphabetical order, as ROS has them, and on the same topic those of a gripper at another rate."""
    order = np.argsort(JOINTS)
    with BagWriter(path) as bag:
        for k, (t, q) in enumerate(zip(EPOCH + log_times(), angles(), strict=True)):
            bag.write("/joint_states", t + 2e-3, bag.state(t, [JOINTS[i] for i in order], q[order]))
            if k % 5 == 0:
                bag.write("/joint_states", t + 3e-3, bag.state(t + 1e-3, ["finger_joint"], [0.7]))


def write_table(path: Path, names: Sequence[str], rows: np.ndarray, delimiter: str = ",") -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow(names)
        writer.writerows([[repr(float(x)) for x in row] for row in rows])


def write_rtde(path: Path, delimiter: str = ",") -> None:
    """As startFileRecording of ur_rtde; with blanks as record.py of Universal Robots' RTDE client."""
    names = ["timestamp", *(f"{what}_{i}" for what in ("target_q", "actual_q", "actual_qd") for i in range(6))]
    table = np.column_stack([EPOCH + log_times(), angles() + 1, angles(), 0 * angles()])
    write_table(path, [*names, "robot_mode"], np.column_stack([table, np.full(S, 7)]), delimiter)


def write_libfranka(path: Path, gap: str = " ") -> None:
    """As logToCSV of libfranka until 0.13, later without blanks, with a seventh joint."""
    groups = {"state.q": 7, "state.q_d": 7, "state.dq": 7, "state.dq_d": 7, "state.tau_J": 7}
    groups |= {"state.tau_ext_hat_filtered": 7, "cmd.q_d": 7, "cmd.dq_d": 7, "cmd.O_T_EE_d": 16, "cmd.O_dP_EE_d": 6}
    groups["cmd.tau_J_d"] = 7
    header = f"time,{gap}success_rate,{gap}"
    header += ",".join(f",{gap}".join(f"{name}[{i}]" for i in range(n)) for name, n in groups.items())
    others = np.ones((S, sum(groups.values()) - 7))
    seven = np.column_stack([angles(), angles()[:, 0]])
    rows = np.column_stack([5000 + 1e3 * log_times(), np.ones(S), seven, others])
    lines = [",".join(f"{x:.10g}" for x in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n")


def write_lerobot_2(folder: Path, *, names: Sequence[str], state: np.ndarray, version: str = "v2.1") -> None:
    """A LeRobotDataset v2 with two episodes, each in a file; the second is the motion."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    number = {"dtype": "float32", "shape": [1], "names": None}
    features = {
        "observation.state": {"dtype": "float32", "shape": [len(names)], "names": list(names)},
        "timestamp": number, "frame_index": {**number, "dtype": "int64"}, "episode_index": {**number, "dtype": "int64"},
    }  # fmt: skip
    info = {
        "codebase_version": version, "robot_type": "so100", "fps": RATE, "total_episodes": 2, "chunks_size": 1000,
        "features": features, "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    }  # fmt: skip
    (folder / "meta/info.json").write_text(json.dumps(info))
    rows = [{"episode_index": i, "tasks": ["strike"], "length": S} for i in range(2)]
    (folder / "meta/episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    for i, q in enumerate((0 * state, state)):
        columns = {
            "observation.state": list(q.astype(np.float32)), "timestamp": log_times().astype(np.float32),
            "frame_index": np.arange(S), "episode_index": np.full(S, i),
        }  # fmt: skip
        pq.write_table(pa.table(columns), folder / f"data/chunk-000/episode_{i:06d}.parquet")


Writer = Callable[[Path], None]
