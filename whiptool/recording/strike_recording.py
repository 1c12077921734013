"""A recorded strike: marker positions, their times and errors, joint log, and command."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, read_arrays, sha256
from whiptool.models.numbers import ASK_UNIT, NoArray, float_array, texts
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike, check_turns
from whiptool.recording.camera import Camera, camera_of
from whiptool.recording.logs import (
    check_angles,
    check_spans,
    increasing_times,
    of_use,
    order_of,
    read_by_name,
    told_of_spans,
)
from whiptool.whole_files import write_npz

DEFAULT_SIGMA = 1e-3  # [m]
DEFAULT_PIXELS = 0.5  # of a camera's view
POSE_PIXELS = 1.0  # of body parts that a network found
LARGEST_SIGMA = 1.0  # [m] of a coordinate; no camera is so far off, millimetres are
FARTHEST = 20.0  # [m] from the shoulder; no whip reaches it, pixels and millimetres do
FAR = 'are these millimetres or pixels? Say units = "mm", or the way to metres'
UNIT = 1e-14  # from 1, of a quaternion's length that is 1 to rounding
FAR_OFF = 1.0  # [s] of a point from its frame
A_DAY = 86400.0  # [s] of a log, of which what lies near the frames is used
# of files whose TOML file holds what they do not
SIDECARS = (".csv", ".mat", ".c3d", ".tsv", ".txt", ".trc", ".h5", ".slp", ".nwb")
UP_IN = {2: "y", 3: "z"}  # which axis points up, by a model's dimension
TURNED = {"y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)), "z": ((1, 0, 0), (0, 0, -1), (0, 1, 0))}  # so that this one does
AT_REST = 0.02  # [s] from the start of a joint log, in which the arm has hardly moved
NOTICED = 3e-3  # [rad] of a joint from where it should stand: an encoder's counts are half of that
LAYOUT = 1  # raised when a key changes its meaning
REQUIRED = ("t", "points", "markers")
NAMES = ("markers", "joint_names", "notes")
UNWRITTEN = ("joint_names", "notes", "joints_listed", "up", "start", "sigma_assumed")  # in a file, where they are empty
_WRITTEN = {"strike": lambda strike: strike.vector, "controller": json.dumps, "view": lambda x: json.dumps(x.table())}
_READ = {
    **dict.fromkeys(("exposure", "t_stay", "start"), float),
    **dict.fromkeys(("camera", "source", "sha256", "up", "sigma_assumed"), str),
    **dict.fromkeys(NAMES, lambda value: tuple(str(name) for name in np.atleast_1d(value).ravel())),
    "strike": Strike.from_vector,
    "controller": lambda value: json.loads(str(value)),
    "view": lambda value: camera_of("view", json.loads(str(value))),
}

PARTS = re.compile(r"tip|handle|shoulder|elbow|node\d+")  # names of markers that a fit predicts
ENCODERS = "encoders"  # in place of a camera: the markers are those of the arm


@dataclass(frozen=True, eq=False)  # arrays have no single truth value to compare by
class StrikeRecording(NoArray, instead="its t and points"):
    """Recording of one strike, M markers over T frames.

    With a `view` it is the recording of one camera in space: `points` and `sigma` are then in pixels, and `t` is the
        middle of the first row's exposure. Several cameras make several recordings, each with its own clock. A camera
        that measures depth, such as a D435, adds the depth of each marker.

    For an arm without a whip the points are the angles of the links, (T, M, 1) [rad].

    Args:
        t: Frame times [s], (T,), strictly increasing; 0 is the command's start by the recording's own clock.
        points: Marker positions [m], (T, M, 2) or (T, M, 3), NaN where missing (one NaN coordinate makes the whole
            point missing); in the strike plane x is forward, y up, the origin at the shoulder; of an arm in space they
            are in the axes of its base: x forward, y to the left, z up; with a base on a wall or a ceiling, in those of
            the world with the origin at the base.
        markers: M different names: `tip`, `handle`, `node1` .. `nodeN`, `shoulder`, `elbow`, or any other names.
        sigma: Standard error of each point, per coordinate [m], (T, M) or broadcastable to it; default: 1 mm, with a
            view half a pixel.
        t_points: Middle of each point's exposure [s], (T, M) or broadcastable to it (a rolling shutter reads rows at
            different times); default: t for all, with a view when its row was read.
        exposure: Exposure time [s]: a point is the mean of its marker's path over this span around `t_points`. 0 with a
            view: that of the view.
        strike: The commanded strike, a `Strike` or its vector, (2 a + 1,), which is converted to one.
        controller: Controller of the arm: a `Controller`, which is kept as its table, or that table as
            `whiptool.impedance.controller.controller_to_table` writes it.
        joints_t: Times of the joint log [s], (S,), strictly increasing.
        joints_q: Measured joints of the arm [rad], (S, a).
        target: Position of the target [m].
        t_stay: Time after the movement that was recorded [s].
        camera: Name of the camera settings, a label only.
        source: File or device of the recording.
        sha256: Checksum of the source's bytes.
        start: Time of the command's start by the clock of the source [s], which was subtracted from the times.
        joint_names: Joint names of the columns of `joints_q`, (a,); empty: they are in the arm's order.
        view: The camera whose pixels the points are; None: the points are positions.
        hand_t: Times of the hand's measured poses [s], (S,), strictly increasing.
        hand_pose: Position [m] and orientation, a quaternion (x, y, z, w), of the hand in the axes of
            points, (S, 7); the hand's axes are those of a model: the whip hangs along its -z.
        depth: With a view, the depth of each marker along the camera's optical axis [m], (T, M); 0 or NaN if not
            measured, NaN if the point is missing. None: no depths.
        depth_sigma: Standard error of the depth [m], (T, M) or broadcastable to it; default: that of a D435 whose
            images are the view's (`Camera.depth_error`).
        joints_listed: Whether the user listed the columns of `joints_q` in the arm's order, so that names that are not
            those of its joints do not matter.
        up: Upward axis of points in space, `y` or `z`, if their file names it; empty: that of the model.
        notes: Assumptions of the reader and data that it left out, in sentences.
        sigma_assumed: Key of the sidecar that would state `sigma`, which was assumed: `sigma` or `sigma_pixels`; empty:
            it was given.
        first_state: For an arm without a whip, its measured angles and their rates at t[0], (2, M) [rad, rad/s].

    Raises:
        InputError: Shapes do not fit, times do not increase, no point was seen, units or clocks are implausible, or
            frames, logs and command do not overlap in time.
    """

    t: np.ndarray
    points: np.ndarray
    markers: tuple[str, ...]
    sigma: np.ndarray | Any = None  # always an array once constructed, of a number, too
    t_points: np.ndarray | Any = None  # likewise
    exposure: float = 0.0
    strike: Strike | Any = None  # always a Strike once constructed, or None
    controller: dict | Any = None
    joints_t: np.ndarray | None = None
    joints_q: np.ndarray | None = None
    target: tuple[float, ...] | None = None
    t_stay: float = T_STAY
    camera: str = ""
    source: str = ""
    sha256: str = ""
    start: float = 0.0
    joint_names: tuple[str, ...] = ()
    view: Camera | None = None
    hand_t: np.ndarray | None = None
    hand_pose: np.ndarray | None = None
    depth: np.ndarray | None = None
    depth_sigma: np.ndarray | Any = None  # an array where there is depth
    joints_listed: bool = False
    up: str = ""
    notes: tuple[str, ...] = ()
    sigma_assumed: str = ""
    first_state: np.ndarray | None = None

    def __post_init__(self) -> None:
        self._put(
            t=increasing_times("t", self.t), notes=tuple(map(str, self.notes)), joints_listed=bool(self.joints_listed)
        )
        self._check_points()
        self._check_errors()
        self._check_command()
        self._check_joints()
        if (self.hand_t is None) != (self.hand_pose is None):
            raise InputError("hand_pose", "one of hand_t and hand_pose", "both or neither")
        if self.hand_t is not None:
            self._put(hand_t=increasing_times("hand_t", self.hand_t, longest=A_DAY))
            self._put(hand_pose=_poses(self.hand_pose, len(self.hand_t)))
        if self.first_state is not None:
            begun, count = float_array("first_state", self.first_state), len(self.markers)
            if begun.shape != (2, count) or not self.angular or not np.isfinite(begun).all():
                raise InputError(
                    "first_state", begun.shape, f"finite angles and rates, (2, {count}), of a recording of angles"
                )
            self._put(first_state=begun)
        if self.up not in ("", *TURNED):
            raise InputError("up", self.up, "the axis that points up, y or z, or empty")
        check_spans(self.t, self.logs, None if self.strike is None else (0.0, self.strike.D + self.t_stay))

    def _put(self, **values: Any) -> None:
        """Set fields to their checked values."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _check_points(self) -> None:
        """Check markers and points."""
        points, markers = float_array("points", self.points), tuple(map(str, texts("markers", self.markers)))
        if points.ndim != 3 or points.shape[:2] != (len(self.t), len(markers)) or points.shape[2] not in (1, 2, 3):
            allowed = f"shape ({len(self.t)}, {len(markers)}, d), d = 2 or 3 coordinates, or 1 for angles"
            raise InputError("points", f"shape {points.shape}", allowed)
        if not markers or len(set(markers)) < len(markers) or not all(markers):
            raise InputError("markers", markers, "at least one name, all different, none empty")
        seen = np.logical_not(np.isnan(points).any(axis=2))  # (T, M)
        points = np.where(seen[..., None], points, np.nan)
        if not seen.any():
            raise InputError("points", "none", "at least one point that is not missing")
        if self.view is not None:
            _check_in_image(points, self.view)
        elif not (farthest := np.abs(points[seen]).max()) <= FARTHEST and points.shape[2] > 1:
            raise InputError("points", float(farthest), f"coordinates within {FARTHEST:g} m", FAR)
        self._put(points=points, markers=markers)

    def _check_errors(self) -> None:
        """Check what belongs to each point: its standard error, its time, and its depth."""
        t, seen, view = self.t[:, None], self.seen, self.view
        sigma, t_points, unit = DEFAULT_SIGMA, np.broadcast_to(t, seen.shape), "m"
        if view is not None:
            sigma, unit = DEFAULT_PIXELS, "pixels"
            t_points = t + np.where(seen, view.row_delay(self.points[..., 1]), 0.0)
            self._put(camera=self.camera or view.name, exposure=self.exposure or view.exposure)
        if self.sigma is None and not self.angular:
            self._put(sigma_assumed="sigma")
        sigma = _spread("sigma", sigma if self.sigma is None else self.sigma, seen.shape)
        t_points = _spread("t_points", t_points if self.t_points is None else self.t_points, seen.shape)
        if not ((sigma[seen] > 0) & np.isfinite(sigma[seen])).all():
            raise InputError("sigma", float(np.nanmin(sigma[seen])), f"finite and > 0 {unit} wherever there is a point")
        if view is None and (largest := float(sigma[seen].max())) > LARGEST_SIGMA:
            raise InputError("sigma", largest, f"a standard error of at most {LARGEST_SIGMA:g} m", ASK_UNIT)
        if not (np.abs((t_points - t)[seen]) <= FAR_OFF).all():
            raise InputError("t_points", "times far from their frame's", f"within {FAR_OFF:g} s of t")
        depth, depth_sigma = _depths(self.depth, self.depth_sigma, seen, view)
        self._put(sigma=sigma, t_points=t_points, depth=depth, depth_sigma=depth_sigma)

    def _check_command(self) -> None:
        """Check exposure, what was commanded, and the target."""
        for name in ("exposure", "t_stay"):
            value = float_array(name, getattr(self, name))
            if value.ndim or not 0 <= value <= 60:
                raise InputError(name, value.tolist(), "a span from 0 to 60 s")
            self._put(**{name: float(value)})
        if self.target is not None:
            target = float_array("target", self.target)
            if target.ndim != 1 or len(target) not in (2, 3) or not (np.abs(target) <= FARTHEST).all():
                raise InputError("target", target.tolist(), f"2 or 3 coordinates within {FARTHEST:g} m")
            self._put(target=tuple(target.tolist()))
        if self.strike is not None and not isinstance(self.strike, Strike):
            self._put(strike=Strike.from_vector(self.strike))
        if self.controller is not None:
            self._put(controller=_plain_table(self.controller))

    def _check_joints(self) -> None:
        """Check the joint log."""
        if (self.joints_t is None) != (self.joints_q is None):
            raise InputError("joints_q", "one of joints_t and joints_q", "both or neither")
        names, width = tuple(map(str, self.joint_names)), 0
        if self.joints_t is not None:
            t, q = increasing_times("joints_t", self.joints_t, longest=A_DAY), float_array("joints_q", self.joints_q)
            if q.ndim != 2 or len(q) != len(t) or q.shape[1] == 0:
                raise InputError("joints_q", f"shape {q.shape}", f"shape ({len(t)}, number of joints)")
            check_angles(q, names)
            self._put(joints_t=t, joints_q=q)
            width = q.shape[1]
        if names and (len(names) != width or len(set(names)) < len(names)):
            raise InputError("joint_names", names, f"{width} different names, one for each column of joints_q, or none")
        self._put(joint_names=names)

    @property
    def called(self) -> str:
        """Name of the recording in messages: its source, if it has one."""
        return self.source or "recording"

    @property
    def seen(self) -> np.ndarray:
        """Whether each point was seen, (T, M)."""
        return ~np.isnan(self.points[..., 0])

    @property
    def joints_alone(self) -> bool:
        """Whether the markers are those of an arm, computed from its encoders, and no camera saw the whip."""
        return self.camera == ENCODERS and not any(x == "tip" or x.startswith("node") for x in self.markers)

    @property
    def angular(self) -> bool:
        """Whether the points are angles of an arm's links."""
        return self.points.shape[2] == 1

    @property
    def assumed_error(self) -> float:
        """The standard error of a coordinate that was assumed [m], with `sigma_assumed` of pixels and with a view
        [pixels]; 0: it was given.
        """
        if self.sigma_assumed == "sigma_pixels":
            return POSE_PIXELS
        usual = DEFAULT_SIGMA if self.view is None else DEFAULT_PIXELS
        return usual if self.sigma_assumed and (self.sigma[self.seen] == usual).all() else 0.0

    @property
    def logs(self) -> dict[str, np.ndarray]:
        """Times of what was logged in addition to the frames."""
        return {name: t for name, t in (("joints", self.joints_t), ("hand", self.hand_t)) if t is not None}

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings about the recording: assumptions of its reader, gaps, and logs that are too short."""
        return (*self.notes, *told_of_spans(self.t, self.logs))

    @property
    def sag(self) -> np.ndarray | None:
        """Measured deviation of the arm from `q_i` when its strike began [rad], (a,); zero below the resolution of
        encoders; None if it was not measured at the start."""
        if self.joints_t is None or self.joints_q is None or self.strike is None or self.joints_t[0] > AT_REST:
            return None
        begun = self.joints_q[np.abs(self.joints_t - max(self.joints_t[0], 0.0)) <= AT_REST]
        if begun.shape[1] != len(self.strike.q_i):
            return None
        off = np.median(begun, axis=0) - self.strike.q_i
        return np.where(np.abs(off) > NOTICED, off, 0.0)

    @property
    def stood(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Function of start postures q_i (B, a) that returns the deviation `sag` for each; None if not measured."""
        sag = self.sag
        return None if sag is None else lambda q_i: np.broadcast_to(sag, q_i.shape)

    @property
    def provenance(self) -> dict[str, Any]:
        """Source and contents of the recording, as plain data for a report."""
        return {
            "source": self.source,
            "sha256": self.sha256,
            "camera": self.camera,
            "frames": len(self.t),
            "span": [float(self.t[0]), float(self.t[-1])],
            "markers": {name: int(n) for name, n in zip(self.markers, self.seen.sum(axis=0))},
            "remarks": list(self.remarks),
        }

    def for_model(self, model: Model) -> StrikeRecording:
        """Return the recording converted for a model.

        The joint log is reduced to the arm's joints, in their order; positions in space and the hand's
        poses are rotated to the model's upward axis (y in the plane, z in space), if the file states an upward axis.

        Raises:
            InputError: The log lacks a joint of the arm, the positions are in a plane and the model is in space, or the
                strike's angles are implausibly large, as in degrees.
        """
        self.check_coordinates(model.dimension)
        if self.strike is not None and len(self.strike.q_i) == model.arm.n:
            check_turns(f"{self.called}: strike", self.strike.vector[:-1], model.arm)
        return self.upright(UP_IN[model.dimension]).ordered(model.arm.joints)

    def check_coordinates(self, d: int) -> None:
        """Refuse angles, and positions with fewer coordinates than `d`; pixels of a camera are accepted.

        Raises:
            InputError: The positions have fewer coordinates, or are angles.
        """
        if self.angular:
            fix = "angles belong to an arm without a whip: fit them with drive free"
            raise InputError(f"{self.called}: points", "angles", f"positions with {d} coordinates", fix)
        if self.view is None and self.points.shape[2] < d:
            rule = f"{d} coordinates, places in space (columns t, tip_x, tip_y, tip_z; z up), for a model in space"
            fix = "record motion capture or two cameras, or take a model in the plane"
            raise InputError(f"{self.called}: points", "2 coordinates, in a plane", rule, fix)

    def upright(self, up: str) -> StrikeRecording:
        """The same recording, its points and the hand's poses turned about the axis that points forward so that another
        one points up."""
        if not self.up or self.up == up or self.points.shape[2] != 3:
            return self
        poses = None if self.hand_pose is None else turned_poses(self.hand_pose, up)
        return dataclasses.replace(self, points=self.points @ np.array(TURNED[up], float).T, hand_pose=poses, up=up)

    def ordered(self, joints: Sequence[str]) -> StrikeRecording:
        """Return the recording with its joint log reduced to these joints, in this order, and to samples near the
        frames. Further joints of the log are left out, which `notes` says.

        Raises:
            InputError: The log lacks one of these joints.
        """
        if self.joints_t is None or self.joints_q is None:
            return self
        width, near = self.joints_q.shape[1], of_use(self.joints_t, self.t)
        order, called = list(range(width)), self.joint_names
        if called and called != tuple(joints):
            try:
                order, called = order_of(called, joints, listed=self.joints_listed), tuple(joints)
            except InputError as error:
                raise error.within(f"{self.source}: " if self.source else "") from None
        if near.all() and called == self.joint_names:
            return self
        return dataclasses.replace(
            self,
            joints_t=self.joints_t[near],
            joints_q=self.joints_q[near][:, order],
            joint_names=called,
            notes=(*self.notes, *read_by_name(self.joint_names, order)),
        )

    def marker(self, name: str) -> np.ndarray:
        """Return the positions of one marker [m], with a `view` [pixels], (T, d); NaN where missing.

        Raises:
            InputError: No marker has this name.
        """
        if name not in self.markers:
            raise InputError("marker", name, "one of " + ", ".join(self.markers))
        return self.points[:, self.markers.index(name)]

    def without(self, mask: np.ndarray) -> StrikeRecording:
        """Return the recording without the points where a mask (T, M) is true, or without the frames where a mask (T,)
        is true.

        Raises:
            InputError: The mask has another shape, or nothing is left.
        """
        mask = np.asarray(mask, bool)
        if mask.shape not in ((len(self.t),), self.seen.shape):
            raise InputError("mask", f"shape {mask.shape}", f"shape {self.seen.shape} or ({len(self.t)},)")
        mask = mask if mask.ndim == 2 else np.broadcast_to(mask[:, None], self.seen.shape)
        return dataclasses.replace(self, points=np.where(mask[..., None], np.nan, self.points))

    def commanded(self, otherwise: str = "") -> Strike:
        """Return the commanded strike.

        Args:
            otherwise: A hint to add to the error message.

        Raises:
            InputError: The recording does not state the strike.
        """
        if self.strike is not None:
            return self.strike
        file, fix = Path(self.source), "in Python, give StrikeRecording(..., strike=Strike(q_i, q_f, D))"
        if file.suffix.lower() in SIDECARS:
            table = "strike = {q_i = [...], q_f = [...], D = ...}"
            fix = f"write {file.with_suffix('.toml').name} next to it with {table} (angles in rad, D in s); {fix}"
        raise InputError("recording", self.called, "a recording that states its strike's command", fix + otherwise)

    def save(self, path: Path | str) -> None:
        """Write an NPZ file, without pickle.

        Its keys are the fields, with those that are None or empty left out, and `format`, the number of the layout (1).
        `markers`, `joint_names` and `notes` are arrays of strings, `strike` is the vector `[q_i, q_f, D]`, `controller`
        and `view` are JSON texts.

        Raises:
            InputError: The file cannot be written.
        """
        arrays: dict[str, Any] = {"format": np.int64(LAYOUT)}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is not None and not (field.name in UNWRITTEN and not value):
                arrays[field.name] = np.asarray(_WRITTEN.get(field.name, np.asarray)(value))
        try:
            write_npz(Path(path), arrays)
        except OSError as error:
            raise InputError(
                "recording", str(path), "a file that can be written", f"reason: {error.strerror}"
            ) from None

    def __repr__(self) -> str:
        span = f"{len(self.t)} frames from {self.t[0]:.3f} to {self.t[-1]:.3f} s"
        of = "" if self.strike is None else f", {self.strike}"
        by = "" if self.view is None else f", seen by {self.view.name}"
        return f"StrikeRecording({', '.join(self.markers)}: {span}{of}{by})"

    @classmethod
    def load(cls, path: Path | str) -> StrikeRecording:
        """Read a recording that `save` wrote; the keys `t`, `points` and `markers` are required, all others optional.

        If the file does not state its source, the source is the file itself.

        Raises:
            InputError: The file is damaged, contains pickled objects or is of a later format, a key is unknown or
                missing, or a value is not allowed.
        """
        path, keys = Path(path), [field.name for field in dataclasses.fields(cls)]
        values: dict[str, Any] = read_arrays(path, "recording")
        with parsing(path, "NPZ"):
            for key in values:
                if key not in (*keys, "format"):
                    raise InputError("key", key, "one of " + ", ".join(keys))
            for key in REQUIRED:
                if key not in values:
                    raise InputError(key, None, f"a value; a recording has at least {', '.join(REQUIRED)}")
            if (number := int(values.pop("format", LAYOUT))) != LAYOUT:
                raise InputError("format", number, f"{LAYOUT}", "it was written by another version of whiptool")
            values = {key: _READ.get(key, lambda value: value)(value) for key, value in values.items()}
            if not values.get("sha256"):
                values |= {"source": values.get("source") or str(path), "sha256": sha256(path)}
            return cls(**values)


