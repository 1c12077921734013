"""Free parameters as variables of the solver: logarithms of positive parameters, others scaled; bounds and priors."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.models.parameters import AnyArm
from whiptool.words import rounded

_LINK = {
    "mass": "kg", "length": "m", "com": "m", "inertia": "kg m^2", "friction": "N m s/rad",
    "position": "m", "armature": "kg m^2", "hand_position": "m",
}  # fmt: skip
_UNITS = {
    "whip": {
        "l": "m", "m": "kg", "k": "N m/rad", "b": "N m s/rad", "rest_angle": "rad", "dry_friction": "N m",
        "friction_velocity": "rad/s", "drag": "N s^2/m^2", "hinge_mass": "kg",
        "cubic_stiffness": "N m/rad^3", "rest_angle_x": "rad", "node_inertia": "kg m^2",
    },
    "arm": _LINK,
    "link": {**_LINK, "dry_friction": "N m", "drag": "N s^2/m^2", "zero": "rad"},
    "profile": {
        "length": "m", "linear_density": "kg/m", "bending_stiffness": "N m^2", "bending_damping": "N m^2 s",
        "rest_curvature": "1/m", "drag": "N s^2/m^3", "tip_mass": "kg", "bead_mass": "kg",
    },
    "law": {"beta": "s", "K": "N m/rad", "B": "N m s/rad"},
    "": {
        "gravity": "m/s^2", "friction_velocity": "rad/s",
        "torque_limit": "N m", "delay": "s", "clamp": "rad", "rotation": "rad", "shift_x": "m", "shift_y": "m",
        "rotation_x": "rad", "rotation_y": "rad", "rotation_z": "rad", "shift_z": "m", "smoothing": "s",
    },
}  # fmt: skip


_OF_SLIDES = {"friction": "N s/m", "armature": "kg", "torque_limit": "N"}


def unit_of(name: str, slides: Sequence[bool] = ()) -> str:
    """Return the unit of a parameter such as `whip.k[3]`, `arm.com[0].x`, `profile.length` or `delay`; empty if it has
    none. That of a gain depends on which joints slide (default: none): `law.K[1]` of two joints is torque of joint 1
    per position of joint 2."""
    group, dot, quantity = name.partition(".")
    group, quantity = (group, quantity) if dot else ("", name)
    symbol, _, rest = quantity.split(".")[0].partition("[")
    if any(slides) and rest:
        number = int(rest.rstrip("]"))
        if group == "law" and symbol in ("K", "B"):
            row, column = divmod(number, len(slides))
            return _gain(symbol, force=slides[row], length=slides[column])
        if group in ("arm", "") and symbol in _OF_SLIDES and slides[number]:
            return _OF_SLIDES[symbol]
    return _UNITS.get(group, {}).get(symbol, "")


def _gain(symbol: str, *, force: bool, length: bool) -> str:
    """Return the unit of a stiffness K or damping B: of a force or a torque, per length or angle."""
    return f"{'N' if force else 'N m'}{' s' if symbol == 'B' else ''}/{'m' if length else 'rad'}"


def units(arm: AnyArm, controller: Controller | None, names: Sequence[str]) -> dict[str, str]:
    """Return the units of parameters by name; those of gains depend on which joints are prismatic and on whether the
    hand is controlled.
    """
    of_law = of_arm = [joint in arm.slides for joint in arm.joints]
    if controller is not None and controller.hand is not None:
        of_law = [name[0] in "xyz" for name in controller.strike_space(arm).names if name.endswith("_i")]
    return {name: unit_of(name, of_law if name.startswith("law.") else of_arm) for name in names}


def with_unit(value: float, unit: str, digits: int = 5) -> str:
    """Return a value with its unit as text, rounded to `digits` significant digits."""
    return f"{rounded(value, digits)} {unit}".strip()


def names_of(name: str, known: Collection[str]) -> list[str]:
    """Return the full parameter names for an abbreviated name; empty if no name fits.

    A full name such as `whip.k` is unchanged, `k` stands for every name that ends with `.k`, and `com`, if no name ends
    with it, its elements `link.com[0]`, `link.com[1]`, ...
    """
    if name in known:
        return [name]
    ends = [full for full in known if full.endswith(f".{name}")]
    return ends or [full for full in known if f".{full.partition('[')[0]}".endswith(f".{name}")]


_FACTOR = 1e3  # a positive number is sought within this factor of its first value
# usual size of what may be zero or of either sign, in its own unit
_ZERO_OR_MORE = {
    "drag": 1e-3, "drag_ratio": 1.0, "dry_friction": 1e-3,
    "cubic_stiffness": 1.0, "hinge_mass": 1e-2, "node_inertia": 1e-6, "tip_mass": 1e-2, "friction": 1e-2,
    "bending_damping": 1e-3, "bead_mass": 1e-2, "bead_place": 0.1,
}  # fmt: skip
_ANY_SIGN = {
    "rest_angle": 0.1, "rest_angle_x": 0.1, "rest_curvature": 0.1, "delay": 0.01, "clamp": 0.1, "zero": 0.01,
    "rotation": 0.01, "rotation_x": 0.01, "rotation_y": 0.01, "rotation_z": 0.01,
    "shift_x": 0.01, "shift_y": 0.01, "shift_z": 0.01,
    "density_waves": 0.1, "stiffness_waves": 0.1, "K": 1.0, "B": 0.1,
}  # fmt: skip
_AT_MOST = {"bead_place": 1.0}
_ARBITRARY_ZERO = (  # whose smallness says nothing
    "delay", "rotation", "rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y", "shift_z", "clamp", "zero",
)  # fmt: skip
_ROOM = 10.0  # a number that may be zero is seen up to so many times its usual size: its interval still says something
_AT_BOUND = 1e-6  # of z, within which a fit ended at a bound
_OFF_BOUND = 0.05  # of the usual size, or of a bounded range: how far from a bound a fit starts


@dataclass(frozen=True)
class Variable:
    """A free parameter as the solver sees it: z is its logarithm if `log`, else the parameter divided by `scale`;
    `lower` and `upper` are the bounds of z, and `unit` is the parameter's unit."""

    name: str
    log: bool
    scale: float
    lower: float  # of z
    upper: float
    unit: str = ""

    @property
    def arbitrary_zero(self) -> bool:
        """Whether the zero of the parameter is arbitrary: a position or time that was chosen by hand."""
        return _quantity(self.name) in _ARBITRARY_ZERO

    def value(self, z: float) -> float:
        """Return the parameter's value for a value of the solver's variable."""
        return float(np.exp(z) if self.log else z * self.scale)

    def z(self, value: float) -> float:
        """Return the solver's variable for a value of the parameter."""
        return float(np.log(value) if self.log else value / self.scale)

    def slope(self, z: float) -> float:
        """Return the derivative of the value by z."""
        return float(np.exp(z) if self.log else self.scale)

    def bound(self, z: float) -> str:
        """Return which bound a value of z lies at: `lower`, `upper`, or empty if it lies inside."""
        if z <= self.lower + _AT_BOUND:
            return "lower"
        return "upper" if z >= self.upper - _AT_BOUND else ""

    def off_bounds(self, z: float) -> float:
        """Return z moved slightly inside its bounds, because a fit that starts at a bound stalls."""
        margin = min(_OFF_BOUND, _OFF_BOUND * (self.upper - self.lower))
        return float(np.clip(z, self.lower + margin, self.upper - margin))


