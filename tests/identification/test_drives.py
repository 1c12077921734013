"""What drives a recorded whip or pendulum: markers by name, steps by time, first states, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pendulum_swing import angles_of, pendulum
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.identification.drives import CommandDrive, DriveOptions, FreeDrive, pieces
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller, PositionControl
from whiptool.models import preset
from whiptool.models.kinematics import arm_frames, chain_motion
from whiptool.models.parameters import ArmLink
from whiptool.models.strike import Strike
from whiptool.models.whip import WhipParameters
from whiptool.recording.readers.angles import first_state
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout import CompiledRollout

LEMON, CONTROLLER = preset("lemon2024"), Controller()
PLANT = Plant(LEMON, CONTROLLER)
STRIKE = Strike((-1.2, 0.9), (1.2, 0.3), 0.7)
ONE_LINK = pendulum((ArmLink(mass=0.2, length=0.3),))


def recorded(markers: tuple[str, ...], t: np.ndarray, places: np.ndarray) -> StrikeRecording:
    return StrikeRecording(t=t, points=places, markers=markers, sigma=np.full(places.shape[:2], 1e-3), strike=STRIKE)


def test_markers_are_found_by_name():
    """Nodes count from 1 to 12 behind the arm's two links; what only looks like a node is none."""
    t = np.linspace(0.1, 0.5, 5)
    drive = CommandDrive(recorded(("tip",), t, np.zeros((5, 1, 2))), PLANT, DriveOptions("command"))
    assert [drive.link_of(name) for name in ("node1", "node12")] == [2, 13]
    assert drive.link_of("node12") == drive.link_of("tip")
    for name in ("node0", "node13", "node", "nodes", "node1a", "5"):
        assert drive.link_of(name) is None


def test_every_link_is_where_the_whole_model_has_it():
    """Predictions of the first node, a middle one and the tip, beside the rollout's own joints."""
    path = CompiledRollout(LEMON, CONTROLLER, timestep=2.5e-4).trajectory(STRIKE, t_stay=0.1)
    some = slice(400, 3600, 400)
    theta = np.cumsum(path.q[some], axis=1)
    lengths = np.r_[LEMON.arm.per_link("length"), LEMON.whip.per_node("l")]
    ends = np.cumsum(np.stack([np.sin(theta), -np.cos(theta)], axis=2) * lengths[:, None], axis=1)
    markers = {"handle": 1, "node1": 2, "node7": 8, "tip": 13}
    seen = recorded(tuple(markers), path.t[some], ends[:, list(markers.values())])
    predictor = Predictor([seen], PLANT, drive="command", shared=["whip.k"], timestep=2.5e-4)
    (found,) = predictor(PLANT, {}, predictor.start, derivatives=False)
    np.testing.assert_allclose(found.value.reshape(-1, 4, 2), seen.points, atol=2e-6)


@pytest.mark.parametrize(("first", "last", "h", "steps"), [
    (0.0, 1.5, 1e-3, 1500), (0.2, 1.2, 1e-3, 1000), (0.1, 0.4004, 1e-3, 301), (0.3, 0.9, 2e-4, 3000),
])  # fmt: skip
def test_a_swing_is_rolled_out_to_its_last_sample_and_no_further(first, last, h, steps):
    t = np.linspace(first, last, 11)
    swing = angles_of(t, np.zeros((11, 1)), np.zeros((2, 1)))
    assert FreeDrive(swing, ONE_LINK, DriveOptions("free", h=h, unknown_start=True)).steps == steps


def test_a_rod_that_swings_a_little_is_a_harmonic_oscillator():
    """A uniform rod about its end: omega^2 = 3 g / (2 l)."""
    t = np.linspace(0, 2, 81)
    swing = angles_of(t, np.zeros((81, 1)), np.array([[1e-3], [2e-3]]))
    predictor = Predictor([swing], ONE_LINK, drive="free", shared=["gravity"])
    (found,) = predictor(ONE_LINK, {}, predictor.start, derivatives=False)
    omega = np.sqrt(3 * 9.81 / (2 * 0.3))
    np.testing.assert_allclose(found.value, 1e-3 * np.cos(omega * t) + 2e-3 / omega * np.sin(omega * t), atol=3e-7)


