"""One marker's track through one camera's images, read at any time between its frames."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.triangulation import triangulate

GAP = 2.5  # frames without a marker over which its track is not drawn on


class CameraTrack:
    """Path of one marker in the images of one camera, interpolated between frames.

    Args:
        recording: Recording of the camera, with its view.
        marker: Name of one of its markers.
    """

    def __init__(self, recording: StrikeRecording, marker: str) -> None:
        assert recording.view is not None
        m = recording.markers.index(marker)
        seen = recording.seen[:, m]
        self.camera, self.t = recording.view, recording.t_points[seen, m]
        self.pixels, self.sigma = recording.points[seen, m], recording.sigma[seen, m]
        self.gap = GAP * float(np.median(np.diff(recording.t)))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the marker's pixels (T, 2) at times t (T,) [s], NaN if not tracked, and their standard errors (T,)."""
        unseen = np.full((len(t), 2), np.nan), np.full(len(t), np.nan)
        if len(self.t) < 4:
            return unseen
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        inside = (t >= self.t[0]) & (t <= self.t[-1]) & (self.t[after] - self.t[after - 1] < self.gap)
        smooth = PchipInterpolator(self.t, self.pixels)(t)
        straight = np.stack([np.interp(t, self.t, x) for x in self.pixels.T], axis=1)
        between = np.linalg.norm(smooth - straight, axis=1)  # what a curve between two frames may be wrong by
        pixels = np.where(inside[:, None], smooth, np.nan)
        return pixels, np.hypot(np.interp(t, self.t, self.sigma), between)

    def beside(self, other: CameraTrack, delay: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the distances between this and the other camera's lines of sight in the image [pixels], (P,), and
        their standard errors (P,).

        Args:
            other: Track of the same marker by another camera.
            delay: Time of the other camera's clock minus this one's [s].
        """
        seen, sigma = other.at(self.t + delay)
        found = triangulate([self.camera, other.camera], np.stack([self.pixels, seen]))
        apart = 2 * found.residual  # the point between two lines of sight is half as far from either
        known = np.isfinite(apart) & np.isfinite(sigma)
        return apart[known], np.hypot(self.sigma[known], sigma[known])

    def error(self, other: CameraTrack) -> float:
        """Return the standard error of the result of `beside` due to the pixel errors of both cameras [pixels]."""
        return float(np.hypot(np.median(self.sigma), np.median(other.sigma)))
