"""What a command line says of a fit: recordings to hold out, names, profiles, priors and controllers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w

from whiptool.errors import InputError
from whiptool.identification.inputs import (
    check_controllers,
    common_controller,
    full_name,
    in_pixels,
    may_be_filmed,
    opened,
    profile_of,
    read_marker,
    read_prior,
    split,
    tracked,
)
from whiptool.identification.plant import Plant
from whiptool.identification.variables import names_of
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.parameters import Model
from whiptool.models.whip import WhipParameters

LEMON = preset("lemon2024")
PLANT = Plant(LEMON, Controller(OIAC()))


@pytest.mark.parametrize(
    ("recordings", "held_out", "fitted", "others"),
    [
        ("ab", None, "ab", ""), ("abc", None, "ab", "c"), ("abcd", None, "abc", "d"), ("abcd", ("2",), "ab", "cd"),
        ("abcd", ("0",), "abcd", ""), ("abcd", ("b", "d"), "ac", "bd"), ("abc", ("c", "x", "x"), "ab", "cx"),
    ],
)  # fmt: skip
def test_what_is_held_out(recordings, held_out, fitted, others):
    assert split(tuple(recordings), held_out) == (list(fitted), list(others))


def test_something_is_fitted_and_nothing_twice():
    with pytest.raises(InputError, match="recordings: got 'a'"):
        split(("a", "b", "a"), None)
    for held_out in (("2",), ("3",), ("a", "b")):
        with pytest.raises(InputError, match="at least one has to be fitted"):
            split(("a", "b"), held_out)


def test_short_names_are_looked_up():
    assert full_name("k", PLANT) == full_name("whip.k", PLANT) == "whip.k"
    assert full_name("a", PLANT) == "law.a"
    assert full_name("delay", PLANT) == "delay"
    assert full_name("arm.mass[0]", PLANT) == "arm.mass[0]"
    profiled = Plant(LEMON, None, profile_of(LEMON, ""))
    assert full_name("length", profiled) == "profile.length"
    with pytest.raises(InputError, match=r"^free parameter: .*; the profile gives"):
        full_name("k", profiled)
    with pytest.raises(
        InputError, match=r"^free parameter: .* whip.k\[0\] and so on; this model has a value per node$"
    ):
        full_name("k", Plant(profiled.model))
    with pytest.raises(InputError, match=r"^free parameter: got 'colour'; allowed: one of l, m, k, b, "):
        full_name("colour", PLANT)


def test_short_names_end_names_or_name_all_elements():
    known = ["gravity", "whip.a", "law.a", "link.com[0]", "link.com[1]", "link.incom[0]"]
    for name, found in {
        "gravity": ["gravity"],
        "law.a": ["law.a"],
        "a": ["whip.a", "law.a"],
        "com[1]": ["link.com[1]"],
        "com": ["link.com[0]", "link.com[1]"],
        "link.com": ["link.com[0]", "link.com[1]"],
        "om": [],
        "": [],
    }.items():
        assert names_of(name, known) == found


def test_a_short_name_of_several_numbers_is_refused():
    with pytest.raises(InputError, match=r"got 'mass'; allowed: one of arm\.mass\[0\], arm\.mass\[1\]$"):
        full_name("mass", PLANT)


def test_a_prior_file_is_named_where_a_name_is_unknown(tmp_path):
    (tmp_path / "prior.toml").write_text("colour = {value = 1.0, error = 0.1}\n")
    with pytest.raises(InputError, match=r"prior\.toml: free parameter: got 'colour'"):
        read_prior(str(tmp_path / "prior.toml"), PLANT, ("whip.k",))


def test_the_profile_of_a_uniform_whip_is_lumped_back_into_it():
    """But for half a node's mass and drag that the handle takes."""
    whip = WhipParameters(N=8, l=0.1, m=0.02, k=0.3, b=0.05, rest_angle=0.04, drag=3e-3)
    lumped = profile_of(Model(arm=LEMON.arm, whip=whip), "").lump(8)
    assert lumped.length == pytest.approx(whip.length)
    for name in ("k", "b", "rest_angle"):
        np.testing.assert_allclose(lumped.per_node(name)[1:], whip.per_node(name)[1:])
    for name in ("m", "drag"):
        np.testing.assert_allclose(lumped.per_node(name)[:-1], whip.per_node(name)[:-1])
        assert lumped.per_node(name)[-1] == pytest.approx(whip.per_node(name)[-1] / 2)
    again = profile_of(Model(arm=LEMON.arm, whip=lumped), "")
    assert again.numbers == pytest.approx(profile_of(Model(arm=LEMON.arm, whip=whip), "").numbers)


