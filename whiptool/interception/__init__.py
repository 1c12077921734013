"""Moving targets: their tracks, and strikes that meet them."""

from whiptool.interception.interceptor import Interception, Interceptor, TargetCamera
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import TargetTrack, fit_track

__all__ = ["Interception", "Interceptor", "Library", "TargetCamera", "TargetTrack", "fit_track"]
