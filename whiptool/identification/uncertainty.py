"""Uncertainty of a fit: covariance, and directions without information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit  # quantiles of Student's t; scipy.stats would take half a second to import

from whiptool.errors import InputError
from whiptool.identification.correlation import Autoregression, Grid, error_correlation, spread
from whiptool.identification.solver import Block, reduce
from whiptool.identification.variables import Variable, room

FLAT = 1.0  # standard error of a direction, relative, from which it counts as unseen
_SHARE = 0.05  # part of a flat direction from which a number belongs to it


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of the G shared unknowns z; each z is a logarithm or a scaled parameter (see `Variable`)."""

    variables: tuple[Variable, ...]  # of the G shared unknowns
    z: np.ndarray  # their estimate, (G,)
    covariance: np.ndarray  # of z without flat directions, for independent errors, (G, G)
    correlation: np.ndarray  # correlation matrix of `covariance`, (G, G)
    singular_values: np.ndarray  # of the Jacobian of the whitened residuals by z, largest first, (G,)
    directions: np.ndarray  # right singular vectors in rows, one for each singular value, (G, G)
    units: np.ndarray  # scale of each z for singular values and directions, (G,), see `variables.room`
    flat: np.ndarray  # which directions the recordings contain no information on, (G,)
    condition_number: float  # of the Jacobian with its columns scaled to unit length
    residual_variance: float  # variance of the whitened residuals; 1 if the stated errors are right
    freedom: float  # degrees of freedom of that variance, fewer if errors are correlated; intervals use Student's t
    stated: np.ndarray  # covariance of z if errors correlate as `errors` says, from which intervals follow, (G, G)
    whiteness: float  # correlation of successive residuals of one channel; 0 if independent
    errors: Autoregression  # autocorrelation of the errors of one channel, estimated from the residuals
    error_variance: float = 1.0  # variance of these errors, in units of the stated one

    @property
    def correlated(self) -> bool:
        """Whether successive errors are significantly correlated."""
        return len(self.errors.coefficients) > 0

    @property
    def sizes(self) -> np.ndarray:
        """Reference value of each unknown's relative change, (G,).

        1 for a logarithm; for a parameter that may be zero its magnitude, at least its standard error; for one whose
        zero is arbitrary its typical size, if larger than its magnitude.
        """
        errors = np.sqrt(np.diag(self.covariance))
        return np.array(
            [
                1.0 if v.log else max(abs(x), 1.0) if v.arbitrary_zero else max(abs(x), error) or 1.0
                for v, x, error in zip(self.variables, self.z, errors, strict=True)
            ]
        )

    @property
    def flat_changes(self) -> np.ndarray:
        """Relative changes of the G unknowns for a step of length 1 along each of the F flat directions, (F, G).

        Relative to `sizes`; with such a step no unknown changes by more than its entry in `units`.
        """
        return self.directions[self.flat] * self.units / self.sizes

    def product(self, powers: Mapping[str, float], level: float = 0.95) -> tuple[float, tuple[float, float] | None]:
        """Return a product of powers of positive parameters, such as k / m for `{"whip.k": 1, "whip.m": -1}`, and its
        interval at a level, None if the product is not determined. It can be determined although its parameters are
        not."""
        weights = np.zeros(len(self.z))
        names = [v.name for v in self.variables]
        for name, power in powers.items():
            weights[names.index(name)] = power
        middle = float(weights @ self.z)
        if np.linalg.norm((self.directions[self.flat] * self.units) @ weights) > _SHARE * np.linalg.norm(weights):
            return float(np.exp(middle)), None
        half = float(np.sqrt(weights @ self.stated @ weights) * stdtrit(self.freedom, (1 + level) / 2))
        return float(np.exp(middle)), (float(np.exp(middle - half)), float(np.exp(middle + half)))


