"""Arms from URDF: against Pinocchio's own whole model, and against the same robot in MJCF that MuJoCo reads."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest
from robot_data import example_robots
from robot_files import FRANKA_HAND, MJCF, UR_BASE, UR_FLANGE, URDF, as_urdf

from whiptool.errors import InputError
from whiptool.impedance.arm import Arm
from whiptool.models import Model, SpatialArm, WhipParameters
from whiptool.models.files import read_robot
from whiptool.models.kinematics import arm_frames
from whiptool.models.mjcf import read_mjcf
from whiptool.models.presets import PANDA_ARM, UR5E_ARM
from whiptool.models.robot_files import ArmChoice
from whiptool.models.urdf import read_urdf

WHIP = WhipParameters(N=1, l=0.1, m=0.01, k=0, b=0, joints="universal")
TIP = ArmChoice(tip="tool")
NO_LIMIT = "a velocity or effort of 0 or less in the <limit> of elbow is taken as no limit"


@pytest.fixture
def read(tmp_path):
    def read(choice: ArmChoice | None = TIP, text: str = URDF) -> SpatialArm:
        path = tmp_path / "small.urdf"
        path.write_text(text)
        return read_urdf(path, choice)

    return read


def test_the_arm_moves_as_pinocchio_s_whole_robot(read):
    """Forward kinematics and inertia matrix of the robot with its finger where it is locked."""
    arm = read(ArmChoice(tip="tool", locked={"finger_joint": 0.03}))
    whole = pin.buildModelFromXML(URDF)
    data = whole.createData()
    ours = Arm(Model(WHIP, arm))
    for rail, shoulder, elbow in np.random.default_rng(0).uniform(-1, 1, (10, 3)):
        q = np.array([rail, np.cos(shoulder), np.sin(shoulder), elbow, 0.03])  # continuous: a point of a circle
        pin.framesForwardKinematics(whole, data, q)
        at = data.oMf[whole.getFrameId("tool")]
        hand = arm_frames(arm, np.array([rail, shoulder, elbow]))[-1]
        np.testing.assert_allclose(hand.origin, at.translation, atol=1e-14)
        np.testing.assert_allclose(-hand.rotation[:, 2], at.rotation[:, 2], atol=1e-14)  # the whip goes on along z
        M = pin.crba(whole, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(ours.inertia([rail, shoulder, elbow]), M[:3, :3], atol=1e-13)


def test_limits_and_friction_are_the_file_s(read):
    rail, shoulder, elbow = read().links
    assert read().joints == ("rail", "shoulder_joint", "elbow")
    assert (rail.kind, rail.friction, rail.limits.position, rail.limits.velocity) == ("prismatic", 0.5, (-0.3, 0.4), 2)
    assert (rail.limits.torque, shoulder.limits.position, shoulder.limits.torque) == (80, (-np.inf, np.inf), 20)
    assert (elbow.limits.velocity, elbow.limits.torque) == (np.inf, np.inf)  # 0 says that there is none
    assert shoulder.axis == (0.0, 0.6, 0.8)


def test_the_same_robot_in_mjcf_is_the_same_arm(read, tmp_path):
    path = tmp_path / "small.xml"
    path.write_text(MJCF)
    choice = ArmChoice(tip="tool", locked={"finger_joint": 0.02})
    a, b = read(choice), read_mjcf(path, choice)
    assert a.joints == b.joints
    for ours, theirs in zip(a.links, b.links, strict=True):
        for name in ("mass", "com", "inertia", "axis", "position", "rotation", "friction"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-14, err_msg=name)
        assert ours.kind == theirs.kind
    np.testing.assert_allclose(a.hand_position, b.hand_position, atol=1e-14)
    np.testing.assert_allclose(a.hand_rotation, b.hand_rotation, atol=1e-14)
    assert [link.limits.torque for link in b.links] == [80, 20, np.inf]  # of the joint; of gear and force; none


def test_locked_joints_become_rigid(read):
    whole = read()
    locked = read(ArmChoice(tip="tool", locked={"shoulder-joint": 0.7}))
    moving = read(ArmChoice(tip="tool", moving=("rail", "elbow"), locked={"shoulder-joint": 0.7}))
    assert locked == moving
    assert locked.joints == ("rail", "elbow")
    for rail, elbow in np.random.default_rng(1).uniform(-1, 1, (5, 2)):
        whole_hand, hand = (
            arm_frames(whole, np.array([rail, 0.7, elbow]))[-1],
            arm_frames(locked, np.array([rail, elbow]))[-1],
        )
        np.testing.assert_allclose(hand.origin, whole_hand.origin, atol=1e-14)
        M = Arm(Model(WHIP, whole)).inertia([rail, 0.7, elbow])
        np.testing.assert_allclose(Arm(Model(WHIP, locked)).inertia([rail, elbow]), M[::2, ::2], atol=1e-13)


def test_the_whip_goes_on_outward(read):
    for outward in ((0, 0, 1), (1, 0, 0), (0, -2, 0), (1, 2, 3)):
        choice = ArmChoice(tip="tool", outward=outward)
        arm, plain = read(choice), read()
        turned = np.array(plain.hand_rotation) @ np.diag([1, -1, -1])  # the tip's own frame
        np.testing.assert_allclose(
            -np.array(arm.hand_rotation)[:, 2], turned @ np.array(outward) / np.linalg.norm(outward), atol=1e-15
        )


@pytest.mark.parametrize(
    ("text", "choice", "message"),
    [
        ("", TIP, "file: got 'no XML'"),
        ("<mujoco/>", TIP, "file: got '<mujoco>'.*expand xacro"),
        ('<robot name="x" xmlns:xacro="x"><xacro:arm/></robot>', TIP, "links: got 'none'; .*expand xacro first"),
        (URDF, None, "tip: got 'none'; allowed: the name of one end, as the robot branches: tool, finger"),
        (URDF, ArmChoice(tip="flange"), "tip: got 'flange'; allowed: one of base, cart"),
        (URDF, ArmChoice(tip="base"), r"moving: got \[\]"),
        (URDF, ArmChoice(tip="tool", moving=("wrist",)), "moving: got 'wrist'; allowed: one of the joints rail,"),
        (URDF, ArmChoice(tip="tool", moving=("finger_joint",)), "moving: got 'finger_joint'"),
        (URDF, ArmChoice(tip="tool", locked={"wrist": 0}), "locked: got 'wrist'; allowed: one of the joints rail,"),
        (URDF.replace("continuous", "ball"), TIP, "got 'type ball'; allowed: revolute, continuous"),
        (URDF.replace("continuous", "floating"), TIP, "joint shoulder-joint: got 'type floating'"),
        (URDF.replace('<child link="finger"/>', '<child link="tool"/>'), TIP, "link tool: .*without loops"),
        (URDF.replace('<child link="finger"/>', '<child link="base"/>'), TIP, "links: got 'tool'; .*without loops"),
        (URDF.replace('<child link="finger"/>', '<child link="thumb"/>'), TIP, "joint finger_joint: got 'child thumb'"),
        (URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="rail" multiplier="2"/>'), TIP,
         "joint elbow: got 'a mimic of rail'; .*arm.locked = { elbow = 0 }"),
        (URDF.replace('lower="-2" upper="2"', 'lower="0" upper="0"'), TIP,
         "joint elbow: got 'lower 0 and upper 0'; .*continuous"),
        (URDF.replace('<parent link="upper"/>', ""), TIP, "joint elbow: got 'parent '"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_said_in_one_line(read, capfd, text, choice, message):
    with pytest.raises(InputError, match=message) as caught:
        read(choice, text)
    assert "\n" not in str(caught.value)
    assert "small.urdf: " in str(caught.value)
    assert capfd.readouterr() == ("", "")  # nor does Pinocchio say anything


def test_a_moving_link_without_mass_is_a_frame_between_two_hinges(read):
    """It adds nothing: the robot's inertia is Pinocchio's, whether the link has no mass or no inertial."""
    upper = re.search('<link name="upper">.*?</link>', URDF, re.DOTALL)
    for bare in ('<link name="upper"/>', re.sub('(mass value|i[xyz]{2})=".*?"', r'\1="0"', upper[0])):
        text = URDF.replace(upper[0], bare)
        arm, whole = read(TIP, text), pin.buildModelFromXML(text)
        assert [link.mass > 0 for link in arm.links] == [True, False, True]
        q = np.array([0.1, np.cos(0.4), np.sin(0.4), -0.7, 0.0])
        M = pin.crba(whole, whole.createData(), q)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(Arm(Model(WHIP, arm)).inertia([0.1, 0.4, -0.7]), M[:3, :3], atol=1e-13)


def test_the_urdf_of_ur_description_is_the_preset(read):
    """Its frames without mass, as xacro writes them, and its three dead ends, of which one is the tool frame."""
    arm = read(None, as_urdf(UR5E_ARM, before=UR_BASE, behind=UR_FLANGE))
    assert arm.joints == UR5E_ARM.joints
    for ours, its in zip(arm.links, UR5E_ARM.links, strict=True):
        for name in ("mass", "com", "inertia", "axis", "position", "rotation"):
            np.testing.assert_allclose(getattr(ours, name), getattr(its, name), atol=1e-9, err_msg=name)
        assert ours.limits.position == pytest.approx(its.limits.position)
    np.testing.assert_allclose(arm.hand_position, UR5E_ARM.hand_position, atol=1e-12)


def test_the_urdf_of_franka_description_with_its_hand(read):
    """The fingers branch off, and mimic each other; the hand's tool frame is the tip, the fingers are locked."""
    text = as_urdf(PANDA_ARM, behind=FRANKA_HAND)
    arm = read(None, text)
    assert arm.joints == PANDA_ARM.joints
    assert arm.links[-1].mass == pytest.approx(PANDA_ARM.links[-1].mass + 0.73 + 2 * 0.015)
    for ours, its in zip(arm.links[:-1], PANDA_ARM.links, strict=False):
        np.testing.assert_allclose(ours.inertia, its.inertia, atol=1e-9)
    without = text.replace("panda_hand_tcp", "panda_hand_end")
    with pytest.raises(InputError, match=r"tip: .*panda_hand_end, panda_leftfinger, panda_rightfinger; give --arm-tip"):
        read(None, without)
    bare = read(None, re.sub("<inertial>.*?</inertial>", "<visual/>", text, flags=re.DOTALL))
    assert bare.weightless == bare.joints  # as franka_description was for years
    assert {link.limits.torque for link in bare.links} == {np.inf}
    assert [link.limits.velocity for link in bare.links] == [link.limits.velocity for link in arm.links]


