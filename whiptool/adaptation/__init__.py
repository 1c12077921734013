"""Adaptation: learning an unknown whip, strike by strike: strike, film, identify again, plan again."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "Adaptation": "loop",
    "Options": "loop",
    "Belief": "prior",
    "default_prior": "prior",
    "TipPort": "ports",
    "RigPort": "ports",
    "Twin": "twins",
    "draw_twin": "twins",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.adaptation.loop import Adaptation, Options
    from whiptool.adaptation.ports import RigPort, TipPort
    from whiptool.adaptation.prior import Belief, default_prior
    from whiptool.adaptation.twins import Twin, draw_twin


def __getattr__(name: str) -> object:  # CasADi is imported where used
    if name in _HOMES:
        return getattr(import_module(f"whiptool.adaptation.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'whiptool.adaptation' has no attribute {name!r}")