def assess(
    variables: Sequence[Variable],
    z: np.ndarray,
    blocks: Sequence[Block],
    channels: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    prior: np.ndarray | None,
    *,
    values: Mapping[str, float] | None = None,
) -> Uncertainty:
    """Return the uncertainty of the shared unknowns z (G,) at the solution of a fit.

    The blocks are weighted residuals and derivatives of the data, followed by the rows that regularise a recording's
    own unknowns; each has the channels, integers (K,), and the times (K,) [s] of its first K residuals. The prior on z
    has rows (m, G). The scale of an unknown may depend on `values`, all parameters of the plant by name.
    """
    G, units = len(z), room(variables, z, values or {})
    J = np.vstack([reduce(block)[1][:, :G] for block in blocks])
    count = sum(len(c) for c in channels)
    squares = sum(float(b.r[: len(c)] @ b.r[: len(c)]) for b, c in zip(blocks, channels, strict=True))
    own = sum(_taken_up(b, len(c)) for b, c in zip(blocks, channels, strict=True))
    freedom = max(count - G - own, 1.0)
    variance = squares / freedom
    root = np.sqrt(max(variance, 1e-300))
    rows = J / root if prior is None else np.vstack([J / root, prior])
    rows = rows * units
    if not np.isfinite(rows).all():
        raise InputError(
            "fit",
            "a fit that ended where the model diverges",
            "finite derivatives",
            "start nearer to the solution, or set bounds",
        )
    s, directions = _by_singular_value(rows)
    flat = s < np.maximum(1 / FLAT, 1e-9 * s.max(initial=0.0))
    kept = directions[~flat]
    covariance = (kept.T / s[~flat] ** 2) @ kept * np.outer(units, units)
    root = (kept.T / s[~flat]) * units[:, None]
    errors, level, freedom, stated = _sandwich(blocks, channels, times, root, variance, freedom, prior)
    return Uncertainty(
        variables=tuple(variables),
        z=z,
        covariance=covariance,
        correlation=_correlation(covariance),
        singular_values=s,
        directions=directions,
        units=units,
        flat=flat,
        condition_number=_condition(rows),
        residual_variance=variance,
        freedom=freedom,
        stated=stated,
        whiteness=_whiteness(blocks, channels),
        errors=errors,
        error_variance=level,
    )


def _by_singular_value(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the singular values of rows (K, G), largest first, and the direction of each, (G,), (G, G)."""
    G = rows.shape[1]
    _, s, directions = np.linalg.svd(rows, full_matrices=False)
    if len(directions) < G:
        directions = np.linalg.svd(rows)[2]
    return np.concatenate([s, np.zeros(G - len(s))]), directions


def _condition(rows: np.ndarray) -> float:
    """Return the condition number of rows whose columns are scaled to unit length; infinite where a column is zero."""
    norms = np.linalg.norm(rows, axis=0)
    if not (norms > 0).all():
        return float("inf")
    unit = np.linalg.svd(rows / norms, compute_uv=False)
    return float(unit[0] / unit[-1]) if unit[-1] > 0 else float("inf")


def _correlation(covariance: np.ndarray) -> np.ndarray:
    sd = np.sqrt(np.diag(covariance))
    sd = np.where(sd > 0, sd, 1)
    return covariance / np.outer(sd, sd)


def _taken_up(block: Block, count: int) -> float:
    """How many of a recording's own unknowns its readings determine, rather than the rows that regularise them.

    There may be more unknowns than readings: a hand's motion has hundreds of coefficients.
    """
    rest, unknowns = block.B[count:], block.B.shape[1]
    if not len(rest):
        return min(unknowns, count)
    whole = block.B.T @ block.B
    return unknowns - float(np.trace(np.linalg.lstsq(whole, rest.T @ rest, rcond=None)[0]))


def _sandwich(
    blocks: Sequence[Block],
    channels: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    root: np.ndarray,
    variance: float,
    freedom: float,
    prior: np.ndarray | None,
) -> tuple[Autoregression, float, float, np.ndarray]:
    """How errors correlate, their variance and its degrees of freedom, and the covariance of z, (G, G). `root` is R (G,
    directions seen) such that `R R'` is the covariance for independent errors; see `assess` for the others."""
    grids = [Grid.of(channel, t) for channel, t in zip(channels, times, strict=True)]
    seen, followed, rest = [], [], []
    for block, channel in zip(blocks, channels, strict=True):
        own = np.linalg.qr(block.B)[0]
        along = (block.A - own @ (own.T @ block.A)) @ root  # what the recording's own unknowns cannot take up
        seen.append(along[: len(channel)])
        rest.append(along[len(channel) :])
        followed.append(np.hstack([seen[-1] / np.sqrt(max(variance, 1e-300)), own[: len(channel)]]))
    residuals = [block.r[: len(channel)] for block, channel in zip(blocks, channels, strict=True)]
    errors, level = error_correlation(grids, residuals, followed, root.shape[1], freedom)
    if not len(errors.coefficients):
        return errors, variance, freedom, root @ root.T
    scatter = level * spread(grids, residuals, seen, errors) + variance * sum(x.T @ x for x in rest)
    scatter = scatter / variance**2
    if prior is not None:
        scatter += (prior @ root).T @ (prior @ root)
    return errors, level, errors.independent(freedom, grids), root @ scatter @ root.T


def _whiteness(blocks: Sequence[Block], channels: Sequence[np.ndarray]) -> float:
    """Correlation of successive residuals of one channel, about its mean."""
    lagged = power = 0.0
    for block, channel in zip(blocks, channels, strict=True):
        for name in np.unique(channel):
            series = block.r[: len(channel)][channel == name]
            series = series - series.mean()
            lagged += float(series[1:] @ series[:-1])
            power += float(series @ series)
    return lagged / power if power > 0 else 0.0


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
    """Return every shared unknown with its class, error and interval at a level; in a fit that is `withdrawn`, because
    it is invalid, all classes but `flat` and `at bound` become `withdrawn`."""
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
