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
    hand = "NAME.hand.csv"           # the hand's measured poses: t [s], hand_x, ... hand_z [m], hand_qx, ... hand_qw;
    # hand = "Grip"                  # or a rigid body of the same file, where that is Motive's
    hand_start = 1.25                # likewise; default: start
    joints_topic = "/joint_states"   # where joints is a ROS bag with several topics of joints
    hand_topic = "/tool/pose"        # likewise of poses; or, for poses from tf, the base's and the hand's frame:
    hand_frames = ["base_link", "tool0"]
    hand_axes = ["x", "-y", "-z"]    # axes of the logged frame that are the hand's x, y, z; the whip is along its -z
    hand_offset = [0, 0, 0.3]        # where the whip is held, in the logged frame [m], as at the end of a stick
    hand_up = "y"                    # which axis of that file points up; default: z, as in the axes of a robot's base

    [strike]                         # what was commanded
    q_i = [-1.36, 0.47]              # [rad]
    q_f = [1.73, 1.41]
    D = 0.95                         # [s]

    [controller]                     # as in the config.toml of whiptool.optimize
    law = "oiac"
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError, alike
from whiptool.given_files import read_toml, sha256
from whiptool.models.strike import Strike
from whiptool.recording import homography
from whiptool.recording.camera import Camera, read_cameras
from whiptool.recording.logs import ClocksApart
from whiptool.recording.readers.joint_log import JointLog
from whiptool.recording.readers.keys import Keys
from whiptool.recording.readers.log_keys import LOG_KEYS, LOGS, LogKeys
from whiptool.recording.readers.table import AXES, stacked
from whiptool.recording.strike_recording import DEFAULT_SIGMA, StrikeRecording, assumed_size

COMMON = ("camera", "exposure", "target", "t_stay", *LOG_KEYS, "strike", "controller")
SPACE = ("units", "axes", "origin", "up")  # of readers whose files hold places in space
VIEW = ("cameras", "sigma", "depth_units", "baseline", "subpixel")  # of readers whose files hold what a camera saw
PIXELS = ("homography", "known_points", "scale", "origin", "kind", "synthetic")  # of readers whose files hold pixels
FILM = ("cameras",)  # of readers whose files hold frames that a camera in space may have taken
CLOCK = ("fps", "timestamps", "stamp", "readout", "shutter")  # of readers whose files hold frames
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
UNSTATED = {  # what to do where neither the file nor its sidecar states a key
    "units": "state units in the sidecar file",
    "axes": 'such as axes = ["x", "z", "-y"], of a file whose z is up, in space axes = ["x", "y", "z"]',
    "fps": "write one into the sidecar .toml",
    "homography": "state them in the sidecar .toml",
}
KINDS = ("color", "infrared")  # of light
STAMPS = {"start": 0.5, "middle": 0.0, "end": -0.5}  # exposures from the stamp to the middle


class Sidecar(LogKeys):
    """Checked access to the keys of a sidecar, a TOML file next to a recording, with options that override them."""

    @classmethod
    def of(
        cls,
        path: Path,
        options: Mapping[str, Any],
        *keys: str,
        file: Path | None = None,
        table: Mapping[str, Any] | None = None,
    ) -> Sidecar:
        """Return the sidecar of a recording's file, if there is one, combined with the reader's options, which override
        it. The format has `keys` in addition to the common ones; `file` is the sidecar's, if not `NAME.toml`, and
        `table` what of it counts, by default all."""
        file = file or path.with_suffix(".toml")
        if table is None:
            table = read_toml(file) if file.is_file() else {}
        known = (*keys, *COMMON)
        for where, given in ((f"{file}: ", table), ("option ", options)):
            for key in given:
                if key not in known:
                    fix = f"did you mean {meant}?" if (meant := alike(key, known)) else ""
                    raise InputError(where + key, given[key], "one of the keys " + ", ".join(known), fix)
        given = {key: value for key, value in options.items() if value is not None}
        return cls({**table, **given}, file.parent, f"{file if table else path}: ")

    def fields(self, notes: Sequence[str] = (), log: JointLog | None = None, up: str = "z") -> dict[str, Any]:
        """Return the values of the keys common to all formats as arguments of `StrikeRecording`; `start` is subtracted
        from the times of joints and hand only. `notes` are further remarks of the reader; for `log` and `up` see
        `logged`."""
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
        logs, said = self.logged(log, up)
        return fields | logs | {"notes": (*notes, *said)}

    def recording(
        self,
        path: Path,
        *,
        notes: Sequence[str] = (),
        log: JointLog | None = None,
        files: Iterable[Path] = (),
        others: tuple[str, ...] = (),
        **read: Any,
    ) -> StrikeRecording:
        """Return the recording of a file from what was `read` from it, arguments of `StrikeRecording`; keys of the
        sidecar override these. `files` were read and are hashed, by default `path`; the keys `others` are for something
        else in the file, such as its images; for `notes` see `fields`, for `log` `logged`."""
        source: dict[str, Any] = {"source": str(path), "sha256": sha256(files or path), "start": self.start}
        in_space = read["points"].shape[2] == 3 and read.get("view") is None
        up = self.table.get("up", read.get("up")) if in_space else None
        fields = self.fields(notes, log, "y" if up == "y" else "z")
        if "up" in self.table and read["points"].shape[2] == 2 and read.get("view") is None:
            raise self.refuse("up", "none, for places in a plane, whose y is up")
        self.check_used(others)
        try:
            found = StrikeRecording(**{**source, **read, **fields})
            if size := assumed_size(found):
                said = f"errors: {size} taken as the standard error of each coordinate, for nothing states it; else say"
                return replace(found, notes=(*found.notes, f"{said} {found.sigma_assumed}"))
            return found
        except ClocksApart as error:
            of_logs = {f"{what}_t": fields[f"{what}_t"] + self.start_of(what) for what in LOGS if f"{what}_t" in fields}
            error.logs = fields | self.logged(log)[0] | of_logs
            raise

    def view(self) -> Camera:
        """Return the camera in space of a recording in pixels, which the keys `camera` (name) and `cameras` (file)
        state.

        The file is next to the sidecar; an option may name a file elsewhere.
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

    def sigma(self) -> float | None:
        """Return the standard error per coordinate of all points [m]; None if the key is missing."""
        return self.number("sigma", 0.0, low=1e-9, high=1.0) if "sigma" in self.table else None

    def places(self, columns: dict[str, dict[str, int]], table: np.ndarray) -> dict[str, Any]:
        """Return a table's M markers as arguments of `StrikeRecording`: `markers`, `points` (T, M, d) [m] in whiptool's
        axes, and `sigma` (T, M) [m], None where neither columns nor sidecar state it. `columns` are the indices of each
        marker's coordinates and `sigma` in the table (T, columns), which is in the file's units and axes."""
        axes = [axis for axis in AXES if axis in next(iter(columns.values()))]
        unit, stated = UNITS[self.word("units", UNITS, "m")], ["sigma" in found for found in columns.values()]
        default = None if all(stated) else self.sigma()
        return {
            "markers": tuple(columns),
            "points": self.metres(np.stack([stacked(table, columns, axis) for axis in axes], axis=2)),
            "sigma": stacked(table, columns, "sigma", default or DEFAULT_SIGMA, unit=unit)
            if default or any(stated)
            else None,
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
                pair = Keys(known, self.folder, "known_points.")
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
