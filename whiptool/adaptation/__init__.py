"""Adaptation to an unknown whip: strike, film, identify the whip, and plan the next strike."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "Adaptation": "loop",
    "Adapter": "adapter",
    "Options": "adapter",
    "Belief": "prior",
    "default_prior": "prior",
    "TipPort": "ports",
    "RigPort": "ports",
    "Twin": "twins",
    "draw_twin": "twins",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.adaptation.adapter import Adapter, Options
    from whiptool.adaptation.loop import Adaptation
    from whiptool.adaptation.ports import RigPort, TipPort
    from whiptool.adaptation.prior import Belief, default_prior
    from whiptool.adaptation.twins import Twin, draw_twin

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)  # CasADi is imported where used
