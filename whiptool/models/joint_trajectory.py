"""Joint trajectories for robots, as CSV or as a ROS 2 goal, and the hand's poses as joints of a virtual arm.

The trajectory of a strike begins with a movement to its start and a rest, and in hand space has the hand's poses.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.given_files import number_in, read_text
from whiptool.models.excess import Excess
from whiptool.models.hand_space import HandPath, hand_poses
from whiptool.models.numbers import float_array, number, numbers
from whiptool.models.pose_columns import POSE
from whiptool.models.smooth_path import path_between
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink, Vector, limit_unit
from whiptool.models.spline_points import spline_points
from whiptool.models.strike import StrikePath
from whiptool.whole_files import write_whole
from whiptool.words import counted

RATE = 500.0  # [1/s], of a UR5e's servos
REST = 3.0  # [s] in which the whip comes to hang still
_QUANTITIES = ("position", "velocity", "acceleration")
_UNIT = 1e-6  # by which the length of a quaternion may differ from 1
_ROUNDING = 1e-9  # by which a sample may be beyond a limit


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """Commanded positions, velocities and accelerations of an arm's n joints at T instants.

    Args:
        joints: Names of the joints, (n,).
        t: Times [s], (T,), from 0, increasing.
        q, v, a: Positions [rad or m], velocities [rad/s or m/s], accelerations [rad/s^2 or m/s^2], (T, n) each.
        hand: Poses of the hand in the base's frame, (T, 7): position x, y, z [m], unit quaternion x, y, z, w; None:
            unknown.

    Raises:
        InputError: Shapes do not match, a value is not finite, a quaternion is not of unit length, or times do not
            increase from 0.
    """

    joints: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    hand: np.ndarray | None = None

    def __post_init__(self) -> None:
        T, n = len(self.t), len(self.joints)
        shapes = {"q": (T, n), "v": (T, n), "a": (T, n)} | ({} if self.hand is None else {"hand": (T, len(POSE))})
        for name, shape in shapes.items():
            values = float_array(f"trajectory's {name}", getattr(self, name))
            if values.shape != shape or not np.isfinite(values).all():
                raise InputError(f"trajectory's {name}", values.shape, f"finite numbers of the shape {shape}")
        if self.hand is not None and (np.abs(np.linalg.norm(self.hand[:, 3:], axis=1) - 1) > _UNIT).any():
            raise InputError("trajectory's quaternions", "one of another length", "unit quaternions of the hand")
        if len(float_array("trajectory's times", self.t)) < 2 or self.t[0] != 0 or not (np.diff(self.t) > 0).all():
            raise InputError("trajectory's times", self.t[:3].tolist(), "two instants or more, increasing from 0")

    def __repr__(self) -> str:
        return f"JointTrajectory({len(self.t)} instants of {counted(len(self.joints), 'joint')}, {self.t[-1]:.3f} s)"

    @classmethod
    def of_strike(
        cls,
        strike: StrikePath,
        joints: Sequence[str],
        *,
        start: Sequence[float] | None = None,
        limits: Sequence[JointLimits] = (),
        rate: float = RATE,
        rest: float = REST,
        t_stay: float = 0.0,
        sway: float = 0.0,
    ) -> JointTrajectory:
        """Return the movement from a posture to a strike's start, a rest, the strike's reference (Eq. 1), and a stay at
        its end.

        Args:
            strike: The strike; in hand space the path of its joints.
            joints: Names of the arm's joints, (n,).
            start: Present posture [rad or m], (n,); default: the strike's start, with no movement to it.
            limits: Limits of each joint, of which the movement to the start uses a fifth, see `path_between`. Default:
                none.
            rate: Sampling rate [1/s]; all parts of the trajectory begin at a sample.
            rest: Least time at rest before the strike [s].
            t_stay: Least time after the strike [s].
            sway: Period [s] of the hanging whip, which the movement to the start does not leave swinging; see
                `path_between`.

        Raises:
            InputError: A value is out of range, or has another number of joints.
        """
        n = len(strike.q_i)
        if len(joints) != n:
            raise InputError("joints", tuple(joints), f"the names of {n} joints")
        step = 1 / number("rate", rate, low=1)
        parts = []
        if start is not None:
            way = path_between(numbers("start posture", tuple(start), n), strike.q_i, limits, rate, sway=sway)
            parts.append(tuple(x[:-1] for x in way))  # its end is the next part's first sample
        parts.append(strike.reference(np.zeros(_samples(number("rest", rest, low=0), step))))
        parts.append(strike.reference(_instants(strike.D, step)))
        parts.append(strike.reference(np.full(_samples(number("t_stay", t_stay, low=0), step) + 1, np.inf)))
        q, v, a = (np.concatenate(x) for x in zip(*parts, strict=True))
        hand = hand_poses(strike.way.kinematics, q) if isinstance(strike, HandPath) else None
        return cls(tuple(joints), np.arange(len(q)) * step, q, v, a, hand)

    @property
    def strike_begins(self) -> float:
        """Start time of a strike [s]: the last instant at rest before the last movement."""
        moving = np.flatnonzero(self.v.any(axis=1))
        if not len(moving):
            return float(self.t[-1])
        resting = np.flatnonzero(~self.v[: moving[-1]].any(axis=1))
        return float(self.t[resting[-1]]) if len(resting) else 0.0

    def beyond(self, limits: Sequence[JointLimits], *, slides: Sequence[bool] = ()) -> Excess | None:
        """Return a description of the largest violation of a limit of position, velocity, acceleration or jerk.

        The derivatives are judged twice: as they are given, the jerk by differences of the accelerations; and between
        samples, by differences of the positions, as a robot does that receives nothing else; where the largest velocity
        depends on the position, this is the earlier one. None: all limits are kept.

        Args:
            limits: Limits of each joint, (n,); empty without limits.
            slides: Which joints are prismatic, (n,); empty: none.
        """
        slides, differences = slides or [False] * len(self.joints), self.differences()
        worst, said = _ROUNDING, None
        for j, (joint, limit) in enumerate(zip(self.joints, limits, strict=bool(limits))):
            for quantity, between, values, (lowest, highest), scale in self._judged(j, limit, differences):
                excess = np.maximum(lowest - values, values - highest) / scale
                i = int(excess.argmax())
                if excess[i] > worst:
                    worst, unit = excess[i], limit_unit(quantity, slides=slides[j])
                    allowed = f"is {limit.position[0]:g} to {limit.position[1]:g}"
                    if quantity == "velocity" and limit.by_position:
                        allowed = f"at this position is {lowest[i]:.3f} to {highest[i]:.3f}"
                    elif quantity != "position":
                        allowed = f"is {scale:g}"
                    words = f"the {quantity} of {joint}{between} is {values[i]:+.3f} {unit}; its limit {allowed} {unit}"
                    said = Excess(words, float(self.t[i]))
        return said

    def differences(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return velocities, accelerations and jerks [rad or m; per s, s^2, s^3] by backward differences of the
        positions, (T, n) each. Before the first sample the joints are taken to rest at its positions.
        """
        steps = np.diff(self.t)
        if np.ptp(steps) < _ROUNDING * self.t[-1]:
            steps = np.full(len(steps), self.t[-1] / len(steps))
        found, values = [], self.q
        for _ in range(3):
            values = np.diff(values, axis=0, prepend=values[:1]) / np.r_[steps[0], steps][:, None]
            found.append(values)
        return found[0], found[1], found[2]

    def _judged(self, j: int, limit: JointLimits, differences: tuple[np.ndarray, ...]) -> Iterator[tuple]:
        """Yield what is judged of a joint: the quantity, words on it, values, lowest and highest (T,), and a scale."""
        low, high = limit.position
        yield "position", "", self.q[:, j], (low, high), (high - low) / 2 if math.isfinite(high - low) else 1.0
        jerk = np.diff(self.a[:, j], prepend=self.a[0, j]) / np.diff(self.t, prepend=-1.0)
        given, between = (self.v[:, j], self.a[:, j], jerk), [x[:, j] for x in differences]
        q, before = self.q[:, j], np.r_[self.q[:1, j], self.q[:-1, j]]
        step = self.t[-1] / (len(self.t) - 1)
        for k, quantity in enumerate(("velocity", "acceleration", "jerk")):
            scale = (limit.fastest, limit.acceleration, limit.jerk)[k]
            if math.isfinite(scale):
                bounds = [
                    limit.velocities(x) if k == 0 else np.outer((-scale, scale), np.ones_like(x)) for x in (q, before)
                ]
                slack = (2 / step) ** (k + 1) * np.spacing(np.abs(q).max())  # of rounded positions
                yield quantity, "", given[k], bounds[0], scale
                yield (
                    quantity,
                    " between samples",
                    between[k],
                    bounds[1] + np.outer((-slack, slack), np.ones_like(q)),
                    scale,
                )

    def save_csv(self, path: Path | str) -> None:
        """Write a CSV file at full precision.

        The columns are `time`, then `position_JOINT`, `velocity_JOINT`, `acceleration_JOINT`, and, if known, the hand's
        poses, `hand_x` to `hand_qw`.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        poses = np.empty((len(self.t), 0)) if self.hand is None else self.hand
        writer.writerow(_header(self.joints) + list(POSE[: poses.shape[1]]))
        for row in np.column_stack([self.t, self.q, self.v, self.a, poses]).tolist():
            writer.writerow(map(repr, row))
        write_whole(path, text.getvalue())

    @classmethod
    def load_csv(cls, path: Path | str) -> JointTrajectory:
        """Read a trajectory that `save_csv` wrote.

        Raises:
            InputError: There is no such file, it has another format, or a number is missing.
        """
        text = read_text(path, "CSV", "trajectory")
        try:
            header, *rows = list(csv.reader(text.splitlines()))
            values = np.array([[number_in(x) for x in row] for row in rows])
        except (ValueError, csv.Error) as error:
            raise InputError(
                "trajectory", str(path), "a CSV file of numbers with a header", f"reason: {str(error)[:160]}"
            ) from None
        names = [name.removeprefix("position_") for name in header if name.startswith("position_")]
        with_hand = header[-len(POSE) :] == list(POSE)
        if header != _header(names) + list(POSE) * with_hand or values.ndim != 2 or values.shape[1] != len(header):
            raise InputError(
                "trajectory", str(path), "the columns time, position_JOINT ..., velocity_..., acceleration_..."
            )
        q, v, a = np.split(values[:, 1 : 1 + 3 * len(names)], 3, axis=1)
        return cls(tuple(names), values[:, 0], q, v, a, values[:, -len(POSE) :] if with_hand else None)

    def save_goal(self, path: Path | str) -> None:
        """Write the goal of a ROS 2 `FollowJointTrajectory` action as YAML, with the fields of `trajectory_msgs`.

        Its points are those of `for_splines`, as all samples are too long for an argument of `ros2 action send_goal`.
        """
        few = self.for_splines()
        points = [
            {"positions": q, "velocities": v, "accelerations": a, "time_from_start": _duration(t)}
            for t, q, v, a in zip(few.t, few.q.tolist(), few.v.tolist(), few.a.tolist(), strict=True)
        ]
        _write_yaml({"trajectory": {"joint_names": list(self.joints), "points": points}}, path)

    def for_splines(self) -> JointTrajectory:
        """Return the trajectory with the few samples from which a controller's quintic splines repeat all of them.

        The splines are within 1e-6 rad or m of the positions, and 1e-3 rad/s^2 or m/s^2 of the accelerations.
        """
        few = spline_points(self.t, self.q, self.v, self.a)
        hand = None if self.hand is None else self.hand[few]
        return JointTrajectory(self.joints, self.t[few], self.q[few], self.v[few], self.a[few], hand)

    def save_hand(self, path: Path | str) -> None:
        """Write the hand's poses as YAML, with the fields of a ROS 2 message `trajectory_msgs/MultiDOFJointTrajectory`.

        The goal of `save_goal` does not contain the poses, because there they would be commands of floating joints.
        """
        assert self.hand is not None
        points = []
        for t, pose in zip(self.t, self.hand.tolist(), strict=True):
            transform = {"translation": dict(zip("xyz", pose[:3], strict=True)),
                         "rotation": dict(zip("xyzw", pose[3:], strict=True))}  # fmt: skip
            points.append({"transforms": [transform], "time_from_start": _duration(t)})
        _write_yaml({"joint_names": ["hand"], "points": points}, path)


def _samples(duration: float, step: float) -> int:
    """Number of whole steps that last at least so long."""
    return math.ceil(duration / step - _ROUNDING)


def _instants(duration: float, step: float) -> np.ndarray:
    """The samples of a part, from its beginning; its end is the next part's first."""
    return np.arange(_samples(duration, step)) * step