def test_a_whip_that_was_lumped_from_a_uniform_profile_is_known_by_it():
    """The rope of the robots: 1 m, radius 6.35 mm, 700 kg/m^3, E = 2e5 Pa."""
    profile = profile_of(preset("ur5e"), "")
    assert profile.length == pytest.approx(1.0)
    assert profile.linear_density == pytest.approx(700 * np.pi * 6.35e-3**2)
    assert profile.bending_stiffness == pytest.approx(2e5 * np.pi * 6.35e-3**4 / 4)
    assert profile.bending_damping == pytest.approx(0.1 * profile.bending_stiffness)
    rope = preset("ur5e").whip
    bent = replace(rope, k=(*rope.per_node("k")[:-1], 2 * rope.per_node("k")[-1]))
    with pytest.raises(InputError, match="a value per node"):
        profile_of(replace(preset("ur5e"), whip=bent), "")


def test_the_profile_of_a_file_is_the_files(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        "[whip.profile]\nlength = 0.7\nlinear_density = 0.1\nbending_stiffness = 0.01\nbending_damping = 0.002\n"
    )
    assert profile_of(LEMON, str(file)).length == 0.7
    file.write_text("[whip]\nN = 3\n")
    assert profile_of(LEMON, str(file)).length == pytest.approx(LEMON.whip.length)


def test_priors_are_independent_with_the_squares_of_their_errors(tmp_path):
    file = tmp_path / "prior.toml"
    file.write_text('k = {value = 0.3, error = 0.1}\n"delay" = {value = -0.01, error = 0.005}\n')
    prior = read_prior(str(file), PLANT, ("whip.k", "delay", "whip.m"))
    assert prior is not None
    assert (prior.names, prior.mean) == (("whip.k", "delay"), (0.3, -0.01))
    np.testing.assert_allclose(prior.covariance, np.diag([0.01, 2.5e-5]))
    assert read_prior(None, PLANT, ()) is None
    for text in (
        "k = {value = 0.0, error = 0.1}",
        "k = {value = 0.3, error = 0.0}",
        "k = 3",
        "b = {value = 1, error = 1}",
        "",
    ):
        file.write_text(text)
        with pytest.raises(InputError):
            read_prior(str(file), PLANT, ("whip.k", "delay"))


def test_markers_are_read_and_checked(tmp_path):
    file = tmp_path / "marker.toml"
    file.write_text("radius = 0.02\nhue = [95, 140]\n")
    marker = read_marker(str(file))
    assert marker is not None
    assert (marker.radius, marker.hue) == (0.02, (95, 140))
    assert read_marker(None) is None
    for text in ("radius = 0.02\ncolour = 3", "radius = -1.0", "hue = [95, 140]"):
        file.write_text(text)
        with pytest.raises(InputError):
            read_marker(str(file))


def recording(source: str, **table) -> SimpleNamespace:
    return SimpleNamespace(source=source, called=source, controller={"law": "oiac", **table} if table else None)


def test_recordings_share_a_controller_and_what_it_compensates():
    masses = [0.1, 0.2, 0.3]
    told, untold, none = recording("a", a=0.1, compensated=masses), recording("b", a=0.1), recording("c")
    expected = Controller(OIAC(a=0.1), compensated=tuple(masses))
    for order in ([told, untold, none], [none, untold, told], [untold, told, told]):
        assert common_controller(order) == expected
    assert common_controller([untold, none]) == Controller(OIAC(a=0.1))
    assert common_controller([none]) is None
    with pytest.raises(InputError, match="x: controller"):
        common_controller([told, recording("x", a=0.2)])
    with pytest.raises(InputError, match="x: controller"):
        common_controller([told, recording("x", a=0.1, compensated=[0.1, 0.2, 0.4])])
    with pytest.raises(InputError, match="x: controller"):
        common_controller([recording("x", a=-1.0)])