def test_a_link_without_inertial_weighs_what_its_shapes_do(read, tmp_path):
    """A ball of 0.1 m radius of water, off its joint; a cube of 0.2 m as a mesh."""
    ball = '<collision><origin xyz="0 0 0.3"/><geometry><sphere radius="0.1"/></geometry></collision>'
    inertial = re.search('<link name="fore">(<inertial>.*?</inertial>)', URDF, re.DOTALL)[1]
    bare = re.sub('(i[xyz]{2})=".*?"', r'\1="0"', re.sub('mass value=".*?"', 'mass value="1e-9"', inertial))
    rest = read(TIP, URDF.replace(inertial, bare)).links[2]
    arm = read(TIP, URDF.replace(inertial, ball))
    assert arm.links[2].mass - rest.mass == pytest.approx(1000 * 4 / 3 * np.pi * 1e-3)
    assert arm.weightless == ()
    assert arm.notes[0].startswith("no <inertial> in fore: taken as 1000 kg/m3")
    corners = [(x, y, z) for x in (0, 0.2) for y in (0, 0.2) for z in (0, 0.2)]
    faces = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    triangles = [triangle for a, b, c, d in faces for triangle in ((a, b, c), (a, c, d))]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in triangles]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    mesh = '<visual><geometry><mesh filename="package://robot/cube.obj"/></geometry></visual>'
    assert read(TIP, URDF.replace(inertial, mesh)).weightless == ("elbow",)  # there is no such folder
    there = read(TIP, URDF.replace(inertial, mesh.replace("robot/", "")))
    assert there.links[2].mass - rest.mass == pytest.approx(8.0)


