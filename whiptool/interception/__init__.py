"""Moving targets: their tracks, and strikes that meet them."""

from whiptool.interception.aiming import Interception, TargetCamera
from whiptool.interception.library import Library
from whiptool.interception.planning import intercept, plan, refresh
from whiptool.interception.tracks import TargetTrack, fit_track

__all__ = ["Interception", "Library", "TargetCamera", "TargetTrack", "fit_track", "intercept", "plan", "refresh"]
