"""Numbers as text: counts with nouns, ratios, rounding errors as 0; and names in any spelling."""

from __future__ import annotations

import math
from collections.abc import Iterable

_NOTHING = 1e-15  # in SI units, below which any number here is the rest of a rounding


def rounded(x: float, digits: int = 3) -> str:
    """Return a number as text with `digits` significant digits: `0` if it is only a rounding error, `none` if not
    finite.
    """
    if not math.isfinite(x):
        return "none"
    return f"{x:.{digits}g}" if abs(x) >= _NOTHING else "0"


def fixed(x: float, digits: int = 2) -> str:
    """Return a number as text with `digits` decimals, and `none` if it is not finite."""
    return f"{x:.{digits}f}" if math.isfinite(x) else "none"


def method_name(written: str) -> str:
    """Return a method's name in whiptool's spelling: `cmaes` for `CMA-ES` and `cma_es`.

    For NLopt's algorithms it is NLopt's spelling: `nlopt:GN_CRS2_LM` for `nlopt:gn-crs2-lm`.
    """
    family, colon, algorithm = written.strip().partition(":")
    plain = family.lower().replace("-", "").replace("_", "").replace(" ", "")
    return plain + colon + algorithm.upper().replace("-", "_")


def as_named(written: str, names: Iterable[str]) -> str:
    """Return the one of `names` that differs only in capital letters, hyphens or underscores; else the name as
    written."""

    def plain(name: str) -> str:
        return name.strip().lower().replace("_", "-")

    return next((name for name in names if plain(name) == plain(written)), written)


def counted(count: int, thing: str, things: str = "") -> str:
    """Return a count with its noun, such as `1 strike` and `1,200 strikes`; `things` is an irregular plural."""
    return f"{count:,} {thing if count == 1 else things or thing + 's'}"


def times(ratio: float, other: str) -> str:
    """Return a ratio as text, such as `2.5 times DDPG`.

    If the ratio is not finite and positive, the text is `no ratio to DDPG`.
    """
    if not math.isfinite(ratio) or ratio <= 0:
        return f"no ratio to {other}"
    return f"{ratio:.2g} times {other}"
