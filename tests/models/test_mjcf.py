"""Arms from MJCF: what only MuJoCo's files have; test_urdf.py compares a whole robot."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from repository import ROOT
from robot_files import MJCF

from whiptool.errors import InputError
from whiptool.impedance import ConstantImpedance, Controller, PositionControl
from whiptool.limits.clearance import Clearance
from whiptool.models import Model
from whiptool.models.files import read_robot
from whiptool.models.kinematics import arm_frames
from whiptool.models.mjcf import read_mjcf
from whiptool.models.presets import preset
from whiptool.models.robot_files import ArmChoice
from whiptool.models.scene import Scene
from whiptool.rollout.mujoco_model import build_spec, export_xml

TIP = ArmChoice(tip="tool")


@pytest.fixture
def read(tmp_path):
    def read(text: str, choice: ArmChoice | None = TIP):
        path = tmp_path / "small.xml"
        path.write_text(text)
        return read_mjcf(path, choice)

    return read


SHOULDER = """<mujoco><worldbody><body name="upper" pos="0.1 0 0.5" euler="0 20 0">
  <joint name="x" axis="1 0 0" pos="0 0.1 0"/><joint name="y" axis="0 1 0"/>
  <joint name="z" axis="0 0 1" armature="0.3"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03"/>
  <body name="fore" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" ref="30"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02"/><site name="hand" pos="0 0 -0.25" euler="0 90 0"/></body>
