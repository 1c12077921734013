"""Checks of numbers where they enter."""

from __future__ import annotations

import math

import numpy as np

from whiptool.errors import InputError

LARGEST = 1e15  # of any quantity in SI units: what is beyond is a slip, and overflows where it is squared


def number(name: str, value: object, *, low: float = -math.inf, high: float = LARGEST, strict: bool = False) -> float:
    """`value` as a float from `low` (above it, if `strict`) to `high`."""
    rule = "a finite number" if low == -math.inf else f"a finite number {'>' if strict else '>='} {low:g}"
    rule += "" if high == LARGEST else f" and <= {high:g}"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(name, value, rule)
    x = float(value)
    if not math.isfinite(x) or x < low or (strict and x == low):
        raise InputError(name, value, rule)
    if abs(x) > high:
        raise InputError(name, value, rule if high != LARGEST else f"a number of magnitude <= {LARGEST:g}")
    return x


def whole(name: str, value: object, *, low: int = 1, high: int | None = None) -> int:
    """`value` as an int from `low` to `high`."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        x = int(value)
        if x >= low and (high is None or x <= high):
            return x
    span = f">= {low}" if high is None else f"from {low} to {high}"
    raise InputError(name, value, f"a whole number {span}")


def numbers(name: str, value: object, count: int) -> tuple[float, ...]:
    """`value` as `count` finite floats."""
    if not isinstance(value, (list, tuple, np.ndarray)) or np.ndim(value) != 1 or len(value) != count:
        raise InputError(name, value, f"{count} finite numbers")
    return tuple(number(f"{name}[{i}]", x) for i, x in enumerate(value))
