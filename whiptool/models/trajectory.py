"""Trajectories of strikes, and closest approaches of paths to a position."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, TypeAlias, cast

import numpy as np

from whiptool.errors import InputError, no_attribute
from whiptool.extras import optional
from whiptool.given_files import read_arrays
from whiptool.models.numbers import NoArray, array_of, number
from whiptool.whole_files import write_npz, write_whole

if TYPE_CHECKING:
    import pandas
    from scipy.interpolate import PPoly


class ClosestApproach(NamedTuple):
    """Closest approaches of polygonal paths to a position."""

    distance: np.ndarray  # [m], (...); infinite for a path without a segment whose two ends are known
    segment: np.ndarray  # index of the segment, (...)
    share: np.ndarray  # position within the segment, 0 to 1, (...)

    def along(self, values: np.ndarray) -> np.ndarray:
        """Return the change of one path's values (T, ...) over the segment of its closest approach, (...)."""
        return values[self.segment + 1] - values[self.segment]

    def between(self, values: np.ndarray) -> np.ndarray:
        """Return values (T, ...) of one path, interpolated linearly at its closest approach, (...)."""
        return values[self.segment] + self.share * self.along(values)


def closest_on_segments(paths: np.ndarray, place: np.ndarray) -> ClosestApproach:
    """Return the closest approaches of polygonal paths to a position.

    Args:
        paths: Paths in d dimensions, (..., T, d) [m]; NaN for missing points.
        place: Position (d,), or one for each path, (..., d) [m].
    """
    start, step = paths[..., :-1, :] - np.asarray(place)[..., None, :], np.diff(paths, axis=-2)
    squared = (step**2).sum(axis=-1)
    along = -(start * step).sum(axis=-1)
    share = np.clip(np.divide(along, squared, out=np.zeros_like(along), where=squared > 0), 0, 1)
    distance = np.linalg.norm(start + share[..., None] * step, axis=-1)
    distance = np.where(np.isnan(distance), np.inf, distance)
    if distance.shape[-1] == 0:
        shape = distance.shape[:-1]
        return ClosestApproach(np.full(shape, np.inf), np.zeros(shape, int), np.zeros(shape))
    segment = distance.argmin(axis=-1)
    nearest = segment[..., None]
    found = (np.take_along_axis(x, nearest, axis=-1)[..., 0] for x in (distance, share))
    return ClosestApproach(next(found), segment, next(found))


def closest_on_curve(curve: PPoly, place: np.ndarray, *, samples: int) -> float:
    """Return the time [s] at which a smooth curve of positions (d,) [m] over time comes nearest to a position (d,) [m].

    The nearest of `samples` equally spaced instants is refined to the root of the squared distance's derivative; the
    distance must have one minimum between three successive instants.
    """
    from scipy.optimize import brentq  # a third of what a command imports

    t = np.linspace(curve.x[0], curve.x[-1], samples)
    nearest = int(np.linalg.norm(curve(t) - place, axis=1).argmin())

    def slope(at: float) -> float:
        return float((curve(at) - place) @ curve(at, 1))

    before, after = t[max(nearest - 1, 0)], t[min(nearest + 1, len(t) - 1)]
    if not slope(before) < 0 < slope(after):  # nearest at an end of the curve
        return float(t[nearest])
    return cast(float, brentq(slope, before, after, xtol=1e-14))


class Placed(Protocol):
    """An object with a position, such as a `Target`."""

    @property
    def position(self) -> tuple[float, ...]:
        """Position (x, y) in the strike plane, or (x, y, z) in space [m]."""
        ...


Points: TypeAlias = Placed | np.ndarray | Sequence[float]


def target_points(target: Points, count: int, dimension: int = 2) -> np.ndarray:
    """Return positions of targets, (count, dimension) [m], from a `Target` or position for all or one for each."""
    d, where = dimension, "in the plane" if dimension == 2 else "in space"
    rule = f"a Target {where}, shape ({d},), or one each, ({count}, {d})"
    points = array_of("target", getattr(target, "position", target), rule)
    if points.shape not in ((d,), (count, d)):
        raise InputError("target", f"shape {points.shape}", rule)
    return np.broadcast_to(points, (count, d))