def assumed_size(recording: StrikeRecording) -> str:
    """Return the standard error that was assumed of a recording as text, such as `1 mm`; empty: it was given."""
    error = recording.assumed_error
    if error and recording.view is None and recording.sigma_assumed == "sigma":
        return f"{1e3 * error:g} mm"
    return f"{error:g} pixel{'' if error == 1 else 's'}" if error else ""


def turned_poses(poses: np.ndarray, up: str) -> np.ndarray:
    """Return poses (S, 7), whose other axis is up, turned about the axis that points forward so that `up` points up.

    The places are turned, and the orientations: R x, and the rotation R after that of the hand.
    """
    from scipy.spatial.transform import Rotation

    turn = np.array(TURNED[up], float)
    return np.hstack([poses[:, :3] @ turn.T, (Rotation.from_matrix(turn) * Rotation.from_quat(poses[:, 3:])).as_quat()])


def _poses(value: object, count: int) -> np.ndarray:
    """Places and unit quaternions (count, 7)."""
    poses = float_array("hand_pose", value)
    if poses.shape != (count, 7) or not np.isfinite(poses).all():
        raise InputError("hand_pose", f"shape {poses.shape}", f"finite numbers of shape ({count}, 7)")
    if not (farthest := np.abs(poses[:, :3]).max()) <= FARTHEST:
        raise InputError("hand_pose", float(farthest), f"positions within {FARTHEST:g} m", "are these millimetres?")
    size = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    if np.abs(size - 1).max() > 1e-2:
        raise InputError("hand_pose", float(size[np.abs(size - 1).argmax(), 0]), "quaternions (x, y, z, w) of length 1")
    poses[:, 3:] /= np.where(np.abs(size - 1) > UNIT, size, 1.0)  # what was divided once stays as it is
    return poses


