"""What a fit knows, and what it does not: covariance, block bootstrap, flat directions, classes of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from whiptool.errors import InputError
from whiptool.identification.solver import Block, reduce
from whiptool.identification.variables import Variable

PINNED = 0.1  # standard error, relative, up to which a number counts as pinned
FLAT = 1.0  # standard error of a direction, relative, from which it counts as unseen
_ROOM = 10.0  # a number that may be zero is seen up to so many times that: its interval still says something
_SHARE = 0.05  # part of a flat direction from which a number belongs to it
TRADED = 0.9  # correlation from which two numbers trade off
_SMALL = 0.05  # of its usual size, below which a number that may be zero counts as this
_BLOCK = 0.1  # [s], of residuals that are drawn together


@dataclass(frozen=True)
class Parameter:
    """One free number after the fit.

    Args:
        name, value, start: In its own unit.
        kind: `pinned`: known to 10 % or better; `weak`: not; `traded`: with all others known it would be pinned, but
            its error goes with that of `partner`; `flat`: the recordings do not see it; `at bound`: its bound stopped
            it.
        error: Standard error: relative where the number is positive, else in its unit; NaN if flat.
        interval: 95 % interval; None where there is none to give (flat, at bound).
        alone: Standard error if all other numbers were known.
        partner, correlation: The number it is most correlated with, and how much.
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


@dataclass(frozen=True)
class Uncertainty:
    """How well the shared unknowns z are known; z is a logarithm or a scaled number (see `Variable`).

    Args:
        variables: Of the G shared unknowns.
        z: Their estimate, (G,).
        covariance: Of z, flat directions left out, (G, G).
        correlation: The same, scaled, (G, G).
        singular_values: Of the Jacobian of the whitened residuals by z, largest first, (G,).
        directions: Which combination of z each one is for, rows, (G, G).
        units: What singular values and directions count z in, 1 for logarithms, (G,).
        flat: Which directions are unseen, (G,).
        flat_share: How far each unknown takes part in the unseen directions, 0 to 1, (G,).
        condition_number: Of the Jacobian with columns of unit length: what correlation alone does.
        residual_variance: Of the whitened residuals; 1 if the stated errors are right.
        freedom: Degrees of freedom of that variance.
        bootstrap: Covariance of z from the block bootstrap, (G, G).
        whiteness: Correlation of successive residuals of one channel, 0 if independent.
        correlated: Whether that is above 0 by more than chance; the intervals then come from the bootstrap.
    """

    variables: tuple[Variable, ...]
    z: np.ndarray
    covariance: np.ndarray
    correlation: np.ndarray
    singular_values: np.ndarray
    directions: np.ndarray
    units: np.ndarray
    flat: np.ndarray
    flat_share: np.ndarray
    condition_number: float
    residual_variance: float
    freedom: float
    bootstrap: np.ndarray
    whiteness: float
    correlated: bool

    @property
    def stated(self) -> np.ndarray:
        """The covariance that intervals are drawn from, (G, G)."""
        return self.bootstrap if self.correlated else self.covariance

    def product(self, powers: Mapping[str, float], level: float = 0.95) -> tuple[float, tuple[float, float] | None]:
        """A product of powers of positive numbers, such as k / m, and its interval; None if it is not seen.

        A combination can be known where its numbers are not.

        Args:
            powers: By name, such as `{"whip.k": 1, "whip.m": -1}`.
            level: Of the interval.
        """
        weights = np.zeros(len(self.z))
        names = [v.name for v in self.variables]
        for name, power in powers.items():
            weights[names.index(name)] = power
        middle = float(weights @ self.z)
        if np.linalg.norm(self.directions[self.flat] @ weights) > _SHARE * np.linalg.norm(weights):
            return float(np.exp(middle)), None
        half = float(np.sqrt(weights @ self.stated @ weights) * student.ppf((1 + level) / 2, self.freedom))
        return float(np.exp(middle)), (float(np.exp(middle - half)), float(np.exp(middle + half)))


