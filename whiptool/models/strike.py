"""A strike: the arm moves from q_i to q_f in D seconds along a minimum-jerk path (Eq. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, overload

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.arrays import ArrayLike, Vector, made_of_numbers
from whiptool.models.numbers import ends_and_duration, number, numbers, whole
from whiptool.models.parameters import ArmParameters, Model
from whiptool.models.planar_arm import AnyArm
from whiptool.models.spatial_arm import SpatialArm

PI = math.pi
FASTEST = 15 / 8  # largest speed of a minimum-jerk path (Eq. 1), in spans per duration
LARGEST_ACCELERATION = 10 / math.sqrt(3)  # likewise, per squared duration
LARGEST_JERK = 60.0  # likewise, per cubed duration: at both ends
T_STAY = 0.3  # [s] that a strike is watched after the movement ended; not printed in the paper


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
    """Reference trajectory (zero-torque trajectory) of the arm's n joints; it converts to an array, its `vector`.

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
        """Desired positions, velocities and accelerations at times t [s], each of shape (*t.shape, n); Eq. 1.

        Before time 0 the position is `q_i`, after D it is `q_f`.
        """
        if isinstance(t, float):
            s = min(max(t / self.D, 0.0), 1.0)
        else:
            s = np.clip(np.asarray(t, float) / self.D, 0.0, 1.0)[..., None]
        q_i, span = self._ends
        position = q_i + span * (s**3 * (10 - 15 * s + 6 * s**2))  # Eq. 1
        velocity = span * (30 * s**2 * (1 - s) ** 2 / self.D)
        acceleration = span * (60 * s * (1 - s) * (1 - 2 * s) / self.D**2)
        return position, velocity, acceleration


@dataclass(frozen=True)
class StrikeBounds(ArrayLike):
    """Box in which strikes are searched; `lower` and `upper` are in the order of `Strike.vector`. It converts to an
    array (2, 2 n + 1).

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
        return rng.uniform(lower, upper, (whole("size", size, low=0), len(lower)))


def eased(t: np.ndarray, D: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the fraction of a minimum-jerk path (Eq. 1) at times t [s], and its first two time derivatives."""
    s = np.clip(t / D, 0.0, 1.0)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    return share, 30 * s**2 * (1 - s) ** 2 / D, 60 * s * (1 - s) * (1 - 2 * s) / D**2


_PERSON = ("shoulder_flexion", "shoulder_abduction", "shoulder_rotation", "elbow")
_D = (0.4, 1.5)  # [s]; none is printed


def is_person(arm: AnyArm) -> bool:
    """Whether an arm has the joints of the human arm of Nah et al. 2023."""
    return arm.joints == _PERSON


def default_bounds(arm: AnyArm | Model) -> StrikeBounds:
    """Return the default bounds of strikes of an arm, or of a model's arm [rad or m], [s].

    For the planar arm of two joints the bounds are ours, because the paper prints none. For the human arm they are
    those of Nah et al. 2023. For other arms in space they are the position limits of the joints, at most half a turn to
    either side.

    Raises:
        InputError: The arm has no default bounds; give bounds.
    """
    arm = arm.arm if isinstance(arm, Model) else arm
    expect(ArmParameters, SpatialArm, arm=arm)
    if arm.dimension == 3:
        return _person_bounds() if is_person(arm) else _bounds_of_limits(arm)
    if arm.n == 2:
        return StrikeBounds((-0.5 * PI, 0.0, 0.1 * PI, 0.0, _D[0]), (-0.1 * PI, 0.9 * PI, PI, 0.9 * PI, _D[1]))
    rule = f"lower and upper, {2 * arm.n + 1} numbers each (joints of the arm: {arm.n})"
    raise InputError("bounds", "none", rule, "give --lower and --upper")


def _person_bounds() -> StrikeBounds:
    lower = PI * np.array([-0.5, -0.5, -0.5, 0.0, 0.1, -0.5, -0.5, 0.0])
    upper = PI * np.array([-0.1, 0.5, 0.5, 0.9, 1.0, 0.5, 0.5, 0.9])
    return StrikeBounds((*lower, _D[0]), (*upper, _D[1]))


def _bounds_of_limits(arm: AnyArm) -> StrikeBounds:
    low, high = np.array([limits.position for limits in arm.joint_limits]).T
    around = arm.turns & (high - low > 2 * PI)
    low, high = np.where(around, -PI, low), np.where(around, PI, high)
    return StrikeBounds((*low, *low, _D[0]), (*high, *high, _D[1]))
