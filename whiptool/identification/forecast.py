"""Standard errors of predicted readings, calibrated by the fitted recordings.

A predicted reading differs from the reading by `A (dz + d) + B dx - e`: the error `dz` of the shared parameters, their
deviation `d` in this recording from their mean over all recordings, the error `dx` of the recording's own unknowns,
which its first readings determine, and the error `e` of the reading. What a model lacks shows in two ways: as errors of
readings, with the size and autocorrelation that the fit left; and as parameters that differ from recording to
recording (Sargsyan, Najm and Ghanem 2015), whose effect grows with time as that of the parameters does. How large both
are is estimated from the fitted recordings, each predicted from its first readings as a held-out one is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.optimize import minimize
from scipy.special import stdtrit
from scipy.stats import t as student

from whiptool.identification.correlation import Grid
from whiptool.identification.solver import Block, reduce
from whiptool.identification.uncertainty import Uncertainty

_STARTS = ((0.0, 0.0), (-3.0, 5.0), (0.0, 5.0))  # logarithms of `share` and `between` at which their search starts


@dataclass(frozen=True)
class Readings:
    """A recording's K readings as a prediction sees them."""

    block: Block  # residuals, K of readings and then those that regularise the own unknowns, with their derivatives
    known: np.ndarray  # 1 for readings to which the own unknowns are fitted, 0 for those that are predicted, (K,)
    channel: np.ndarray  # channel of each reading, (K,)
    t: np.ndarray  # time of each reading [s], (K,)


@dataclass(frozen=True)
class Forecast:
    """Distribution of the errors of predicted readings. Its `covariance` is that of the shared unknowns of a recording
    that was not fitted, about their fitted values, if parameters differ between recordings as the fit's covariance
    says."""

    uncertainty: Uncertainty  # of the G shared unknowns
    covariance: np.ndarray  # (G, G)
    share: float = 1.0  # variance of the readings' errors, over that of the fit's residuals
    between: float = 0.0  # factor of `covariance`; 0 if only one recording was fitted: differences are unknown
    freedom: float = np.inf  # degrees of freedom of Student's t distribution of the errors

    def standard_errors(self, readings: Readings) -> np.ndarray:
        """Return the standard errors of predicted minus measured readings, in units of their stated errors, (K,)."""
        moved, reading_errors = _parts(readings, self.uncertainty)
        cov = self.between * self.covariance if self.between else self.uncertainty.stated
        return np.sqrt(self.share * reading_errors + np.einsum("kg,gh,kh->k", moved, cov, moved))


def calibrated(fitted: Sequence[Readings], pseudo: Sequence[Block], uncertainty: Uncertainty) -> Forecast:
    """Return the forecast whose standard errors fit the errors that the fitted recordings show when each of them is
    predicted from its first readings.

    The fit's parameters are kept, and their covariance is reduced by what each recording contributed to them. For each
    recording, `pseudo` is a block of least squares that errs as the fit does.
    """
    seen = ~uncertainty.flat
    root = (uncertainty.directions[seen].T / uncertainty.singular_values[seen]) * uncertainty.units[:, None]
    information = []  # of each recording, of all of them the identity
    for block in pseudo:
        J = reduce(block)[1][:, :-1] @ root / np.sqrt(max(uncertainty.residual_variance, 1e-300))
        information.append(J.T @ J)
    one, total = np.eye(root.shape[1]), np.sum([n @ n for n in information], axis=0)
    covariance = root @ (one + total) @ root.T
    if len(fitted) < 2 or not seen.any():
        return Forecast(uncertainty, covariance, freedom=uncertainty.freedom)
    errors, from_readings, from_parameters = [], [], []
    for readings, n in zip(fitted, information, strict=True):
        predicted = readings.known == 0
        moved, variance = _parts(readings, uncertainty)
        left = root @ ((one - n) @ (one - n) + total - n @ n) @ root.T
        errors.append(_as_predicted(readings)[predicted])
        from_readings.append(variance[predicted])
        from_parameters.append(np.einsum("kg,gh,kh->k", moved, left, moved)[predicted])
    share, between = _likeliest(
        np.concatenate(errors), np.concatenate(from_readings), np.concatenate(from_parameters), len(fitted)
    )
    return Forecast(uncertainty, covariance, share, between, float(len(fitted)))


