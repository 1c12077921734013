"""Appearance of a marker, and blobs of its colour in an image (Sect. 2.4: Gaussian filter, HSV thresholds)."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import opencv

_SMOOTHING = 1.0  # standard deviation of the Gaussian filter [pixels]
_FILTERED = 1 / (2 * np.sqrt(np.pi) * _SMOOTHING)  # what the filter leaves of white noise
_FLOOR = 0.02  # least strength that can be part of a blob, of a whole marker's 1 or so
_DIM = 0.12  # likewise in infrared, where everything reflects some light
_DEVIATIONS = 6.0  # least strength of a blob in standard deviations of the filtered noise
_MARGIN = 2  # pixels around a blob that may hold some of its light
_FAINT = 0.35  # share of a known marker's light below which a blob is not worth looking at


@dataclass(frozen=True)
class Marker:
    """Thresholds and size of a marker.

    Args:
        radius: Radius of the marker [m].
        hue: Lowest and highest hue [deg], through 0 if the first is larger; None in infrared.
        saturation: Least saturation, in [0, 1]; motion blur reduces a marker's saturation but not its hue.
        value: Infrared only: smallest and largest contrast of the brightest point of the marker at rest to its
            surroundings, in [0, 1].

    Raises:
        InputError: A number is out of range.
    """

    radius: float
    hue: tuple[float, float] | None = None
    saturation: float = 0.12
    value: tuple[float, float] = (0.2, 1.0)

    def __post_init__(self) -> None:
        if not 0 < self.radius < np.inf:
            raise InputError("radius", self.radius, "a radius > 0 m")
        if self.hue is not None and not all(0 <= x <= 360 for x in self.hue):
            raise InputError("hue", self.hue, "two angles in [0, 360] deg")
        if not 0 <= self.saturation <= 1:
            raise InputError("saturation", self.saturation, "a number in [0, 1]")
        if not 0 <= self.value[0] < self.value[1] <= 1:
            raise InputError("value", self.value, "two numbers in [0, 1], the first the smaller")

    @cached_property
    def weights(self) -> np.ndarray:
        """Weights [1 / level] that add up red, green and blue to a pixel's strength, (1, 3); in infrared that of
        brightness, (1, 1).

        The strength says how much of the marker's colour a pixel has: 1 for the pure bright colour, 0 for grey. It is
        linear in light, so that the centroid of a blurred marker is its mean position over the exposure.
        """
        if self.hue is None:
            return np.full((1, 1), 1 / 255, np.float32)
        low, high = self.hue
        middle = (low + ((high - low) % 360) / 2) % 360
        rgb = np.array(colorsys.hsv_to_rgb(middle / 360, 1, 1))
        chroma = rgb - rgb.mean()
        return (chroma / (chroma @ rgb) / 255).astype(np.float32)[None]

    def strength(self, image: np.ndarray) -> np.ndarray:
        """Return how much of the marker's colour each pixel has, (H, W) float32: 1 if it is pure and bright, 0 if it is
        grey; in infrared the brightness. See `weights`."""
        return opencv().transform(image.astype(np.float32), self.weights)

    def is_of_color(self, rgb: np.ndarray) -> bool:
        """Whether a colour (3,), in levels 0 to 255, passes the thresholds of hue and saturation."""
        if self.hue is None:
            return True
        hue, saturation, _ = colorsys.rgb_to_hsv(*np.clip(rgb, 0, 255) / 255)
        low, high = self.hue
        return saturation >= self.saturation and (hue * 360 - low) % 360 <= (high - low) % 360


# For the markers of the virtual camera; a rig's own need their own thresholds.
TIP_MARKERS = {
    "color": Marker(0.025, hue=(95, 140)),
    "infrared": Marker(0.025, value=(0.65, 1.0)),
}
TARGET_MARKERS = {
    "color": Marker(0.04, hue=(5, 40)),
    "infrared": Marker(0.04, value=(0.25, 0.6)),
}


@dataclass(frozen=True, eq=False)
class Blob:
    """A connected region of an image with a marker's colour."""

    pixel: np.ndarray  # centroid weighted by strength (see `Marker.weights`) [pixels], (2,)
    mass: float  # sum of the strength [pixels]
    peak: float  # largest strength after filtering
    box: tuple[int, int, int, int]  # left, top, width, height [pixels]
    cut: bool  # whether the region touches the image's edge
    noise: float  # standard error of the centroid, per coordinate, due to sensor noise [pixels]


def noise_of(strength: np.ndarray) -> float:
    """Return a robust estimate of the noise's standard deviation in an image of `Marker.strength`, (H, W), from
    differences of neighbours in rows.
    """
    return float(1.4826 * np.median(np.abs(np.diff(strength[::4], axis=1))) / np.sqrt(2))


