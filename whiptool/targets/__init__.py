"""Moving targets: their tracks, and strikes that meet them."""

from whiptool.targets.aiming import Camera, Interception
from whiptool.targets.interception import intercept, plan, refresh
from whiptool.targets.library import Library
from whiptool.targets.tracks import Track, fit_track

__all__ = ["Camera", "Interception", "Library", "Track", "fit_track", "intercept", "plan", "refresh"]