</body></worldbody></mujoco>"""


def test_several_hinges_on_one_body_have_massless_links_and_the_hand_may_be_a_site(read):
    arm = read(SHOULDER, ArmChoice(tip="hand"))
    assert arm.joints == ("x", "y", "z", "elbow")
    assert (arm.per_link("mass")[:3] > 0).tolist() == [False, False, True]
    assert arm.links[2].armature == 0.3
    model = mujoco.MjModel.from_xml_string(SHOULDER)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(0).uniform(-1, 1, (5, 4)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        hand, site = arm_frames(arm, q)[-1], data.site("hand")
        np.testing.assert_allclose(hand.origin, site.xpos, atol=1e-15)
        np.testing.assert_allclose(-hand.rotation[:, 2], site.xmat.reshape(3, 3)[:, 2], atol=1e-14)


def test_an_exported_model_is_read_back(read):
    """To the six digits that MuJoCo writes."""
    panda = preset("panda")
    arm = read(export_xml(panda)[0], ArmChoice(tip="whip1", moving=panda.arm.joints))
    assert arm.joints == panda.arm.joints
    for ours, theirs in zip(panda.arm.links[:6], arm.links, strict=False):  # the whip counts with the seventh
        for name in ("mass", "com", "inertia", "position", "rotation"):
            np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=1e-5, atol=1e-6, err_msg=name)
        assert theirs.limits.position == pytest.approx(ours.limits.position)
    np.testing.assert_allclose(arm.hand_position, panda.arm.hand_position, atol=1e-12)


@pytest.mark.parametrize("name", ["nah2023", "ur5e", "panda"])
def test_presets_weigh_the_same_in_mujoco(name):
    model = preset(name)
    mj = build_spec(model).compile()
    assert mj.body_mass.sum() == pytest.approx(model.arm.per_link("mass").sum() + model.whip.mass)


@pytest.mark.parametrize(
    ("text", "choice", "message"),
    [
        ("", TIP, "file: got 'no model'; allowed: an MJCF file that MuJoCo compiles"),
        (MJCF, None, "tip: got 'none'; .*as the robot branches: tool, finger"),
        (MJCF, ArmChoice(tip="flange"), "tip: got 'flange'; allowed: one of base, cart"),
        (MJCF, ArmChoice(tip="tool", moving=("wrist",)), "moving: got 'wrist'; allowed: one of the joints rail,"),
        (MJCF, ArmChoice(tip="tool", locked={"wrist": 1}), "locked: got 'wrist'"),
        (MJCF.replace('name="shoulder-joint" axis="0 0.6 0.8"', 'name="shoulder-joint" type="ball"').replace(
            '<motor joint="shoulder-joint" gear="2" forcerange="-10 10"/>', ""),
         TIP, "joint shoulder-joint: got 'ball'; allowed: hinge or slide"),
        (MJCF.replace('<joint joint1="finger_joint"/>', '<connect body1="tool" body2="base" anchor="0 0 0"/>'), TIP,
         "equality .*: got 'a connection of two bodies'; allowed: a chain without loops"),
        (MJCF.replace('<inertial pos="0 0 0.15" mass="1.2" diaginertia="0.01 0.012 0.004"/>', ""), TIP,
         "got 'no model'.*mass and inertia of moving bodies"),
        (MJCF.replace('<compiler angle="radian"/>', '<compiler angle="radian"/><option gravity="0 0 9.81"/>'), TIP,
         r"option gravity: got \(0.0, 0.0, 9.81\); allowed: 0 0 -9.81 .*--mount"),
        (MJCF.replace('<compiler angle="radian"/>',
                      '<compiler angle="radian"/><option><flag gravity="disable"/></option>'), TIP,
         r"option gravity: got \(0.0, 0.0, 0.0\); allowed: 0 0 -9.81 .*--mount"),
        (MJCF.replace('range="-0.3 0.4"', ""), TIP, "joint rail: position: got 'no range'.*arm.locked = { rail = 0 }"),
        (MJCF.replace('range="-0.3 0.4"', 'range="0.4 -0.3"'), TIP,
         'joint rail: got \'range 0.4 -0.3\'; allowed: a range whose first value .* limited="false"; correct it'),
        (MJCF.replace('range="-2 2"', 'range="140 -140"'), TIP, "joint elbow: got 'range 140 -140'"),
        (MJCF.replace('range="-2 2"', 'range="140 -140"'), ArmChoice(tip="tool", locked={"elbow": 0.1}),
         "joint elbow: got 'range 140 -140'"),
        (MJCF.replace('damping="0.5"', 'damping="-0.5"'), TIP, "rail: friction: got -0.5.*correct it in the file"),
        (MJCF.replace('joint1="finger_joint"', 'joint1="elbow" joint2="rail"'), TIP,
         "joint elbow: got 'tied to rail'; .*arm.locked = { elbow = 0 }"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said_in_one_line(read, text, choice, message):
    with pytest.raises(InputError, match=message) as caught:
        read(text, choice)
    assert "\n" not in str(caught.value)


def test_a_range_of_a_joint_that_is_not_limited_means_nothing(read):
    arm = read(MJCF.replace('range="-2 2"', 'range="140 -140" limited="false"'))
    assert arm.links[2].limits.position == (-np.inf, np.inf)
    read(MJCF.replace('range="0 0.05"', 'range="0.05 0" limited="false"'))  # of a gripper's


def test_a_body_whose_mesh_is_not_there_and_that_has_no_inertial_is_weightless(read):
    """Its kinematics are the file's, torques are not limited; the base, which does not move, needs no inertia."""
    inertial = '<inertial pos="0.01 0.02 0.03" euler="0.3 0 0" mass="2" diaginertia="0.02 0.03 0.025"/>'
    without = MJCF.replace(inertial, "").replace('<inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>', "")
    assert without.count("inertial") == MJCF.count("inertial") - 2
    arm, whole = read(without), read(MJCF)
    assert (arm.weightless, whole.weightless) == (("rail",), ())
    assert arm.links[0].mass == 0
    assert arm.links[1:] == tuple(replace(x, limits=replace(x.limits, torque=np.inf)) for x in whole.links[1:])
    assert arm.notes[0].startswith(
        "no mass of what rail moves is given (no <inertial>, or a mass of 0): the arm has to be under position control"
    )
    assert read(without.replace('<body name="cart"', "<body")).weightless == ("rail",)
    Controller(PositionControl()).check_fits(arm)
    with pytest.raises(InputError, match=r"arm: got 'unknown inertia of the links of rail'.*--controller position"):
        Controller(ConstantImpedance()).check_fits(arm)


