"""Recordings: their defaults, shapes and rules."""

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest
from recordings import T, full, fuzz, places, same, times
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.impedance.controller import controller_from_table, controller_to_table
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.readers import (
    read_recording,
)
from whiptool.recording.readers.keys import Keys
from whiptool.recording.strike_recording import StrikeRecording

# ---------------------------------------------------------------- the recording itself


def test_defaults_and_shapes():
    points = places()
    points[9, 0, 0] = np.nan  # half a point is no point
    r = StrikeRecording(times(), points, ("tip", "handle"))
    assert r.sigma.shape == r.t_points.shape == r.seen.shape == (T, 2)
    np.testing.assert_array_equal(r.t_points[:, 1], r.t)
    assert np.isnan(r.marker("tip")[9]).all()
    assert r.seen.sum() == 2 * T - 4
    assert r.provenance["markers"] == {"tip": T - 1, "handle": T - 3}
    points[:] = 7
    assert (r.points[r.seen] != 7).all()  # it keeps a copy
    hidden = r.without(r.t > 0.2)
    assert hidden.seen[r.t <= 0.2].sum() == r.seen[r.t <= 0.2].sum()
    assert not hidden.seen[r.t > 0.2].any()
    with pytest.raises(InputError, match="tip, handle"):
        r.marker("toe")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"t": np.zeros(T)}, "later than"),
        ({"t": np.r_[times()[:-1], 0.1]}, r"t\[29\]"),
        ({"t": np.arange(T) * 16.7}, "milliseconds or frame numbers"),
        ({"t": np.r_[np.nan, times()[1:]]}, "NaN at index 0"),
        ({"t": [0.0]}, "at least two times"),
        ({"t": "now"}, "numbers"),
        ({"points": 1e3 * places()}, "millimetres or pixels"),
        ({"points": places()[:, :1]}, "shape"),
        ({"points": np.full((T, 2, 2), np.nan)}, "not missing"),
        ({"points": np.where(np.isnan(places()), np.inf, 0)}, "finite"),
        ({"markers": ("tip", "tip")}, "all different"),
        ({"sigma": 0.0}, "> 0 m"),
        ({"sigma": np.ones(7)}, "broadcasts"),
        ({"t_points": times()[:, None] + 9}, "within 1 s"),
        ({"exposure": -1}, "span"),
        ({"joints_q": np.full((50, 2), 90.0)}, "degrees"),
        ({"joints_q": None}, "both or neither"),
        ({"joints_t": np.zeros(50)}, "later than"),
        ({"target": (1.0,)}, "2 or 3 coordinates"),
        ({"controller": {"law": "x", "f": object()}}, "finite numbers"),
        ({"controller": {"a": 1}}, "law"),
    ],
)
def test_broken_rules(change, said):
    with pytest.raises(InputError, match=said) as caught:
        dataclasses.replace(full(), **change)
    assert "\n" not in str(caught.value)


def test_a_controller_is_kept_as_its_table():
    controller = Controller(ConstantImpedance(), torque_limit=4.0)
    given, table = (
        StrikeRecording(times(), places(), ("tip", "handle"), controller=x)
        for x in (controller, controller_to_table(controller))
    )
    assert given.controller == table.controller
    assert controller_from_table(given.controller) == controller
    with pytest.raises(InputError, match="allowed: a Controller, or its table with the key law"):
        StrikeRecording(times(), places(), ("tip", "handle"), controller="oiac")


def test_a_strike_may_be_its_vector():
    vector = np.array([-1.2, 0.9, 1.2, 0.3, 0.7])
    assert dataclasses.replace(full(), strike=vector).strike == Strike.from_vector(vector)
    with pytest.raises(InputError, match=r"^strike"):
        dataclasses.replace(full(), strike=vector[:4])


def test_frames_belong_to_the_strike_or_to_the_moment_before_it():
    """A whip is filmed as it hangs before its command; a clock that counts from elsewhere is none of the command's."""
    assert dataclasses.replace(full(), t=times() - 0.9, t_points=None, joints_t=None, joints_q=None).strike is not None
    for late in (-60.0, 60.0):
        with pytest.raises(InputError, match=r"frames within the strike, 0 to 1\.3 s.*start"):
            dataclasses.replace(full(), t=times() + late, t_points=None, joints_t=None, joints_q=None)


def test_a_command_that_is_missing_is_asked_for_where_it_can_be_told():
    t = np.arange(9) / 60
    none = StrikeRecording(t, np.zeros((9, 1, 2)), ("tip",), source="films/a.csv")
    with pytest.raises(
        InputError, match=r"write a\.toml next to it with strike = \{q_i = .*strike=Strike\(q_i, q_f, D\)\)$"
    ):
        none.commanded()
    with pytest.raises(InputError, match=r"got 'twin-3'; .*command; in Python, give .*, or drive by joints$"):
        dataclasses.replace(none, source="twin-3").commanded(", or drive by joints")


