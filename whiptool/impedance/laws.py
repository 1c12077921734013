"""Control laws by name: constant impedance, online impedance adaptation (OIAC), position control."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeVar, runtime_checkable

import casadi as ca
import numpy as np

from whiptool.errors import InputError, expect
from whiptool.extras import Registry
from whiptool.models.numbers import NoArray, array_of, number
from whiptool.words import as_named


@runtime_checkable
class Law(Protocol):
    """A control law: it gives stiffness K and damping B from tracking errors e and their rates de.

    The torque is `tau = K e + B de` (Eq. 2). Laws are frozen dataclasses; the fields are the parameters, and `kind` is
    the name of the law.
    """

    kind: ClassVar[str]
    # further, where unknown whips are learned: `uncertain`, the names of single parameters that are not exactly known
    if TYPE_CHECKING:  # what makes it a dataclass
        __dataclass_fields__: ClassVar[dict[str, Any]]

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K [N m/rad] and B [N m s/rad], (..., n, n) each, for errors `e` [rad] and `de` [rad/s], (..., n).

        It is used by the MuJoCo simulator and by a rig.
        """
        ...

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """Torque (n, 1) as a CasADi expression of symbolic `parameters()` and errors, for the compiled simulator."""
        ...

    def sizes(self, n: int) -> dict[str, int]:
        """Names and lengths of `parameters()` for an arm of n joints. This implementation is for laws whose parameters
        are single numbers, of length 1."""
        return dict.fromkeys(self.parameters(), 1)

    def parameters(self) -> dict[str, np.ndarray]:
        """Return the law's parameters by name, each flattened, matrices row by row, as `expression` takes them."""
        return {f.name: np.ravel(getattr(self, f.name)) for f in fields(self)}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> Self:
        """Return the same law with other values of its `parameters`. This implementation is for laws whose parameters
        are single numbers, (1,) each."""
        return type(self)(**{name: float(x[0]) for name, x in numbers.items()})


LAWS: Registry[type[Law]] = Registry("laws", type, what="controller.law")
L = TypeVar("L", bound=type[Law])


def register(law: L) -> L:
    """Class decorator that registers a law under its `kind` for the compiled simulator, identification and files."""
    LAWS[law.kind] = law
    return law


Matrix = tuple[tuple[float, ...], ...]
_ROUNDING = 1e-9  # of eigenvalues, in parts of the largest gain


def _gain(name: str, value: object) -> Matrix | float:
    """Return a gain that was given as a square matrix, as its diagonal, or as one number for all joints."""
    rule = "a square matrix of finite numbers, its diagonal, or one number for all joints"
    array = array_of(name, value, rule)
    if array.ndim == 0:
        return float(array)
    if array.ndim == 1:
        array = np.diag(array)
    if array.ndim != 2 or not array.size or array.shape[0] != array.shape[1]:
        raise InputError(name, value, rule)
    return tuple(tuple(float(x) for x in row) for row in array)


def _check_acts_against(name: str, matrix: Matrix | float) -> None:
    """Refuse a gain that pushes a joint farther from its path, or drives it on."""
    gain = np.atleast_2d(matrix)
    if np.linalg.eigvalsh(gain + gain.T)[0] < -_ROUNDING * np.abs(gain).max():
        rule = "a matrix that acts against any error: its symmetric part has no eigenvalue below 0"
        raise InputError(name, matrix, rule)


@register
@dataclass(frozen=True)
class ConstantImpedance(NoArray, Law, instead="its K or B"):
    """`tau = K e + B de`; the default matrices are the paper's (Eq. 22, from Nah et al. 2020).

    `ConstantImpedance(100, 10)` gives every joint of any arm the same stiffness and damping.

    Args:
        K: Stiffness [N m/rad], (n, n), or its diagonal, (n,), or one number for all joints of any arm.
        B: Damping [N m s/rad], in the same forms.

    Raises:
        InputError: A matrix has another form, or another number of joints than the other, or its symmetric part has a
            negative eigenvalue, which would be unstable.
    """

    K: Matrix | float = ((29.5, 14.3), (14.3, 39.3))
    B: Matrix | float = ((2.95, 1.43), (1.43, 3.93))

    kind: ClassVar[str] = "constant"
    uncertain: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", _gain("K", self.K))
        object.__setattr__(self, "B", _gain("B", self.B))
        if isinstance(self.K, tuple) and isinstance(self.B, tuple) and len(self.K) != len(self.B):
            raise InputError("B", self.B, f"{len(self.K)} rows, as many as K")
        _check_acts_against("K", self.K)
        _check_acts_against("B", self.B)

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        K, B = (x if x.ndim else x * np.eye(np.shape(e)[-1]) for x in self._arrays)
        if np.ndim(e) == 1:  # what a rollout asks for at every stage of every step
            return K, B
        shape = (*np.shape(e), np.shape(e)[-1])
        return np.broadcast_to(K, shape), np.broadcast_to(B, shape)

    @cached_property
    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        arrays = np.array(self.K), np.array(self.B)
        for array in arrays:
            array.flags.writeable = False
        return arrays

    def sizes(self, n: int) -> dict[str, int]:
        return {name: n * n if isinstance(x, tuple) else 1 for name, x in (("K", self.K), ("B", self.B))}

    def changed(self, numbers: Mapping[str, np.ndarray]) -> ConstantImpedance:
        """Return the same law with other values of its `parameters`.

        All finite values are allowed, since fits may pass through invalid values.
        """
        law = object.__new__(ConstantImpedance)
        for name in ("K", "B"):
            object.__setattr__(law, name, _gain(name, np.reshape(numbers[name], np.shape(getattr(self, name)))))
        return law

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        n = e.numel()
        gains = (p["K"], p["B"])
        K, B = (x * ca.SX.eye(n) if x.numel() == 1 else ca.reshape(x, n, n).T for x in gains)  # row by row
        return K @ e + B @ de