def test_a_tip_with_the_name_of_a_joint_and_a_prefix_that_nothing_declares(read):
    """As of exporters that call link and joint alike, and of Drake's files."""
    text = URDF.replace('"tool"', '"bracket"').replace('"finger"', '"finger_joint"')
    text = text.replace('name="elbow" type="revolute">', 'name="elbow" type="revolute"><drake:other value="1"/>')
    assert read(ArmChoice(tip="bracket"), text) == read(TIP, URDF)


def test_what_mimics_a_locked_joint_follows_it(read):
    """A second finger at twice the first one's place and 1 cm more."""
    second = re.search('<joint name="finger_joint".*</link>', URDF, re.DOTALL)[0].replace("finger", "thumb")
    mimic = second.replace("<axis", '<mimic joint="finger_joint" multiplier="2" offset="0.01"/><axis')
    at = {locked: ArmChoice(tip="tool", locked=locked_at) for locked, locked_at in (
        ("one", {"finger_joint": 0.02}), ("both", {"finger_joint": 0.02, "thumb_joint": 0.05}))}  # fmt: skip
    assert read(at["one"], URDF.replace("</robot>", mimic + "</robot>")) == read(
        at["both"], URDF.replace("</robot>", second + "</robot>")
    )


def test_limits_that_pinocchio_does_not_read_are_the_file_s(read):
    """Speeds by position, of Franka's files; acceleration, deceleration and jerk, of URDF 1.2."""
    slowed = '<position_based_velocity_limits velocity_offset="0.3" deceleration_limit="6"/><axis xyz="0 1 0"/>'
    text = URDF.replace('<axis xyz="0 1 0"/>', slowed).replace(
        'velocity="2"', 'velocity="2" acceleration="9" jerk="50"'
    )
    rail, shoulder, elbow = (link.limits for link in read(TIP, text).links)
    assert (elbow.deceleration, elbow.velocity_offset, elbow.by_position) == (6, 0.3, True)
    assert (elbow.velocity_margin, elbow.position_margin) == (1e-3, 1e-2)
    kept = "keep reserves of 0.001 rad/s and 10 mrad; arm.limits changes that"
    assert read(TIP, text).notes[0] == f"speed limits that depend on the position of elbow {kept}"
    assert (rail.acceleration, rail.jerk, rail.by_position) == (9, 50, False)
    assert shoulder == read().links[1].limits
    slower = text.replace('acceleration="9"', 'acceleration="9" deceleration="7"')
    assert read(TIP, slower).links[0].limits.acceleration == 7
    for wrong, said in (('jerk="fast"', "rail: jerk"), ('jerk="-1"', "rail: jerk")):
        with pytest.raises(InputError, match=said):
            read(TIP, text.replace('jerk="50"', wrong))