def test_meshes_tell_an_inertia_and_what_a_shape_is_fitted_to(read, tmp_path):
    """A tetrahedron of 1/6 m3, as MuJoCo weighs it, and its ball."""
    (tmp_path / "corner.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    text = """<mujoco><asset><mesh name="corner" file="corner.obj"/></asset><worldbody><body name="one">
      <joint name="j"/>{}</body>
</worldbody></mujoco>"""
    arm = read(text.format('<geom type="mesh" mesh="corner" density="600"/>'), ArmChoice())
    assert arm.links[0].mass == pytest.approx(100, rel=1e-6)
    assert arm.links[0].com == pytest.approx((0.25, 0.25, 0.25))
    fitted = read(text.format('<geom type="sphere" mesh="corner" fitscale="0.5"/>'), ArmChoice())
    whole = mujoco.MjSpec.from_file(str(tmp_path / "small.xml")).compile()
    assert fitted.links[0].capsules[0].radius == pytest.approx(whole.geom_size[0, 0])
    assert fitted.links[0].mass == pytest.approx(whole.body_mass[1])


def test_torques_of_motors_are_what_they_can_be_told_times_their_gear(read):
    """A motor's command is its torque; a servo's is a place, and limits none."""
    motor = '<motor joint="shoulder-joint" gear="2" forcerange="-10 10"/>'
    for given, torque in (
        ('<motor joint="shoulder-joint" gear="-50" ctrlrange="-0.4 0.4"/>', 20.0),
        ('<general joint="shoulder-joint" gainprm="3" ctrlrange="-2 2"/>', 6.0),
        ('<position joint="shoulder-joint" kp="9" ctrlrange="-1 1"/>', np.inf),
        ('<motor joint="shoulder-joint" gear="2"/>', np.inf),
        ('<motor joint="shoulder-joint" ctrlrange="-5 8"/>', 5.0),
        ('<motor joint="shoulder-joint" ctrlrange="0 9"/><motor joint="shoulder-joint" ctrlrange="-9 0"/>', 9.0),
        (motor + motor, 40.0),
        ('<motor joint="shoulder-joint" gear="50" ctrlrange="-1 1" forcerange="-100 100"/>', 50.0),
        ('<motor joint="shoulder-joint" ctrlrange="-20 20" forcerange="-100 100"/>', 20.0),
        ('<general joint="shoulder-joint" gainprm="10" ctrlrange="-1 1" forcerange="-100 100"/>', 10.0),
        ('<general joint="shoulder-joint" gainprm="10" ctrlrange="-9 9" dyntype="integrator" actrange="-3 3"/>', 30.0),
        (motor.replace("/>", ' group="2"/>') + motor, 20.0),
        (motor.replace("/>", ' group="2"/>'), np.inf),
        (motor + '<damper joint="shoulder-joint" kv="1" ctrlrange="0 1"/>', 20.0),
    ):
        told = MJCF.replace(motor, given).replace("<asset>", '<option actuatorgroupdisable="2"/><asset>')
        assert read(told).links[1].limits.torque == pytest.approx(torque), given
    both = MJCF.replace(motor, '<motor joint="rail" ctrlrange="-9 9"/>')
    assert read(both).links[0].limits.torque == 9  # the joint's own actuatorfrcrange allows 80


def test_torques_that_differ_by_direction_are_said(read):
    motor = '<motor joint="shoulder-joint" gear="2" forcerange="-10 10"/>'
    told = MJCF.replace(motor, '<motor joint="shoulder-joint" gear="-2" ctrlrange="-10 30"/>')
    arm = read(told.replace('actuatorfrcrange="-80 80"', 'actuatorfrcrange="0 80"'))
    assert [link.limits.torque for link in arm.links] == [80, 20, np.inf]
    assert arm.notes == (
        "rail has 0 to 80 N in the file: 80 N is taken for both directions",
        "shoulder-joint has -60 to 20 N m in the file: 20 N m is taken for both directions",
    )
    assert read(MJCF).notes == ()


def _with_tendon(tendon: str, equality: str = "") -> str:
    sites = MJCF.replace('<geom type="mesh"', '<site name="low"/><geom type="mesh"')
    sites = sites.replace('<body name="tool"', '<site name="high"/><body name="tool"')
    return sites.replace("<equality>", f"<tendon>{tendon}</tendon><equality>{equality}")


@pytest.mark.parametrize(
    ("tendon", "equality", "message"),
    [
        ('<fixed name="t">{elbow}{finger}</fixed>', '<tendon tendon1="t"/>', "an equality, over elbow, finger_joint"),
        ('<fixed name="t" range="-1 1">{elbow}</fixed>', "", "a range, over elbow'"),
        ('<fixed name="t" stiffness="1">{elbow}{rail}</fixed>', "", "stiffness, over rail, elbow'"),
        ('<spatial name="t" damping="1"><site site="low"/><site site="high"/></spatial>', "",
         "damping, over shoulder-joint, elbow'"),
    ],
)  # fmt: skip
def test_tendons_that_act_on_the_arm_are_refused(read, tendon, equality, message):
    joints = {"elbow": "elbow", "rail": "rail", "finger": "finger_joint"}
    coefficients = {key: f'<joint joint="{name}" coef="1"/>' for key, name in joints.items()}
    with pytest.raises(InputError, match=rf"tendon t: got '{message}.*take it out of the file, or lock .*elbow"):
        read(_with_tendon(tendon.format(**coefficients), equality))


def test_tendons_of_a_gripper_or_that_only_measure_are_no_matter(read):
    gripper = '<fixed name="t" stiffness="1" range="0 1"><joint joint="finger_joint" coef="1"/></fixed>'
    measuring = '<spatial><site site="low"/><site site="high"/></spatial>'
    assert read(_with_tendon(gripper + measuring, '<tendon tendon1="t"/>')) == read(MJCF)


def test_forces_that_have_no_part_in_the_model_are_said(read):
    """Damping and armature of joints have one; what is no joint of the arm has none to say."""
    changed = MJCF.replace(
        '<joint name="elbow"', '<joint name="elbow" stiffness="2" springref="1" frictionloss="0.1" damping="0.2 0.3"'
    )
    changed = changed.replace('<joint name="finger_joint"', '<joint name="finger_joint" stiffness="2" frictionloss="1"')
    changed = changed.replace('<body name="tool"', '<body name="tool" gravcomp="1"')
    changed = changed.replace('<compiler angle="radian"/>', '<compiler angle="radian"/><option density="1.2"/>')
    arm = read(changed)
    assert arm.links[2].friction == 0.2
    assert arm.notes == (
        "springs of the joints elbow (stiffness) have no part in the model",
        "dry friction of elbow (frictionloss) has no part in the model, only viscous damping has",
        "of the damping of elbow only what grows with the speed itself counts, no higher powers",
        "gravcomp of tool has no part in the model: the joints bear the whole weight",
        "density of <option> has no part in the model: the arm moves without drag",
    )


def test_a_loop_beyond_the_tip_is_no_loop_of_the_arm(read):
    loop = '<connect body1="finger" body2="fore" anchor="0 0 0"/>'
    assert read(MJCF.replace('<joint joint1="finger_joint"/>', loop)) == read(MJCF)
    with pytest.raises(InputError, match=r"a connection of two bodies'.*lock elbow, or choose another tip"):
        read(MJCF.replace('<joint joint1="finger_joint"/>', loop.replace("fore", "upper")))


def test_actuators_of_tendons_are_said_to_limit_no_torque(read):
    pulling = _with_tendon('<fixed name="t"><joint joint="elbow" coef="1"/><joint joint="rail" coef="1"/></fixed>')
    arm = read(pulling.replace("<actuator>", '<actuator><motor tendon="t" ctrlrange="-1 1"/>'))
    assert arm.notes == ("actuators that pull at tendons limit no torque here: of rail, elbow",)


def test_dampers_muscles_and_actuators_at_sites_are_named(read):
    site = MJCF.replace('<body name="tool"', '<site name="high"/><body name="tool"')
    further = """<damper joint="rail" kv="1" ctrlrange="0 1"/><muscle joint="elbow" lengthrange="0 1"/>
      <general site="high" gear="1 0 0 0 0 0" ctrlrange="-1 1"/>"""
    assert read(site.replace("<actuator>", f"<actuator>{further}")).notes == (
        "dampers of rail and muscles of elbow (actuators) have no part in the model, and limit no torque here",
        "actuators that pull at sites limit no torque here: of rail, shoulder-joint, elbow",
    )
    off = further.replace("<general", '<general group="3"').replace("<damper", '<damper group="3"')
    off = off.replace("<muscle", '<muscle group="3"')
    disabled = site.replace("<asset>", '<option actuatorgroupdisable="3"/><asset>')
    assert read(disabled.replace("<actuator>", f"<actuator>{off}")).notes == ()


WORLD = Path(os.environ.get("WHIPTOOL_DATA") or ROOT.parent / "shared" / "data") / "cases" / "robots" / "world.xml"


@pytest.mark.skipif(not WORLD.exists(), reason=f"{WORLD} is not there")
def test_distances_to_what_stands_in_the_world_are_those_of_mujoco():
    """A table of the world, a rack beside the robot, a mesh and an ellipsoid; the table is 0.118 m deep at the end."""
    arm = read_robot(WORLD, ArmChoice(tip="tip"))
    model = Model(preset("ur5e").whip, arm)
    scene = Scene(model, 0.0, ("close", "apart"))
    theirs, robot = {"table_in_world": 1, "rack": 2, "the floor": 0}, mujoco.MjModel.from_xml_path(str(WORLD))
    theirs |= {f"the link of j{i + 1}": 3 + i for i in range(3)}
    data = mujoco.MjData(robot)
    assert arm.notes == ()
    end = [0.3, 1.9, 1.0]
    for q in (end, *np.random.default_rng(0).uniform(-2, 2, (20, 3))):
        data.qpos[:] = q
        mujoco.mj_forward(robot, data)
        for pair, distance in zip(scene.pairs, scene.distances(np.array([q]))[0][0], strict=True):
            names = scene.names_of(pair)
            right = mujoco.mj_geomDistance(robot, data, *(theirs[name] for name in names), 10.0, None)
            least = 3e-3 if "the link of j3" in names else 1e-6
            assert right - least < distance < right + 1e-6, names
            if q is end and names == ("the link of j3", "table_in_world"):
                assert distance == pytest.approx(-0.118, abs=3e-3)
    found = Clearance(model, 0.0).beyond_on_way(np.linspace(0, 1, 9), np.linspace([0, 0.5, 0.5], end, 9))
    assert "the link of j3 is 121 mm inside table_in_world" in str(found)
    named = replace(arm, never_touch=(*arm.never_touch, ("table_in_world", "j3")))
    pairs = [(scene.names_of(pair)) for pair in Scene(replace(model, arm=named), 0.0, "apart").pairs]
    assert ("the link of j3", "table_in_world") not in pairs
    assert ("the link of j2", "table_in_world") in pairs


BESIDE = """<mujoco><asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1"/>
  <mesh name="gone" file="gone.obj"/></asset><worldbody>{}
  <body name="one"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="j"/>{}</body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("world", "link", "note"),
    [
        ('<geom type="plane" size="1 1 1"/>', "", ()),
        ('<geom name="wall" type="plane" size="1 1 1" euler="0 90 0"/>', "", ("planes (wall) are not looked at: ",)),
        ('<geom name="low" type="plane" size="1 1 1" pos="0 0 -1"/>', "", ("planes (low) are not looked at: ",)),
        ('<geom type="hfield" hfield="hills"/>', "", ("meshes without a readable file, height fields or distance fields"
                                                      " of world are not looked at: ",)),
        ("", '<geom type="mesh" mesh="gone"/>', ("meshes without a readable file, height fields or distance fields of "
                                                 "one are not looked at: nothing is judged to touch them",)),
        ("", '<geom type="mesh" mesh="gone" contype="0" conaffinity="0"/>', ()),
    ],
)  # fmt: skip
def test_shapes_that_are_not_looked_at_are_said(read, world, link, note):
    notes = read(BESIDE.format(world, link), ArmChoice()).notes
    assert len(notes) == len(note)
    assert all(mine.startswith(its) for mine, its in zip(notes, note, strict=True))


