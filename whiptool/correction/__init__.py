"""Correction within the strike: what disturbs it is estimated on the way, and the rest of its reference is changed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "AnyStart": "rolled",
    "Begun": "rolled",
    "Corrector": "corrector",
    "Disturbances": "disturbances",
    "Estimator": "linear",
    "LinearStrike": "linear",
    "Paths": "rolled",
    "Sensing": "linear",
    "Submovements": "rolled",
    "correct": "corrector",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.correction.corrector import Corrector, correct
    from whiptool.correction.disturbances import Disturbances
    from whiptool.correction.linear import Estimator, LinearStrike, Sensing
    from whiptool.correction.rolled import AnyStart, Begun, Paths, Submovements

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)