def test_dry_friction_and_an_inertia_without_mass_are_said_to_have_no_part(read):
    massless = URDF.replace('<mass value="1.2"/>', '<mass value="0"/>')
    arm = read(TIP, massless.replace('<dynamics damping="0.5"/>', '<dynamics damping="0.5" friction="0.1"/>'))
    assert (arm.links[0].friction, arm.links[1].inertia) == (0.5, (0,) * 6)
    assert arm.notes == (
        "the inertia of what shoulder-joint moves is left out, as its mass is 0: no body has one without the other",
        NO_LIMIT,
        "dry friction of rail has no part in the model, only its damping has",
    )
    assert read().notes == (NO_LIMIT,)


def test_what_is_beyond_or_narrower_than_the_arm_has_it_is_said(read):
    mimicking = URDF.replace(
        '<axis xyz="1 0 0"/>\n    <limit lower="0"', '<axis xyz="1 0 0"/><mimic joint="elbow"/><limit lower="0"'
    )
    safe = '<safety_controller k_velocity="1" soft_lower_limit="{}" soft_upper_limit="2"/><limit lower="-2"'
    assert read(TIP, mimicking).notes == (
        "what mimics joints of the arm does not move with them, but is held: finger_joint",
        NO_LIMIT,
    )
    assert read(TIP, URDF.replace('<limit lower="-2"', safe.format(-2))).notes == (NO_LIMIT,)
    assert read(TIP, URDF.replace('<limit lower="-2"', safe.format(-1.9))).notes == (
        NO_LIMIT,
        "soft limits of elbow (<safety_controller>) are not kept, only those of <limit>",
    )