def assess(
    variables: Sequence[Variable],
    z: np.ndarray,
    blocks: Sequence[Block],
    channels: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    prior: np.ndarray | None,
    *,
    rng: np.random.Generator,
    replicates: int = 400,
) -> Uncertainty:
    """Uncertainty of a fit at its end.

    Args:
        variables, z: Shared unknowns, G.
        blocks: Weighted residuals and derivatives of the data, then what regularises a recording's own unknowns.
        channels: Of each block, which series each of its first residuals belongs to, (K,) whole numbers.
        times: When they were measured [s], (K,).
        prior: Rows of the prior on z, (m, G).
        rng: For the bootstrap.
        replicates: Of the bootstrap.

    Raises:
        InputError: The fit ended where the model diverges.
    """
    G = len(z)
    projected = [_projected(block) for block in blocks]
    J = np.vstack([reduce(block)[1][:, :G] for block in blocks])
    # singular values are relative errors: a number that may be zero counts by its size, at least by its usual one,
    # and with room: a logarithm's error of more than 1 is a guess at its order of magnitude, this one's a bound
    units = np.array([1.0 if v.log else _ROOM * max(abs(x), 1.0) for v, x in zip(variables, z, strict=True)])
    count = sum(len(c) for c in channels)
    squares = sum(float(b.r[: len(c)] @ b.r[: len(c)]) for b, c in zip(blocks, channels, strict=True))
    own = sum(min(b.B.shape[1], len(c)) - _regularised(b, len(c)) for b, c in zip(blocks, channels, strict=True))
    freedom = max(count - G - own, 1.0)
    variance = squares / freedom
    root = np.sqrt(max(variance, 1e-300))
    rows = J / root if prior is None else np.vstack([J / root, prior])
    rows = rows * units
    if not np.isfinite(rows).all():
        raise InputError(
            "fit", "an end where the model diverges", "finite derivatives", "start nearer, or bound what is free"
        )
    _, s, directions = np.linalg.svd(rows, full_matrices=False)
    s = np.concatenate([s, np.zeros(G - len(s))])
    if len(directions) < G:
        directions = np.linalg.svd(rows)[2]
    flat = s < np.maximum(1 / FLAT, 1e-9 * s.max(initial=0.0))
    kept = directions[~flat]
    # who takes part in what is not seen: by relative changes, lest a small number hide behind large ones
    sizes = np.array([1.0 if v.log else max(abs(x), _SMALL) for v, x in zip(variables, z, strict=True)])
    unseen = np.linalg.qr((directions[flat] * units / sizes).T)[0] if flat.any() else np.zeros((G, 1))
    covariance = (kept.T / s[~flat] ** 2) @ kept * np.outer(units, units)
    norms = np.linalg.norm(rows, axis=0)
    seen = norms > 0
    unit = np.linalg.svd(rows[:, seen] / norms[seen], compute_uv=False) if seen.any() else np.ones(1)
    condition = float(unit[0] / unit[-1]) if seen.all() and unit[-1] > 0 else float("inf")
    drawn, whiteness, correlated = _bootstrap(
        projected, blocks, channels, times, covariance, variance, freedom, count, rng, replicates
    )
    return Uncertainty(
        variables=tuple(variables),
        z=z,
        covariance=covariance,
        correlation=_correlation(covariance),
        singular_values=s,
        directions=directions,
        units=units,
        flat=flat,
        flat_share=np.linalg.norm(unseen, axis=1),
        condition_number=condition,
        residual_variance=variance,
        freedom=freedom,
        bootstrap=drawn,
        whiteness=whiteness,
        correlated=correlated,
    )


def _correlation(covariance: np.ndarray) -> np.ndarray:
    sd = np.sqrt(np.diag(covariance))
    sd = np.where(sd > 0, sd, 1)
    return covariance / np.outer(sd, sd)


def _projected(block: Block) -> np.ndarray:
    """Derivatives by the shared unknowns with what the own ones can take up removed, (K, G)."""
    if not block.B.shape[1]:
        return block.A
    Q = np.linalg.qr(block.B)[0]
    return block.A - Q @ (Q.T @ block.A)