def test_a_strike_in_degrees_is_refused_where_its_arm_is_known():
    """No arm turns a joint by more than two turns."""
    t = np.arange(9) / 60
    told = StrikeRecording(t, np.zeros((9, 1, 2)), ("tip",), strike=[-78.0, 27.0, 99.0, 81.0, 0.95], source="deg.csv")
    with pytest.raises(InputError, match=r"deg\.csv: strike: got '-78 rad of shoulder'.*are these degrees\?"):
        told.for_model(preset("lemon2024"))
    right = dataclasses.replace(told, strike=[-1.36, 0.47, 1.73, 1.41, 0.95])
    assert right.for_model(preset("lemon2024")) is right


def test_a_standard_error_in_millimetres_is_asked_about():
    t = np.arange(9) / 60
    points = np.stack([np.sin(t), -np.cos(t)], axis=1)[:, None]
    StrikeRecording(t, points, ("tip",), np.array(1.0))
    with pytest.raises(InputError, match=r"^sigma: got 2\.0; .*are these millimetres\?$"):
        StrikeRecording(t, points, ("tip",), np.array(2.0))


def test_npz_round_trip(tmp_path):
    full().save(tmp_path / "a.npz")
    same(StrikeRecording.load(tmp_path / "a.npz"), full())
    same(read_recording(tmp_path / "a.npz"), full())
    np.savez(tmp_path / "b.npz", t=times(), points=places(), markers=["tip", "handle"])  # by hand
    b = read_recording(tmp_path / "b.npz")
    assert b.source == str(tmp_path / "b.npz")
    assert len(b.sha256) == 64


def test_npz_never_unpickles(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    np.savez(tmp_path / "a.npz", t=times(), points=places(), markers=np.array([Bomb(), Bomb()], object))
    with pytest.raises(InputError, match="pickled objects"):
        read_recording(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(InputError):
        read_recording(tmp_path / "b.npz")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"t": times(), "points": places()}, "markers"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "colour": 1}, "colour"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "format": 2}, "another version"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "strike": [1.0, 2.0]}, "strike"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "controller": "{"}, "JSON"),
    ],
)
def test_npz_damage(tmp_path, arrays, said):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.npz")


def test_fuzz_npz(tmp_path):
    full().save(tmp_path / "a.npz")
    fuzz(tmp_path / "a.npz", 150, lambda: read_recording(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", t=times(), points=places(), markers=["tip", "handle"])  # not compressed
    fuzz(tmp_path / "b.npz", 150, lambda: read_recording(tmp_path / "b.npz"))


def test_what_is_turned_upright_is_one_rigid_motion_of_points_and_poses():
    """A marker fixed to the hand stays where it is in the hand; all of it turns as by Euler's angle about x."""
    rng = np.random.default_rng(0)
    turns, places_of = Rotation.random(T, random_state=1), rng.normal(size=(T, 3))
    marker = places_of + turns.apply([0.1, -0.2, 0.3])
    pose = np.hstack([places_of, turns.as_quat()])
    seen = StrikeRecording(times(), marker[:, None], ("m",), hand_t=times(), hand_pose=pose, up="y")
    turned, by = seen.upright("z"), Rotation.from_euler("x", 90, degrees=True)
    found = Rotation.from_quat(turned.hand_pose[:, 3:])
    np.testing.assert_allclose(turned.hand_pose[:, :3], by.apply(places_of), atol=1e-14)
    assert ((by * turns) * found.inv()).magnitude().max() < 1e-14
    np.testing.assert_allclose(turned.hand_pose[:, :3] + found.apply([0.1, -0.2, 0.3]), turned.marker("m"), atol=1e-14)
    back = turned.upright("y")
    np.testing.assert_allclose(back.hand_pose[:, :3], places_of, atol=1e-14)
    assert (turns * Rotation.from_quat(back.hand_pose[:, 3:]).inv()).magnitude().max() < 1e-14


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("points", places() + 1j * 0),
        ("points", places() > 0),
        ("points", places().astype(str)),
        ("points", [[["1_0.5", "0.2"]] * 2] * T),
        ("sigma", True),
        ("sigma", "0.001"),
        ("sigma", 1e-3 + 0j),
        ("exposure", True),
        ("exposure", [0.001, 0.002]),
        ("t_stay", False),
        ("joints_q", np.ones((50, 2), bool)),
        ("target", [True, False]),
        ("t_points", times()[:, None] + 0j),
        ("t", times() + 0j),
    ],
)
def test_texts_booleans_and_complex_numbers_are_no_numbers(name, value):
    with pytest.raises(InputError, match=rf"{name}: got "):
        dataclasses.replace(full(), **{name: value})


@pytest.mark.parametrize("value", [[True, False], ["1", "2"], ["1_0", "2"]])
def test_texts_and_booleans_of_a_sidecar_are_no_numbers(value):
    with pytest.raises(InputError, match=r"origin: got .*finite numbers"):
        Keys({"origin": value}, Path(), "").array("origin", 2)


def test_missing_numbers_may_be_none():
    some = places().tolist()
    some[0][0] = [None, None]
    assert not StrikeRecording(times(), some, ("tip", "handle")).seen[0, 0]
