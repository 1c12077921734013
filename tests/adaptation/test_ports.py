"""Ports: the miss that frames show, and what is said of a port that returns something else."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from recordings import write_rows

from whiptool.adaptation import adapter
from whiptool.adaptation.adapter import Options
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.plan_search import Plan, PlanningEffort
from whiptool.adaptation.ports import AwaitsRecording, RobotPort, TipPort
from whiptool.adaptation.prior import Learned, default_prior
from whiptool.adaptation.steps import Seen, checked, seen_of
from whiptool.adaptation.twins import draw_twin
from whiptool.commands import adapt
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import Controller, constant_preset, oiac_preset
from whiptool.limits.robot_trajectory import Execution
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.recording.camera import Camera, write_cameras
from whiptool.recording.readers import write_csv
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


UR5E = preset("ur5e")
START, END = (-1.63, -1.07, -0.22, -0.49, 2.16, 0.42), (-2.17, -2.07, -0.33, -1.73, -0.35, 2.09)
STRIKE_ROBOT_PORT = Strike(START, END, 1.5)


def test_a_strike_goes_out_as_a_trajectory_and_comes_back_as_a_recording(tmp_path):
    port = RobotPort(UR5E, Target((1.0, 0.2, 0.6)), execution=Execution(rest=0.5), t_stay=0.2)
    with pytest.raises(AwaitsRecording, match=r"run .*trajectory\.csv, .* into .*recorded\.csv") as waits:
        port.strike(STRIKE_ROBOT_PORT, 1, tmp_path)
    told = JointTrajectory.load_csv(waits.value.trajectory)
    assert told.strike_begins == pytest.approx(0.5)
    np.testing.assert_allclose(told.q[[0, -1]], [STRIKE_ROBOT_PORT.q_i, STRIKE_ROBOT_PORT.q_f], atol=1e-15)
    assert (tmp_path / "trajectory.yaml").exists()
    t = np.arange(0.0, 0.8, 0.02)
    tip = [[s, 1.0 + 0.1 * s, 0.2 + 0.3, 0.6] for s in t.tolist()]
    write_rows(waits.value.recording, [["t", "tip_x", "tip_y", "tip_z"], *tip])
    names = ["wrist_3", *UR5E.arm.joints[:-1]]
    log = [["time", *(f"position_{x}" for x in names)], *([s, 9.0, 1.0, 2.0, 3.0, 4.0, 5.0] for s in t.tolist())]
    write_rows(tmp_path / "log.csv", log)
    (tmp_path / "recorded.toml").write_text('joints = "log.csv"\n')
    seen = port.strike(STRIKE_ROBOT_PORT, 1, tmp_path)
    assert seen.seen_miss == pytest.approx(0.3)
    assert seen.recording is not None
    assert seen.recording.joints_q is not None
    np.testing.assert_array_equal(seen.recording.joints_q[0], [1.0, 2.0, 3.0, 4.0, 5.0, 9.0])
    assert (seen.recording.strike, seen.recording.t_stay) == (STRIKE_ROBOT_PORT, 0.2)


def test_a_strike_from_its_own_start_is_judged_once(tmp_path, monkeypatch):
    judged, judge = [], Execution.judged
    monkeypatch.setattr(Execution, "judged", lambda *args, **kw: judged.append(args[2]) or judge(*args, **kw))
    low = Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6)
    port = RobotPort(UR5E, Target((1.0, 0.2, 0.6)), t_stay=0.2)
    assert "the whip's node 20 is" in (port.strike(low, 1, tmp_path).refused or "")
    assert judged == [low]


def test_a_trajectory_begins_where_the_robot_stands_by_the_robots_own_names_and_rate(tmp_path):
    posture = (-1.5, -1.2, -0.2, -0.5, 2.0, 0.4)
    port = RobotPort(UR5E, Target((1.0, 0.2, 0.6)), execution=Execution(posture=posture, prefix="left_"), t_stay=0.2)
    with pytest.raises(AwaitsRecording) as waits:
        port.strike(STRIKE_ROBOT_PORT, 1, tmp_path)
    told = JointTrajectory.load_csv(waits.value.trajectory)
    np.testing.assert_array_equal(told.q[0], posture)
    assert told.joints[:3] == ("left_shoulder_pan_joint", "left_shoulder_lift_joint", "left_elbow_joint")
    assert told.t[1] == pytest.approx(1 / 500)
    assert told.strike_begins > 3 + 2 * 1.669  # the rest, and two periods of the rope's slowest swing
    whip = UR5E.whip
    quarter = dataclasses.replace(whip, l=whip.per_node("l") / 4)  # swings in half the time: 0.83 s
    short = dataclasses.replace(UR5E, whip=quarter)
    with pytest.raises(AwaitsRecording) as other:
        port.strike(STRIKE_ROBOT_PORT, 2, tmp_path, short)
    sooner = told.strike_begins - JointTrajectory.load_csv(other.value.trajectory).strike_begins
    assert sooner == pytest.approx(2 * 1.669 / 2, abs=0.1)
    below = RobotPort(UR5E, Target((1.0, 0.2, 0.6)), execution=Execution(posture=(0.4, 1.5, 0.0, 0.0, 0.0, 0.0)))
    with pytest.raises(InputError, match=r"^posture: got .*straight line of the joints.*below the floor"):
        below.strike(STRIKE_ROBOT_PORT, 2, tmp_path)
    low = Strike(
        (0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6
    )  # the arm is not, its whip is
    for one in (port, below, RobotPort(UR5E, Target((1.0, 0.2, 0.6)), t_stay=0.2)):
        assert "below the floor" in (one.refusal(low) or "")
        assert "the whip's node 20 is" in one.strike(low, 3, tmp_path).refused
    assert port.refusal(STRIKE_ROBOT_PORT) is None


def test_a_recording_of_our_own_format_is_read_as_any_other(tmp_path):
    """It says itself what a sidecar would; what the run knows of its strikes counts nevertheless."""
    port, t = RobotPort(UR5E, Target((1.0, 0.2, 0.6)), t_stay=0.2), np.arange(40) / 50
    seen = StrikeRecording(t, np.full((40, 1, 3), 0.5), ("tip",))
    seen.save(tmp_path / "a.npz")
    write_csv(seen, tmp_path / "a.csv")
    for name in ("a.npz", "a.csv"):
        read = port.read(tmp_path / name, STRIKE_ROBOT_PORT)
        np.testing.assert_array_equal(read.points, seen.points)
        assert (read.strike, read.t_stay, read.target) == (STRIKE_ROBOT_PORT, 0.2, (1.0, 0.2, 0.6))
    (tmp_path / "a.npz").write_bytes(b"hello")
    with pytest.raises(InputError, match=r"a\.npz.*NPZ"):
        port.read(tmp_path / "a.npz", STRIKE_ROBOT_PORT)


def test_a_recording_in_the_plane_is_none_of_an_arm_in_space(tmp_path):
    write_rows(tmp_path / "a.csv", [["t", "tip_x", "tip_y"], *([i / 50, 0.5, 0.1] for i in range(40))])
    with pytest.raises(InputError, match=r"a\.csv: points: got '2 coordinates, in a plane'; allowed: 3 coordinates"):
        RobotPort(UR5E, Target((1.0, 0.2, 0.6))).read(tmp_path / "a.csv", STRIKE_ROBOT_PORT)


def test_what_two_cameras_saw_comes_back_as_one_recording_of_places(tmp_path):
    """A tip that moves along a line; the command is that which was asked for, and need not stand in the sidecars."""
    space_films = pytest.importorskip("space_films")
    cameras = {"left": space_films.LEFT, "right": space_films.RIGHT}
    t = np.linspace(0.0, 1.0, 1001)
    line = np.array([0.5, -0.2, 0.4]) + t[:, None] * [0.3, 0.4, 0.2]
    for camera in cameras.values():
        film = space_films.film_in_space(camera, t, line[:, None])
        write_csv(film, tmp_path / f"{camera.name}.csv")
    write_cameras(tmp_path / "cameras.toml", cameras)
    port = RobotPort(UR5E, Target((0.65, 0.0, 0.6)), t_stay=0.2)
    files = [tmp_path / f"{name}.csv" for name in cameras]
    seen = port.read_cameras(files, STRIKE_ROBOT_PORT, tmp_path / "cameras.toml")
    assert (seen.strike, seen.t_stay, seen.target, seen.view) == (STRIKE_ROBOT_PORT, 0.2, (0.65, 0.0, 0.6), None)
    true = np.array([0.5, -0.2, 0.4]) + seen.t_points * [0.3, 0.4, 0.2]
    assert np.nanmax(np.abs(seen.points[:, 0] - true)) < 1e-3
    assert np.isfinite(seen.points).mean() > 0.8
    with pytest.raises(InputError, match="pixels'; allowed: positions of the tip"):
        checked(Seen(film, None), STRIKE_ROBOT_PORT, 1)


def test_the_command_asks_for_a_strike_and_ends(tmp_path, capsys):
    """It begins with a look at the whip as it hangs, which costs no plan; asked again, it asks for the same."""
    out = tmp_path / "run"
    args = ["--model", "ur5e", "--port", "robot", "--target", "1.0", "0.2", "0.6", "--out", str(out)]
    assert adapt.main(args) == adapt.AWAITS == 3
    first = (out / "strike-0000" / "trajectory.csv").read_bytes()
    assert "recorded.csv" in capsys.readouterr().out
    assert adapt.main(["--resume", str(out), "--json"]) == adapt.AWAITS
    assert '"awaits": ' in capsys.readouterr().out
    assert (out / "strike-0000" / "trajectory.csv").read_bytes() == first
    start = JointTrajectory.load_csv(out / "strike-0000" / "trajectory.csv").q[0]
    posture = [f"{x + 0.1:.6f}" for x in start]
    assert adapt.main(["next", "--run", str(out), "--posture", *posture]) == adapt.AWAITS
    moved = JointTrajectory.load_csv(out / "strike-0000" / "trajectory.csv")
    np.testing.assert_array_equal(moved.q[0], list(map(float, posture)))
    assert adapt.main(["next", "--run", str(out), "--posture", "1", "2"]) == 2
    assert "--posture: got" in capsys.readouterr().err


def test_next_tells_a_recording_and_asks_for_the_next_strike(tmp_path, capsys, monkeypatch):
    """Each call is a process of its own; one that was killed after it asked asks for the same."""
    planned = Plan(tuple(map(float, STRIKE_ROBOT_PORT.vector)), 0.5, 0.1, 0.1, None, "a strike", 0.0)
    monkeypatch.setattr(adapter, "plan", lambda *args, **named: planned)
    monkeypatch.setattr(adapt, "_page", lambda *args: "page")
    monkeypatch.setattr(adapter, "check_beginnings", lambda *args: [])  # the recording is made up
    reasons: list[str] = []
    learned = lambda prior, recordings, **named: Learned(  # noqa: E731
        prior, {}, dict.fromkeys([recordings[-1].source], reasons[0]) if reasons else {}, 0.0
    )
    monkeypatch.setattr(adapter, "update", learned)
    out, recorded = tmp_path / "run", tmp_path / "anywhere.csv"
    rows = [[0.02 * i, 1.0, 0.5, 0.001 * i] for i in range(40)]
    write_rows(recorded, [["t", "tip_x", "tip_y", "tip_z"], *rows])
    (tmp_path / "anywhere.toml").write_text("sigma = 0.002\n")
    begin = ["--model", "ur5e", "--port", "robot", "--target", "1.0", "0.2", "0.6", "--max-strikes", "1"]
    assert adapt.main([*begin, "--out", str(out)]) == adapt.AWAITS
    said = capsys.readouterr().out
    assert f"adapt next --run {out} RECORDING" in said
    go_on = ["next", "--run", str(out), "--json"]
    assert adapt.main(go_on) == adapt.AWAITS
    assert json.loads(capsys.readouterr().out)["number"] == 0
    assert adapt.main([*go_on, str(recorded), "--cameras", "cameras.toml"]) == 2
    assert "only with the recordings of two cameras or more" in capsys.readouterr().err
    assert adapt.main([*go_on, str(recorded), str(recorded)]) == 2
    assert "allowed: pixels of a camera" in capsys.readouterr().err
    pixels = tmp_path / "left.csv"
    write_rows(pixels, [["t", "tip_u", "tip_v"], *[[0.02 * i, 100.0, 50.0 + i] for i in range(40)]])
    (tmp_path / "left.toml").write_text('sigma = 0.2\ncamera = "left"\n')
    assert adapt.main([*go_on, str(pixels), str(pixels), "--cameras", "absent.toml"]) == 2
    assert capsys.readouterr().err.startswith("whiptool: --cameras: got 'absent.toml'; allowed: a readable TOML file")
    reasons.append("the tip was lost in 90% of the frames")
    assert adapt.main([*go_on, str(recorded)]) == 2
    said = capsys.readouterr().err
    assert f"{recorded}, strike 0: got 'nothing to learn from: the tip was lost in 90% of the frames'" in said
    assert adapt.main(go_on) == adapt.AWAITS  # nothing was kept of it: the same strike is asked for
    assert json.loads(capsys.readouterr().out)["number"] == 0
    in_place = out / "strike-0000" / "recorded.csv"
    in_place.write_text(recorded.read_text())
    assert adapt.main(["--resume", str(out), "--json"]) == 2
    assert f"{in_place}, strike 0: got 'nothing to learn" in capsys.readouterr().err
    in_place.unlink()
    reasons.clear()
    assert adapt.main([*go_on, str(recorded)]) == adapt.AWAITS
    asked = json.loads(capsys.readouterr().out)
    assert (asked["number"], asked["strike"]) == (1, list(planned.strike))
    told = JointTrajectory.load_csv(Path(asked["trajectory"]))
    np.testing.assert_allclose(told.q[-1], STRIKE_ROBOT_PORT.q_f, atol=1e-15)
    assert adapt.main(go_on) == adapt.AWAITS
    assert json.loads(capsys.readouterr().out) == asked
    assert adapt.main([*go_on, str(recorded)]) == 2
    assert "another recording than that of strike 0" in capsys.readouterr().err
    recorded.write_text(recorded.read_text().replace(",0.5,", ",0.2,"))
    assert adapt.main([*go_on, str(recorded)]) == 1  # and the run is at its end
    assert json.loads(capsys.readouterr().out)["strikes"] == 1
    assert (out / "report.html").exists()


def test_a_rope_in_space_is_aimed_at_within_the_limits_of_its_robot():
    options = AdaptOptions(model="ur5e", camera="tip", target=(1.5, 0.3, 0.5), arrival_angle=90.0, least_speed=1.0)
    options.check()
    assert options.build_target(UR5E) == Target.arriving((1.5, 0.3, 0.5), np.pi / 2, speed=1.0)
    assert options.build_controller().prescribed
    still = AdaptOptions(model="ur5e", camera="tip", target=(1.5, 0.3, 0.5), direction=(0.0, 1.0, 0.0), least_speed=0.0)
    assert still.build_target(UR5E).speed is None
    planar = AdaptOptions(target=(1.2, 0.1), least_speed=5.0)
    assert planar.build_target(preset("lemon2024")) == Target((1.2, 0.1), speed=5.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"model": "ur5e", "target": (1.0, 0.2, 0.6)}, "--model: got 'ur5e'; allowed: a model in the plane, unless"),
        ({"port": "robot", "latency": 0.002}, "--latency.*only without --port robot"),
        ({"port": "robot", "camera": "twin"}, "--camera.*only without --port robot"),
        ({"port": "robot", "family": "kin"}, "--family.*only with a simulated whip"),
    ],
)
def test_options_that_a_robot_does_not_have_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        AdaptOptions(**options).check()