def test_a_piece_of_a_swing_begins_where_a_parabola_through_its_first_samples_says():
    """Exact where the swing is a parabola, with a curvature that a straight line would take for speed."""
    t = np.linspace(2.0, 3.0, 401)
    s = t - t[0]
    angles = np.stack([0.3 - 1.5 * s + 40 * s**2, -0.2 + 2 * s - 25 * s**2], axis=1)
    recording = angles_of(t, angles, np.zeros((2, 2)))
    np.testing.assert_allclose(first_state(t, angles), [[0.3, -0.2], [-1.5, 2.0]], atol=1e-9)
    first, second = pieces(recording, 0.5)
    np.testing.assert_array_equal(first.first_state, np.zeros((2, 2)))  # as measured
    assert second.first_state is None
    start = first_state(second.t, second.points[..., 0])
    begins = second.t[0] - 2.0
    np.testing.assert_allclose(start[0], [0.3 - 1.5 * begins + 40 * begins**2, -0.2 + 2 * begins - 25 * begins**2])
    np.testing.assert_allclose(start[1], [-1.5 + 80 * begins, 2 - 50 * begins], atol=1e-8)
    assert [len(piece.t) for piece in (first, second)] == [200, 201]


def test_in_space_the_command_drives_a_whip_as_the_rollout_has_it(monkeypatch):
    """Of a robot whose joints are on their reference: hand, a node and the tip, each with three coordinates."""
    monkeypatch.setenv("WHIPTOOL_ENGINE", "interpreter")
    whip = WhipParameters(N=3, l=0.2, m=0.02, k=0.05, b=0.004, joints="universal", node_inertia=2e-6)
    model, controller = replace(preset("ur5e"), whip=whip), Controller(PositionControl())
    strike = Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.3, -1.6, 0.9, -1.2, 0.0, 0.1), 0.15)
    path = CompiledRollout(model, controller, timestep=1e-3).trajectory(strike, t_stay=0.05)
    some = slice(20, 200, 20)
    places = chain_motion(model, path.q[some])[0]
    markers = {"handle": 6, "node2": 8, "tip": 9}
    seen = StrikeRecording(path.t[some], places[:, list(markers.values())], tuple(markers), strike=strike)
    plant = Plant(model, controller)
    predictor = Predictor([seen], plant, drive="command", shared=["whip.k"], timestep=1e-3)
    (found,) = predictor(plant, {}, predictor.start, derivatives=False)
    np.testing.assert_allclose(found.value.reshape(-1, 3, 3), seen.points, atol=1e-6)
    flat = replace(seen, points=seen.points[..., :2])
    with pytest.raises(InputError, match=r"points: got '2 coordinates, in a plane'.*z up"):
        Predictor([flat], plant, drive="command", shared=["whip.k"])


