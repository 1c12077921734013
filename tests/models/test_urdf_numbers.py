"""Numbers in URDF files: each that is used is read, or refused by its element and its value."""

from __future__ import annotations

import os
import re
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from robot_cases import robot_case
from robot_files import URDF

from whiptool.errors import InputError
from whiptool.impedance.arm import Arm
from whiptool.models import Model, SpatialArm, WhipParameters
from whiptool.models.files import read_robot
from whiptool.models.kinematics import arm_frames
from whiptool.models.robot_files import ArmChoice
from whiptool.models.urdf import read_urdf

TIP, TCP = ArmChoice(tip="tool"), ArmChoice(tip="my_tcp")
BALL = '<collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.03"/></geometry></collision>'
SHAPED = URDF.replace('<link name="fore">', f'<link name="fore">{BALL}')
FORE = re.search('<link name="fore">.*?</link>', SHAPED, re.DOTALL)[0]
WHIP = WhipParameters(N=1, l=0.1, m=0.01, k=0, b=0, joints="universal")


@pytest.fixture
def read(tmp_path):
    def read(text: str, choice: ArmChoice | None = TIP) -> SpatialArm:
        (tmp_path / "small.urdf").write_text(text)
        return read_urdf(tmp_path / "small.urdf", choice)

    return read


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ('mass value="0.8"', 'mass value="${m3}"',
         r"link fore: value of <inertial/mass>: got '\${m3}'; allowed: a number >= 0; expand xacro first$"),
        ('mass value="0.8"', 'mass value="0,8"', "got '0,8'; .* >= 0; write points and blanks, no commas"),
        ('mass value="0.8"', 'mass value="nan"', "link fore: value of <inertial/mass>: got 'nan'"),
        ('mass value="0.8"', 'mass value="inf"', "link fore: value of <inertial/mass>: got 'inf'"),
        ('mass value="0.8"', 'mass value="1e999"', "link fore: value of <inertial/mass>: got '1e999'"),
        ('mass value="0.8"', 'mass value="1_0"', "link fore: value of <inertial/mass>: got '1_0'"),
        ('mass value="0.8"', 'mass value="-0.8"', "link fore: value of <inertial/mass>: got '-0.8'; allowed: .* >= 0"),
        ('mass value="0.8"', 'mass value=""', "link fore: value of <inertial/mass>: got ''"),
        ('mass value="0.8"', 'mass kg="0.8"', "link fore: <inertial/mass>: got 'no value'"),
        ('<mass value="0.8"/>', "", "link fore: got 'an <inertial> without <mass>'; .*; leave out the <inertial>"),
        (re.search("<inertia .*?/>", FORE)[0], "", "link fore: got 'an <inertial> without <inertia>'"),
        ('ixx="0.004"', 'ixx="${i}"', r"link fore: ixx of <inertial/inertia>: got '\${i}'; .*expand xacro first"),
        (' ixy="0"', "", "link fore: <inertial/inertia>: got 'no ixy'"),
        ('<inertial><origin xyz="0 0 0.1"/>', '<inertial><origin xyz="0 0 ${h}"/>',
         r"link fore: xyz of <inertial/origin>: got '0 0 \${h}'; allowed: 3 numbers; expand xacro first"),
        ('<inertial><origin xyz="0 0 0.1"/>', '<inertial><origin xyz="0 0.1"/>', "got '0 0.1'; allowed: 3 numbers"),
        ('radius="0.03"', 'radius="0,03"', "link fore: radius of <collision/geometry/sphere>: got '0,03'"),
        ('radius="0.03"', 'radius="0.03 1"', "link fore: radius of <collision/geometry/sphere>: got '0.03 1'"),
        ('radius="0.03"', 'radius="-1"', "link fore: radius of <collision/geometry/sphere>: got '-1'"),
        ('radius="0.03"', "", "link fore: <collision/geometry/sphere>: got 'no radius'"),
        ('<collision><origin xyz="0 0 0.1"/>', '<collision><origin xyz="${h}"/>',
         r"link fore: xyz of <collision/origin>: got '\${h}'; allowed: 3 numbers; expand xacro first"),
    ],
)  # fmt: skip
def test_what_is_no_number_in_a_link_is_refused(read, capfd, right, wrong, message):
    read(SHAPED)
    assert right in FORE
    with pytest.raises(InputError, match=message):
        read(SHAPED.replace(FORE, FORE.replace(right, wrong)))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', "joint elbow: xyz of <axis>: got '0 1'; allowed: 3 numbers"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "joint elbow: got 'an <axis> of 0 0 0'; allowed: a direction"),
        ('rpy="0 0.4 0"', 'rpy="0 ${pi/8} 0"', r"joint elbow: rpy of <origin>: got '0 \${pi/8} 0'; .*xacro"),
        ('upper="2"', 'upper="${pi}"', r"joint elbow: upper of <limit>: got '\${pi}'"),
        (' effort="0"', "", "joint elbow: <limit>: got 'no effort'; .*effort=\"0\" says that there is no limit"),
        ('damping="0.5"', 'damping="0,5"', "joint rail: damping of <dynamics>: got '0,5'"),
        ('<link name="finger"/>', 2 * '<link name="finger"/>', "link finger: got 'another <link> of this name'"),
    ],
)
def test_what_is_no_number_in_a_joint_is_refused(read, capfd, right, wrong, message):
    text = re.sub('<link name="finger">.*?</link>', '<link name="finger"/>', URDF, flags=re.DOTALL)
    read(text)
    assert right in text
    with pytest.raises(InputError, match=message):
        read(text.replace(right, wrong))
    assert capfd.readouterr() == ("", "")