def half_width(level: float, freedom: float) -> float:
    """Return half the width of an interval of this level, in standard errors."""
    return float(stdtrit(freedom, (1 + level) / 2))


def own_errors(readings: Readings, uncertainty: Uncertainty) -> np.ndarray:
    """Return the standard errors of a recording's own unknowns, as its known readings determine them, (L,)."""
    gain, covariance = _gain(readings)
    moved = gain.T @ readings.block.A[: len(gain)]
    covariance += moved @ uncertainty.stated @ moved.T
    for x in Grid.of(readings.channel, readings.t).lay(gain):
        correlated = matmul_toeplitz(uncertainty.errors.correlations(len(x)), x)
        covariance += uncertainty.error_variance * x.T @ correlated
    return np.sqrt(np.diag(covariance))


def _gain(readings: Readings) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the own unknowns by the errors of the readings, (K, L), 0 for predicted ones, and the covariance
    that the regularising rows leave them, (L, L)."""
    count, known = len(readings.known), readings.known > 0
    B, W = readings.block.B[:count], readings.block.B[count:]
    spread = np.linalg.inv(B[known].T @ B[known] + W.T @ W)
    gain = np.zeros(B.shape)
    gain[known] = B[known] @ spread
    return gain, spread @ W.T @ W @ spread


def _parts(readings: Readings, uncertainty: Uncertainty) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the errors by the shared unknowns, (K, G), and the variance from errors of readings, (K,)."""
    count = len(readings.known)
    A, B = readings.block.A[:count], readings.block.B[:count]
    if not B.shape[1]:
        return A, np.full(count, uncertainty.error_variance)
    gain, left = _gain(readings)
    moved = A - B @ (gain.T @ A)
    variance = uncertainty.error_variance * _from_errors(B, gain, readings, uncertainty)
    return moved, variance + np.einsum("kl,lm,km->k", B, left, B)


def _from_errors(B: np.ndarray, gain: np.ndarray, readings: Readings, uncertainty: Uncertainty) -> np.ndarray:
    """Variance of `B gain' e - e` for errors e of unit variance with their autocorrelation, (K,)."""
    grid = Grid.of(readings.channel, readings.t)
    row, frame = grid.place
    correlation = uncertainty.errors.correlations(grid.frames)
    own, shared = np.zeros((B.shape[1],) * 2), np.zeros(len(B))
    for c, laid in enumerate(grid.lay(gain)):
        passed = matmul_toeplitz(correlation, laid)
        own += laid.T @ passed
        mine = row == c
        shared[mine] = np.einsum("kl,kl->k", B[mine], passed[frame[mine]])
    return np.maximum(1 + np.einsum("kl,lm,km->k", B, own, B) - 2 * shared, 0.0)


def _as_predicted(readings: Readings) -> np.ndarray:
    """Residuals of a fitted recording with its own unknowns fitted to the known readings only, (K,)."""
    block, known = readings.block, readings.known > 0
    count = len(known)
    B, W = block.B[:count], block.B[count:]
    if not B.shape[1]:
        return block.r[:count]
    normal = B[known].T @ B[known] + W.T @ W
    change = np.linalg.solve(normal, B[known].T @ block.r[:count][known] + W.T @ block.r[count:])
    return block.r[:count] - B @ change


def _likeliest(
    errors: np.ndarray, from_readings: np.ndarray, from_parameters: np.ndarray, freedom: float
) -> tuple[float, float]:
    """Return the factors of both variances that make the errors likeliest, each reading counted alike."""

    def cost(logarithms: np.ndarray) -> float:
        share, between = np.exp(np.clip(logarithms, -20, 20))
        scale = np.sqrt(share * from_readings + between * from_parameters)
        return -float(np.mean(student.logpdf(errors, freedom, scale=np.maximum(scale, 1e-12))))

    ends = [minimize(cost, start, method="Nelder-Mead") for start in _STARTS]
    share, between = np.exp(np.clip(min(ends, key=lambda end: end.fun).x, -20, 20))
    return float(share), float(between)
