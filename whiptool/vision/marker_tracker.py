"""Tracking of one marker from image to image: a Kalman filter, mean-shift, search, and confidence.

Mean-shift alone loses a fast tip: at 60 frames/s a tip at 20 m/s moves 60 pixels. A filter for constant acceleration
with white-noise jerk therefore predicts the position, mean-shift starts there inside a gate, and if it fails the whole
image is searched by connected components. The total brightness of a marker does not depend on blur and shows whether
the marker is completely visible: hidden or cut blobs and other objects get a low confidence and no position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import Camera
from whiptool.vision.calibration import PlaneCalibration
from whiptool.vision.exposure import measurement_sigma
from whiptool.vision.markers import Blob, Marker, find_blobs, noise_of
from whiptool.vision.source import Frame

# Spectral density of a marker's jerk [m^2 / s^5]: it lets through what random strikes of 15 to 30 m/s do at the crack,
# where the tip strays by two decimetres within a frame from a constant acceleration
_JERK = 2e7
_AT_REST = 1.0, 20.0  # standard deviations of a resting marker's speed [m/s] and acceleration [m/s^2]
_IN_FLIGHT = 12.0, 200.0  # likewise of one that was just found again
_ERROR = 0.3  # of a measurement [pixels]
_DEVIATIONS = 4.0  # standard deviations that the gate, within which a marker is looked for, lets through
_NARROWEST = 8.0  # radius of the gate, at least [pixels]
_FASTEST = 50.0  # a marker is no faster [m/s]; random strikes of the paper's whip stay below 35


class MotionFilter:
    """Kalman filter of a marker's motion in the image, in which both coordinates share one covariance; it starts from a
    pixel (2,) at time t [s] with the image scale `per_metre` [pixels/m] there, at rest unless it may be `moving`."""

    def __init__(self, pixel: np.ndarray, t: float, per_metre: float, *, moving: bool = False) -> None:
        speed, acceleration = _IN_FLIGHT if moving else _AT_REST
        self.t, self._per_metre = t, per_metre
        self._x = np.stack([pixel, np.zeros(2), np.zeros(2)])  # position, velocity, acceleration, (3, 2)
        self._P = np.diag([_ERROR**2, (speed * per_metre) ** 2, (acceleration * per_metre) ** 2])
        self._jerk = _JERK * per_metre**2

    @property
    def pixel(self) -> np.ndarray:
        """Last position, (2,) [pixels]."""
        return self._x[0]

    @property
    def velocity(self) -> np.ndarray:
        """Velocity in the image [pixels/s], (2,)."""
        return self._x[1]

    def could_reach(self, t: float, pixel: np.ndarray) -> bool:
        """Whether a whip's tip could have moved from its last position to `pixel` (2,) by the time t [s]."""
        farthest = _NARROWEST + _FASTEST * self._per_metre * max(t - self.t, 0.0)
        return float(np.hypot(*(pixel - self.pixel))) <= farthest

    def velocity_with(self, t: float, pixel: np.ndarray) -> np.ndarray:
        """Return the velocity after `update(t, pixel)`, (2,) [pixels/s], without updating."""
        x, P = self._ahead(t)
        return x[1] + P[1, 0] / (P[0, 0] + _ERROR**2) * (pixel - x[0])

    def _ahead(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        d = max(t - self.t, 0.0)
        F = np.array([[1, d, d**2 / 2], [0, 1, d], [0, 0, 1]])
        Q = self._jerk * np.array(
            [[d**5 / 20, d**4 / 8, d**3 / 6], [d**4 / 8, d**3 / 3, d**2 / 2], [d**3 / 6, d**2 / 2, d]]
        )
        return F @ self._x, F @ self._P @ F.T + Q

    def predict(self, t: float) -> tuple[np.ndarray, float]:
        """Return the expected position at time t [s], (2,), and the search radius around it [pixels]."""
        x, P = self._ahead(t)
        return x[0], max(_NARROWEST, _DEVIATIONS * float(np.sqrt(P[0, 0] + _ERROR**2)))

    def update(self, t: float, pixel: np.ndarray) -> None:
        """Update with a measured position `pixel` (2,) at time t [s]."""
        x, P = self._ahead(t)
        gain = P[:, 0] / (P[0, 0] + _ERROR**2)  # (3,)
        self._x = x + gain[:, None] * (pixel - x[0])
        self._P = P - np.outer(gain, P[0])
        self.t = t


SURE = 0.5  # confidence from which a position is reported


@dataclass(frozen=True)
class Light:
    """Settings for the estimation and the check of a marker's brightness and size."""

    tolerance: float = 0.15  # relative deviation of a blob's brightness above which it is doubtful
    usual: float = 0.06  # relative deviation due to shading and noise
    most_size_error: float = 1.7  # largest ratio between the first blob's area and the marker's, or its inverse
    slow: float = 2.0  # speed below which the marker's brightness is learned [m/s]
    weight: float = 0.05  # of a new blob in the running mean of the marker's brightness


_LIGHT = Light()
_NEARING = Light(tolerance=0.35, usual=0.15, most_size_error=2.5, slow=np.inf, weight=0.5)  # changes with its distance


@dataclass(frozen=True, eq=False)
class Sighting:
    """Measured position of one marker in one frame; NaN where unsure."""

    t_point: float  # middle of the marker's exposure [s]; with a rolling shutter, that of its image row
    pixel: np.ndarray  # mean position over the exposure [pixels], (2,)
    point: np.ndarray  # mean position on the strike plane [m], (2,)
    sigma: float  # standard error of `point`, per coordinate [m]
    confidence: float  # in [0, 1]; positions are given from 0.5


class MarkerTracker:
    """Tracks one marker from frame to frame, in the strike plane by `calibration`, by default from the camera's pose.

    With a `distance` [m] the marker moves in space about this far from the camera; positions are then those on a plane
    there that faces the camera, and only pixels are meaningful. `background` is an image without the marker, whose
    objects of the marker's colour are ignored; by default the first frame without the blob that is taken as the marker.
    `start` (2,) [pixels] is the marker's position in the first frame, if other objects look like it.
    """

    def __init__(
        self,
        marker: Marker,
        settings: Camera,
        *,
        calibration: PlaneCalibration | None = None,
        distance: float | None = None,
        background: np.ndarray | None = None,
        start: np.ndarray | None = None,
    ) -> None:
        if (marker.hue is None) != (settings.kind == "infrared"):
            raise InputError(
                "marker", marker, f"one {'without' if marker.hue is None else 'with'} a hue for color images"
            )
        self.marker, self.settings = marker, settings
        self._distance, self._light = distance, _LIGHT if distance is None else _NEARING
        plane = calibration or settings if distance is None else PlaneCalibration(settings.facing(distance))
        self._to_plane = plane.to_plane
        self._background = None if background is None else marker.strength(background)
        self._start, self._begun = start, False
        self._noise, self._mass = 0.0, np.nan  # noise of the strength; light of the whole marker [pixels]
        self._motion: MotionFilter | None = None
        self._locked = False  # on something that the gate is around

    def update(self, frame: Frame) -> Sighting:
        """Return the marker's position in the next frame, in pixels and on the strike plane [m]; NaN where unsure."""
        if not self._begun:
            self._begin(frame)
        blob, confidence = self._gated(frame) if self._locked else (None, 0.0)
        if blob is not None and confidence >= SURE:
            return self._seen(frame, blob, confidence)
        # Lost: whatever else looks like it is taken up for the next frame to confirm, and not reported before
        found, sureness = self._anywhere(frame) if self._begun else (None, 0.0)
        self._locked = found is not None
        if found is not None:
            t = self._time_of(frame, found.pixel[1])
            self._motion = MotionFilter(found.pixel, t, self._pixels_per_metre(found.pixel), moving=True)
        return self._unsure(frame, max(confidence, sureness))

    def _begin(self, frame: Frame) -> None:
        """Find the marker at rest, learn its light, and learn the background."""
        whole = self._image_region()
        strength = self.marker.strength(frame.image)
        self._noise = noise_of(strength)
        background = np.full_like(strength, np.median(strength)) if self._background is None else self._background
        least = self.marker.value[0] / 2 if self.marker.hue is None else 0.0  # infrared sees everything in one colour
        blobs = find_blobs(
            self.marker, frame.image, background, self._noise, whole, least_mass=0.0, least_strength=least
        )
        fits = [b for b in blobs if self._could_be_first(b)]
        if self._start is not None:
            fits = sorted(fits, key=lambda b: np.hypot(*(b.pixel - self._start)))[:1]
        if self._background is None:
            # The arm is in it too, and will move: where it has less of the marker's colour, it is left out
            usual = np.median(strength)
            strength[strength < usual - 5 * self._noise] = usual
            self._background = strength
            if len(fits) == 1:  # fill its place with what is around it
                x, y, w, h = fits[0].box
                wide = np.s_[max(y - 6, 0) : y + h + 6, max(x - 6, 0) : x + w + 6]
                inner = np.s_[max(y - 3, 0) : y + h + 3, max(x - 3, 0) : x + w + 3]
                strength[inner] = np.nan
                strength[inner] = np.nanmedian(strength[wide])
        if fits:
            self._mass = float(np.median([b.mass for b in fits]))
        self._begun = bool(fits)
        if len(fits) == 1:
            pixel = fits[0].pixel
            self._motion = MotionFilter(pixel, self._time_of(frame, pixel[1]), self._pixels_per_metre(pixel))
            self._locked = True

    def _could_be_first(self, blob: Blob) -> bool:
        size = np.pi * (self.marker.radius * self._pixels_per_metre(blob.pixel)) ** 2
        low, high = self.marker.value
        right_size = 1 / self._light.most_size_error < blob.mass / blob.peak / size < self._light.most_size_error
        return right_size and not blob.cut and (self.marker.hue is not None or low <= blob.peak <= high)

    def _gated(self, frame: Frame) -> tuple[Blob | None, float]:
        """Mean-shift from where the marker should be now, inside the gate."""
        assert self._motion is not None
        expected, gate = self._predict(frame)
        size = self.marker.radius * self._pixels_per_metre(expected)
        blur = np.hypot(*self._motion.velocity) * self.settings.exposure
        half = gate + 1.5 * size + blur + 4
        x0, y0, x1, y1 = self._image_region()
        low, high = np.floor(expected - half).astype(int), np.ceil(expected + half).astype(int) + 1
        region = max(x0, low[0]), max(y0, low[1]), min(x1, high[0]), min(y1, high[1])
        if region[2] - region[0] < 3 or region[3] - region[1] < 3:
            return None, 0.0
        blobs = find_blobs(
            self.marker, frame.image, self._background, self._noise, region, least_mass=self._mass, near=expected
        )
        inside = [b for b in blobs[:1] if np.hypot(*(b.pixel - expected)) <= gate]
        return (inside[0], self._likeness(frame, inside[0])) if inside else (None, 0.0)

    def _anywhere(self, frame: Frame) -> tuple[Blob | None, float]:
        """Connected components in the whole image; never sure before the next frame confirms it."""
        blobs = find_blobs(
            self.marker, frame.image, self._background, self._noise, self._image_region(), least_mass=self._mass
        )
        scores = np.array([self._likeness(frame, b) for b in blobs])
        if self._motion is not None and len(blobs):
            reach = [self._motion.could_reach(self._time_of(frame, b.pixel[1]), b.pixel) for b in blobs]
            scores = np.where(reach, scores, 0.0)
        if not len(blobs) or scores.max() < SURE:
            return None, 0.0
        best = int(scores.argmax())
        if scores.sum() > scores[best] + SURE:
            return None, 0.0  # two that could be it
        return blobs[best], float(scores[best])

    def _missing(self, frame: Frame, blob: Blob) -> float:
        """By what share a blob's light differs from that of the whole marker."""
        return abs(blob.mass / (self._mass * self._stretch(frame, blob)) - 1)

    def _likeness(self, frame: Frame, blob: Blob) -> float:
        """How much a blob's light is that of the whole marker, in [0, 1]."""
        off = self._missing(frame, blob) / self._light.tolerance
        return float(np.exp(-0.5 * off**2)) * (0.3 if blob.cut else 1.0)

    def _stretch(self, frame: Frame, blob: Blob) -> float:
        """A marker that runs along with the rows of a rolling shutter is seen for longer."""
        if self._motion is None or not self.settings.readout:
            return 1.0
        velocity = self._motion.velocity_with(self._time_of(frame, blob.pixel[1]), blob.pixel)
        share = velocity[1] * self.settings.readout / self.settings.height
        return float(1 / (1 - np.clip(share, -0.3, 0.3)))

    def _seen(self, frame: Frame, blob: Blob, confidence: float) -> Sighting:
        assert self._motion is not None
        per_metre, stretch = self._pixels_per_metre(blob.pixel), self._stretch(frame, blob)
        # Light that is missing at one end moves the centroid by half its share of the blob's length
        doubt = max(0.0, self._missing(frame, blob) - self._light.usual) * max(blob.box[2:]) / 2  # [pixels]
        self._motion.update(self._time_of(frame, blob.pixel[1]), blob.pixel)
        speed = float(np.hypot(*self._motion.velocity)) / per_metre
        if speed < self._light.slow:
            self._mass += self._light.weight * (blob.mass / stretch - self._mass)
        error = measurement_sigma(self.settings, speed, distance=self._distance)
        return Sighting(
            self._time_of(frame, blob.pixel[1]),
            blob.pixel,
            self._to_plane(blob.pixel),
            float(np.hypot(max(blob.noise, doubt) / per_metre, error)),
            confidence,
        )

    def _unsure(self, frame: Frame, confidence: float) -> Sighting:
        row = self.settings.height / 2 if self._motion is None else self._predict(frame)[0][1]
        unseen = np.full(2, np.nan)
        t = self._time_of(frame, float(np.clip(row, 0, self.settings.height)))
        return Sighting(t, unseen, unseen, np.nan, min(confidence, 0.9 * SURE))

    def _predict(self, frame: Frame) -> tuple[np.ndarray, float]:
        """Where it should be in this frame (2,), and how far off it may be [pixels]."""
        assert self._motion is not None
        expected, gate = self._motion.predict(self._time_of(frame, self._motion.pixel[1]))
        if self.settings.readout:  # its row, and with it its time, follows from where it is
            expected, gate = self._motion.predict(
                self._time_of(frame, float(np.clip(expected[1], 0, self.settings.height)))
            )
        return expected, gate

    def _time_of(self, frame: Frame, row: float) -> float:
        return frame.t + float(self.settings.row_delay(row)) + self.settings.exposure / 2

    def _pixels_per_metre(self, pixel: np.ndarray) -> float:
        steps = self._to_plane(pixel + np.array([[0, 0], [1, 0], [0, 1]]))
        dx, dy = steps[1] - steps[0], steps[2] - steps[0]
        return float(1 / np.sqrt(abs(dx[0] * dy[1] - dx[1] * dy[0])))

    def _image_region(self) -> tuple[int, int, int, int]:
        return 0, 0, self.settings.width, self.settings.height
