"""Models and arms in TOML files: read back the same, every mistake named."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from random_models import models
from robot_files import MJCF, URDF
from spatial_arms import ARMS, random_model

from whiptool.errors import InputError
from whiptool.models import (
    load_model,
    preset,
    read_model,
    write_model,
)
from whiptool.models.files import model_from_table, model_to_table
from whiptool.models.mount import with_stick
from whiptool.models.robot_files import ArmChoice
from whiptool.models.urdf import read_urdf

ROBOT = """
[whip]
N = 3
joints = "universal"
node_inertia = 1e-7
[whip.profile]
length = 1.0
linear_density = 0.1
bending_stiffness = 2e-4
bending_damping = 2e-5
[arm]
file = "small.urdf"
tip = "tool"
locked = {finger_joint = 0.01}
stick = {length = 0.4, mass = 0.1}
"""


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_files_read_back_the_same(tmp_path, arm):
    model = random_model(rng=np.random.default_rng(5), **arm)
    write_model(model, tmp_path / "model.toml")
    assert read_model(tmp_path / "model.toml") == model


def test_hulls_and_things_next_to_the_robot_read_back_the_same(tmp_path):
    table = '<worldbody><geom name="table" type="box" size="1 1 0.1" pos="0 0 -3"/>'
    (tmp_path / "small.xml").write_text(
        MJCF.replace("<worldbody>", table).replace(
            '<inertial pos="0 0 0.02"', '<geom type="ellipsoid" size=".1 .2 .3"/><inertial pos="0 0 0.02"'
        )
    )
    model = load_model(tmp_path / "small.xml", tip="tool")
    assert model.arm.base[0].name == "table"
    assert len(model.arm.links[-1].capsules[0].hull) == 386
    write_model(model, tmp_path / "model.toml")
    assert read_model(tmp_path / "model.toml") == dataclasses.replace(model, name="small")


FURTHER = """
[arm.limits]
jerk = 500.0
[arm.limits.elbow]
acceleration = 9.0
velocity = 1.5
[arm.limits.shoulder-joint]
torque_rate = 100.0
"""


def test_limits_may_be_given_beside_a_robot_s_file(tmp_path):
    (tmp_path / "small.urdf").write_text(URDF)

    def read(text: str):
        (tmp_path / "model.toml").write_text(ROBOT + text)
        return [link.limits for link in read_model(tmp_path / "model.toml").arm.links]

    own, (rail, shoulder, elbow) = read(""), read(FURTHER)
    assert rail == dataclasses.replace(own[0], jerk=500.0)
    assert shoulder == dataclasses.replace(own[1], jerk=500.0, torque_rate=100.0)
    assert elbow == dataclasses.replace(own[2], jerk=500.0, acceleration=9.0, velocity=1.5)
    for wrong, said in (
        ("wrist = {jerk = 1.0}", "limits.wrist"),
        ("jerk = -1.0", "jerk"),
        ("elbow = 3", "limits.elbow"),
    ):
        with pytest.raises(InputError, match=f"arm.limits.*{said.split('.')[-1]}"):
            read(f"[arm.limits]\n{wrong}\n")


def test_a_file_may_name_a_robot_s_file_beside_it(tmp_path):
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "model.toml").write_text(ROBOT)
    model = load_model(str(tmp_path / "model.toml"))
    arm = read_urdf(tmp_path / "small.urdf", ArmChoice(tip="tool", locked={"finger_joint": 0.01}))
    assert model.arm == with_stick(arm, length=0.4, mass=0.1)
    assert (model.whip.N, model.whip.joints, model.whip.node_inertia) == (3, "universal", 1e-7)
    write_model(model, tmp_path / "again.toml")  # holds the arm itself
    (tmp_path / "small.urdf").unlink()
    assert read_model(tmp_path / "again.toml") == model


def test_a_robot_s_file_is_a_model_with_the_robots_rope(tmp_path):
    start, end = URDF.index('  <joint name="finger_joint"'), URDF.index("</robot>")
    (tmp_path / "arm.urdf").write_text(URDF[:start] + URDF[end:])
    model = load_model(str(tmp_path / "arm.urdf"))
    assert (model.name, model.arm.joints) == ("arm", ("rail", "shoulder_joint", "elbow"))
    assert model.whip == preset("ur5e").whip
    (tmp_path / "arm.xml").write_text(MJCF)
    with pytest.raises(InputError, match="tip: got 'none'"):
        load_model(str(tmp_path / "arm.xml"))


def test_limits_in_degrees_are_asked_about():
    """Of arms that a file describes link by link, as of robots' files; a slide's numbers are lengths."""
    table = model_to_table(preset("ur5e"))
    assert model_from_table(table).arm.notes == ()
    table["arm"]["links"][1]["limits"]["position"] = [-360, 360]
    table["arm"]["links"][2]["limits"]["velocity"] = 180
    said = "limits are farther than arms go: shoulder_lift_joint (360 rad), elbow_joint (180 rad/s); are they in"
    assert model_from_table(table).arm.notes[0].startswith(said)
    for i in (1, 2):
        table["arm"]["links"][i]["kind"] = "prismatic"
    table["arm"]["links"][1]["limits"]["position"] = [-36, 36]
    assert model_from_table(table).arm.notes == ()


def test_mistakes_are_named(tmp_path):
    (tmp_path / "small.urdf").write_text(URDF)
    good = model_to_table(preset("nah2023"))
    link = good["arm"]["links"][3]
    for arm, message in (
        ({"links": [{**link, "length": 1}]}, r"arm\.links\[0\]\.length: got 1; allowed: one of the keys mass, com"),
        ({"links": [{**link, "axis": [0, 0, 3]}]}, r"arm\.links\[0\]\.axis: .*a unit vector"),
        ({"links": [{**link, "limits": {"speed": 1}}]}, r"arm\.links\[0\]\.limits\.speed"),
        ({"links": [{**link, "limits": {"velocity": -1}}]}, r"arm\.links\[0\]\.limits\.velocity"),
        ({"links": [{"position": [0, 0, 0]}]}, r"arm\.links\[0\]\.mass: got None.*missing"),
        ({"links": [{"mass": 1, "length": 1}]}, r"whip\.joints: got 'universal'; allowed: hinge"),
        ({"file": 3}, r"arm\.file: got 3"),
        ({"file": "robot.sdf"}, "arm: file: .*a robot's file: .urdf, .xml"),
        ({"file": "none.urdf"}, "arm: file: .*readable"),
        ({"file": "small.urdf", "end": "tool"}, r"arm\.end: got 'tool'; allowed: one of the keys tip"),
        ({"file": "small.urdf", "tip": "tool", "moving": ["wrist"]}, "moving: got 'wrist'"),
        ({"file": "small.urdf", "tip": "tool", "stick": 0.4}, r"arm\.stick: got 0.4"),
        ({"file": "small.urdf", "tip": "tool", "stick": {"length": -1, "mass": 0}}, "stick length"),
    ):
        with pytest.raises(InputError, match=message):
            model_from_table({**good, "arm": arm}, tmp_path)
    with pytest.raises(InputError, match=r"whip\.joints: got 'hinge'; allowed: universal or rod"):
        model_from_table({**good, "whip": {**good["whip"], "joints": "hinge", "node_inertia": 0}})
    with pytest.raises(InputError, match=r"^model: got 'robot\.sdf'; allowed: a preset .*ur5e"):
        load_model("robot.sdf")


def test_capsules_are_in_the_file_and_bad_ones_are_named(tmp_path):
    arm = preset("panda").arm
    table = model_to_table(preset("panda"))
    assert model_from_table(table).arm == arm
    assert table["arm"]["never_touch"] == [["joint1", "joint3"]]
    assert "capsules" not in model_to_table(preset("nah2023"))["arm"]["links"][0]
    for path, value, message in (
        (("links", 0, "capsules", 0, "radius"), -1, r"arm.links\[0\].capsules\[0\].radius"),
        (("links", 0, "capsules"), 3, r"arm.links\[0\].capsules"),
        (("base", 0, "thick"), 3, r"arm.base\[0\].thick"),
        (("never_touch",), [["joint1", "elbow"]], "arm.never_touch"),
        (("never_touch",), "joint1", "arm.never_touch"),
    ):
        bad = copy.deepcopy(table)
        at = bad["arm"]
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value
        with pytest.raises(InputError, match=message):
            model_from_table(bad)


ROUND = {"length": 1.0, "youngs_modulus": 2e5, "diameter": 0.0127, "density": 700.0, "bending_damping": 2.6e-5}


@given(models())
@settings(max_examples=50, deadline=None, derandomize=True)
def test_files_read_back_the_same_files(tmp_path_factory, model):
    path = tmp_path_factory.mktemp("model") / "model.toml"
    write_model(model, path)
    again = read_model(path)
    assert again == model
    assert again.name == model.name
    assert load_model(str(path)) == model


def test_mistakes_in_files_are_named(tmp_path):
    good = model_to_table(preset("lemon2024"))
    for change, name in (
        ({"whip": {**good["whip"], "N": 0}}, r"whip\.N: got 0"),
        ({"whip": {**good["whip"], "mass": 1}}, r"whip\.mass: got 1; allowed: one of the keys N, l, m"),
        ({"whip": {"N": 3}}, r"whip\.l: got None.*missing"),
        ({"gravitee": 1}, "gravitee"),
        ({"arm": {"links": []}}, r"arm\.links"),
        ({"arm": {"links": [{"mass": -1, "length": 1}]}}, r"arm\.links\[0\]\.mass: got -1"),
        ({"arm": 3}, "arm: got 3; allowed: a table"),
        ({"whip": {"N": 4, "profile": {"length": -1}}}, r"whip\.profile\."),
        ({"whip": {"N": 4, "l": 1, "profile": {}}}, r"whip\.l"),
        ({"whip": {"N": 4, "profile": {"length": 1, "density": 700}}}, r"whip\.profile\.youngs_modulus: got None"),
        ({"whip": {"N": 4, "profile": ROUND | {"density": -1}}}, r"whip\.profile\.density"),
        (
            {"whip": {"N": 4, "profile": ROUND | {"linear_density": 1}}},
            r"whip\.profile\.linear_density",
        ),
        ({"whip": {"N": 4, "clamp": 1.5, "profile": ROUND}}, r"whip\.clamp: got 1\.5; allowed: true or false"),
    ):
        with pytest.raises(InputError, match=name):
            model_from_table({**good, **change})
    (tmp_path / "broken.toml").write_text("whip = [")
    with pytest.raises(InputError, match="valid TOML"):
        read_model(tmp_path / "broken.toml")
    with pytest.raises(InputError, match="readable"):
        read_model(tmp_path / "absent.toml")


def test_a_profile_in_a_file_is_lumped(tmp_path):
    path = tmp_path / "tapered.toml"
    path.write_text("""
        [whip]
        N = 6
        [whip.profile]
        length = 0.9
        linear_density = 0.2
        bending_stiffness = 0.02
        bending_damping = 0.005
        density_taper = 0.3
        [arm]
        links = [{mass = 0.25, length = 0.31}, {mass = 0.274, length = 0.34}]
    """)
    whip = read_model(path).whip
    assert (whip.N, whip.length) == (6, pytest.approx(0.9))
    density = 0.2 * (0.3 - 1) / np.log(0.3) * 0.9  # integral of the geometric taper
    assert whip.mass == pytest.approx(density)


def test_a_rope_by_its_material_is_that_of_the_presets():
    """Whose stiffness is written with the radius, E pi r^4 / 4; clamped it bends at the hand by half a link's share."""
    EI = 2e5 * np.pi * 0.00635**4 / 4
    arm = model_to_table(preset("ur5e"))["arm"]
    whip = {"N": 20, "joints": "rod", "profile": {**ROUND, "bending_damping": 0.1 * EI}}
    rope = model_from_table({"whip": whip, "arm": arm}).whip
    for name in ("l", "m", "k", "b"):
        np.testing.assert_allclose(rope.per_node(name), preset("ur5e").whip.per_node(name), rtol=1e-12)
    clamped = model_from_table({"whip": {**whip, "clamp": True}, "arm": arm}).whip
    np.testing.assert_allclose(clamped.per_node("k"), EI * 20 * np.r_[2, np.ones(19)], rtol=1e-12)
    assert model_from_table({"whip": {**whip, "clamp": False}, "arm": arm}).whip == rope
