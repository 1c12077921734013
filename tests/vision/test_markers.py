"""Markers' colours and blobs on images that NumPy paints: light, centroid and noise in closed form."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.vision.markers import TARGET_MARKERS, TIP_MARKERS, Marker, find_blobs, noise_of

pytest.importorskip("cv2", reason="needs the extra `vision`")

GREEN, GREY = Marker(0.02, hue=(95, 140)), Marker(0.02, value=(0.3, 0.9))
H, W = 60, 80
ALL = (0, 0, W, H)


def cover(at: tuple[float, float], radius: float) -> np.ndarray:
    """Share of each pixel that a disc covers, from 11 x 11 points in each, (H, W)."""
    fine = (np.arange(11) - 5) / 11
    u = (np.arange(W)[:, None] + fine).ravel()
    v = (np.arange(H)[:, None] + fine).ravel()
    inside = np.hypot(u - at[0], v[:, None] - at[1]) <= radius
    return inside.reshape(H, 11, W, 11).mean(axis=(1, 3))


def painted(*discs: tuple[tuple[float, float], float], color=(0, 255, 0), ground=(60, 60, 60)) -> np.ndarray:
    share = np.clip(sum((cover(at, radius) for at, radius in discs), np.zeros((H, W))), 0, 1)[..., None]
    return np.round(share * np.array(color, float) + (1 - share) * np.array(ground, float)).astype(np.uint8)


def blobs(marker: Marker, image: np.ndarray, background=None, noise=0.0, region=ALL, **options):
    return find_blobs(marker, image, background, noise, region, **{"least_mass": 0.0, **options})


@pytest.mark.parametrize(("hue", "middle"), [((95, 140), 117.5), ((350, 30), 10.0), ((0, 360), 0.0), ((40, 40), 40.0)])
def test_strength_is_one_for_the_pure_colour_and_none_for_greys(hue, middle):
    marker = Marker(0.02, hue=hue)
    pure = 255 * np.array(colorsys.hsv_to_rgb(middle / 360, 1, 1))
    image = np.array([[pure, [200.0] * 3, 0.5 * pure, 0.5 * pure + 60]])
    np.testing.assert_allclose(marker.strength(image), [[1.0, 0.0, 0.5, 0.5]], atol=1e-6)


def test_infrared_strength_is_brightness():
    assert GREY.weights.shape == (1, 1)
    np.testing.assert_allclose(GREY.strength(np.array([[0, 51, 255]], np.uint8)), [[0, 0.2, 1.0]], atol=1e-6)
    assert GREY.is_of_color(np.zeros(3))


@pytest.mark.parametrize(
    ("hue", "saturation", "passes"),
    [
        (95.5, 0.5, True),
        (94.5, 0.5, False),
        (139.5, 0.5, True),
        (140.5, 0.5, False),
        (117, 0.13, True),
        (117, 0.11, False),
    ],
)
def test_thresholds_of_hue_and_saturation(hue, saturation, passes):
    rgb = 200 * np.array(colorsys.hsv_to_rgb(hue / 360, saturation, 1))
    assert bool(GREEN.is_of_color(rgb)) is passes


@pytest.mark.parametrize(("hue", "passes"), [(345, False), (351, True), (0, True), (29, True), (31, False)])
def test_hues_go_around_the_circle(hue, passes):
    rgb = 200 * np.array(colorsys.hsv_to_rgb(hue / 360, 0.8, 1))
    assert bool(Marker(0.02, hue=(350, 30)).is_of_color(rgb)) is passes


def test_a_disc_is_found_with_its_centre_and_light():
    at, radius = (31.37, 22.81), 5.0
    (blob,) = blobs(GREEN, painted((at, radius)))
    np.testing.assert_allclose(blob.pixel, at, atol=0.03)
    pure = GREEN.strength(np.array([[[0, 255, 0]]], np.uint8))[0, 0]
    assert blob.mass == pytest.approx(np.pi * radius**2 * pure, rel=0.01)
    assert blob.peak == pytest.approx(pure, rel=0.02)
    assert not blob.cut
    left, top, width, height = blob.box
    assert left < at[0] - 4 < at[0] + 4 < left + width
    assert top < at[1] - 4 < at[1] + 4 < top + height


def test_places_are_those_of_the_whole_image():
    image = painted(((40.0, 30.0), 5.0))
    (blob,) = blobs(GREEN, image, region=(25, 18, 60, 45))
    np.testing.assert_allclose(blob.pixel, [40.0, 30.0], atol=0.02)
    assert abs(blob.box[0] + blob.box[2] / 2 - 40.5) <= 1
    assert not blobs(GREEN, image, region=(0, 0, 25, 45))


@pytest.mark.parametrize(
    ("at", "cut"),
    [
        *(((7.5, 30), True), ((8.5, 30), False), ((71.5, 30), True), ((69, 30), False)),
        *(((40, 7.5), True), ((40, 8.5), False), ((40, 51.5), True), ((40, 50.5), False)),
    ],
)
def test_what_touches_the_images_edge_is_cut(at, cut):
    (blob,) = blobs(GREEN, painted((at, 5.0)))
    assert blob.cut is cut


def test_the_background_is_taken_off():
    fixed = painted(((20.0, 20.0), 6.0))
    both = painted(((20.0, 20.0), 6.0), ((50.0, 35.0), 5.0))
    assert len(blobs(GREEN, both)) == 2
    (blob,) = blobs(GREEN, both, GREEN.strength(fixed))
    np.testing.assert_allclose(blob.pixel, [50.0, 35.0], atol=0.02)
    (blob,) = blobs(GREEN, both, GREEN.strength(fixed), region=(10, 10, 70, 55))
    np.testing.assert_allclose(blob.pixel, [50.0, 35.0], atol=0.02)


def test_the_blob_at_the_place_that_is_expected_comes_first():
    image = painted(((20.0, 20.0), 5.0), ((60.0, 40.0), 5.0))
    for at in ((20.0, 20.0), (60.0, 40.0)):
        first = blobs(GREEN, image, near=np.array(at) + 2)[0]
        np.testing.assert_allclose(first.pixel, at, atol=0.05)
    void = blobs(GREEN, image, near=np.array([74.0, 4.0]))[0]  # in the void: the nearest
    np.testing.assert_allclose(void.pixel, [60.0, 40.0], atol=0.05)
    part = blobs(GREEN, image, near=np.array([60.0, 40.0]), region=(5, 6, 78, 58))[0]
    np.testing.assert_allclose(part.pixel, [60.0, 40.0], atol=0.05)


def test_what_weighs_too_little_or_is_of_another_colour_is_left_out():
    image = painted(((20.0, 20.0), 5.0))
    whole = blobs(GREEN, image)[0].mass
    assert blobs(GREEN, image, least_mass=whole / 0.36)
    assert not blobs(GREEN, image, least_mass=whole / 0.34)
    yellow = painted(((20.0, 20.0), 5.0), color=(200, 230, 0))
    assert GREEN.strength(yellow).max() > 0.3
    assert not blobs(GREEN, yellow)
    assert not blobs(GREEN, image, least_strength=1.2)
    assert not blobs(GREEN, image, noise=0.9)
    assert not blobs(GREEN, painted())


def test_darkness_is_no_negative_light():
    """A dark bar beside the disc, where the background was bright: the centroid is not pushed away from it."""
    bright = painted(ground=(90, 140, 90))
    image = painted(((40.0, 30.0), 5.0), ground=(90, 140, 90))
    (alone,) = blobs(GREEN, image, GREEN.strength(bright), noise=0.003)
    image[:, 46:50] = 10
    (beside,) = blobs(GREEN, image, GREEN.strength(bright), noise=0.003)
    np.testing.assert_allclose(beside.pixel, alone.pixel, atol=0.02)


def test_the_centroids_noise_is_that_of_many_noisy_images():
    rng, at = np.random.default_rng(0), (40.3, 30.6)
    clean = painted((at, 5.0), ground=(60, 60, 60)).astype(float)
    found, stated = [], []
    for _ in range(150):
        image = np.clip(np.round(clean + rng.normal(0, 6.0, clean.shape)), 0, 255).astype(np.uint8)
        blob = blobs(GREEN, image, noise=noise_of(GREEN.strength(image)))[0]
        found.append(blob.pixel)
        stated.append(blob.noise)
    assert np.std(found, axis=0).mean() == pytest.approx(np.mean(stated), rel=0.25)


def test_noise_is_a_standard_deviation_that_edges_do_not_touch():
    rng = np.random.default_rng(0)
    image = rng.normal(0, 0.02, (400, 300))
    assert noise_of(image) == pytest.approx(0.02, rel=0.03)
    image[:, 100:200] += 0.8
    assert noise_of(image) == pytest.approx(0.02, rel=0.03)


def test_infrared_marks_only_what_outshines():
    share = cover((40.0, 30.0), 5.0)
    image = np.round(60 + 120 * share).astype(np.uint8)
    ground = np.full((H, W), 60 / 255, np.float32)
    (blob,) = blobs(GREY, image, ground)
    np.testing.assert_allclose(blob.pixel, [40.0, 30.0], atol=0.02)
    assert blob.mass == pytest.approx(np.pi * 25 * 120 / 255, rel=0.02)
    faint = np.round(60 + 0.1 * 255 * share).astype(np.uint8)
    assert not blobs(GREY, faint, ground)
    colored = painted(((40.0, 30.0), 5.0), color=(60 - 10, 60 + 20, 60 - 10))
    assert len(blobs(GREEN, colored)) == 1  # of 0.1: enough in colour


def test_markers_are_checked():
    for bad in (
        {"radius": 0.0}, {"radius": np.inf}, {"hue": (-1, 10)}, {"hue": (10, 361)}, {"saturation": -0.1},
        {"saturation": 1.1}, {"value": (0.5, 0.5)}, {"value": (-0.1, 0.5)}, {"value": (0.5, 1.1)},
    ):  # fmt: skip
        with pytest.raises(InputError):
            Marker(**{"radius": 0.02, **bad})
    Marker(0.02, hue=(0, 360), saturation=0.0, value=(0.0, 1.0))
    Marker(0.02, saturation=1.0)
    assert TIP_MARKERS["color"].hue == (95, 140)
    assert TARGET_MARKERS["infrared"].hue is None