def test_meshes_that_nothing_is_judged_to_touch_are_said(read):
    shaped = '<collision><geometry><mesh filename="package://nowhere/fore.stl"/></geometry></collision>'
    on_fore = URDF.replace('<link name="fore">', '<link name="fore">' + shaped)
    assert read(TIP, on_fore).notes == (
        NO_LIMIT,
        "collision shapes of fore that are meshes are not looked at: nothing is judged to touch them",
    )
    assert read(TIP, on_fore.replace('mesh filename="package://nowhere/fore.stl"', 'sphere radius="0.1"')).notes == (
        NO_LIMIT,
    )


def test_limits_in_degrees_are_asked_about(tmp_path):
    """In URDF and in MJCF alike; a slide's numbers are lengths."""
    degrees = {
        "small.urdf": URDF.replace('lower="-2" upper="2" velocity="0"', 'lower="-120" upper="120" velocity="180"'),
        "small.xml": MJCF.replace('range="-2 2"', 'range="-120 120"'),
    }
    for name, text in degrees.items():
        (tmp_path / name).write_text(text)
    of_urdf, of_mjcf = (read_robot(tmp_path / name, TIP).notes[-1] for name in degrees)
    assert of_urdf.startswith("limits are farther than arms go: elbow (120 rad), elbow (180 rad/s); are they in")
    assert of_mjcf.startswith("limits are farther than arms go: elbow (120 rad); are they in degrees?")


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(InputError, match="readable URDF file"):
        read_urdf(tmp_path / "none.urdf")


def test_the_panda_of_example_robot_data_is_the_preset():
    file = example_robots() / "panda_description/urdf/panda.urdf"
    arm = read_urdf(file, ArmChoice(tip="panda_link8"))
    for ours, theirs in zip(PANDA_ARM.links[:6], arm.links, strict=False):  # the seventh carries a gripper there
        for name in ("mass", "com", "inertia", "axis", "position", "rotation"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-15, err_msg=name)
        assert ours.limits.position == theirs.limits.position
        assert (ours.limits.velocity, ours.limits.torque) == (theirs.limits.velocity, theirs.limits.torque)
    np.testing.assert_allclose(PANDA_ARM.hand_position, arm.hand_position, atol=1e-15)


def test_where_a_locked_joint_cannot_be_is_refused(read):
    """The finger slides from 0 to 5 cm."""
    read(ArmChoice(tip="tool", locked={"finger_joint": 0.04, "shoulder-joint": 3.0}))
    for name, wrong in (("finger_joint", 20), ("shoulder-joint", 45)):
        with pytest.raises(InputError, match=f"locked.{name}: got {wrong}.0; .*are these (millimetres|degrees)"):
            read(ArmChoice(tip="tool", locked={name: wrong}))
