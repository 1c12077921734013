"""Ports: the miss that frames show, and what is said of a port that returns something else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.adaptation.adapter import Options
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.plan_search import PlanningEffort
from whiptool.adaptation.ports import Seen, TipPort, checked, seen_of
from whiptool.adaptation.prior import default_prior
from whiptool.adaptation.twins import draw_twin
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import Controller, constant_preset, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.camera import Camera
from whiptool.recording.strike_recording import StrikeRecording

STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
T = np.arange(30) / 60


def circle(**changes) -> StrikeRecording:
    """A tip on a circle of 1 m about (0.2, 0), one turn a second."""
    points = np.stack([0.2 + np.cos(2 * np.pi * T), np.sin(2 * np.pi * T)], axis=1)
    return StrikeRecording(T, points[:, None], ("tip",), **changes)


def test_the_miss_is_seen_between_frames():
    at = 2 * np.pi * 0.1 + 0.06  # between two frames, which are 0.1 m apart
    target = (0.2 + 1.3 * np.cos(at), 1.3 * np.sin(at))
    seen = seen_of(circle(), target, true_miss=0.29)
    assert seen.seen_miss == pytest.approx(0.3, abs=1e-3)
    assert np.linalg.norm(circle().marker("tip") - target, axis=1).min() > 0.3005
    assert (seen.true_miss, seen.fault) == (0.29, "")


def test_what_is_in_a_plane_or_of_another_arm_is_no_strike_in_space():
    with pytest.raises(InputError, match=r"points: got '2 coordinates, in a plane'; allowed: 3 coordinates.*tip_z"):
        seen_of(circle(source="a.csv"), (1.0, 0.2, 0.6))
    six = Strike((0.0,) * 6, (0.5,) * 6, 0.6)
    with pytest.raises(InputError, match="strike of the recording"):
        checked(Seen(circle(strike=STRIKE), None), six, 1)


def test_a_gap_holds_no_tip():
    target = (0.2, 1.0)  # passed at 0.25 s
    recording = circle()
    lost = recording.without(np.abs(T - 0.25) < 0.07)
    assert seen_of(recording, target).seen_miss == pytest.approx(0.0, abs=1e-3)
    assert seen_of(lost, target).seen_miss == pytest.approx(2 * np.sin(np.pi / 12), abs=1e-3)  # the last frame, 5 off
    assert seen_of(recording.without(T > 0.04), target).seen_miss is None
    lonely = recording.without(np.arange(len(T)) % 5 > 0)  # every fifth frame shows it, the third of them at 0.25 s
    assert seen_of(lonely, target).seen_miss == pytest.approx(0.0, abs=1e-9)
    assert seen_of(recording, target, fault="the motor is hot").seen_miss is None
    with pytest.raises(InputError, match="tip"):
        seen_of(dataclasses.replace(recording, markers=("handle",)), target)


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        (circle(), "StrikeRecording from strike 2.*seen_of"),
        (None, "NoneType from strike 2.*seen_of"),
        (0.03, "float from strike 2.*a Seen"),
        (Seen("film.npz", 0.1), "str from strike 2.*a StrikeRecording"),
        (Seen(dataclasses.replace(circle(), markers=("handle",)), 0.1), "handle.*the tip"),
        (Seen(circle(strike=Strike((0.0, 0.0), (1.0, 1.0), 1.0)), 0.1), "strike of the recording.*requested strike"),
    ],
)
def test_a_port_is_told_what_it_should_return(returned, said):
    with pytest.raises(InputError, match=f"(?s){said}"):
        checked(returned, STRIKE, 2)


def test_what_one_camera_saw_in_pixels_is_refused():
    camera = Camera("left", 640, 480, np.diag([500.0, 500.0, 1.0]), np.eye(3), np.zeros(3))
    pixels = dataclasses.replace(circle(), view=camera)
    with pytest.raises(InputError, match=r"pixels.*in m"):
        seen_of(pixels, (0.2, 1.0, 0.0))
    with pytest.raises(InputError, match=r"pixels.*in m"):
        checked(Seen(pixels, 0.1), STRIKE, 2)


def test_what_the_loop_knows_is_added():
    first, second = (checked(seen_of(circle(source="lab"), (1.0, 0.0)), STRIKE, n).recording for n in (1, 2))
    assert first is not None
    assert second is not None
    assert first.strike == STRIKE
    assert (first.source, second.source) == ("lab, strike 1", "lab, strike 2")  # recordings are told apart by these
    again = checked(Seen(first, 0.1), STRIKE, 1).recording
    assert again is not None
    assert again.source == first.source
    refused = Seen(None, None, fault="too fast")
    assert checked(refused, STRIKE, 1) is refused


def test_a_bare_recording_is_refused_by_the_loop():
    class Careless:
        def strike(self, strike, number, folder, believed=None):
            return circle()

    model, controller = preset("lemon2024"), Controller(oiac_preset("table4"))
    prior = default_prior(model, controller, whip="uniform")
    brief = PlanningEffort(pool=4, polished=1, steps=0, whips=2, rounds=0)
    adaptation = Adaptation(prior, Careless(), Target((1.2, 0.1)), Options(first=brief))
    with pytest.raises(InputError, match="seen_of"):
        adaptation.run()


def test_a_twin_s_target_is_a_target_or_its_place():
    model, controller = preset("lemon2024"), Controller()
    twin = draw_twin("kin", 0, model, controller)
    assert TipPort(twin, Target((1.2, 0.1))).target == TipPort(twin, [1.2, 0.1]).target == (1.2, 0.1)


def test_a_port_of_another_target_or_arm_is_refused_when_it_is_made():
    model, controller = preset("lemon2024"), Controller(oiac_preset("table4"))
    twin, prior, target = draw_twin("kin", 0, model, controller), default_prior(model, controller), Target((1.2, 0.1))
    with pytest.raises(InputError, match=r"target: got \(1.2, 0.3, 0.5\); .*in the plane"):
        TipPort(twin, (1.2, 0.3, 0.5))
    with pytest.raises(InputError, match=r"target: got \(1.3, 0.0\); allowed: \(1.2, 0.1\), which the port aims at"):
        Adaptation(prior, TipPort(twin, target), Target((1.3, 0.0)))
    robot = preset("ur5e")
    of_robot = default_prior(robot, Controller(constant_preset("ur5e")))
    with pytest.raises(InputError, match=r"target: got .*in space"):
        Adaptation(of_robot, TipPort(twin, target), target)
    with pytest.raises(InputError, match=r"port: got 'a twin whose joints are shoulder, elbow'; .*shoulder_pan"):
        Adaptation(of_robot, TipPort(twin, target), Target((0.8, 0.0, 0.5)))
    Adaptation(prior, TipPort(twin, [1.2, 0.1]), target)
