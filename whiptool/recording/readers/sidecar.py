"""The sidecar, a TOML file next to a recording with values that the recording lacks; and the reader's options.

Every key of the sidecar `NAME.toml` of `NAME.csv`, `NAME.mp4`, ... is also an option of the reader, which takes
precedence. Common to all formats:

    camera = "infra 848x480x90"      # for people
    exposure = 0.002                 # [s]
    target = [1.2, 0.1]              # [m]
    t_stay = 0.3                     # [s]
    start = 1.25                     # when the command started by the file's own clock [s]; subtracted from its times
    joints = "NAME.joints.csv"       # measured joints: columns t [s], then one per joint [rad], see `joint_log`
    joint_columns = {shoulder = "actual_q_0", elbow = "actual_q_1"}  # its columns that are the arm's joints; or a list
    joint_units = "rad"              # or "deg", or "normalized", from -100 to 100 as LeRobot's, with
    joint_ranges = {shoulder = [-1.9, 1.9], elbow = [-1.7, 1.7]}     # angles at -100 and at 100 [rad]
    joints_start = 1.25              # when the command started by that file's clock [s]; default: start
    hand = "NAME.hand.csv"           # the hand's measured poses: t [s], hand_x, ... hand_z [m], hand_qx, ... hand_qw
    hand_start = 1.25                # likewise; default: start
    joints_topic = "/joint_states"   # where joints is a ROS bag with several topics of joints
    hand_topic = "/tool/pose"        # likewise of poses; or, for poses from tf, the base's and the hand's frame:
    hand_frames = ["base_link", "tool0"]
    hand_axes = ["x", "-y", "-z"]    # axes of the logged frame that are the hand's x, y, z; the whip is along its -z
    hand_offset = [0, 0, 0.3]        # where the whip is held, in the logged frame [m], as at the end of a stick

    [strike]                         # what was commanded
    q_i = [-1.36, 0.47]              # [rad]
    q_f = [1.73, 1.41]
    D = 0.95                         # [s]

    [controller]                     # as in the config.toml of whiptool.optimize
    law = "oiac"
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.given_files import read_toml, sha256
from whiptool.models.strike import Strike
from whiptool.recording import homography
from whiptool.recording.camera import Camera, read_cameras
from whiptool.recording.logs import ClocksApart, order_of
from whiptool.recording.readers.joint_log import JointLog
from whiptool.recording.readers.robot_logs import read_hand, read_joints
from whiptool.recording.readers.table import AXES, stacked
from whiptool.recording.strike_recording import StrikeRecording

COMMON = (
    "camera", "exposure", "target", "t_stay", "start", "joints", "joint_columns", "joint_units", "joint_ranges",
    "joints_start", "joints_topic", "hand", "hand_start", "hand_topic", "hand_frames", "hand_axes", "hand_offset",
    "strike", "controller",
)  # fmt: skip
SPACE = ("units", "axes", "origin", "up")  # of readers whose files hold places in space
VIEW = ("cameras", "sigma", "depth_units", "baseline", "subpixel")  # of readers whose files hold what a camera saw
PIXELS = ("homography", "known_points", "scale", "origin", "kind", "synthetic")  # of readers whose files hold pixels
FILM = ("cameras",)  # of readers whose files hold frames that a camera in space may have taken
CLOCK = ("fps", "timestamps", "stamp", "readout", "shutter")  # of readers whose files hold frames
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
KINDS = ("color", "infrared")  # of light
ANGLES = ("rad", "deg", "normalized")
SIGNS = {"": 1.0, "-": -1.0}
LOGS = ("joints", "hand")  # of a robot, each with a clock that may be another one
TURN = 0.6  # [rad] from a whole turn, of a joint between two samples
STAMPS = {"start": 0.5, "middle": 0.0, "end": -0.5}  # exposures from the stamp to the middle


@dataclass(frozen=True)
class Sidecar:
    """Checked access to the keys of a sidecar file, a TOML file next to a recording, with options that override them.

    Args:
        table: Values by key.
        folder: Folder to which file names in it are relative.
        place: Prefix of names in error messages.
    """

    table: Mapping[str, Any]
    folder: Path
    place: str

    @classmethod
    def of(cls, path: Path, options: Mapping[str, Any], *keys: str, file: Path | None = None) -> Sidecar:
        """Return the sidecar of a recording, if there is one, combined with options.

        Args:
            path: File of the recording.
            options: Options of the reader, which override the sidecar.
            keys: Keys of the format in addition to the common keys.
            file: File of the sidecar, if it is not `NAME.toml`.

        Raises:
            InputError: The sidecar is not TOML, or a key is unknown.
        """
        file = file or path.with_suffix(".toml")
        table = read_toml(file) if file.is_file() else {}
        known = (*COMMON, *keys)
        for where, given in ((f"{file}: ", table), ("option ", options)):
            for key in given:
                if key not in known:
                    raise InputError(where + key, given[key], "one of the keys " + ", ".join(known))
        given = {key: value for key, value in options.items() if value is not None}
        return cls({**table, **given}, file.parent, f"{file if table else path}: ")

    def starting(self, t: float) -> Sidecar:
        """Return the sidecar with the command's start at a time by the file's clock [s], unless it states `start`."""
        return self if "start" in self.table else replace(self, table={**self.table, "start": float(t)})

    def refuse(self, key: str, allowed: str, fix: str = "") -> InputError:
        """Return the error for a key's value; `allowed` says which values are allowed, `fix` how to correct it."""
        return InputError(self.place + key, self.table.get(key), allowed, fix)

    def number(self, key: str, default: float, *, low: float = -np.inf, high: float = np.inf) -> float:
        """Return a key's value as a number from `low` to `high`; `default` if the key is missing."""
        value = self.table.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not low <= value <= high:
            raise self.refuse(key, f"a number from {low:g} to {high:g}")
        return float(value)

    def word(self, key: str, words: Mapping[str, Any] | tuple[str, ...], default: str) -> str:
        """Return a key's value, which has to be one of several words; `default` if the key is missing."""
        value = self.table.get(key, default)
        if not isinstance(value, str) or value not in words:
            raise self.refuse(key, "one of " + ", ".join(words))
        return value

    def flag(self, key: str) -> bool:
        """Return a key's value, true or false; false if the key is missing."""
        value = self.table.get(key, False)
        if not isinstance(value, bool):
            raise self.refuse(key, "true or false")
        return value

    def array(self, key: str, *shape: int | None) -> np.ndarray | None:
        """Return a key's value as an array of a shape, in which None means any length; None if the key is missing."""
        if key not in self.table:
            return None
        try:
            array = np.array(self.table[key], float)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape))
        if not fits or not np.isfinite(array).all():
            raise self.refuse(key, "finite numbers, " + " x ".join("n" if n is None else str(n) for n in shape))
        return array

    def names(self, key: str) -> dict[str, str] | None:
        """Return a key's table of names, `name in whiptool = "name in the file"`, as a dict; None if the key is
        missing.

        The key may also be a list of names that are the same in whiptool and in the file.
        """
        value = self.table.get(key)
        if value is None:
            return None
        if isinstance(value, (list, tuple)):
            value = {name: name for name in value if isinstance(name, str)} if len(value) else None
        if not isinstance(value, Mapping) or not value or not all(isinstance(x, str) for x in value.values()):
            raise self.refuse(key, 'names, as in {tip = "WhipTip", handle = "Hand"}')
        return dict(value)

    def file(self, key: str) -> Path | None:
        """Return the path of a file in the sidecar's folder, or of any file if an option gives a path; None if the key
        is missing.
        """
        name = self.table.get(key)
        if name is None or isinstance(name, Path):
            return name
        if name is False:  # none, although the sidecar names one
            return None
        if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
            raise self.refuse(key, "the name of a file next to it, without folders")
        return self.folder / name

    def fields(self, notes: Sequence[str] = (), log: JointLog | None = None) -> dict[str, Any]:
        """Return the values of the keys common to all formats as arguments of `StrikeRecording`; `start` is subtracted
        from the times of joints and hand only.

        Args:
            notes: Further remarks of the reader.
            log: Joint log in the recording itself, used if the sidecar names no file.

        Raises:
            InputError: A value is not allowed.
        """
        fields: dict[str, Any] = {
            key: self.table[key] for key in ("target", "t_stay", "exposure", "up") if key in self.table
        }
        camera, strike, controller = (self.table.get(key) for key in ("camera", "strike", "controller"))
        if camera is not None:
            fields["camera"] = str(camera)
        if isinstance(strike, Mapping):
            if set(strike) != {"q_i", "q_f", "D"}:
                raise self.refuse("strike", "a table with q_i, q_f and D")
            try:
                strike = Strike(**strike)
            except InputError as error:
                raise error.within(f"{self.place}strike.") from None
            except (TypeError, ValueError):
                raise self.refuse("strike", "angles q_i, q_f [rad] and a duration D [s]") from None
        if strike is not None:
            if not isinstance(strike, Strike):
                raise self.refuse("strike", "a table with q_i, q_f and D")
            fields["strike"] = strike
        if controller is not None:
            if not isinstance(controller, Mapping):
                raise self.refuse("controller", "a table")
            fields["controller"] = dict(controller)
        said = list(notes)
        if (file := self.file("joints")) is not None:
            stated = "joint_units" in self.table
            log = read_joints(file, self.joint_columns, self.table.get("joints_topic"), stated=stated)
        if log is not None:
            angles, units = self.angles(log)
            fields |= {"joints_t": log.t - self.start_of("joints"), "joints_q": angles}
            fields |= {"joint_names": log.names, "joints_listed": log.listed}
            said += [*log.notes, *units]
        if (file := self.file("hand")) is not None:
            hand = read_hand(file, self.table.get("hand_topic"), self._hand_frames)
            poses, axes = self._held(hand.q)
            fields |= {"hand_t": hand.t - self.start_of("hand"), "hand_pose": poses}
            said += [*hand.notes, *axes]
        return fields | {"notes": tuple(said)}

    @property
    def _hand_frames(self) -> tuple[str, str] | None:
        """Names of the base's and the hand's frame in `tf`; None without the key."""
        given = self.table.get("hand_frames")
        if given is None:
            return None
        if not isinstance(given, (list, tuple)) or len(given) != 2 or not all(isinstance(x, str) for x in given):
            raise self.refuse("hand_frames", 'two names, the base\'s frame and the hand\'s, as ["base_link", "tool0"]')
        return given[0], given[1]

    def _held(self, poses: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """Poses (S, 7) of the model's hand, from those of the logged frame, and a sentence on its axes."""
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

    def recording(
        self,
        path: Path,
        *,
        notes: Sequence[str] = (),
        log: JointLog | None = None,
        files: Iterable[Path] = (),
        **read: Any,
    ) -> StrikeRecording:
        """Return the recording of a file; keys of the sidecar override data of the file.

        Args:
            path: The file, which is hashed if no `files` are given.
            notes, log: See `fields`.
            files: Files that were read.
            read: Arguments of `StrikeRecording` that were read from the file.
        """
        source: dict[str, Any] = {"source": str(path), "sha256": sha256(files or path), "start": self.start}
        fields = self.fields(notes, log)
        try:
            return StrikeRecording(**{**source, **read, **fields})
        except ClocksApart as error:
            of_logs = {f"{what}_t": fields[f"{what}_t"] + self.start_of(what) for what in LOGS if f"{what}_t" in fields}
            error.logs = fields | of_logs
            raise

    def start_of(self, what: str) -> float:
        """Return when the command started by the clock of the log of `joints` or `hand` [s]."""
        return self.number(f"{what}_start", self.start)

    def view(self) -> Camera:
        """Return the camera in space of a recording in pixels, which the keys `camera` (name) and `cameras` (file)
        state.

        The file is next to the sidecar; an option may name a file elsewhere.

        Raises:
            InputError: A key is missing, or the file has no camera of that name.
        """
        name, cameras = self.table.get("camera"), self.table.get("cameras")
        if cameras is None:
            raise self.refuse("cameras", "the file of cameras in space, for a recording in pixels", "see write_cameras")
        known = read_cameras(self.file("cameras") or "")
        if not isinstance(name, str) or name not in known:
            raise self.refuse("camera", f"the camera that saw it, one of {', '.join(known)}")
        return known[name]

    @cached_property
    def filmed_by(self) -> Camera | None:
        """Return the camera in space of a film; None if the key `cameras` is missing."""
        return None if self.table.get("cameras") is None else self.view()

    @property
    def joint_columns(self) -> Mapping[str, str] | None:
        """Columns of the joint log by the arm's joints; None if the sidecar does not state them."""
        return self.names("joint_columns")

    @property
    def start(self) -> float:
        """Time at which the command started, by the file's clock [s]."""
        return self.number("start", 0.0)

    def angles(self, log: JointLog) -> tuple[np.ndarray, list[str]]:
        """Return the joint angles of a log in rad (S, a), with jumps by full turns removed, and sentences on this and
        on the unit.

        Raises:
            InputError: The unit contradicts the columns' names, or is `normalized` without the joints' ranges.
        """
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
        table = Sidecar(ranges, self.folder, f"{self.place}joint_ranges.")
        ends = {name: table.array(name, 2) for name in ranges}
        names = log.names or tuple(ranges)
        try:
            order = order_of(tuple(ranges), names, listed=True)
        except InputError:
            raise self.refuse("joint_ranges", f"{rule}, for each of {', '.join(names)}") from None
        low, high = np.array([ends[list(ranges)[i]] for i in order]).T
        return low + (log.q + 100) / 200 * (high - low)

    def metres(self, points: np.ndarray, units: str = "m", axes: tuple[str, ...] | None = None) -> np.ndarray:
        """Convert positions (..., 2 or 3) in the file's units and axes to metres in whiptool's axes.

        The keys are `units` (m, cm, mm, in); `axes`, the file's axes that point forward, up and, in space, out of the
        plane, such as `["x", "z", "-y"]`; `origin`, the shoulder's position in the file's axes and units.
        """
        factor = UNITS[self.word("units", UNITS, units)]
        d = points.shape[-1]
        if (origin := self.array("origin", d)) is not None:
            points = points - origin
        chosen = self.table.get("axes", axes)
        if chosen is not None:
            known = [sign + name for name in "xyz"[:d] for sign in ("", "-", "+")]
            if not isinstance(chosen, (list, tuple)) or len(chosen) not in (2, 3) or not set(chosen) <= set(known):
                raise self.refuse("axes", f"2 or {d} of {', '.join(known)}" if d > 2 else "2 of x, y, -x, -y")
            columns = ["xyz".index(name[-1]) for name in chosen]
            if len(set(columns)) < len(columns):
                raise self.refuse("axes", "different axes")
            points = points[..., columns] * [-1.0 if name[0] == "-" else 1.0 for name in chosen]
        return points * factor

    def places(self, columns: dict[str, dict[str, int]], table: np.ndarray) -> dict[str, Any]:
        """Return a table's M markers as arguments of `StrikeRecording`: `markers`, `points` (T, M, d) [m] in whiptool's
        axes, and `sigma` (T, M) [m].

        Args:
            columns: Indices of the columns of each marker's coordinates and, if it has one, of its `sigma`, by name.
            table: All columns, (T, columns), in the file's units and axes.
        """
        axes = [axis for axis in AXES if axis in next(iter(columns.values()))]
        unit, default = UNITS[self.word("units", UNITS, "m")], self.number("sigma", 1e-3, low=1e-9, high=1.0)
        return {
            "markers": tuple(columns),
            "points": self.metres(np.stack([stacked(table, columns, axis) for axis in axes], axis=2)),
            "sigma": stacked(table, columns, "sigma", default, unit=unit),
        }

    def homography(self) -> np.ndarray | None:
        """Return the homography (3, 3) from pixels to metres, from the keys `homography`, `known_points`, or `scale`
        and `origin`; None without them.
        """
        matrix, known = self.array("homography", 3, 3), self.table.get("known_points")
        given = [key for key in ("homography", "known_points", "scale") if key in self.table]
        if len(given) > 1:
            raise InputError(self.place + given[1], f"together with {given[0]}", "only one of " + ", ".join(given))
        try:
            if matrix is not None:
                return homography.checked_homography(matrix)
            if known is not None:
                if not isinstance(known, Mapping) or set(known) != {"pixels", "metres"}:
                    raise InputError("known_points", known, "a table with the lists pixels and metres")
                pair = Sidecar(known, self.folder, "known_points.")
                return homography.homography_from_points(pair.array("pixels", None, 2), pair.array("metres", None, 2))
            if "scale" in self.table:
                if (origin := self.array("origin", 2)) is None:
                    raise InputError("origin", None, "the shoulder's pixel [u, v], with scale")
                return homography.homography_from_scale(self.number("scale", 0.0), origin)
        except InputError as error:
            raise (error if error.name.startswith(self.place) else error.within(self.place)) from None
        return None

    def exposure(self) -> float:
        """Return the exposure time of each row [s]; default: that of the camera in space, or 0."""
        camera = self.filmed_by
        return self.number("exposure", 0.0 if camera is None else camera.exposure, low=0.0, high=1.0)

    def readout(self) -> float:
        """Return the time from the first row's exposure to the last's [s], 0 for a global shutter; default: as for
        `exposure`.
        """
        camera = self.filmed_by
        usual = 0.0 if camera is None else float(camera.row_delay(camera.height - 1))
        readout = self.number("readout", usual, low=0.0, high=1.0)
        shutter = self.word("shutter", ("global", "rolling"), "rolling" if readout else "global")
        if (shutter == "rolling") != (readout > 0):
            raise self.refuse("readout", "> 0 with a rolling shutter, 0 or absent with a global one")
        return readout
