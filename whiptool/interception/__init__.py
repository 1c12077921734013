"""Moving targets: their tracks, and strikes that meet them."""

from whiptool.interception.aiming import Camera, Interception
from whiptool.interception.library import Library
from whiptool.interception.planning import intercept, plan, refresh
from whiptool.interception.tracks import Track, fit_track

__all__ = ["Camera", "Interception", "Library", "Track", "fit_track", "intercept", "plan", "refresh"]
