"""Faults of a recording's times: the regression on them beside one of everything, and how often it is fooled."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from whiptool.identification.solver import Block
from whiptool.identification.time_base import SIGNIFICANCE, FittedReadings, likeliest_fault

T = np.arange(80) / 60
SLOPES = [40 * np.sin(5 * T), 30 * np.cos(4 * T + 1)]  # standard errors a second


def readings(errors: list[np.ndarray], clock: dict | None = None) -> list[FittedReadings]:
    """Two recordings with two shared unknowns and one of their own, which is regularised; fitted by least squares."""
    rng = np.random.default_rng(0)
    A = [np.stack([np.cos(3 * T + i), T**2], axis=1) for i in range(2)]
    B = [np.vstack([rng.normal(size=(80, 1)), [[2.0]]]) for _ in range(2)]
    padded = [np.vstack([a, np.zeros((1, 2))]) for a in A]
    blocks = [Block(np.append(e, 0.0), a, b) for e, a, b in zip(errors, padded, B, strict=True)]
    whole = np.zeros((162, 4))
    for i, block in enumerate(blocks):
        whole[81 * i : 81 * i + 81, :2], whole[81 * i : 81 * i + 81, 2 + i] = block.A, block.B[:, 0]
    r = np.concatenate([block.r for block in blocks])
    r = r - whole @ np.linalg.lstsq(whole, r, rcond=None)[0]
    blocks = [Block(x, block.A, block.B) for x, block in zip(np.split(r, 2), blocks, strict=True)]
    return [FittedReadings(b, np.zeros(80, int), T, s, clock or {}) for b, s in zip(blocks, SLOPES, strict=True)]


def noise(seed: int) -> list[np.ndarray]:
    return list(np.random.default_rng(seed).standard_normal((2, 80)))


@pytest.mark.parametrize(
    ("kind", "at", "pattern"),
    [("delay", None, np.ones(80)), ("clock_rate", None, T), ("jump", T[40], (T[40] <= T).astype(float))],
)
def test_a_fault_is_found_with_its_size_and_error(kind, at, pattern):
    """Size and error are those of one regression on all unknowns and the fault; a reading is late by its slope."""
    errors = noise(1)
    errors[1] = errors[1] + 0.3 * SLOPES[1] * pattern
    told = readings(errors)
    found = likeliest_fault(told, None, correlated=False)
    assert (found.recording, found.kind, found.at) == (1, kind, at)
    assert found.p_value < SIGNIFICANCE
    columns = np.zeros((162, 5))
    for i, x in enumerate(told):
        rows = slice(81 * i, 81 * i + 81)
        columns[rows, :2], columns[rows, 2 + i] = x.block.A, x.block.B[:, 0]
    columns[81:161, 4] = SLOPES[1] * pattern
    r = np.concatenate([x.block.r for x in told])
    normal = np.linalg.inv(columns.T @ columns)
    size = (normal @ columns.T @ r)[4]
    assert found.size == pytest.approx(size, rel=1e-9)
    assert abs(found.size - 0.3) < 4 * found.error
    left = r - columns @ (normal @ columns.T @ r)
    readings_left = np.delete(left, [80, 161])
    variance = readings_left @ readings_left / 153
    assert found.error == pytest.approx(np.sqrt(max(variance, 1.0) * normal[4, 4]), rel=0.01)


def test_sound_times_are_rarely_doubted():
    """The level is one in a thousand; among many that are alike Bonferroni's rule keeps well below it."""
    p = [likeliest_fault(readings(noise(seed)), None, correlated=False).p_value for seed in range(400)]
    assert sum(x <= SIGNIFICANCE for x in p) <= 3
    assert sum(x <= 0.05 for x in p) <= 30


def test_errors_that_correlate_are_no_fault():
    """An autoregression that would be a fault of independent errors is none of errors that correlate as they do."""
    rng, found = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(40):
        errors = [np.zeros(80), np.zeros(80)]
        for e in errors:
            for i, w in enumerate(rng.standard_normal(80)):
                e[i] = (0.9 * e[i - 1] if i else 0.0) + w
        for correlated in found:
            fault = likeliest_fault(readings(errors), None, correlated=correlated)
            found[correlated] += fault.p_value <= SIGNIFICANCE
    assert found[False] > 20
    assert found[True] <= 4


def test_a_clock_that_was_fitted_is_judged_by_its_own_value():
    """A delay of its own, far from 0 by its error, is a fault, though nothing of it is left in the residuals."""
    told = readings(noise(5))
    with_delay = []
    for x in told:
        B = np.hstack([x.block.B, np.append(-x.slope, 0.0)[:, None]])
        r = x.block.r - B @ np.linalg.lstsq(B, x.block.r, rcond=None)[0]
        with_delay.append(FittedReadings(Block(r, x.block.A, B), x.channel, T, x.slope, {"delay": (1, 0.3)}))
    found = likeliest_fault(with_delay, None)
    assert (found.kind, found.size) == ("delay", 0.3)
    assert found.p_value == pytest.approx(2 * (2 * 80 + 2) * student.sf(0.3 / found.error, 150), rel=1)
    assert found.p_value < 1e-9


def test_what_the_fitted_unknowns_take_up_is_no_evidence():
    """Where slopes are what an unknown does, no fault can be told from it."""
    x = readings(noise(2))[0]
    A = np.vstack([x.slope[:, None] * np.stack([np.ones(80), T], axis=1), np.zeros((1, 2))])
    r = x.block.r - A @ np.linalg.lstsq(A, x.block.r, rcond=None)[0]
    found = likeliest_fault([FittedReadings(Block(r, A, x.block.B), x.channel, T, x.slope, {})], None)
    assert found is None or found.kind == "jump"