def _check_in_image(points: np.ndarray, view: Camera) -> None:
    """Refuse points (T, M, d) that are not where a camera has pixels, or just outside them."""
    if points.shape[2] != 2:
        raise InputError("points", f"shape {points.shape}", "shape (T, M, 2) in pixels, with a view")
    seen = points[~np.isnan(points[..., 0])]
    size = np.array([view.width, view.height])
    outside = (seen < -size / 2) | (seen > 1.5 * size)
    if outside.any():
        pixel = seen[outside.any(axis=1)][0].tolist()
        pixels = f"pixels of {view.name}, {view.width} x {view.height}"
        raise InputError("points", pixel, pixels, "is it another camera's view?")


def _depths(
    depth: object, sigma: object, seen: np.ndarray, view: Camera | None
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Depths of the points that were seen and their standard errors [m], (T, M) each; None without depths."""
    if depth is None:
        if sigma is not None:
            raise InputError("depth_sigma", "given", "None unless depth is given")
        return None, None
    if view is None:
        raise InputError("depth", "measured", "None unless a view is given, the camera that measured it")
    z = _spread("depth", depth, seen.shape)
    z[(z == 0) | ~seen] = np.nan
    there = ~np.isnan(z)
    if not there.any():
        return None, None
    allowed = f"depths > 0 and at most {FARTHEST:g} m"
    if z[there].min() < 0:
        raise InputError("depth", float(z[there].min()), allowed)
    if z[there].max() > FARTHEST:
        raise InputError("depth", float(z[there].max()), allowed, "are these millimetres?")
    error = _spread("depth_sigma", view.depth_error(z) if sigma is None else sigma, seen.shape)
    if not ((error[there] > 0) & np.isfinite(error[there])).all():
        raise InputError("depth_sigma", float(np.min(error[there])), "finite and > 0 m wherever there is a depth")
    return z, np.where(there, error, np.nan)


def _spread(name: str, value: object, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers broadcast to a shape, as a new array."""
    array = float_array(name, value)
    try:
        return np.broadcast_to(array, shape).copy()
    except ValueError:
        raise InputError(name, f"shape {array.shape}", f"shape {shape}, or one that broadcasts to it") from None


def _plain_table(value: object) -> dict:
    """A controller as a table of plain data, as JSON keeps it."""
    made = getattr(value, "table", None)  # of a Controller
    value = made() if callable(made) else value
    if not isinstance(value, dict) or not isinstance(value.get("law"), str):
        raise InputError("controller", str(value)[:80], "a Controller, or its table with the key law")
    try:
        return json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError):
        raise InputError("controller", str(value)[:80], "a table of finite numbers, texts and lists") from None
