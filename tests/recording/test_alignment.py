"""Two records of one motion: offset, rate, scale and frame are found, within what is stated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.recording.alignment import Path, align

EPOCH = 1.7e9
R = Rotation.from_euler("xyz", [0.3, 0.2, 1.4]).as_matrix()
LEVER, SHIFT = np.array([0.02, 0.03, -0.05]), np.array([0.1, 2.0, 0.3])


def place(t: np.ndarray) -> np.ndarray:
    s = np.clip(t - 0.2, 0, None)
    return np.stack([np.sin(2.5 * s) + 0.3 * np.sin(7 * s), 0.4 * s * np.cos(3 * s), 0.5 * np.sin(4 * s)], 1)


def turned(t: np.ndarray) -> np.ndarray:
    s = np.clip(t - 0.2, 0, None)
    return Rotation.from_euler("xyz", np.stack([s, 0.5 * np.sin(2 * s), -s], 1)).as_matrix()


def hand(rate: float = 500) -> Path:
    t = np.arange(0, 1.5, 1 / rate)
    return Path(t + EPOCH, place(t), turned(t))


def seen(rate: float, noise: float, seed: int, *, fps: float = 60, scale: float = 1.0) -> tuple[Path, float]:
    """A marker by another clock and in another frame; and the offset of the clocks in the middle."""
    t = np.arange(0.05, 1.35, 1 / fps)
    x = scale * (place(t) + turned(t) @ LEVER) @ R.T + SHIFT
    x += noise * np.random.default_rng(seed).normal(size=x.shape)
    return Path(0.7 + rate * t, x), 0.7 + (rate - 1) * t.mean() - EPOCH


@pytest.mark.parametrize(("fps", "logged"), [(60, 500), (240, 125), (30, 1000)])
def test_clock_and_frame_are_found_at_any_rates(fps, logged):
    track, offset = seen(1.001, 0.0, 0, fps=fps, scale=0.5)
    found = align(track, hand(logged))
    assert found is not None
    assert found.offset == pytest.approx(offset, abs=5e-5, rel=0)
    assert found.rate == pytest.approx(1.001, abs=2e-4)
    assert found.scale == pytest.approx(0.5, rel=2e-3)
    np.testing.assert_allclose(found.rotation, R, atol=5e-3)
    np.testing.assert_allclose(found.shift, SHIFT, atol=5e-3)


def test_standard_errors_are_those_of_repeated_recordings():
    """Of 25 records with 2 mm of noise, offset, rate and scale scatter as each of them states."""
    off = []
    for seed in range(25):
        track, offset = seen(1.0, 2e-3, seed)
        found = align(track, hand())
        assert found is not None
        errors = found.errors
        off.append(
            [(found.offset - offset) / errors["offset"], (found.rate - 1) / errors["rate"],
             (found.scale - 1) / errors["scale"]]
        )  # fmt: skip
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert (spread > 0.6).all()
    assert (spread < 1.5).all(), spread


def test_the_rate_falls_back_on_its_prior_where_a_record_is_short():
    track, _ = seen(1.0, 5e-3, 0)
    few = track.t < track.t[0] + 0.6
    found = align(Path(track.t[few], track.places[few]), hand())
    assert found is not None
    assert 1e-3 < found.errors["rate"] <= 2.05e-3


def test_records_of_different_motions_are_not_aligned():
    t = np.arange(0, 1.5, 0.01)
    rng = np.random.default_rng(0)
    other = Path(t, np.cumsum(rng.normal(size=(len(t), 3)), axis=0) * 0.02)
    assert align(other, hand()) is None
    assert align(Path(t, np.zeros((len(t), 3))), hand()) is None
    assert align(Path(t[:5], place(t[:5])), hand()) is None


def test_a_plane_sees_the_path_in_space():
    t = np.arange(0, 1.5, 1 / 500)
    s = np.clip(t - 0.2, 0, None)
    path = np.stack([np.sin(3 * s), 0 * s, 0.5 * np.cos(4 * s)], 1)
    flat = path[::5, [0, 2]] @ [[0.8, -0.6], [0.6, 0.8]] + [0.3, -0.2]
    found = align(Path(t[::5] + 0.25, flat), Path(t, path))
    assert found is not None
    assert found.offset == pytest.approx(0.25, abs=1e-4)
    assert found.scale == pytest.approx(1, rel=1e-3)
