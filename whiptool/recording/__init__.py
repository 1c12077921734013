"""Recorded strikes: what a camera and the encoders saw, and readers of the formats it comes in. No physics."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "StrikeRecording": "strike_recording",
    "READERS": "readers",
    "read_recording": "readers",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.recording.readers import READERS, read_recording
    from whiptool.recording.strike_recording import StrikeRecording


def __getattr__(name: str) -> object:  # readers are imported where used
    if name in _HOMES:
        return getattr(import_module(f"whiptool.recording.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'whiptool.recording' has no attribute {name!r}")