@dataclass(frozen=True)
class Approach(NoArray, instead="its distance, tip or velocity"):
    """Closest approach of the tip to its target, for B strikes of an arm with a joints.

    Args:
        distance: Distance of the tip from the target [m], (B,); infinite if a strike diverged before its first step.
        time: Time of the closest approach [s], (B,).
        velocity: Velocity of the tip at the closest approach [m/s], (B, 2), in space (B, 3).
        tip: Position of the tip at the closest approach [m], (B, 2), in space (B, 3).
        max_joint_speed: Largest speed of each arm joint over the strike [rad/s], (B, a).
        max_torque: Largest torque of each arm joint over the strike [N m], (B, a).
        diverged: Whether the simulation diverged, with joint speeds that grew without bound, (B,).
        error: Standard error of the distance [m], (B,), for measured distances; None for computed ones.
        positions: Lowest and highest position of each arm joint over the strike [rad or m], (B, 2, a); None: not known.
        effort: Integral of each arm joint's squared torque over the strike, by the trapezoidal rule [N^2 m^2 s],
            (B, a); None: not known.
        lost: For a rig, why a strike has no closest approach: `refused` or `unseen`, else empty, (B,) strings; None:
            the strikes were simulated.
        integration_error: Estimated integration error of the distance [m], (B,); infinite if the tolerance was not met
            or the strike diverged. None: not estimated.
    """

    distance: np.ndarray
    time: np.ndarray
    velocity: np.ndarray
    tip: np.ndarray
    max_joint_speed: np.ndarray
    max_torque: np.ndarray
    diverged: np.ndarray
    error: np.ndarray | None = None
    positions: np.ndarray | None = None
    effort: np.ndarray | None = None
    lost: np.ndarray | None = None
    integration_error: np.ndarray | None = None

    def __repr__(self) -> str:
        if len(self.distance) == 1 and self.diverged[0]:
            return f"Approach(diverged; {self.distance[0]:.4f} m until then)"
        if len(self.distance) == 1:
            return f"Approach({self.distance[0]:.4f} m at {self.time[0]:.3f} s, {self.speed[0]:.1f} m/s)"
        return f"Approach({len(self.distance)} strikes, the nearest {np.nanmin(self.distance, initial=np.inf):.4f} m)"

    @classmethod
    def none(cls, joints: int, dimension: int) -> Approach:
        """Return the approaches of zero strikes."""
        number, place, of_joints = np.empty(0), np.empty((0, dimension)), np.empty((0, joints))
        return cls(number, number, place, place, of_joints, of_joints, np.empty(0, bool))

    def of_paths(self, i: int, paths: np.ndarray, target: np.ndarray, h: float) -> Approach:
        """Return strike i's approach (B = 1) with the nearest of several paths in place of the tip's.

        Args:
            i: Index of the strike.
            paths: Paths sampled at the strike's steps, (paths, T, d) [m]; NaN after divergence.
            target: Position of the target, (d,) [m].
            h: Time step [s].
        """
        nearest = closest_on_segments(paths, target)
        k = int(nearest.distance.argmin())
        segment, share = int(nearest.segment[k]), float(nearest.share[k])
        start, step = paths[k, segment], paths[k, segment + 1] - paths[k, segment]
        rest = {name: getattr(self, name)[i : i + 1] for name in ("max_joint_speed", "max_torque", "diverged")}
        rest["effort"] = None if self.effort is None else self.effort[i : i + 1]
        return Approach(
            nearest.distance[k : k + 1],
            np.array([(segment + share) * h]),
            step[None] / h,
            (start + share * step)[None],
            **rest,
        )

    @property
    def known(self) -> np.ndarray:
        """Whether each strike has a distance whose integration error meets the tolerance, (B,)."""
        return ~self.diverged & np.isfinite(self.farthest)

    @property
    def farthest(self) -> np.ndarray:
        """Upper bound of the distance: distance plus estimated integration error [m], (B,); see `Goals.hit`."""
        return self.distance if self.integration_error is None else self.distance + self.integration_error

    @property
    def speed(self) -> np.ndarray:
        """Speed of the tip at the closest approach [m/s], (B,)."""
        return np.linalg.norm(self.velocity, axis=-1)


_SHAPES = {"t": "T", "q": "Tn", "v": "Tn", "q_d": "Ta", "v_d": "Ta", "tau": "Ta", "K": "Taa", "B": "Taa"}
_SHAPES |= {"tip": "Td", "tip_velocity": "Td", "diverged": ""}  # of a trajectory's file


