"""Numbers as people read them: counts with their nouns, ratios, what only a rounding is left of; names as written."""

from __future__ import annotations

import math
from collections.abc import Iterable

_NOTHING = 1e-15  # in SI units, below which any number here is the rest of a rounding


def rounded(x: float, digits: int = 3) -> str:
    """Return a number to so many digits: `0` where only a rounding is left of it, and `none` if it is not finite."""
    if not math.isfinite(x):
        return "none"
    return f"{x:.{digits}g}" if abs(x) >= _NOTHING else "0"


def fixed(x: float, digits: int = 2) -> str:
    """Return a number with so many digits after the point, and `none` if it is not finite."""
    return f"{x:.{digits}f}" if math.isfinite(x) else "none"


def method_name(written: str) -> str:
    """Return a method's name in the toolbox's spelling: `CMA-ES` and `cma_es` are `cmaes`.

    NLopt's algorithms have NLopt's spelling: `nlopt:gn-crs2-lm` is `nlopt:GN_CRS2_LM`.
    """
    family, colon, algorithm = written.strip().partition(":")
    plain = family.lower().replace("-", "").replace("_", "").replace(" ", "")
    return plain + colon + algorithm.upper().replace("-", "_")


def as_named(written: str, names: Iterable[str]) -> str:
    """Return the one of some names that is written with other capital letters, hyphens or underscores; else itself."""

    def plain(name: str) -> str:
        return name.strip().lower().replace("_", "-")

    return next((name for name in names if plain(name) == plain(written)), written)


def counted(count: int, thing: str, things: str = "") -> str:
    """Return a count with its noun, such as `1 strike` and `1,200 strikes`; `things` where the plural takes no s."""
    return f"{count:,} {thing if count == 1 else things or thing + 's'}"


def times(ratio: float, other: str) -> str:
    """Return how many times something of another a quantity is, such as `2.5 times DDPG`.

    A ratio that is not a finite positive number is given as words.
    """
    if not math.isfinite(ratio) or ratio <= 0:
        return f"no ratio to {other}"
    return f"{ratio:.2g} times {other}"
