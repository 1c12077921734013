"""Strikes of an arm's joints along a minimum-jerk path (Eq. 1), or of its hand; their bounds, and joint space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, overload

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.numbers import (
    ArrayLike,
    Vector,
    array_of,
    ends_and_duration,
    made_of_numbers,
    number,
    numbers,
    whole,
)
from whiptool.models.parameters import AnyArm, ArmParameters, Model
from whiptool.models.spatial_arm import SpatialArm

PI = math.pi
LARGEST_SAMPLE = 10_000_000  # strikes
FASTEST = 15 / 8  # largest speed of a minimum-jerk path (Eq. 1), in spans per duration
LARGEST_ACCELERATION = 10 / math.sqrt(3)  # likewise, per squared duration
LARGEST_JERK = 60.0  # likewise, per cubed duration: at both ends
T_STAY = 0.3  # [s] that a strike is watched after the movement ended; not printed in the paper


def eased(t: float | np.ndarray, D: float) -> tuple[Any, Any, Any]:
    """Return the fraction of a minimum-jerk path (Eq. 1) at times t [s], and its first two time derivatives."""
    s = min(max(t / D, 0.0), 1.0) if isinstance(t, float) else np.clip(np.asarray(t, float) / D, 0.0, 1.0)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    return share, 30 * s**2 * (1 - s) ** 2 / D, 60 * s * (1 - s) * (1 - 2 * s) / D**2


def strike_names(arm: AnyArm) -> tuple[str, ...]:
    """Return the names of a strike's coordinates, for shoulder and elbow `q_si, q_ei, q_sf, q_ef, D` (Algorithm 1).

    If joint names begin with the same letter, the whole names are used: `q_shoulder_i`.
    """
    stems = [f"q_{s}" if len(s) == 1 or s.isdecimal() else f"q_{s}_" for s in arm.subscripts]
    return (*(stem + "i" for stem in stems), *(stem + "f" for stem in stems), "D")


def sliding_names(arm: AnyArm) -> tuple[str, ...]:
    """Return the names of a strike's coordinates that are positions of prismatic joints [m]."""
    names = zip(strike_names(arm), (*arm.joints, *arm.joints), strict=False)  # all but D
    return tuple(name for name, joint in names if joint in arm.slides)


def named_strike(strike: Strike, arm: AnyArm) -> dict[str, float]:
    """Return the strike's parameters by their names, angles in rad and D in s."""
    return dict(zip(strike_names(arm), map(float, strike.vector), strict=True))


_VECTOR = "joint positions q_i, as many q_f, and D [s]: 5 numbers for 2 joints, 13 for 6"