SPELLED = {  # names of a trajectory's symbols, in words
    "times": "t", "positions": "q", "velocities": "v", "desired_positions": "q_d", "desired_velocities": "v_d",
    "torques": "tau", "stiffness": "K", "damping": "B",
}  # fmt: skip


@dataclass(frozen=True)
class Trajectory(NoArray, instead="its t, q, tau or tip"):
    """One strike at T instants, for an arm with a joints and a chain with n coordinates.

    Args:
        t: Times [s], (T,).
        q, v: Joint positions [rad] and velocities [rad/s], (T, n).
        q_d, v_d: Desired positions and velocities of the arm, (T, a); in hand space those of the joints on the hand's
            path.
        tau: Arm torques [N m], (T, a).
        K, B: Stiffness [N m/rad] and damping [N m s/rad] of the controller, (T, a, a).
        tip, tip_velocity: Position [m] and velocity [m/s] of the tip, (T, 2), in space (T, 3).
        diverged: Whether the simulation diverged, so that the trajectory ends early.
        names: Name and unit of each of the n coordinates, see `Model.coordinate_names`; empty: not known.

    The symbols also have long names: `times`, `positions`, `velocities`, `torques` and so on, see `SPELLED`.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    q_d: np.ndarray
    v_d: np.ndarray
    tau: np.ndarray
    K: np.ndarray
    B: np.ndarray
    tip: np.ndarray
    tip_velocity: np.ndarray
    diverged: bool = False
    names: tuple[tuple[str, str], ...] = ()

    MEETING: ClassVar[str] = "closest approach"  # what `approach` returns, in words
    FOLLOWED: ClassVar[str] = "tip"  # of which `tip` is the path, in words

    def __repr__(self) -> str:
        fastest = self.tip_speed.max()
        ended = "diverged" if self.diverged else "ended"
        return f"Trajectory({len(self.t)} instants, {ended} at {self.t[-1]:.3f} s, tip at most {fastest:.1f} m/s)"

    def __getattr__(self, name: str) -> np.ndarray:
        if name not in SPELLED:
            plots = "whiptool.plot_strike(path, model, target) draws it, and plot_tip_speed(path) and the like"
            raise no_attribute(self, name, {"plot": plots})
        return getattr(self, SPELLED[name])

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *SPELLED]

    def decisive(self, near: Approach) -> float:
        """Return the time of the posture that decides an approach (B = 1) [s]: that of the approach itself."""
        return float(near.time[0])

    @property
    def duration(self) -> float:
        """Duration [s]: of the movement and of the time after it."""
        return float(self.t[-1] - self.t[0])

    @property
    def tip_speed(self) -> np.ndarray:
        """Speed of the tip [m/s], (T,)."""
        return np.linalg.norm(self.tip_velocity, axis=1)

    @property
    def tracking_error(self) -> np.ndarray:
        """Tracking errors of the arm's joints, `q_d - q` [rad], (T, a)."""
        return self.q_d - self.q[:, : self.q_d.shape[1]]

    def approach(self, target: Points) -> Approach:
        """Return the closest approach (B = 1): the nearest point of the segments between successive tip positions."""
        nearest = closest_on_segments(self.tip, target_points(target, 1, self.tip.shape[1])[0])
        if np.isinf(nearest.distance):  # diverged in the first step
            of_tip = 0.0, *np.full((2, self.tip.shape[1]), np.nan)
        else:
            of_tip = tuple(nearest.between(x) for x in (self.t, self.tip_velocity, self.tip))
        a = self.tau.shape[1]
        q = self.q[:, :a]
        return Approach(
            *(np.array([x]) for x in (nearest.distance, *of_tip)),
            max_joint_speed=np.abs(self.v[:, :a]).max(axis=0)[None],
            max_torque=np.abs(self.tau).max(axis=0)[None],
            diverged=np.array([self.diverged]),
            positions=np.stack([q.min(axis=0), q.max(axis=0)])[None],
            effort=np.trapezoid(self.tau**2, self.t, axis=0)[None],
        )

    def distance(self, target: Points) -> np.ndarray:
        """Distance between tip and target at every instant [m], (T,)."""
        return np.linalg.norm(self.tip - target_points(target, 1, self.tip.shape[1])[0], axis=1)

    def miss(self, target: Points) -> float:
        """Return the miss distance of the tip at a target, the distance at the closest approach [m]."""
        return float(self.approach(target).distance[0])

    def since(self, begin: float) -> Trajectory:
        """Return the part after the time `begin` [s], with times relative to it."""
        begin = number("begin", begin)
        part = {name: getattr(self, name)[self.t >= begin] for name, axes in _SHAPES.items() if axes}
        part["t"] = part["t"] - begin
        return replace(self, **part)

    def save(self, path: Path | str) -> None:
        """Write an NPZ file, without pickle."""
        arrays: dict[str, Any] = {name: np.asarray(getattr(self, name)) for name in _SHAPES}
        arrays["names"] = np.array(self.names, str).reshape(-1, 2)
        write_npz(path, arrays)

    def columns(self) -> dict[str, np.ndarray]:
        """Return all quantities over time by name, (T,) each.

        The names are `t`, `q.shoulder`, ..., `q.whip[0]`, ..., `K.shoulder.elbow`, `tip.x`; if the joints' names are
        not known, `q[0]` and `K[0][1]`.
        """
        return {name: self.t if name == "t" else values for name, _, values in self._columns()}

    def _columns(self) -> Iterator[tuple[str, str, np.ndarray]]:
        """Yield name, unit and values (T,) of every number over time; the unit is empty where it is not known."""
        yield "t", "s", self.t
        for quantity, axes in _SHAPES.items():
            values, letters = getattr(self, quantity), axes[1:]
            for place in np.ndindex(np.shape(values)[1:]) if letters else ():
                if letters == "d":
                    suffix, unit = f".{'xyz'[place[0]]}", "m" if quantity == "tip" else "m/s"
                elif self.names:
                    suffix = "".join(f".{self.names[i][0]}" for i in place)
                    unit = _unit(quantity, *(self.names[i][1] for i in place))
                else:
                    suffix, unit = "".join(f"[{i}]" for i in place), ""
                yield quantity + suffix, unit, values[(slice(None), *place)]

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table of T rows, whose columns are those of `columns`.

        Raises:
            InputError: pandas is not installed.
        """
        return optional("pandas", "a data frame").DataFrame(self.columns())

    def to_csv(self, path: Path | str | None = None) -> str | None:
        """Write a CSV file of T rows under the names of `columns` with units, `q.shoulder [rad]`; or return its text.

        Args:
            path: Path of the file; None: the text is returned.
        """
        columns, text = list(self._columns()), StringIO()
        header = ",".join(f"{name} [{unit}]" if unit else name for name, unit, _ in columns)
        np.savetxt(text, np.stack([values for *_, values in columns], axis=1), "%.17g", ",", header=header, comments="")
        if path is None:
            return text.getvalue()
        write_whole(path, text.getvalue())
        return None

    @classmethod
    def load(cls, path: Path | str) -> Trajectory:
        """Read a trajectory that `save` wrote.

        Raises:
            InputError: There is no such file, or it is not a trajectory.
        """
        arrays: dict[str, Any] = read_arrays(path, "trajectory", _SHAPES)
        t = arrays["t"]
        if not len(t) or not np.isfinite(t).all() or not (np.diff(t) > 0).all():
            raise InputError(
                f"{path}: t", f"{len(t)} times", "one or more finite times, each later than the previous time"
            )
        named = {name: arrays[name] for name in _SHAPES}
        names = arrays.get("names", np.empty((0, 2), str))  # files of older versions have none
        if names.shape not in ((0, 2), (named["q"].shape[1], 2)) or names.dtype.kind != "U":
            raise InputError(f"{path}: names", names.shape, "name and unit of each coordinate")
        return cls(**named | {"diverged": bool(arrays["diverged"]), "names": tuple(map(tuple, names.tolist()))})


def _unit(quantity: str, unit: str, per: str = "") -> str:
    """Return the unit of a joint's quantity, by its symbol in a trajectory and the unit of the joint's position; of
    gains, per position of another joint, whose unit is `per`.
    """
    torque = "N" if unit == "m" else "N m"
    of_gains = {"K": f"{torque}/{per}", "B": f"{torque} s/{per}"}
    return {"q": unit, "q_d": unit, "v": f"{unit}/s", "v_d": f"{unit}/s", "tau": torque, **of_gains}[quantity]