def test_what_has_no_part_in_the_arm_may_be_written_as_it_likes(read, capfd):
    """Pinocchio's parser refused each of these files."""
    arm = read(URDF)
    for right, other in (
        ('<robot name="small">', "<robot>"),
        ('<robot name="small">', '<robot name="small" version="2.0">'),
        ('<robot name="small">', '<robot name="small" xmlns="http://ros.org"><material name="x"/><material name="x"/>'),
        ('<dynamics damping="0.5"/>', '<dynamics damping="0.5"/><safety_controller/><calibration rising="x"/>'),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics D="${d}"/>'),
        ('<parent link="fore"/><child link="tool"/>',
         '<parent link="fore"/><child link="tool"/><limit effort="${e}"/><axis xyz="0 0 0"/>'),
        ('<limit lower="0" upper="0.05" velocity="1" effort="5"/>', ""),
    ):  # fmt: skip
        assert right in URDF
        found = read(URDF.replace(right, other))
        assert (found, found.notes) == (arm, arm.notes)
    assert capfd.readouterr() == ("", "")


def test_a_negative_limit_is_none_and_is_said_to_be(read):
    arm = read(URDF.replace('velocity="2" effort="80"', 'velocity="2" effort="-1"'))
    assert arm.links[0].limits.torque == np.inf
    assert arm.notes == ("a velocity or effort of 0 or less in the <limit> of rail, elbow is taken as no limit",)


def test_fifty_threads_leave_standard_error_as_it_is(tmp_path, capfd):
    """Loading used to send the process's standard error to a file that was then deleted."""
    path = tmp_path / "small.urdf"
    path.write_text(SHAPED)

    def load(i: int) -> SpatialArm:
        arm = read_urdf(path, TIP)
        os.write(2, b"%d\n" % i)
        return arm

    with ThreadPoolExecutor(50) as pool:
        arms = list(pool.map(load, range(50)))
    os.write(2, b"after\n")
    said = capfd.readouterr().err.split()
    assert (sorted(said[:-1], key=int), said[-1]) == ([str(i) for i in range(50)], "after")
    assert all(arm == arms[0] for arm in arms)


TRANSMISSION = '<transmission name="t"><joint name="elbow"/>{}<actuator name="a">{}</actuator></transmission></robot>'
GEARED = "<motorInertia>1e-4</motorInertia>"


@pytest.mark.parametrize(
    "text",
    [
        URDF.replace("</robot>", TRANSMISSION.format("", body))
        for body in (
            '<drake:rotor_inertia value="1e-4"/><drake:gear_ratio value="100"/>',
            GEARED + "<mechanicalReduction> -100 </mechanicalReduction>",
        )
    ]
    + [
        URDF.replace("</robot>", TRANSMISSION.format("<mechanicalReduction>100</mechanicalReduction>", GEARED)),
        URDF.replace('<axis xyz="0 1 0"/>', '<motor motor_inertia="1e-4" gear_ratio="100"/><axis xyz="0 1 0"/>'),
        URDF.replace('<axis xyz="0 1 0"/>', '<drake:rotor_inertia value="1"/><axis xyz="0 1 0"/>'),
    ],
)
def test_the_rotor_s_inertia_is_read_where_files_have_it(read, text):
    assert [link.armature for link in read(text).links] == pytest.approx([0, 0, 1])


def test_a_rotor_s_inertia_that_is_not_read_is_said(read):
    two = TRANSMISSION.format('<joint name="rail"/>', GEARED)
    arm = read(URDF.replace("</robot>", two))
    assert [link.armature for link in arm.links] == [0, 0, 0]
    assert "rotor inertias of the transmissions t are not read, as each moves several joints" in arm.notes
    wrong = TRANSMISSION.format("", "<motorInertia>${j}</motorInertia>")
    with pytest.raises(InputError, match=r"transmission t: rotor inertia: got '\${j}'.*xacro"):
        read(URDF.replace("</robot>", wrong))
    twice = URDF.replace('<axis xyz="0 1 0"/>', '<motor motor_inertia="2e-4"/><axis xyz="0 1 0"/>')
    with pytest.raises(InputError, match=r"joint elbow: got 'rotor inertias of 0\.0002 and 0\.0001 kg m2"):
        read(twice.replace("</robot>", TRANSMISSION.format("", GEARED)))