def test_the_hands_pose_drives_a_whip_as_its_arms_joints_do():
    """Motion capture of the hand beside the joints' log of the same motion, with quaternions of either sign."""
    whip = WhipParameters(N=5, l=0.2, m=0.02, k=0.05, b=0.004, joints="universal", node_inertia=2e-6)
    robot = replace(preset("ur5e"), whip=whip)
    log, strike = (
        np.arange(-0.05, 0.7, 0.01),
        Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6),
    )
    joints = strike.reference(log)[0]
    hand = arm_frames(robot.arm, joints)[-1]
    turned = Rotation.from_matrix(hand.rotation).as_quat()
    turned[::4] *= -1
    t = np.arange(0, 0.65, 1 / 60)
    places = np.random.default_rng(0).normal(size=(len(t), 2, 3))
    seen = StrikeRecording(
        t,
        places,
        ("tip", "node2"),
        joints_t=log,
        joints_q=joints,
        hand_t=log,
        hand_pose=np.hstack([hand.origin, turned]),
    )
    plant, shared = Plant(robot, Controller()), ["whip.k", "whip.l"]
    found = {}
    for drive in ("joints", "hand"):
        predictor = Predictor([seen], plant, drive=drive, shared=shared)
        (found[drive],) = predictor(plant, {}, predictor.start, derivatives=True)
    np.testing.assert_allclose(found["hand"].value, found["joints"].value, atol=1e-4)
    scale = np.abs(found["joints"].by_shared).max(axis=0)
    np.testing.assert_allclose(found["hand"].by_shared / scale, found["joints"].by_shared / scale, atol=1e-3)
    with pytest.raises(InputError, match="a recording with the hand's pose"):
        Predictor([replace(seen, hand_t=None, hand_pose=None)], plant, drive="hand", shared=shared)
    with pytest.raises(InputError, match="for a model in the plane"):
        Predictor([seen], Plant(preset("lemon2024"), Controller()), drive="hand", shared=shared)


def test_of_several_recordings_the_culprit_is_named():
    t = np.linspace(0.1, 0.5, 9)
    good = replace(recorded(("tip",), t, np.zeros((9, 1, 2))), source="one.csv", joints_t=t, joints_q=np.zeros((9, 2)))
    for change, said in (
        ({"joints_t": None, "joints_q": None}, "a recording with measured joint angles"),
        ({"joints_q": np.zeros((9, 3))}, "joints_q: got 'shape"),
        ({"joint_names": ("hip", "knee")}, "one column for each joint of the arm"),
        ({"markers": ("toe",)}, "tip or nodes of the whip"),
    ):
        with pytest.raises(InputError, match=rf"two\.csv.*{said}|{said}.*two\.csv"):
            Predictor([good, replace(good, source="two.csv", **change)], PLANT, drive="joints", shared=["whip.k"])


def test_places_of_an_upright_file_are_predicted_in_the_models_axes():
    """A file whose y axis is up says so, and the predictor of a model in space has z up: nobody has to turn it."""
    places = np.random.default_rng(0).normal(size=(9, 1, 3))
    model, t = preset("ur5e"), np.linspace(0.1, 0.5, 9)
    q = np.tile([0.0, -1.5, 0.5, -0.5, 0.2, 0.0], (9, 1))
    seen = StrikeRecording(t=t, points=places, markers=("tip",), up="y", joints_t=t, joints_q=q)
    predictor = Predictor([seen], Plant(model, Controller(PositionControl())), drive="joints", shared=["whip.drag"])
    np.testing.assert_allclose(predictor.measured[0].reshape(9, 3), places[:, 0, [0, 2, 1]] * [1, -1, 1])


def test_what_is_missing_in_a_recording_is_named_with_its_cure():
    """The marker's name in capitals, the command, and the command of an arm with more joints."""
    plant, t = Plant(preset("lemon2024"), Controller()), np.arange(30) / 60
    strike = Strike((-1.3, 0.4), (1.7, 1.4), 0.9)
    seen = StrikeRecording(t, np.full((30, 1, 2), 0.5), ("tip",), strike=strike)
    refused = {
        r"^recording: markers: got 'Tip'; allowed: tip or nodes .* lower case$": replace(seen, markers=("Tip",)),
        r"noside\.toml next to it with strike = .*or choose the drive": replace(seen, strike=None, source="noside.csv"),
        r"^recording: strike: got .*a strike of the arm's 2 joints$": replace(
            seen, strike=Strike((0.0,) * 3, (0.5,) * 3, 0.9)
        ),
    }
    for said, recording in refused.items():
        with pytest.raises(InputError, match=said):
            Predictor([recording], plant, drive="command", shared=["whip.k"])
