"""Hand space: paths of the hand against SciPy's interpolation of rotations, and slopes against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from whiptool.commands.options.search_options import SearchOptions
from whiptool.errors import InputError
from whiptool.impedance import Controller, HandControl, PositionControl
from whiptool.models import ArmLink, ArmParameters, preset
from whiptool.models.hand_space import DEGREE, EXACT, HandSpace, HandWay, home_posture
from whiptool.models.kinematics import HandKinematics, arm_frames, rotation_vector
from whiptool.models.strike import HandStrike, JointSpace, Strike, StrikeBounds
from whiptool.objective import Objective
from whiptool.rollout import ReferenceRollout

RNG = np.random.default_rng(8)
SHARE = np.array([0.0, 0.2, 0.7, 1.0])
PLANE = HandKinematics(ArmParameters((ArmLink(0.3, 0.2),) * 3), np.array([0.2, 0.9, 0.7]), orientation=True)
PANDA = HandKinematics(preset("panda").arm, np.array([0, -0.5, 0, -2.0, 0, 1.7, 0.7]), orientation=True)
each = pytest.mark.parametrize("kinematics", [PLANE, PANDA], ids=["plane", "space"])


def rotations_of(way: HandWay, share: np.ndarray = SHARE) -> np.ndarray:
    """Rotations at shares of a way that has some."""
    rotations = way.at(share).rotation
    assert rotations is not None
    return rotations


def test_orientations_turn_evenly_about_one_axis_by_the_shortest_way():
    ends = RNG.normal(size=(4, 2, 6))
    way = HandWay(PANDA, ends)
    poses = way.at(SHARE)
    for i in range(4):
        rotations = Rotation.from_rotvec(ends[i, :, 3:]) * Rotation.from_matrix(PANDA.upright)
        np.testing.assert_allclose(rotations_of(way)[i], Slerp([0, 1], rotations)(SHARE).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(poses.place, ends[:, :1, :3] + SHARE[:, None] * (ends[:, 1:] - ends[:, :1])[..., :3])


def test_a_hand_in_the_plane_turns_by_the_difference_of_its_angles_more_than_half_a_turn_too():
    way = HandWay(PLANE, np.array([[0.1, 0.2, -2.0], [0.3, -0.2, 2.5]]))
    np.testing.assert_allclose(way.motion, [0.2, -0.4, 4.5])
    angle = rotation_vector(rotations_of(way, np.array([0.5])) @ PLANE.upright.T)[0]
    np.testing.assert_allclose(angle, [0, -0.25, 0], atol=1e-12)


def test_without_orientation_there_is_only_a_place():
    way = HandWay(HandKinematics(preset("panda").arm, PANDA.posture), np.array([[0.1, 0.2, 0.3], [0.4, 0.1, 0.3]]))
    assert way.at(SHARE).rotation is None
    np.testing.assert_allclose(way.motion, [0.3, -0.1, 0.0])


@each
def test_slopes_against_differences(kinematics):
    m, d, h = kinematics.size, kinematics.dimension, 1e-6
    ends = 0.7 * RNG.normal(size=(3, 2, m))
    way = HandWay(kinematics, ends)
    slopes, of_start, of_turns = way.slopes(SHARE), way.start_slopes(), way.turn_slopes()[1]
    for j in range(2 * m):
        step = np.zeros(2 * m)
        step[j] = h
        before, after = (HandWay(kinematics, ends + sign * step.reshape(2, m)) for sign in (-1, 1))
        moved = after.at(SHARE).place - before.at(SHARE).place
        turned = rotation_vector(rotations_of(after) @ np.swapaxes(rotations_of(before), -1, -2))
        change = np.concatenate([moved, turned], axis=-1) @ kinematics.rows.T / (2 * h)
        np.testing.assert_allclose(slopes[..., j], change, atol=1e-7)
        if j % m >= d:
            k = j % m - d + (j // m) * (m - d)
            at_start = rotations_of(after)[:, 0] - rotations_of(before)[:, 0]
            np.testing.assert_allclose(of_start[..., k], at_start / (2 * h), atol=1e-7)
            np.testing.assert_allclose(of_turns[..., k], (after.turns - before.turns) / (2 * h), atol=1e-7)


LEMON, UR5E, PANDA_HAND_SPACE = (preset(name).arm for name in ("lemon2024", "ur5e", "panda"))
SPACES = {name: HandSpace(preset(name).arm) for name in ("lemon2024", "ur5e", "panda")}
SPACES |= {f"{name}-pose": HandSpace(preset(name).arm, orientation=True) for name in ("ur5e", "panda")}
THREE = ArmParameters((ArmLink(0.4, 0.2),) * 3)
RNG_HAND_SPACE = np.random.default_rng(5)


def possible(space: HandSpace, count: int) -> np.ndarray:
    """Random strikes that the arm can make."""
    strikes = space.bounds.sample(RNG_HAND_SPACE, 6 * count)
    return strikes[space.beyond(strikes) == 0][:count]


every_space = pytest.mark.parametrize("space", SPACES.values(), ids=SPACES)


def test_names_and_widths():
    assert SPACES["lemon2024"].names == ("x_i", "y_i", "x_f", "y_f", "D")
    assert SPACES["panda"].names == ("x_i", "y_i", "z_i", "x_f", "y_f", "z_f", "D")
    turns = ("turn_x_i", "turn_y_i", "turn_z_i")
    assert SPACES["panda-pose"].names[:6] == ("x_i", "y_i", "z_i", *turns)
    assert HandSpace(THREE, posture=(0.3, 0.9, 0.7), orientation=True).names == (
        "x_i",
        "y_i",
        "turn_i",
        "x_f",
        "y_f",
        "turn_f",
        "D",
    )
    assert [(space.kind, space.width) for space in SPACES.values()] == [
        *(("hand", 5), ("hand", 7), ("hand", 7)),
        *(("pose", 13), ("pose", 13)),
    ]
    assert [JointSpace(arm).width for arm in (LEMON, UR5E, PANDA_HAND_SPACE)] == [5, 13, 15]
    assert HandSpace(UR5E, led=True).layout == {"q_i": 6, "path": 6 * (DEGREE + 1), "D": 1}


@every_space
def test_the_hand_goes_from_start_to_end_along_a_straight_line_at_least_jerk(space):
    for vector in possible(space, 4):
        path, strike = space.path(vector), space.strike(vector)
        t = np.linspace(-0.1, strike.D + 0.1, 60)
        d = space.arm.dimension
        of_hand = Strike(strike.x_i[:d], strike.x_f[:d], strike.D).reference(t)  # Eq. 1, of places instead of joints
        pose, speed = path.hand(t)
        seen = [0, 2] if d == 2 else [0, 1, 2]
        np.testing.assert_allclose(pose.place[:, seen], of_hand[0], atol=1e-14)
        np.testing.assert_allclose(speed[:, :d], of_hand[1], atol=1e-12)
        q, v, _ = path.reference(t)
        if space.arm.dimension == 2:
            theta = np.cumsum(q, axis=1)
            l = space.arm.per_link("length")
            place = np.stack([(l * np.sin(theta)).sum(1), -(l * np.cos(theta)).sum(1)], axis=1)
            np.testing.assert_allclose(place, of_hand[0], atol=EXACT)
            continue
        frame = arm_frames(space.arm, q, v)[-1]
        np.testing.assert_allclose(frame.origin, of_hand[0], atol=EXACT)
        np.testing.assert_allclose(frame.velocity, of_hand[1], atol=50 * EXACT)
        if space.kind == "pose":
            home = arm_frames(space.arm, space.kinematics.posture)[-1].rotation
            ends = Rotation.from_rotvec([strike.x_i[3:], strike.x_f[3:]]) * Rotation.from_matrix(home)
            share = Strike((0.0,), (1.0,), strike.D).reference(t)[0].ravel()
            np.testing.assert_allclose(frame.rotation, Slerp([0, 1], ends)(share).as_matrix(), atol=EXACT)
            np.testing.assert_allclose(frame.spin, speed[:, 3:], atol=50 * EXACT)


@every_space
def test_speeds_and_accelerations_are_the_slopes_of_the_joints_way(space):
    vector, h = possible(space, 1)[0], 1e-6
    path, t = space.path(vector), np.linspace(0.05, vector[-1] - 0.05, 20)
    before, after = path.reference(t - h), path.reference(t + h)
    _, v, a = path.reference(t)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * h), v, atol=1e-7 * (1 + np.abs(v).max()))
    np.testing.assert_allclose((after[1] - before[1]) / (2 * h), a, atol=1e-6 * (1 + np.abs(a).max()))
    still = path.reference(np.array([0.0, vector[-1], 9.0]))
    assert not still[1].any()
    assert np.abs(still[2]).max() < 1e-9
    assert path.reference(0.3)[0].shape == (space.arm.n,)
    np.testing.assert_allclose(still[0][0], path.q_i, atol=1e-14)


@pytest.mark.parametrize("led", [False, True])
@pytest.mark.parametrize(
    ("arm", "pose"),
    [(LEMON, False), (PANDA_HAND_SPACE, False), (THREE, True), (PANDA_HAND_SPACE, True)],
    ids=lambda x: str(x)[:16],
)
def test_derivatives_of_what_rollouts_take_against_differences(arm, pose, led):
    posture = (0.3, 0.9, 0.7) if arm is THREE else None
    space, h = HandSpace(arm, posture=posture, orientation=pose, led=led), 1e-6
    strikes = possible(space, 3)
    slopes = space.slopes(strikes)
    assert slopes.shape == (3, sum(space.layout.values()), space.width)
    for j, step in enumerate(h * np.eye(space.width)):
        change = (space.numbers(strikes + step) - space.numbers(strikes - step)) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], change, atol=2e-4 if led else 1e-6)


@every_space
def test_bounds_hold_the_home_posture_and_mostly_strikes_that_can_be_made(space):
    box, hand = space.bounds, space.kinematics.coordinates(space.kinematics.posture)
    assert ((np.array(box.lower)[: space.size] < hand) & (hand < np.array(box.upper)[: space.size])).all()
    assert (space.beyond(box.sample(RNG_HAND_SPACE, 128)) == 0).mean() > 0.3


def test_a_strike_at_rest_at_home_takes_the_home_posture():
    space = SPACES["panda"]
    x = space.kinematics.coordinates(home_posture(PANDA_HAND_SPACE))
    path = space.path(np.array([*x, *x, 0.5]))
    np.testing.assert_allclose(
        path.reference(np.linspace(0, 1, 5))[0], np.tile(home_posture(PANDA_HAND_SPACE), (5, 1)), atol=1e-9
    )


def test_what_the_arm_cannot_do_is_refused_in_one_line():
    space = SPACES["ur5e"]
    x = space.kinematics.coordinates(space.kinematics.posture)
    with pytest.raises(InputError, match="a start and an end that the hand reaches"):
        space.path(np.array([*x, 3.0, 0, 0, 0.6]))
    with pytest.raises(InputError, match="without singular postures"):
        space.path(np.array([-0.2, 0.9, 0.3, -0.2, -0.9, 0.3, 0.6]))  # behind its base
    near = np.array([0.0, 0.3, 0.0, -0.1, 0.0, 1.5, 0.0])  # joint4 ends at -0.07
    short = HandSpace(PANDA_HAND_SPACE, posture=near)
    ends = short.kinematics.coordinates(np.array([near, near + 0.3 * np.eye(7)[3]]))
    with pytest.raises(InputError, match=r"within the joints' limits; joint4 would be at"):
        short.path(np.array([*ends[0], *ends[1], 0.6]))
    assert (space.beyond(np.array([[*x, 3.0, 0, 0, 0.6], [*x, *x, 0.6]])) > 0).tolist() == [True, False]
    farther = space.beyond(np.array([[*x, 3.0, 0, 0, 0.6], [*x, 5.0, 0, 0, 0.6]]))
    assert farther[1] > farther[0]


def test_arms_without_such_a_space_and_home_postures_without_ease_are_refused():
    with pytest.raises(InputError, match="3 joints or more"):
        HandSpace(LEMON, orientation=True)
    assert HandSpace(THREE, posture=(0.3, 0.9, 0.7), orientation=True).size == 3  # a joint for each coordinate
    with pytest.raises(InputError, match=r"^home posture: got 'none'; .*3 joint angles"):
        HandSpace(THREE)
    with pytest.raises(InputError, match="not a singular"):
        HandSpace(LEMON, posture=(0.3, 0.0))
    with pytest.raises(InputError, match="posture"):
        HandSpace(LEMON, posture=(0.3, 0.0, 1.0))
    with pytest.raises(InputError, match=r"^posture: got '40 rad of elbow'; .*are these degrees"):
        HandSpace(LEMON, posture=(0.3, 40.0))


def test_turns_of_the_hand_in_degrees_are_refused_and_places_are_not_angles():
    """By rollouts, searches and options alike; a place may be 15 m away."""
    pose, degrees = SPACES["ur5e-pose"], [15.0, 0, 0, 0, 0, 0, 15.0, 0, 0, 0, 45.0, 0, 1.0]
    lower = (*[-9.0] * 12, 0.4)
    SPACES["ur5e"].check_turns("strike", [15.0, 0, 0, 15.0, 0, 0, 1.0])
    rollout = ReferenceRollout(preset("ur5e"), Controller(PositionControl(), hand=HandControl(orientation=True)))
    given = "got '45 rad of turn_y_f'; .*are these degrees"
    with pytest.raises(InputError, match="^strikes: " + given):
        rollout.vectors(degrees)
    with pytest.raises(InputError, match="^bounds: " + given):
        Objective(rollout, (1.2, 0.1, 0.4), bounds=StrikeBounds(lower, degrees))
    with pytest.raises(InputError, match="^--upper: " + given):
        SearchOptions(lower=lower, upper=tuple(degrees)).build_bounds(preset("ur5e"), pose)


def test_strikes_of_the_hand_and_their_vectors():
    strike = HandStrike((0.1, 0.2), (0.3, 0.4), 0.5)
    np.testing.assert_array_equal(strike.vector, [0.1, 0.2, 0.3, 0.4, 0.5])
    assert HandStrike.from_vector(strike.vector) == strike
    assert repr(strike) == "HandStrike(x_i=(0.1, 0.2), x_f=(0.3, 0.4), D=0.5 s)"
    for bad in ([0.1, 0.2, 0.3, 0.4], [0.1, np.nan, 0.3, 0.4, 0.5], [0.1, 0.2, 0.3, 0.4, 0.0]):
        with pytest.raises(InputError):
            HandStrike.from_vector(bad)
    with pytest.raises(InputError, match="as many as x_i"):
        HandStrike((0.1,), (0.3, 0.4), 0.5)


def test_a_space_that_threads_share_keeps_their_strikes_apart():
    """It keeps what it solved last. Here another thread asks for another strike just as that is kept."""
    alone = SPACES["lemon2024"]
    mine, others = possible(alone, 2)[:, None]

    class Shared(HandSpace):
        interrupted = False

        def __setattr__(self, name, value):
            super().__setattr__(name, value)
            if name == "_last" and value is not None and not self.interrupted:
                self.interrupted = True
                self.numbers(others)

    np.testing.assert_array_equal(Shared(alone.arm).numbers(mine), alone.numbers(mine))
