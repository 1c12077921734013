"""The whip alone against the whole model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from films import film

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure
from whiptool.dynamics.swing import SwingStructure, hand_motion, swing
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller, PositionControl
from whiptool.models import preset
from whiptool.models.kinematics import arm_frames
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import default_bounds
from whiptool.models.whip import WhipParameters
from whiptool.rollout.batch import Batch
from whiptool.rollout.engine import InterpretedEngine

LEMON, CONTROLLER = preset("lemon2024"), Controller()
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 8)


@pytest.mark.parametrize("drive", ["joints", "handle"])
def test_the_whip_alone_follows_the_whole_model(drive):
    """Arm, controller and whip together, and the whip on the hand's motion, are two derivations of one path."""
    recording = film(LEMON, STRIKES[0], markers=("tip", "handle", "node5"), rate=400.0)
    P = Predictor([recording], Plant(LEMON), drive=drive, shared=["whip.k"], timestep=2.5e-4)
    error = (P(Plant(LEMON), {}, P.start, derivatives=False)[0].value - recording.points.ravel()).reshape(-1, 3, 2)
    assert np.abs(error[:, 0]).max() < 1e-3
    assert np.abs(error[:, 1]).max() < 2e-5


WHIPS = {
    "universal": WhipParameters(
        N=3, l=0.2, m=0.02, k=0.05, b=0.004, rest_angle=0.1, rest_angle_x=-0.2, drag=1e-3, joints="universal",
        node_inertia=2e-6,
    ),
    "rod": WhipParameters(
        N=3, l=0.2, m=0.02, k=0.05, b=(0.02, 0.004, 0.004), drag=1e-3, dry_friction=1e-3, joints="rod",
    ),
}  # fmt: skip


def of_whip(whip: WhipParameters) -> tuple[SwingStructure, np.ndarray]:
    """A whip on a hand, and its numbers."""
    names = {"length": "l", "mass": "m", "stiffness": "k", "damping": "b", "inertia": "node_inertia"}
    more = ("rest_angle", "rest_angle_x", "dry_friction", "drag")
    used = [x for x in more if whip.per_node(x).any()] + ["stiffness"] + ["inertia"] * (whip.joints == "universal")
    structure = SwingStructure.of(n=whip.N, moving=True, point_masses=True, used=used, joints=whip.joints)
    values = {name: whip.per_node(ours) for name, ours in names.items()} | {x: whip.per_node(x) for x in more}
    return structure, structure.pack({**values, "gravity": 9.81, "friction_velocity": whip.friction_velocity})


@pytest.mark.parametrize("kind", WHIPS)
def test_a_whip_on_a_moving_hand_accelerates_as_behind_the_arm_that_moves_the_hand(kind):
    """The whole chain with its arm's joints on their reference, and the whip alone under the hand's motion."""
    model, rng = replace(preset("ur5e"), whip=WHIPS[kind]), np.random.default_rng(3)
    controller = Controller(PositionControl())
    loop, (structure, p) = Structure.of(model, controller), of_whip(model.whip)
    q, v, a = rng.uniform(-1, 1, (3, 6))
    x, rate = rng.uniform(-1, 1, (2, structure.coordinates))
    if kind == "rod":
        x = (x.reshape(-1, 3) / np.linalg.norm(x.reshape(-1, 3), axis=1)[:, None]).ravel()
        rate = (rate.reshape(-1, 3) - (x * rate).reshape(-1, 3).sum(1)[:, None] * x.reshape(-1, 3)).ravel()
    whole = closed_loop(loop).acceleration(
        np.r_[q, x, v, rate], 0.0, loop.pack(model, controller, np.zeros((1, 13)))[0], a
    )
    assert isinstance(model.arm, SpatialArm)
    hand = hand_motion(model.arm, q[None], v[None], a[None]).inputs[0]
    alone = swing(structure).acceleration(np.r_[x, rate], 0.0, p, hand)
    np.testing.assert_allclose(alone.full().ravel(), whole.full().ravel()[6:], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", WHIPS)
def test_steps_on_a_moving_hand_are_of_the_second_order(kind):
    """Half the step leaves a quarter of the error: also of rods, whose first damper hangs on the hand's own motion."""
    arm, (structure, p) = preset("ur5e").arm, of_whip(WHIPS[kind])
    assert isinstance(arm, SpatialArm)
    x0 = np.zeros(2 * structure.coordinates)
    if kind == "rod":
        x0[2 : structure.coordinates : 3] = -1
    tips = []
    for steps in (20, 40, 80, 320):
        h = 0.08 / steps
        t = h * np.arange(steps + 2)[:, None]
        angle, size = 20 * t + np.arange(6), 0.02 * np.ones(6)
        joints = size * np.sin(angle), 20 * size * np.cos(angle), -400 * size * np.sin(angle)
        each = np.array([h])
        batch = Batch(
            p=p[None], x0=x0[None], target=np.zeros((1, 3)), h=each, h_last=each, steps=np.array([steps]), hold=1,
            u=hand_motion(arm, *joints).inputs, u_row=np.array([0]), columns=np.arange(6, 9), stride=steps,
        )  # fmt: skip
        tips.append(InterpretedEngine(swing(structure), forward=False)(batch).observed()[0][0][-1])
    errors = np.linalg.norm(np.array(tips[:3]) - tips[3], axis=1)
    assert errors[0] < 1e-3
    assert 3.2 < errors[0] / errors[1] < 5.5
    assert 3.2 < errors[1] / errors[2] < 5.5


ARM = preset("ur5e").arm
assert isinstance(ARM, SpatialArm)
RNG = np.random.default_rng(0)
START, RATE, GROWTH = (RNG.uniform(-1, 1, (3, 5, 6)) * np.array([2.0, 3.0, 9.0])[:, None, None]).tolist()


def moved(t: float):
    """Joints' positions, speeds and accelerations of five motions, (5, 6) each."""
    q, v, a = np.array(START), np.array(RATE), np.array(GROWTH)
    return q + v * t + a * t**2 / 2, v + a * t, a


def test_the_hand_is_where_forward_kinematics_has_it_and_moves_as_differences_say():
    found, frame = hand_motion(ARM, *moved(0.0)), arm_frames(ARM, *moved(0.0)[:2])[-1]
    np.testing.assert_allclose(found.place, frame.origin, atol=1e-12)
    np.testing.assert_allclose(found.inputs[:, :9].reshape(-1, 3, 3).swapaxes(1, 2), frame.rotation, atol=1e-12)
    np.testing.assert_allclose(found.inputs[:, 9:12], frame.spin, atol=1e-12)
    np.testing.assert_allclose(found.inputs[:, 12:15], frame.velocity, atol=1e-12)
    h = 1e-5
    before, after = (arm_frames(ARM, *moved(t)[:2])[-1] for t in (-h, h))
    np.testing.assert_allclose(found.inputs[:, 15:18], (after.spin - before.spin) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(found.inputs[:, 18:], (after.velocity - before.velocity) / (2 * h), atol=1e-6)


def test_derivatives_are_differences():
    joints, h = moved(0.0), 1e-6
    slopes = hand_motion(ARM, *joints).by_joints
    for order in range(3):
        for joint in range(6):
            step = np.zeros((3, 5, 6))
            step[order, :, joint] = h
            up, down = (hand_motion(ARM, *(x + sign * s for x, s in zip(joints, step))) for sign in (1, -1))
            changes = [np.hstack([x.inputs, x.place]) for x in (up, down)]
            np.testing.assert_allclose(slopes[:, :, order, joint], (changes[0] - changes[1]) / (2 * h), atol=2e-7)
