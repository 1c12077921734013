"""Identification: from recorded strikes to the parameters of a whip."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "Fit": "results",
    "Options": "problem",
    "Plant": "plant",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.identification.plant import Plant
    from whiptool.identification.problem import Options
    from whiptool.identification.results import Fit


def __getattr__(name: str) -> object:  # CasADi is imported where used
    if name in _HOMES:
        return getattr(import_module(f"whiptool.identification.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'whiptool.identification' has no attribute {name!r}")