def test_an_impossible_inertia_that_moves_is_refused_by_its_link(read):
    plain = 'ixx="0.004" iyy="0.004" izz="0.001"'
    wrong = URDF.replace(plain, 'ixx="0.004" iyy="0.004" izz="0.1"')
    said = r"link fore: <inertia>: got 'principal moments of 0\.004, 0\.004 and 0\.1 kg m2'; allowed: three of which"
    with pytest.raises(InputError, match=said):
        read(wrong)
    read(URDF.replace(plain, 'ixx="0.004" iyy="0.004" izz="0.00802"'))  # rounded
    base = read(URDF.replace('ixx="1" iyy="1" izz="1"', 'ixx="1" iyy="1" izz="9"'))
    assert (base, base.notes) == (read(URDF), read(URDF).notes)
    light = URDF.replace('ixx="1e-5" iyy="1e-5" izz="1e-5"', 'ixx="1e-5" iyy="1e-5" izz="1e-4"')  # of the finger
    assert read(light).notes == read(URDF).notes  # what it is a part of is possible


def test_joints_that_move_freely_are_held_if_what_moves_is_named(read):
    """On the chain, as a free base is, the cure is in the message; off the chain they are held, and that is said."""
    finger = URDF.replace('name="finger_joint" type="prismatic"', 'name="finger_joint" type="floating"')
    arm, held = read(finger), "what hangs on joints that move freely is held where it is with them at 0: {}"
    assert arm == read(URDF)
    assert held.format("finger_joint") in arm.notes
    free = URDF.replace('name="rail" type="prismatic"', 'name="rail" type="floating"')
    cure = r"arm.moving = \['shoulder-joint', 'elbow'\] in a model file"
    with pytest.raises(InputError, match=rf"joint rail: got 'type floating'; .*{cure}"):
        read(free)
    arm = read(free, ArmChoice(tip="tool", moving=("shoulder-joint", "elbow")))
    assert held.format("rail") in arm.notes
    assert arm == read(URDF, ArmChoice(tip="tool", moving=("shoulder-joint", "elbow")))


def test_notes_do_not_contradict_each_other(read):
    """A guessed mass is no guess that torques depend on where torques are not known."""
    ball = re.sub("<inertial>.*?</inertial>", BALL, FORE, flags=re.DOTALL)
    text = SHAPED.replace(FORE, ball)
    assert read(text).notes[0].endswith("of their shapes, a guess that torques depend on")
    cart = '<visual><geometry><mesh filename="package://nowhere/cart.dae"/></geometry></visual>'
    assert cart in text
    unknown = re.sub('<link name="cart">.*?</link>', f'<link name="cart">{cart}</link>', text, flags=re.DOTALL)
    notes = read(unknown).notes
    assert notes[0].endswith("kg/m3 of their shapes")
    assert notes[-1].endswith("and its torques are not known")


def test_a_suffix_may_be_in_capitals(tmp_path):
    (tmp_path / "SMALL.URDF").write_text(URDF)
    assert read_robot(tmp_path / "SMALL.URDF", TIP).joints == ("rail", "shoulder_joint", "elbow")


def test_an_odd_robot_moves_as_mujoco_reads_it():
    """Turned base, axes of other lengths, a slide, blanks in names, a finger that mimics another and is 13 mm off."""
    path = robot_case("odd.urdf")
    arm, mj = read_robot(path, TCP), mujoco.MjModel.from_xml_path(str(path))
    data, ours = mujoco.MjData(mj), Arm(Model(WHIP, arm))
    for q in np.random.default_rng(0).uniform(-0.1, 0.4, (5, 4)):
        data.qpos[:] = [*q, 0, 0.013]
        mujoco.mj_forward(mj, data)
        M = np.zeros((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, data, M)
        np.testing.assert_allclose(ours.inertia(q), M[:4, :4], atol=1e-13)
        np.testing.assert_allclose(arm_frames(arm, q)[-2].origin, data.xanchor[3], atol=1e-13)


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("xacro_left.urdf", r"link l3: value of <inertial/mass>: got '\${m3}'; .*expand xacro first"),
        ("impossible_inertia.urdf", r"link l3: <inertia>: got 'principal moments of 0\.004, 0\.004 and 0\.1 kg m2'"),
    ],
)
def test_files_that_were_read_wrongly_are_refused(file, message):
    with pytest.raises(InputError, match=message):
        read_robot(robot_case(file), TCP)


def test_the_rotors_of_drake_s_transmissions_are_read():
    arm = read_robot(robot_case("motor_drake.urdf"))
    assert [link.armature for link in arm.links] == [1.0, 1.0]
