"""Arms in space in TOML files, by their links or by a robot's file."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from robot_files import MJCF, URDF
from spatial_arms import ARMS, random_model

from whiptool.errors import InputError
from whiptool.models import load_model, preset, read_model, write_model
from whiptool.models.arm_choice import ArmChoice
from whiptool.models.files import model_from_table, model_to_table
from whiptool.models.stick import with_stick
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
    said = "limits are farther than arms go: shoulder_lift (360 rad), elbow (180 rad/s); are they in degrees?"
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
