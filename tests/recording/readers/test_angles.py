"""Files of arms without a whip and of their angles: they read back the same, and mistakes are named."""

from __future__ import annotations

import numpy as np
import pytest
import tomli_w
from pendulum_data import DATA
from pendulum_swing import pendulum
from scipy.special import ellipj

from whiptool.errors import InputError
from whiptool.identification.plant import read_bare_arm, write_bare_arm
from whiptool.models.parameters import ArmLink
from whiptool.recording.readers import read_recording
from whiptool.recording.readers.angles import read_swings

TWO = pendulum((ArmLink(0.2, 0.2), ArmLink(0.1, 0.2, 0.09, 3e-4, 1e-4)), (1e-3, 0.0), 0.2, (0.0, 2e-3), 9.8)


def test_a_pendulums_file_reads_back_the_same(tmp_path):
    write_bare_arm(TWO.model, tmp_path / "two.toml")
    assert read_bare_arm(tmp_path / "two.toml") == TWO.model


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({}, "links"),
        ({"links": [{"mass": 0.1}]}, r"links\[0\]\.length.*missing"),
        ({"links": [{"mass": 0.1, "length": 0.2, "colour": 1}]}, r"links\[0\]\.colour"),
        ({"links": [{"mass": -0.1, "length": 0.2}]}, "mass"),
        ({"links": [{"mass": 0.1, "length": 0.2}], "wind": 1}, "wind"),
    ],
)
def test_mistakes_in_a_pendulums_file_are_named(tmp_path, table, said):
    (tmp_path / "bad.toml").write_text(tomli_w.dumps(table))
    with pytest.raises(InputError, match=said):
        read_bare_arm(tmp_path / "bad.toml")


@pytest.mark.parametrize("amplitude", [0.3, 1.5, 2.8])
@pytest.mark.parametrize("side", [{}, {"angle_units": "deg"}, {"relative": True}])
def test_links_that_hang_at_half_a_turn_are_recognised(tmp_path, amplitude, side):
    """A swing about pi was read as an inverted one: a fit ended far away, or by an error about a length."""
    t = np.linspace(0, 5, 2000)
    swing = 2 * np.arcsin(np.sin(amplitude / 2) * ellipj(6 * t, np.sin(amplitude / 2) ** 2)[0])  # of one link, exact
    for zero in (0.0, np.pi):
        angles = zero + np.stack([swing, 0.9 * swing], axis=1)
        angles = np.diff(angles, axis=1, prepend=0) if side.get("relative") else angles
        np.savez(tmp_path / "a.npz", dt=t[1], angle=np.degrees(angles) if "angle_units" in side else angles)
        (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
        (found,) = read_swings(tmp_path / "a.npz")
        np.testing.assert_allclose(found.points[:, 0, 0], swing, atol=1e-9)
        assert any("half a turn" in note for note in found.notes) == (zero > 0)
    (tmp_path / "a.toml").write_text(tomli_w.dumps({**side, "zero": 0.0}))
    (found,) = read_swings(tmp_path / "a.npz")  # what is stated holds
    assert np.median(found.points[:, 0, 0]) > 1


@pytest.mark.parametrize("name", ["single.npz", "double.npz"])
@pytest.mark.skipif(not DATA.is_dir(), reason="no recorded pendulums next to this checkout")
def test_every_swing_of_a_real_pendulum_that_hangs_at_pi_is_recognised(name):
    for found in read_swings(DATA / name):
        assert any("half a turn" in note for note in found.notes)
        assert abs(np.median(found.points[-200:])) < 1.0


def test_npz_and_csv_tell_the_same_swing(tmp_path):
    t = np.arange(40) * 0.01
    angle = np.stack([np.cos(5 * t), 0.5 * np.sin(7 * t)], axis=1)
    velocity = np.stack([-5 * np.sin(5 * t), 3.5 * np.cos(7 * t)], axis=1)
    np.savez(tmp_path / "swing.npz", dt=0.01, angle=np.stack([angle, -angle]), velocity=np.stack([velocity, -velocity]))
    header = "t,angle1,angle2"
    first, second = read_swings(tmp_path / "swing.npz")
    assert (first.source, second.source) == (f"{tmp_path / 'swing.npz'}#0", f"{tmp_path / 'swing.npz'}#1")
    np.testing.assert_allclose(first.first_state, [angle[0], velocity[0]])
    np.testing.assert_allclose(second.points[..., 0], -angle)
    (tmp_path / "swing.toml").write_text(tomli_w.dumps({"every": 2, "sigma": 2e-3}))
    assert len(read_recording(tmp_path / "swing.npz").t) == 20
    side = {"zero": 180.0, "angle_units": "deg", "relative": True}
    relative = np.column_stack([t, np.rad2deg(np.diff(angle, axis=1, prepend=0.0)) + np.array([180.0, 0.0])])
    np.savetxt(tmp_path / "other.csv", relative, delimiter=",", header=header, comments="", fmt="%.17g")
    (tmp_path / "other.toml").write_text(tomli_w.dumps(side))
    other = read_recording(tmp_path / "other.csv")
    np.testing.assert_allclose(other.points[..., 0], angle, atol=1e-12)
    np.testing.assert_allclose(other.first_state, [angle[0], velocity[0]], atol=0.05)  # by a parabola


@pytest.mark.parametrize("key", ["angle", "velocity", "t"])
@pytest.mark.parametrize("kind", [bool, complex, str])
def test_an_npz_file_of_texts_booleans_or_complex_numbers_is_refused(key, kind, tmp_path):
    parts = {"t": np.arange(20) / 100, "angle": np.zeros((20, 1)), "velocity": np.zeros((20, 1))}
    np.savez(tmp_path / "a.npz", **parts | {key: parts[key].astype(kind)})
    with pytest.raises(InputError, match=rf"{key}: got .*numbers"):
        read_swings(tmp_path / "a.npz")