def _regularised(block: Block, count: int) -> float:
    """How many of a recording's own unknowns its regularising rows determine, rather than its readings."""
    rest = block.B[count:]
    if not len(rest):
        return 0.0
    whole = block.B.T @ block.B
    return float(np.trace(np.linalg.lstsq(whole, rest.T @ rest, rcond=None)[0]))


def _bootstrap(
    projected: Sequence[np.ndarray],
    blocks: Sequence[Block],
    channels: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    covariance: np.ndarray,
    variance: float,
    freedom: float,
    count: int,
    rng: np.random.Generator,
    replicates: int,
) -> tuple[np.ndarray, float, bool]:
    """Circular block bootstrap (Politis and Romano 1992) of the residuals, through the linearised fit."""
    draws = np.zeros((replicates, len(covariance)))
    lagged, number, power = 0.0, 0, 0.0
    inflate = np.sqrt(count / freedom)
    for A, block, channel, t in zip(projected, blocks, channels, times, strict=True):
        r = block.r[: len(channel)] * inflate
        gain = covariance @ A[: len(channel)].T / variance  # (G, K)
        starts = rng.random((replicates, len(r) + 1))
        for name in np.unique(channel):
            at = np.flatnonzero(channel == name)
            series = r[at] - r[at].mean()
            n = len(series)
            lagged += float(series[1:] @ series[:-1])
            power += float(series @ series)
            number += n
            step = np.median(np.diff(t[at])) if n > 1 else _BLOCK
            length = int(np.clip(round(_BLOCK / max(step, 1e-9)), 1, max(1, n // 4)))
            length = max(length, min(n, round(n ** (1 / 3))))
            pieces = -(-n // length)
            first = (starts[:, :pieces] * n).astype(int)  # the same places in every channel: they err together
            index = (first[:, :, None] + np.arange(length)).reshape(replicates, -1)[:, :n] % n
            draws += series[index] @ gain[:, at].T
    whiteness = lagged / power if power > 0 else 0.0
    # negative correlation is what many nuisance unknowns do to residuals: blocks would then promise too much
    correlated = number > 0 and whiteness > 3 / np.sqrt(number)
    return np.atleast_2d(np.cov(draws.T)), whiteness, bool(correlated)


def classify(uncertainty: Uncertainty, starts: Sequence[float], level: float = 0.95) -> list[Parameter]:
    """Every shared unknown with its class, error and interval."""
    U = uncertainty
    errors = np.sqrt(np.diag(U.stated))
    quantile = student.ppf((1 + level) / 2, U.freedom)
    with np.errstate(divide="ignore"):
        information = np.sqrt(((U.directions * U.singular_values[:, None]) ** 2).sum(axis=0))
        alone = U.units / information
    found = []
    for i, (v, start) in enumerate(zip(U.variables, starts, strict=True)):
        others = np.abs(U.correlation[i]).copy()
        others[i] = -1
        j = int(others.argmax()) if len(others) > 1 else None
        value, unit = v.value(U.z[i]), 1.0 if v.log else v.scale
        usual = 1.0  # what an error is large against: the number, or, if it may be zero, its usual size
        if not v.log and abs(U.z[i]) > 2 * errors[i]:
            usual = abs(U.z[i])
        in_flat = bool(U.flat_share[i] > _SHARE)
        if in_flat:
            kind = "flat"
        elif U.z[i] <= v.lower + 1e-6 or U.z[i] >= v.upper - 1e-6:
            kind = "at bound"
        elif errors[i] <= PINNED * usual:
            kind = "pinned"
        elif j is not None and others[j] >= TRADED and alone[i] <= PINNED * usual:
            kind = "traded"
        else:
            kind = "weak"
        interval = None
        if kind not in ("flat", "at bound"):
            low, high = (v.value(U.z[i] + sign * quantile * errors[i]) for sign in (-1, 1))
            interval = (low, high)
        found.append(
            Parameter(
                name=v.name,
                value=value,
                start=start,
                kind=kind,
                error=float("nan") if in_flat else float(errors[i] * unit),
                interval=interval,
                alone=float(alone[i] * unit),
                partner=None if j is None else U.variables[j].name,
                correlation=0.0 if j is None else float(U.correlation[i, j]),
            )
        )
    return found
