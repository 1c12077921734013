"""Arms from MJCF: what only MuJoCo's files have; test_urdf.py compares a whole robot."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from robot_files import MJCF

from whiptool.errors import InputError
from whiptool.impedance import ConstantImpedance, Controller, PositionControl
from whiptool.models.kinematics import arm_frames
from whiptool.models.mjcf import read_mjcf
from whiptool.models.presets import preset
from whiptool.models.robot_files import ArmChoice
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
        (MJCF.replace('joint1="finger_joint"', 'joint1="elbow" joint2="rail"'), TIP,
         "joint elbow: got 'tied to rail'; .*arm.locked = { elbow = 0 }"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said_in_one_line(read, text, choice, message):
    with pytest.raises(InputError, match=message) as caught:
        read(text, choice)
    assert "\n" not in str(caught.value)


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
    Controller(PositionControl()).check_fits(arm)
    with pytest.raises(InputError, match=r"arm: got 'unknown inertia of the links of rail'.*--controller position"):
        Controller(ConstantImpedance()).check_fits(arm)


def test_meshes_tell_an_inertia_and_what_a_shape_is_fitted_to(read, tmp_path):
    """A tetrahedron of 1/6 m3, as MuJoCo weighs it, and its ball."""
    (tmp_path / "corner.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    text = """<mujoco><asset><mesh name="corner" file="corner.obj"/></asset><worldbody><body name="one">
      <joint name="j"/>{}</body></worldbody></mujoco>"""
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
    ):
        assert read(MJCF.replace(motor, given)).links[1].limits.torque == pytest.approx(torque)
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