def find_blobs(
    marker: Marker,
    image: np.ndarray,
    background: np.ndarray | None,
    noise: float,
    region: tuple[int, int, int, int],
    *,
    least_mass: float,
    least_strength: float = 0.0,
    near: np.ndarray | None = None,
) -> list[Blob]:
    """Return the blobs of a marker's colour in a region (left, top, right, bottom) [pixels] of an image, (H, W, 3) or
    (H, W) uint8.

    `background` is `Marker.strength` of the scene without the marker, (H, W), and `noise` the strength's standard
    deviation. Blobs with less than 35 % of `least_mass`, the whole marker's sum of strength [pixels], are left out, and
    so are parts below `least_strength`. The blob found by mean shift from `near`, the expected position (2,) [pixels],
    is then the first.
    """
    left, top, right, bottom = region
    part = image[top:bottom, left:right]
    strength = marker.strength(part)
    if background is not None:
        strength -= background[top:bottom, left:right]
    smooth = opencv().GaussianBlur(strength, (0, 0), _SMOOTHING)
    threshold = max(_FLOOR if marker.hue else _DIM, _DEVIATIONS * noise * _FILTERED, least_strength)
    labels, stats, order = _components(smooth, threshold, None if near is None else near - (left, top))
    height, width = image.shape[:2]
    blobs = []
    for i in order:
        x, y, w, h, area = (int(v) for v in stats[i])
        if area * smooth.max() < _FAINT * least_mass:
            continue  # cannot weigh enough
        x0, y0 = max(x - _MARGIN, 0), max(y - _MARGIN, 0)
        window = np.s_[y0 : y + h + _MARGIN, x0 : x + w + _MARGIN]
        peak, color = _brightest(part[window], smooth[window], labels[window] == i)
        if marker.hue is not None and not marker.is_of_color(color):
            continue
        light, wide = _light_of(strength[window], labels[window], i, noise)
        mass = float(light.sum())
        if mass < _FAINT * least_mass:
            continue
        xs, ys = np.arange(light.shape[1]), np.arange(light.shape[0])
        u, v = float(light.sum(axis=0) @ xs) / mass, float(light.sum(axis=1) @ ys) / mass
        spread = (wide * ((xs - u) ** 2 + (ys[:, None] - v) ** 2)).sum() / 2
        cut = left + x <= 1 or top + y <= 1 or left + x + w >= width - 1 or top + y + h >= height - 1
        place, box = np.array([left + x0 + u, top + y0 + v]), (left + x, top + y, w, h)
        blobs.append(Blob(place, mass, peak, box, cut, float(noise * np.sqrt(spread) / mass)))
    return blobs


def _components(
    smooth: np.ndarray, threshold: float, near: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Labels of the connected patches above a threshold, (h, w), OpenCV's table of them, and the order to take them."""
    mask = (smooth > threshold).view(np.uint8)
    count, labels, stats, _ = opencv().connectedComponentsWithStats(mask, connectivity=8)
    order = list(range(1, count))
    if near is not None and order:
        first = _climb(smooth * mask, labels, near, stats)
        order.sort(key=lambda i: i != first)
    return labels, stats, order


def _brightest(image: np.ndarray, smooth: np.ndarray, own: np.ndarray) -> tuple[float, np.ndarray]:
    """A blob's greatest strength, and the mean colour around it, in levels; `own` is where the blob is, (h, w)."""
    own_smooth = np.where(own, smooth, 0)
    row, column = divmod(int(own_smooth.argmax()), own.shape[1])
    patch = image[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
    return float(own_smooth.max()), patch.reshape(-1, patch.shape[2] if patch.ndim == 3 else 1).mean(axis=0)


def _light_of(strength: np.ndarray, labels: np.ndarray, label: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A blob's light, (h, w), and where it may be: beyond the threshold's edge, but not in a neighbouring blob."""
    square = np.ones((2 * _MARGIN + 1, 2 * _MARGIN + 1), np.uint8)
    wide = opencv().dilate((labels == label).view(np.uint8), square).astype(bool)
    wide &= (labels == label) | (labels == 0)
    # What is darker than the background (arm and whip before it) is not light, nor negative light, which would push
    # the centroid away from the whip; noise around zero stays
    return np.where(strength < -3 * noise, 0, strength) * wide, wide


def _climb(density: np.ndarray, labels: np.ndarray, start: np.ndarray, stats: np.ndarray) -> int:
    """The label that mean-shift ends on (cv2.meanShift); the nearest where it starts in the void."""
    cv2 = opencv()
    size = int(max(8, np.median(stats[1:, 2:4])))
    height, width = density.shape
    corner = np.clip(np.round(start) - size // 2, 0, [max(width - size, 0), max(height - size, 0)]).astype(int)
    scaled = np.minimum(density * 255, 255).astype(np.uint8)
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.5)
    _, (x, y, w, h) = cv2.meanShift(scaled, (int(corner[0]), int(corner[1]), size, size), until)
    inside = np.bincount(labels[y : y + h, x : x + w].ravel(), density[y : y + h, x : x + w].ravel(), len(stats))
    if inside[1:].any():
        return int(inside[1:].argmax()) + 1
    centers = stats[1:, :2] + stats[1:, 2:4] / 2
    return int(np.hypot(*(centers - start).T).argmin()) + 1
