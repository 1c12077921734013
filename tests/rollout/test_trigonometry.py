"""Sine and cosine of the compiled driver, on vectors, against those of extended precision."""

from __future__ import annotations

import ctypes
from importlib.resources import files

import mpmath
import numpy as np
import pytest

from whiptool.rollout.compiler import find_compiler, load_library

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="there is no C++ compiler")
DRIVER = """
#include GENERATED
extern "C" __attribute__((visibility("default"))) void both(const double* x, double* sines, double* cosines, long n) {
  for (long i = 0; i < n; i += LANES) {
    real angle;
    for (int l = 0; l < LANES; ++l) set_lane(angle, l, x[i + l]);
    const real s = sin(angle), c = cos(angle);
    for (int l = 0; l < LANES; ++l) sines[i + l] = lane(s, l), cosines[i + l] = lane(c, l);
  }
}
"""
UNITS = 2.0  # in the last place, as trigonometry.h says
LONGEST_VECTOR = 8


def sines_and_cosines(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    headers = "".join(files("whiptool.rollout").joinpath(name).read_text() for name in ("lanes.h", "trigonometry.h"))
    library = load_library("", headers + DRIVER, {"SIMD": 1})
    assert library is not None
    assert len(angles) % LONGEST_VECTOR == 0
    x, s, c = np.ascontiguousarray(angles, dtype=float), np.empty(len(angles)), np.empty(len(angles))
    library.both(*(ctypes.c_void_p(array.ctypes.data) for array in (x, s, c)), ctypes.c_long(len(x)))
    return s, c


def angles() -> np.ndarray:
    """Small and large angles of both signs, and the neighbours of multiples of a quarter turn, where digits cancel."""
    rng = np.random.default_rng(0)
    spread = rng.uniform(-10.0, 10.0, 4000)
    large = rng.uniform(-1e5, 1e5, 2000)
    tiny = 10.0 ** rng.uniform(-300, 0, 400)
    quarters = np.arange(-400, 400) * (np.pi / 2)
    neighbours = np.concatenate([np.nextafter(quarters, -np.inf), quarters, np.nextafter(quarters, np.inf)])
    return np.concatenate([spread, large, tiny, neighbours])


@pytest.mark.parametrize("function", ["sin", "cos"])
def test_they_are_right_to_the_last_places(function):
    x = angles()
    found = dict(zip(("sin", "cos"), sines_and_cosines(x), strict=True))[function]
    with mpmath.workprec(120):
        exact = [getattr(mpmath, function)(mpmath.mpf(value)) for value in x]
        error = np.array([float(abs(mpmath.mpf(f) - e)) for f, e in zip(found, exact, strict=True)])
    unit = np.spacing(np.abs([float(e) for e in exact]))
    assert np.max(error / unit) < UNITS


def test_a_lane_without_a_number_stays_one_and_leaves_the_others():
    x = np.array([np.nan, 1.0, np.inf, -2.0, -np.inf, 0.5, 0.0, 3.0])
    lost = ~np.isfinite(x)
    for found, expected in zip(sines_and_cosines(x), (np.sin, np.cos), strict=True):
        assert np.all(np.isnan(found[lost]))
        assert found[~lost] == pytest.approx(expected(x[~lost]), rel=1e-15)
