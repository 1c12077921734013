"""What an impedance law is, and where laws are found by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar, runtime_checkable

import numpy as np

from whiptool.extras import Registry

if TYPE_CHECKING:
    import casadi as ca


@runtime_checkable
class Law(Protocol):
    """A control law: stiffness and damping from tracking errors, `tau = K e + B de` (Eq. 2). A frozen dataclass of
    numbers.
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
        """Names and lengths of `parameters()` for an arm of n joints."""
        ...

    def parameters(self) -> dict[str, np.ndarray]:
        """Return the law's parameters by name, each flattened, matrices row by row."""
        ...

    def changed(self, numbers: Mapping[str, np.ndarray]) -> Law:
        """Return the same law with other values of its `parameters`."""
        ...


LAWS: Registry[type[Law]] = Registry("laws", type, what="controller.law")
L = TypeVar("L", bound=type[Law])


def register(law: L) -> L:
    """Class decorator that registers a law under its `kind` for the compiled simulator, identification and files."""
    LAWS[law.kind] = law
    return law
