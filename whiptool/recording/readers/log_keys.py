"""Logs of a robot that belong to a recording: keys of its sidecar, and joints and hand as the model has them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from whiptool.errors import InputError
from whiptool.models.pose_columns import POSE
from whiptool.recording.logs import order_of
from whiptool.recording.readers.joint_log import UNHEARD, JointLog
from whiptool.recording.readers.keys import Keys, refuse_unheard
from whiptool.recording.readers.programs import EXPORTS, beginning
from whiptool.recording.readers.robot_logs import read_hand, read_joints
from whiptool.recording.strike_recording import TURNED, turned_poses

LOGS = ("joints", "hand")  # of a robot, each with a clock that may be another one
LOG_KEYS = (
    "start", "joints", "joint_columns", "joint_units", "joint_ranges", "joints_start", "joints_topic", "hand",
    "hand_start", "hand_topic", "hand_frames", "hand_axes", "hand_offset", "hand_up",
)  # fmt: skip
ANGLES = ("rad", "deg", "normalized")
TEXTS = (".csv", ".txt", ".log")  # endings of logs without a place for a sidecar of theirs
SIGNS = {"": 1.0, "-": -1.0}
TURN = 0.6  # [rad] from a whole turn, of a joint between two samples


class LogKeys(Keys):
    """The keys of a sidecar on logs of a robot."""

    @property
    def joint_columns(self) -> Mapping[str, str] | None:
        """Columns of the joint log by the arm's joints; None if the sidecar does not state them."""
        return self.names("joint_columns")

    @property
    def start(self) -> float:
        """Time at which the command started, by the file's clock [s]."""
        return self.number("start", 0.0)

    def start_of(self, what: str) -> float:
        """Return when the command started by the clock of the log of `joints` or `hand` [s]."""
        return self.number(f"{what}_start", self.start)

    def starting(self, t: float) -> Self:
        """Return the sidecar with the command's start at a time by the file's clock [s], unless it states `start`."""
        return self if "start" in self.table else self.changed(start=float(t))

    def logged(self, log: JointLog | None, up: str = "z") -> tuple[dict[str, Any], list[str]]:
        """Return the logs as arguments of `StrikeRecording`, by the recording's clock, and sentences on them. `log` is
        that in the recording itself, used if the sidecar names no file; the hand's poses are turned so that `up`, `y`
        or `z`, is the recording's axis that points up."""
        fields, said = {}, list[str]()
        for what in LOGS:
            self._refuse_its_sidecar(what)
        if (file := self.file("joints")) is not None:
            stated = "joint_units" in self.table
            log = read_joints(file, self.joint_columns, self.table.get("joints_topic"), stated=stated)
        if log is not None:
            angles, units = self.angles(log)
            fields |= {"joints_t": log.t - self.start_of("joints"), "joints_q": angles}
            fields |= {"joint_names": log.names, "joints_listed": log.listed}
            said += [*log.notes, *units]
        if (file := self.file("hand")) is not None:
            self._refuse_exports(file)
            hand = read_hand(file, self.table.get("hand_topic"), self._hand_frames)
            poses, axes = self.held(hand.q)
            if self.word("hand_up", tuple(TURNED), "z") != up:
                poses = turned_poses(poses, up)
            if up != "z" and "hand_up" not in self.table:
                axes.append("hand: z is up in its log, as in a robot's base, y in the places; else say hand_up")
            fields |= {"hand_t": hand.t - self.start_of("hand"), "hand_pose": poses}
            said += [*hand.notes, *axes]
        for what in LOGS:
            if self.values.get(what) is False:  # a log is left out for once
                self.asked.update(key for key in self.values if key.startswith(what.removesuffix("s")))
        return fields, said

    def _refuse_exports(self, file: Path) -> None:
        """Refuse what is no log of the hand's poses: a body that no file of this name holds, exports of programs."""
        rule = f"a CSV file next to it (columns t, {', '.join(POSE)}), a ROS bag, or a rigid body in Motive's CSV"
        fix = "of other programs rigid bodies, 6D data and segments are not read: write them as such a CSV file"
        if not file.exists():
            raise self.refuse("hand", rule, fix)
        head = beginning(file) if file.is_file() else b""
        if any(program.matches(file, head) for program in EXPORTS):
            raise self.refuse("hand", rule, fix)

    def _refuse_its_sidecar(self, what: str) -> None:
        """Refuse a sidecar of a log in a text file, unless it is this one."""
        file = self.file(what)
        if file is not None and file.suffix.lower() in TEXTS and self.place != f"{file.with_suffix('.toml')}: ":
            refuse_unheard(file, *UNHEARD)

    def angles(self, log: JointLog) -> tuple[np.ndarray, list[str]]:
        """Return the joint angles of a log in rad (S, a), with jumps by full turns removed, and sentences on this and
        on the unit."""
        unit, said = self.word("joint_units", ANGLES, log.unit or "rad"), []
        if log.unit and unit != log.unit:
            raise self.refuse("joint_units", f"{log.unit}, as the columns are called {', '.join(log.names)}"[:200])
        if not log.unit and "joint_units" not in self.table:
            said.append("joints: taken as rad, for neither columns nor joint_units say it")
        q = np.deg2rad(log.q) if unit == "deg" else self._of_ranges(log) if unit == "normalized" else log.q
        steps = np.diff(q, axis=0)
        jumps = np.abs(steps) > np.pi
        whole = np.abs(np.abs(steps) - 2 * np.pi) < TURN
        if jumps.any() and not (jumps & ~whole).any() and jumps.mean() < 0.05:
            times = ", ".join(f"{t:.3f} s" for t in log.t[1:][jumps.any(axis=1)][:5])
            said.append(f"joints: whole turns from one sample to the next were undone, at {times}")
            q = np.unwrap(q, axis=0)
        return q, said

    def _of_ranges(self, log: JointLog) -> np.ndarray:
        """Angles [rad] of positions that run from -100 to 100 between a joint's ends."""
        ranges, rule = self.table.get("joint_ranges"), "angles at -100 and 100 [rad], as {shoulder = [-1.9, 1.9]}"
        if not isinstance(ranges, Mapping) or not ranges:
            raise self.refuse("joint_ranges", f"{rule}, for each joint that is normalized")
        table = Keys(ranges, self.folder, f"{self.place}joint_ranges.")
        ends = {name: table.array(name, 2) for name in ranges}
        names = log.names or tuple(ranges)
        try:
            order = order_of(tuple(ranges), names, listed=True)
        except InputError:
            raise self.refuse("joint_ranges", f"{rule}, for each of {', '.join(names)}") from None
        low, high = np.array([ends[list(ranges)[i]] for i in order]).T
        return low + (log.q + 100) / 200 * (high - low)

    @property
    def _hand_frames(self) -> tuple[str, str] | None:
        """Names of the base's and the hand's frame in `tf`; None without the key."""
        given = self.table.get("hand_frames")
        if given is None:
            return None
        if not isinstance(given, (list, tuple)) or len(given) != 2 or not all(isinstance(x, str) for x in given):
            raise self.refuse("hand_frames", 'two names, the base\'s frame and the hand\'s, as ["base_link", "tool0"]')
        return given[0], given[1]

    def held(self, poses: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """Return the poses (S, 7) of the model's hand, from those of the logged frame, and a sentence on its axes."""
        from scipy.spatial.transform import Rotation

        axes, offset = self.table.get("hand_axes"), self.array("hand_offset", 3)
        if axes is None and offset is None:
            return poses, [
                "hand: the whip is taken to be along -z of the logged frame, where it is (else say hand_axes)"
            ]
        known = {sign + name: sign_of * np.eye(3)[i] for i, name in enumerate("xyz") for sign, sign_of in SIGNS.items()}
        named = ["x", "y", "z"] if axes is None else axes
        if not isinstance(named, (list, tuple)) or len(named) != 3 or not all(x in known for x in named):
            raise self.refuse("hand_axes", f"three of {', '.join(known)}")
        turn = np.column_stack([known[x] for x in named])
        if not np.isclose(np.linalg.det(turn), 1):
            raise self.refuse("hand_axes", "three axes at right angles, right-handed")
        logged = Rotation.from_quat(poses[:, 3:])
        place = poses[:, :3] + logged.apply(np.zeros(3) if offset is None else offset)
        return np.hstack([place, (logged * Rotation.from_matrix(turn)).as_quat()]), []