def _scaled(K: Matrix, share: float) -> Matrix:
    return tuple(tuple(share * x for x in row) for row in K)


def _diagonal(*values: float) -> Matrix:
    return tuple(tuple(x if i == j else 0.0 for j in range(len(values))) for i, x in enumerate(values))


_NAH2023 = (
    (17.4, 6.85, -7.75, 8.4),
    (6.85, 33.0, 3.7, 0.0),
    (-7.75, 3.7, 27.7, 0.0),
    (8.4, 0.0, 0.0, 23.2),
)

# `nah2020`: Eq. 22, of a person's arm in the plane. `nah2023`: the same authors' in space (iScience 2023). The makers
# of the robots publish no gains. Ours give each joint of the arm 3 Hz, and of the wrist 5 Hz or more, with the largest
# inertia that it has in any posture, stick and rope with it, and damp it critically there; in other postures more so.
CONSTANT_PRESETS: dict[str, ConstantImpedance] = {
    "nah2020": ConstantImpedance(),
    "nah2023": ConstantImpedance(_NAH2023, _scaled(_NAH2023, 0.05)),
    "ur5e": ConstantImpedance(_diagonal(1700, 1700, 400, 100, 75, 5), _diagonal(180, 180, 40, 6, 5, 0.1)),
    "panda": ConstantImpedance(
        _diagonal(1200, 1200, 500, 350, 100, 100, 5), _diagonal(130, 130, 50, 40, 6.5, 6.5, 0.3)
    ),
    "fr3": ConstantImpedance(_diagonal(1250, 1250, 530, 370, 110, 100, 1), _diagonal(136, 136, 54, 40, 7, 6.5, 0.03)),
}


def constant_preset(name: str) -> ConstantImpedance:
    """Return the constant impedance called `name`, such as that of the arm `nah2023`.

    Raises:
        InputError: No preset has that name; the message lists the presets.
    """
    own = as_named(name, CONSTANT_PRESETS)
    if own not in CONSTANT_PRESETS:
        raise InputError("constant impedance", name, ", ".join(CONSTANT_PRESETS))
    return CONSTANT_PRESETS[own]


@register
@dataclass(frozen=True)
class OIAC(NoArray, Law, instead="its parameters()"):
    """Online impedance adaptation control: stiffness and damping that grow with the tracking error.

    `eps = e + beta de` (Eq. 8), `F = eps / gamma`, `K = F e^T`, `B = F de^T` (Eq. 9), `gamma = a / (1 + C |eps|^2)`
    (Eq. 10), `tau = K e + B de` (Eq. 2). Both matrices have rank one, and the torque is `eps (|e|^2 + |de|^2)(1 + C
    |eps|^2) / a`: cubic in the error, and zero at zero error.

    Args:
        a: Adaptation scale; smaller is stiffer.
        beta: Weight of the velocity error [s].
        C: Growth of the gain with the error.
    """

    a: float = 0.2
    beta: float = 0.6
    C: float = 5.0

    kind: ClassVar[str] = "oiac"
    uncertain: ClassVar[tuple[str, ...]] = ("a",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "a", number("a", self.a, low=0, strict=True))
        object.__setattr__(self, "beta", number("beta", self.beta, low=0))
        object.__setattr__(self, "C", number("C", self.C, low=0))

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        epsilon = e + self.beta * de  # Eq. 8
        gamma = self.a / (1 + self.C * np.vecdot(epsilon, epsilon))  # Eq. 10
        F = (epsilon / gamma[..., None])[..., :, None]  # Eq. 9
        return F * e[..., None, :], F * de[..., None, :]

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        epsilon = e + p["beta"] * de  # Eq. 8
        return epsilon * ((ca.sumsqr(e) + ca.sumsqr(de)) * (1 + p["C"] * ca.sumsqr(epsilon)) / p["a"])  # Eqs. 2, 9, 10


# `printed` is the paper's a = 0.2; `table4` is fitted to the four error ratios of Table 4 by
# benchmarks/table4_sweep.py, over random strikes of the default bounds.
OIAC_PRESETS: dict[str, OIAC] = {"printed": OIAC(), "table4": OIAC(a=1.3e-4)}


def oiac_preset(name: str) -> OIAC:
    """Return the OIAC preset called `name`.

    Raises:
        InputError: No preset has that name; the message lists the presets.
    """
    expect(str, name=name)
    own = as_named(name, OIAC_PRESETS)
    if own not in OIAC_PRESETS:
        raise InputError("OIAC preset", name, ", ".join(OIAC_PRESETS))
    return OIAC_PRESETS[own]


@register
@dataclass(frozen=True)
class PositionControl(Law):
    """Position control: joints follow the reference (Eq. 1) exactly, like those of stiff industrial robots.

    The motion is prescribed, and there are no tracking errors. The torques are those that this motion needs under the
    load of the whip, by inverse dynamics, so that torque limits can be checked. K and B are zero.
    """

    kind: ClassVar[str] = "position"
    uncertain: ClassVar[tuple[str, ...]] = ()

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Zeros for errors `e` and `de` of shape (..., n): each (..., n, n)."""
        zeros = np.zeros((*np.shape(e), np.shape(e)[-1]))
        return zeros, zeros.copy()

    @staticmethod
    def expression(p: dict[str, ca.SX], e: ca.SX, de: ca.SX) -> ca.SX:
        """Return zeros (n, 1): no torque depends on the errors."""
        return ca.SX.zeros(e.numel())