@pytest.mark.filterwarnings("error")
def test_a_warning_of_mujoco_is_a_note(read):
    """It is not on stderr beside what a command says."""
    scaled = BESIDE.format("", "").replace("<mujoco>", '<mujoco><compiler settotalmass="3"/>')
    (note,) = read(scaled, ArmChoice()).notes
    assert note.startswith("MuJoCo warns: compiler attribute 'settotalmass' is deprecated")


def test_a_thing_that_is_called_like_a_joint_is_told_apart(read):
    arm = read(BESIDE.format('<geom name="j" size="0.1"/><body name="base"><geom size="0.1"/></body>', ""), ArmChoice())
    assert arm.bodies == ("j", "base", "j (shape)", "base (shape)")


def test_memory_that_a_file_asks_for_is_not_taken(read):
    """MuJoCo would take 2 GB, or half a minute; a picture of 2 MB may be one of 5 GB, and is not read."""
    pictures = """<texture name="t" type="2d" file="gone.png"/><material name="m" texture="t"/>
      <texture type="skybox" builtin="gradient" width="900" height="900"/>"""
    assert read(MJCF.replace("<asset>", f"<asset>{pictures}")) == read(MJCF)
    sizes = '<size nuserdata="300000000" nuser_body="99999999" nkey="9999999" memory="9G"/>'
    assert read(MJCF.replace("<asset>", f"{sizes}<asset>")) == read(MJCF)


def test_a_free_joint_is_refused_with_the_joints_that_can_move(read):
    free = MJCF.replace('<body name="base">', '<body name="base"><freejoint name="root"/>')
    with pytest.raises(InputError, match=r'root: got .free.*arm.moving = \["rail", "shoulder-joint", "elbow"\] in a'):
        read(free)
    moving = ArmChoice(tip="tool", moving=("rail", "shoulder-joint", "elbow"))
    assert read(free, moving) == read(MJCF, moving)


def test_joints_that_follow_the_arm_are_said_to_be_held(read):
    arm = read(MJCF.replace('joint1="finger_joint"', 'joint1="finger_joint" joint2="elbow"'))
    assert arm.notes == (
        "what an equality ties to joints of the arm does not move with them, but is held: finger_joint",
    )


def test_joints_keep_their_names_for_the_robot(read):
    arm = read(MJCF)
    assert (arm.joints[1], arm.names) == ("shoulder_joint", ("rail", "shoulder-joint", "elbow"))


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(InputError, match="readable MJCF file"):
        read_mjcf(tmp_path / "none.xml")
