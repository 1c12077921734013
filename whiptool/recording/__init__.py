"""Recorded strikes from cameras and encoders, and readers of their file formats; no physics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "StrikeRecording": "strike_recording",
    "READERS": "readers",
    "read_recording": "readers",
}
__all__ = list(_HOMES)

if TYPE_CHECKING:
    from whiptool.recording.readers import READERS, read_recording
    from whiptool.recording.strike_recording import StrikeRecording

__getattr__, __dir__ = imported_when_used(__name__, _HOMES)  # readers are imported where used
