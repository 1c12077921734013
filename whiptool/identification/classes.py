"""Classes of parameters: what a fit knows of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit  # quantiles of Student's t; scipy.stats would take half a second to import

from whiptool.identification.uncertainty import Uncertainty
from whiptool.identification.variables import Variable

DETERMINED = 0.1  # standard error, relative, up to which a number counts as well determined
MISFIT = 3.0  # residuals over what the recordings state, from which a fit explains nothing
TRADED = 0.9  # correlation from which two numbers trade off
_UNSEEN = 0.1  # relative change along an unseen direction from which a number is unseen itself


@dataclass(frozen=True)
class Parameter:
    """A free parameter after the fit.

    Args:
        name, value, start: Name, fitted value and starting value, in the parameter's unit.
        unit: SI unit; empty: none.
        kind: `well determined`: known to 10 % or better (a delay, rotation or shift, whose zero is arbitrary, to a
            tenth of its typical size); `weak`: less well; `traded`: well determined if all others were known, but its
            error is correlated with that of `partner`; `flat`: the recordings contain no information on it; `at bound`:
            it ended at a bound; `withdrawn`: the model does not explain the readings, or their times are wrong, so that
            no standard error is valid. All classes assume that the model's form is right.
        error: Standard error of the value, in its unit; NaN if flat or withdrawn.
        interval: 95 % interval; None for the classes flat, at bound and withdrawn.
        alone: Standard error if all other parameters were known; NaN if withdrawn.
        partner, correlation: The parameter with which it is most correlated, and the correlation.
    """

    name: str
    value: float
    start: float
    kind: str
    error: float
    interval: tuple[float, float] | None
    alone: float
    partner: str | None
    correlation: float
    unit: str = ""


def classify(
    uncertainty: Uncertainty, starts: Sequence[float], level: float = 0.95, *, withdrawn: bool = False
) -> list[Parameter]:
    """Return every shared unknown with its class, error and interval.

    Args:
        uncertainty: Uncertainty at the best of the solutions.
        starts: Starting value of each unknown.
        level: Level of the intervals.
        withdrawn: Whether the fit is invalid, so that all classes but `flat` and `at bound` become `withdrawn`.
    """
    U = uncertainty
    errors, alone = np.sqrt(np.diag(U.stated)), _alone(U)
    half = stdtrit(U.freedom, (1 + level) / 2) * errors
    unseen = np.linalg.norm(U.flat_changes, axis=0) > _UNSEEN
    sizes = [_own_size(v, z) for v, z in zip(U.variables, U.z, strict=True)]
    found = []
    for i, (v, start) in enumerate(zip(U.variables, starts, strict=True)):
        j = _partner(U, i)
        kind = _kind(
            not v.bound(U.z[i]),
            unseen=bool(unseen[i]),
            error=errors[i] / sizes[i] if sizes[i] else np.inf,
            alone=alone[i] / sizes[i] if sizes[i] else np.inf,
            correlation=0.0 if j is None else float(abs(U.correlation[i, j])),
        )
        if withdrawn and kind not in ("flat", "at bound"):
            kind = "withdrawn"
        unit, interval = v.slope(U.z[i]), None
        if kind not in ("flat", "at bound", "withdrawn"):
            interval = v.value(U.z[i] - half[i]), v.value(U.z[i] + half[i])
        found.append(
            Parameter(
                name=v.name,
                value=v.value(U.z[i]),
                start=start,
                kind=kind,
                error=float("nan") if unseen[i] or withdrawn else float(errors[i] * unit),
                interval=interval,
                alone=float("nan") if withdrawn else float(alone[i] * unit),
                partner=None if j is None else U.variables[j].name,
                correlation=0.0 if j is None else float(U.correlation[i, j]),
                unit=v.unit,
            )
        )
    return found


def _own_size(v: Variable, z: float) -> float:
    """What an error of z is large or small against: the number itself, however large such numbers usually are; the
    usual size where its zero is arbitrary."""
    if v.log:
        return 1.0
    return max(abs(z), 1.0) if v.arbitrary_zero else abs(z)


def _kind(inside: bool, *, unseen: bool, error: float, alone: float, correlation: float) -> str:
    """The class of a number whose errors are relative."""
    if unseen:
        return "flat"
    if not inside:
        return "at bound"
    if error <= DETERMINED:
        return "well determined"
    return "traded" if correlation >= TRADED and alone <= DETERMINED else "weak"


def _alone(U: Uncertainty) -> np.ndarray:
    """Standard error of each z if all others were known, (G,)."""
    information = np.sqrt(((U.directions * U.singular_values[:, None]) ** 2).sum(axis=0))
    with np.errstate(divide="ignore"):
        return U.units / information


def _partner(U: Uncertainty, i: int) -> int | None:
    """Which unknown the i-th is most correlated with."""
    others = np.abs(U.correlation[i]).copy()
    others[i] = -1
    return int(others.argmax()) if len(others) > 1 else None