def _header(joints: Sequence[str]) -> list[str]:
    return ["time", *(f"{quantity}_{joint}" for quantity in _QUANTITIES for joint in joints)]


def _write_yaml(content: dict[str, Any], path: Path | str) -> None:
    import yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # libyaml's, where PyYAML was built with it, is faster
    write_whole(path, yaml.dump(content, Dumper=dumper, sort_keys=False, default_flow_style=None, width=10_000))


def _duration(t: float) -> dict[str, int]:
    """A time [s] as `builtin_interfaces/Duration`."""
    nanoseconds = round(1e9 * float(t))
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


_STEEPEST = np.deg2rad(65)  # of the middle turn: at 90 degrees the other two are one
_LOCKED = 1 - 1e-6  # sine of the middle turn
_FARTHEST = 20.0  # [m]
_AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def free_hand(turned: np.ndarray) -> SpatialArm:
    """Return a virtual arm with three prismatic joints for the position of its hand and three revolute joints about z,
    y and x for its orientation; with all joints at 0 its rotation matrix is `turned`, (3, 3).
    """
    slides = [_link(axis, JointLimits((-_FARTHEST, _FARTHEST)), "prismatic") for axis in _AXES]
    first = _link(_AXES[2], JointLimits(), rotation=turned)
    turns = [first, *(_link(axis, JointLimits()) for axis in (_AXES[1], _AXES[0]))]
    return SpatialArm((*slides, *turns), joints=(*POSE[:3], "hand_yaw", "hand_pitch", "hand_roll"))