def _quantity(name: str) -> str:
    """Return the quantity in a parameter's name: `zero` of `link.zero[1]`."""
    return name.split(".")[-1].split("[")[0]


def variable(name: str, value: float, bounds: tuple[float, float] | None = None, unit: str | None = None) -> Variable:
    """Return the solver's variable of a parameter with this name, starting value and bounds; the default unit is that
    with revolute joints."""
    quantity = _quantity(name)
    if bounds is not None and not bounds[0] < bounds[1]:
        raise InputError(f"bounds of {name}", bounds, "lower < upper")
    low, high = (-np.inf, np.inf) if bounds is None else bounds
    high = min(high, _AT_MOST.get(quantity, np.inf))
    unit = unit_of(name) if unit is None else unit
    if quantity in _ZERO_OR_MORE:
        scale = _ZERO_OR_MORE[quantity]
        return Variable(name, False, scale, max(low, 0.0) / scale, high / scale, unit)
    if quantity in _ANY_SIGN:
        scale = _ANY_SIGN[quantity]
        return Variable(name, False, scale, low / scale, high / scale, unit)
    if value <= 0:
        raise InputError(f"start of {name}", value, "a number > 0", "start from a guess of its size")
    z = np.log(value)
    lower = np.log(low) if low > 0 else z - np.log(_FACTOR)
    upper = np.log(high) if np.isfinite(high) else z + np.log(_FACTOR)
    return Variable(name, True, 1.0, float(lower), float(upper), unit)


