"""Dynamics of the planar chain in CasADi: equations of motion, the closed loop and its integrator, posture, modes."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "Chain": "chain",
    "chain_of": "chain",
    "hanging_modes": "modes",
    "linearise": "modes",
    "start_posture": "posture",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.dynamics.chain import Chain, chain_of
    from whiptool.dynamics.modes import hanging_modes, linearise
    from whiptool.dynamics.posture import start_posture


def __getattr__(name: str) -> object:  # CasADi is imported where used
    if name in _HOMES:
        return getattr(import_module(f"whiptool.dynamics.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'whiptool.dynamics' has no attribute {name!r}")