def test_another_controller_than_the_plants_is_refused():
    """What was compensated may be unsaid, and so may how long the torque was held; what is fitted may differ."""
    plant = Controller(OIAC(a=0.1), compensated=(0.1, 0.2, 0.3), control_period=0.002)
    masses = [0.1, 0.2, 0.3]
    told = recording("a", a=0.1, compensated=masses, control_period=0.002)
    check_controllers([told, recording("b", a=0.1), recording("c")], plant)
    check_controllers([recording("x", a=0.2)], plant, free=["whip.k", "law.a"])
    refused = {
        "law = constant'; allowed: law = oiac": {"law": "constant"},
        "law = oiac, a = 0.2'; allowed: law = oiac, a = 0.1": {"a": 0.2},
        "law = oiac, control_period = 0.005'; allowed: law = oiac, control_period = 0.002": {
            "a": 0.1,
            "control_period": 0.005,
        },
        "law = oiac, torque_limit = 2.0'; allowed: law = oiac, torque_limit = None": {"a": 0.1, "torque_limit": 2.0},
        "law = oiac, compensated = .*0.4": {"a": 0.1, "compensated": [0.1, 0.2, 0.4]},
    }
    for said, table in refused.items():
        with pytest.raises(InputError, match=f"x: controller: got '{said}.*as the plant's controller has"):
            check_controllers([told, recording("x", **table)], plant)
    with pytest.raises(InputError, match="law = oiac'; allowed: law = constant"):
        check_controllers([told], Controller(ConstantImpedance()), free=["law.K[0]"])


@pytest.mark.slow
def test_an_episode_of_a_dataset_is_named_behind_its_folder(tmp_path):
    pytest.importorskip("pyarrow", reason="needs the extra `io`")
    from recordings import TABLE, H, T, write_lerobot

    write_lerobot(tmp_path / "set")
    sidecar = {"homography": H.tolist(), "episode": {"1": {"strike": TABLE}}}
    (tmp_path / "set" / "whiptool.toml").write_text(tomli_w.dumps(sidecar))
    recording, synthetic = tracked(opened(f"{tmp_path / 'set'}#1"), name="set#1")
    assert recording.strike is not None
    assert (len(recording.t), recording.markers, synthetic) == (T, ("tip", "handle"), False)
    with pytest.raises(InputError, match="episode"):
        opened(f"{tmp_path / 'set'}#7")
    with pytest.raises(InputError, match="exists"):
        opened(f"{tmp_path / 'none'}#1")


@pytest.mark.parametrize(
    ("name", "head", "pixels"),
    [
        ("left.csv", "t,tip_u,tip_v", True),
        ("left.csv", '"t" , "tip_u" , "tip_v"', True),
        ("places.csv", "t,tip_x,tip_y,tip_z", False),
        ("left.npz", "t,tip_u,tip_v", False),
    ],
)
def test_pixels_are_told_by_the_columns_of_a_csv(tmp_path, name, head, pixels):
    (tmp_path / name).write_text(f"{head}\n0,1,2,3\n")
    assert in_pixels(str(tmp_path / name)) is pixels


def test_body_parts_are_in_pixels_where_their_sidecar_names_a_camera_and_no_plane(tmp_path):
    (tmp_path / "left.csv").write_text("scorer,me,me\nbodyparts,tip,tip\ncoords,x,y\n0,1,2\n")
    assert not in_pixels(str(tmp_path / "left.csv"))
    for said, pixels in (('camera = "left"\n', True), ('camera = "iPhone"\nscale = 0.001\n', False)):
        (tmp_path / "left.toml").write_text(said)
        assert in_pixels(str(tmp_path / "left.csv")) is pixels


def test_a_file_that_is_not_there_is_not_in_pixels(tmp_path):
    assert not in_pixels(str(tmp_path / "absent.csv"))


def test_forms_that_can_hold_images(tmp_path):
    for name in ("strike.mp4", "strike.csv"):
        (tmp_path / name).write_bytes(b"t,tip_x,tip_y\n")
    assert may_be_filmed(str(tmp_path / "strike.mp4"))
    assert not may_be_filmed(str(tmp_path / "strike.csv"))


def test_cameras_are_for_what_is_in_pixels(tmp_path):
    """A table of places is read as it is, whatever cameras there are for the others."""
    (tmp_path / "places.csv").write_text("t,tip_x,tip_y\n0,1,2\n0.02,1,2\n")
    (tmp_path / "places.toml").write_text("sigma = 0.002\n")
    found = opened(str(tmp_path / "places.csv"), cameras=tmp_path / "absent.toml")
    assert found.view is None
    assert found.points[1, 0].tolist() == [1.0, 2.0]