@dataclass(frozen=True)
class Prior:
    """Normal prior of free parameters; that of positive parameters is on the logarithm.

    Args:
        names: Names of m free parameters that are the same for all recordings.
        mean: Prior values in the parameters' units, (m,).
        covariance: Covariance, of the logarithms for positive parameters (relative errors), (m, m).

    Raises:
        InputError: Shapes do not fit, or the covariance is not positive definite.
    """

    names: tuple[str, ...]
    mean: tuple[float, ...]
    covariance: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "mean", tuple(map(float, self.mean)))
        covariance = np.array(self.covariance, float)
        m = len(self.names)
        if len(self.mean) != m or covariance.shape != (m, m):
            raise InputError("prior", f"{len(self.mean)} means, covariance {covariance.shape}", f"{m} and ({m}, {m})")
        if not np.allclose(covariance, covariance.T) or not np.linalg.eigvalsh(covariance).min() > 0:
            raise InputError("covariance of the prior", "not positive", "a symmetric positive definite matrix")
        object.__setattr__(self, "covariance", covariance)

    def rows(self, variables: Sequence[Variable]) -> tuple[np.ndarray, np.ndarray]:
        """Return `W` (m, G) and `mean` (G,) such that `W (z - mean)` is standard normal a priori for G variables z."""
        at = {v.name: i for i, v in enumerate(variables)}
        for name in self.names:
            if name not in at:
                raise InputError("prior", name, "one of the free parameters " + ", ".join(at))
        columns = [at[name] for name in self.names]
        chosen = [variables[i] for i in columns]
        mean = np.zeros(len(variables))
        mean[columns] = [v.z(x) for v, x in zip(chosen, self.mean, strict=True)]
        units = np.array([v.scale for v in chosen])  # 1 for logarithms
        root = np.linalg.cholesky(np.linalg.inv(self.covariance / np.outer(units, units)))
        W = np.zeros((len(columns), len(variables)))
        W[:, columns] = root.T
        return W, mean


def room(variables: Sequence[Variable], z: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """Return the error of each of the G unknowns above which it counts as not determined, in units of their values z,
    (G,).

    For a positive parameter it is a factor of e, for a parameter that may be zero ten times its magnitude or its
    typical size, whichever is larger. An inertia about the centre of mass may become negligible, so that its logarithm
    has no effect; the value returned for it is at least the inertia of a rod with the link's mass and length.
    """
    return np.array([_room(v, float(x), values) for v, x in zip(variables, z, strict=True)])


def _room(v: Variable, x: float, values: Mapping[str, float]) -> float:
    if not v.log:
        return _ROOM * max(abs(x), 1.0)
    group, _, quantity = v.name.partition(".")
    if not quantity.startswith("inertia["):
        return 1.0
    mass, length = (values[f"{group}.{quantity.replace('inertia', name)}"] for name in ("mass", "length"))
    return max(1.0, mass * length**2 / 12 / v.value(x))


def variables_of(
    values: Mapping[str, float],
    names: Sequence[str],
    bounds: Mapping[str, tuple[float, float]],
    units: Mapping[str, str],
) -> list[Variable]:
    """Return the solver's variables of the parameters `names`, with starting values, bounds and units by name; bounds
    of others are refused."""
    for name in bounds:
        if name not in names:
            raise InputError(f"bounds of {name}", bounds[name], "bounds of free parameters: " + ", ".join(names))
    return [variable(name, values[name], bounds.get(name), units.get(name)) for name in names]
