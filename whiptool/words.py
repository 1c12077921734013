"""Numbers as people read them: counts with their nouns, ratios, and changes that rounding would hide."""

from __future__ import annotations

import math


def counted(count: int, thing: str, things: str = "") -> str:
    """Return a count with its noun, such as `1 strike` and `1,200 strikes`; `things` where the plural takes no s."""
    return f"{count:,} {thing if count == 1 else things or thing + 's'}"


def times(ratio: float, other: str) -> str:
    """Return how many times something of another a quantity is, such as `2.5 times DDPG`.

    A ratio that is not a finite positive number is none: it says so in words.
    """
    if not math.isfinite(ratio) or ratio <= 0:
        return f"no ratio to {other}"
    return f"{ratio:.2g} times {other}"


def changed(before: float, after: float, *, unit: str = "", digits: int = 3) -> str:
    """Return `before unit -> after unit` with as many digits, `digits` or more, as tell the two apart."""
    if before == after:
        return f"{before:.{digits}g}{unit}, unchanged"
    for more in range(digits, 13):
        old, new = f"{before:.{more}g}", f"{after:.{more}g}"
        if old != new:
            return f"{old}{unit} -> {new}{unit}"
    return f"{before:.{digits}g}{unit}, unchanged"