def hand_joints(poses: np.ndarray) -> tuple[SpatialArm, np.ndarray]:
    """Return a virtual arm for a sequence of hand poses, and its joint positions [m, rad], (S, 6), without jumps.

    With all joints at 0, the arm's hand has one of the 24 orientations of a cube, chosen such that the poses (S, 7),
    each a position [m] and a unit quaternion x, y, z, w in the base's frame, stay farthest from gimbal lock. If none is
    far enough, the cube is rotated to the hand's mean orientation.
    """
    turned = Rotation.from_quat(poses[:, 3:])
    cube = Rotation.create_group("O").as_matrix().round()
    way, steepest = _best_way(cube, turned)
    if steepest > _STEEPEST:
        way, steepest = _best_way(turned.mean().as_matrix() @ cube, turned)
    if steepest > _STEEPEST:
        rule = f"rotations of the hand with a middle Euler angle of at most {np.rad2deg(_STEEPEST):.0f} degrees"
        raise InputError("hand", f"{np.rad2deg(steepest):.0f} degrees", rule, "record the arm's joints instead")
    return free_hand(way), np.hstack([poses[:, :3], np.unwrap(_turns(way, turned), axis=0)])


def _best_way(ways: np.ndarray, turned: Rotation) -> tuple[np.ndarray, float]:
    """Return that of some orientations (W, 3, 3) from which the turn about y is smallest, and how large it is."""
    sines = [np.abs((Rotation.from_matrix(way).inv() * turned).as_matrix()[:, 2, 0]).max() for way in ways]
    steepest = [
        np.pi / 2 if sine > _LOCKED else float(np.abs(_turns(way, turned)[:, 1]).max())  # there SciPy would warn
        for way, sine in zip(ways, sines, strict=True)
    ]
    best = int(np.argmin(steepest))
    return ways[best], steepest[best]


def _turns(way: np.ndarray, turned: Rotation) -> np.ndarray:
    """Return the turns about z, y and x that lead from an orientation to others [rad], (S, 3)."""
    return (Rotation.from_matrix(way).inv() * turned).as_euler("ZYX")


def _link(
    axis: Vector,
    limits: JointLimits,
    kind: Literal["revolute", "prismatic"] = "revolute",
    rotation: np.ndarray | None = None,
) -> SpatialLink:
    given = np.eye(3) if rotation is None else rotation
    turned = tuple(map(tuple, given.tolist()))
    return SpatialLink(0.0, (0, 0, 0), (0.0,) * 6, axis, (0, 0, 0), turned, kind=kind, limits=limits)
