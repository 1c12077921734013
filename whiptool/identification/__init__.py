"""Identification of a whip's parameters from recorded strikes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "Fit": "results",
    "FitOptions": "problem",
    "Plant": "plant",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.identification.plant import Plant
    from whiptool.identification.problem import FitOptions
    from whiptool.identification.results import Fit

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)  # CasADi is imported where used