@made_of_numbers(lambda row: ends_and_duration(row, _VECTOR))
@dataclass(frozen=True)
class Strike(Vector):
    """Reference trajectory (zero-torque trajectory) of the arm's n joints; `np.asarray(strike)` is its `vector`.

    `Strike(-1.36, 0.47, 1.73, 1.41, 0.95)` is the same as `Strike((-1.36, 0.47), (1.73, 1.41), 0.95)`.

    Args:
        q_i: Joint positions at the start [rad; m for a prismatic joint], (n,).
        q_f: Joint positions at the end, (n,).
        D: Duration of the movement [s].

    Raises:
        InputError: A value is not finite, D is not positive, or the lengths differ.
    """

    q_i: tuple[float, ...]
    q_f: tuple[float, ...]
    D: float

    if TYPE_CHECKING:

        @overload
        def __init__(self, q_i: Sequence[float], q_f: Sequence[float], D: float) -> None: ...
        @overload
        def __init__(self, vector: Sequence[float] | np.ndarray, /) -> None: ...
        @overload
        def __init__(self, *vector: float) -> None: ...

    def __post_init__(self) -> None:
        for name in ("q_i", "q_f"):
            object.__setattr__(self, name, numbers(name, getattr(self, name)))
        if len(self.q_i) != len(self.q_f):
            raise InputError("q_f", self.q_f, f"{len(self.q_i)} angles, as many as q_i")
        object.__setattr__(self, "D", number("D", self.D, low=0, strict=True))

    def __repr__(self) -> str:
        start, end = (", ".join(f"{x:.4g}" for x in q) for q in (self.q_i, self.q_f))
        return f"Strike(q_i=({start}), q_f=({end}), D={self.D:.4g} s)"

    @classmethod
    def from_vector(cls, vector: Sequence[float] | np.ndarray) -> Strike:
        """Return the strike of a vector `[q_i, q_f, D]`, shape (2 n + 1,).

        Raises:
            InputError: The length is even, or a value is not allowed.
        """
        return cls(*ends_and_duration(vector, _VECTOR))

    @property
    def vector(self) -> np.ndarray:
        """`[q_i, q_f, D]`, shape (2 n + 1,)."""
        return np.array([*self.q_i, *self.q_f, self.D])

    @cached_property
    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array(self.q_i), np.array(self.q_f) - np.array(self.q_i)

    def reference(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the desired positions [rad or m], velocities [per s] and accelerations [per s^2] at times t [s], each
        of shape (*t.shape, n); Eq. 1.

        Before time 0 the position is `q_i`, after D it is `q_f`.
        """
        s, ds, dds = (x if isinstance(t, float) else x[..., None] for x in eased(t, self.D))
        q_i, span = self._ends
        return q_i + span * s, span * ds, span * dds


@dataclass(frozen=True)
class StrikeBounds(ArrayLike):
    """Box in which strikes are searched; `lower` and `upper` are in the order of `Strike.vector`. `np.asarray(bounds)`
    has these two rows, (2, 2 n + 1).

    Raises:
        InputError: Lengths differ, a value is not finite, lower is not below upper, or D may be <= 0.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            object.__setattr__(self, name, numbers(name, getattr(self, name)))
        lower, upper = self.lower, self.upper
        if len(lower) != len(upper) or len(lower) < 3 or len(lower) % 2 == 0:
            raise InputError("bounds", (lower, upper), "lower and upper of the same odd length (q_i, q_f, D)")
        for i, (low, high) in enumerate(zip(lower, upper, strict=True)):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise InputError(f"bounds[{i}]", (low, high), "finite, lower < upper", "swap or widen them")
        if lower[-1] <= 0:
            raise InputError("bounds of D", lower[-1], "a shortest duration > 0 s")

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper as arrays of shape (2 n + 1,)."""
        return np.array(self.lower), np.array(self.upper)

    def _as_array(self) -> np.ndarray:
        return np.stack(self.box)

    def sample(self, rng: np.random.Generator | int, size: int | None = None, *, seed: int = 0) -> np.ndarray:
        """Return uniformly random strike vectors, (size, 2 n + 1).

        Args:
            rng: Random generator; or the number of strikes, which are then drawn with `seed`.
            size: Number of strikes.
            seed: Seed if only the number of strikes is given.
        """
        if size is None and not isinstance(rng, np.random.Generator):
            rng, size = np.random.default_rng(whole("seed", seed, low=0)), rng
        expect(np.random.Generator, rng=rng)
        assert isinstance(rng, np.random.Generator)
        lower, upper = self.box
        return rng.uniform(lower, upper, (whole("size", size, low=0, high=LARGEST_SAMPLE), len(lower)))


_PERSON = ("shoulder_flexion", "shoulder_abduction", "shoulder_rotation", "elbow")
_D = (0.4, 1.5)  # [s]; none is printed
_OF_PERSON = StrikeBounds(
    (*(PI * np.array([-0.5, -0.5, -0.5, 0.0, 0.1, -0.5, -0.5, 0.0])), _D[0]),
    (*(PI * np.array([-0.1, 0.5, 0.5, 0.9, 1.0, 0.5, 0.5, 0.9])), _D[1]),
)


def is_person(arm: AnyArm) -> bool:
    """Whether an arm has the joints of the human arm of Nah et al. 2023."""
    return arm.joints == _PERSON


def default_bounds(arm: AnyArm | Model) -> StrikeBounds:
    """Return the default bounds of strikes of an arm, or of a model's arm [rad or m], [s].

    The paper prints no bounds for the planar arm of two joints; those returned for it are whiptool's. For the human arm
    they are those of Nah et al. 2023. For other arms in space they are the position limits of the joints, at most half
    a turn to either side.

    Raises:
        InputError: The arm has no default bounds; give bounds.
    """
    arm = arm.arm if isinstance(arm, Model) else arm
    expect(ArmParameters, SpatialArm, arm=arm)
    if arm.dimension == 3:
        return _OF_PERSON if is_person(arm) else _bounds_of_limits(arm)
    if arm.n == 2:
        return StrikeBounds((-0.5 * PI, 0.0, 0.1 * PI, 0.0, _D[0]), (-0.1 * PI, 0.9 * PI, PI, 0.9 * PI, _D[1]))
    rule = f"lower and upper, {2 * arm.n + 1} numbers each (joints of the arm: {arm.n})"
    raise InputError("bounds", "none", rule, "give StrikeBounds(lower, upper)")


def _bounds_of_limits(arm: AnyArm) -> StrikeBounds:
    low, high = np.array([limits.position for limits in arm.joint_limits]).T
    around = arm.turns & (high - low > 2 * PI)
    low, high = np.where(around, -PI, low), np.where(around, PI, high)
    return StrikeBounds((*low, *low, _D[0]), (*high, *high, _D[1]))


_HAND_VECTOR = "the hand's coordinates x_i, as many x_f, and D"


@made_of_numbers(lambda row: ends_and_duration(row, _HAND_VECTOR))
@dataclass(frozen=True)
class HandStrike(Vector):
    """Reference trajectory of the hand in m coordinates, see `HandKinematics`; `np.asarray(strike)` is its `vector`.

    `HandStrike(0.1, 0.2, 0.3, 0.4, 0.5)` is the same as `HandStrike((0.1, 0.2), (0.3, 0.4), 0.5)`.
    """

    x_i: tuple[float, ...]  # at the start, (m,): position [m] and, if prescribed, rotation from the home posture [rad]
    x_f: tuple[float, ...]  # at the end, (m,)
    D: float  # duration of the movement [s]

    if TYPE_CHECKING:

        @overload
        def __init__(self, x_i: Sequence[float], x_f: Sequence[float], D: float) -> None: ...
        @overload
        def __init__(self, vector: Sequence[float] | np.ndarray, /) -> None: ...
        @overload
        def __init__(self, *vector: float) -> None: ...

    def __post_init__(self) -> None:
        for name in ("x_i", "x_f"):
            object.__setattr__(self, name, numbers(name, getattr(self, name)))
        if len(self.x_i) != len(self.x_f):
            raise InputError("x_f", self.x_f, f"{len(self.x_i)} coordinates, as many as x_i")
        object.__setattr__(self, "D", number("D", self.D, low=0, strict=True))

    def __repr__(self) -> str:
        start, end = (", ".join(f"{x:.4g}" for x in hand) for hand in (self.x_i, self.x_f))
        return f"HandStrike(x_i=({start}), x_f=({end}), D={self.D:.4g} s)"

    @classmethod
    def from_vector(cls, vector: Sequence[float] | np.ndarray) -> HandStrike:
        """Return the strike with the vector `[x_i, x_f, D]`, (2 m + 1,)."""
        return cls(*ends_and_duration(vector, _HAND_VECTOR))

    @property
    def vector(self) -> np.ndarray:
        """`[x_i, x_f, D]`, shape (2 m + 1,)."""
        return np.array([*self.x_i, *self.x_f, self.D])


AnyStrike = Strike | HandStrike
FARTHEST_TURN = 4 * np.pi  # [rad] from 0; no arm turns farther


class StrikePath(Protocol):
    """Interface of a strike's joint motion: a `Strike`, or the `HandPath` of a strike in hand space."""

    @property
    def q_i(self) -> tuple[float, ...]:
        """Joint positions at the start [rad or m], (a,)."""
        ...

    @property
    def D(self) -> float:
        """Duration of the movement [s]."""
        ...

    def reference(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the desired positions [rad or m], velocities [per s] and accelerations [per s^2] of the joints at
        times t [s] after the start of the strike, each (*t.shape, a)."""
        ...


class JointSpace:
    """Strikes in joint space of an arm with a joints: vectors `[q_i, q_f, D]` (2 a + 1,), as simulators take them."""

    def __init__(self, arm: AnyArm) -> None:
        self.arm = arm

    @property
    def kind(self) -> str:
        """`joint`, the kind of this space."""
        return "joint"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of a strike's coordinates, (2 a + 1,), such as `q_si, q_ei, q_sf, q_ef, D`; see `strike_names`."""
        return strike_names(self.arm)

    @property
    def width(self) -> int:
        """Length of a strike vector, 2 a + 1."""
        return 2 * self.arm.n + 1

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of a strike vector, in order: `q_i`, `q_f` and `D`."""
        return joint_layout(self.arm.n)

    @property
    def bounds(self) -> StrikeBounds:
        """Default bounds for searches; see `default_bounds`."""
        return default_bounds(self.arm)

    def strike(self, vector: Sequence[float] | np.ndarray) -> Strike:
        """Return the strike of a vector `[q_i, q_f, D]`, (2 a + 1,)."""
        return Strike.from_vector(vector)

    def path(self, vector: np.ndarray) -> Strike:
        """Return the path of the arm's a joints for a vector `[q_i, q_f, D]`, (2 a + 1,); in joint space it is the
        strike itself."""
        return Strike.from_vector(vector)

    def numbers(self, vectors: np.ndarray) -> np.ndarray:
        """Return the strike vectors (B, 2 a + 1) unchanged."""
        return vectors

    def slopes(self, vectors: np.ndarray) -> np.ndarray:
        """Return identity matrices, the derivatives of `numbers`, (B, 2 a + 1, 2 a + 1)."""
        return np.broadcast_to(np.eye(self.width), (len(vectors), self.width, self.width))

    def beyond(self, vectors: np.ndarray) -> np.ndarray:
        """Return zeros (B,): all strikes in joint space are feasible."""
        return np.zeros(len(vectors))

    def check_turns(self, name: str, vectors: Any) -> None:
        """Refuse strikes, (B, 2 a + 1) or one, with a joint angle more than two turns from 0, as one in degrees would
        be; `name` is that of the strikes for the user.
        """
        check_turns(name, np.asarray(vectors)[..., :-1], self.arm)


def check_turns(name: str, positions: Any, arm: AnyArm) -> None:
    """Refuse joint angles more than two turns from 0, as angles in degrees would be, among the positions of the arm's a
    joints, k sets in a row, (k a,) or (B, k a), which the user knows as `name`; prismatic joints are not checked.
    """
    rows = np.reshape(positions, (-1, arm.n))
    refuse_far(name, rows, [joint not in arm.slides for joint in arm.joints], arm.joints)


def refuse_far(name: str, rows: np.ndarray, turning: Sequence[bool], of: Sequence[str]) -> None:
    """Refuse angles more than two turns from 0, as values in degrees would be, among values (B, k) that the user knows
    as `name`; `turning` (k,) says which of the k are angles [rad], and `of` (k,) names them.
    """
    far = np.argwhere((np.abs(rows) > FARTHEST_TURN) & np.array(turning))
    if len(far):
        row, column = far[0]
        given, rule = f"{rows[row, column]:g} rad of {of[column]}", "angles up to two turns (12.57 rad) from 0"
        raise InputError(name, given, rule, "angles are in radians; are these degrees?")


def joint_layout(a: int) -> dict[str, int]:
    """Return name and size of every block of a strike vector for an arm with a joints."""
    return {"q_i": a, "q_f": a, "D": 1}


def checked_vectors(strikes: Any, width: int, whose: str) -> np.ndarray:
    """Return one strike or many, or their vectors, (width,) or (B, width), as finite vectors with positive durations,
    (B, width); `whose` describes the arm or space to which they belong, for messages.
    """
    given = array_of("strikes", strikes, f"a Strike, or an array of shape (B, {width}), for {whose}")
    vectors = np.ascontiguousarray(np.atleast_2d(given))
    if vectors.ndim != 2 or vectors.shape[1] != width:
        raise InputError("strikes", vectors.shape, f"an array of shape (B, {width}), for {whose}")
    if not np.isfinite(vectors).all() or not (vectors[:, -1] > 0).all():
        raise InputError("strikes", "a value that is not finite, or D <= 0", "finite angles and D > 0 s")
    return vectors
