"""What a lab recorded of a position-controlled robot: its joints' log and motion capture, from exports to whips."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import robot_lab

from whiptool.adaptation.adapter import Options
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.plan_search import PlanningEffort
from whiptool.adaptation.ports import AwaitsRecording, RobotPort
from whiptool.adaptation.posterior import update
from whiptool.adaptation.prior import default_prior
from whiptool.commands import identify
from whiptool.goals.target import Target
from whiptool.identification.fit import FitOptions as Fitting
from whiptool.identification.fit import fit
from whiptool.identification.plant import Plant
from whiptool.impedance import Controller, PositionControl
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.robot_trajectory import Execution
from whiptool.models import Model, WhipParameters, preset, read_model, write_model
from whiptool.models.strike import Strike, StrikeBounds
from whiptool.recording.readers import read_recording

TRUE = {"whip.k": 0.05, "whip.b": 0.004, "whip.l": 0.2}
WHIP = WhipParameters(N=5, l=0.2, m=0.02, k=0.05, b=0.004, joints="universal", node_inertia=2e-6)
TRUTH = dataclasses.replace(preset("ur5e"), whip=WHIP)
STRIKES = (
    Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6),
    Strike((-0.3, -1.5, 1.5, -1.2, -0.2, 0.1), (0.4, -1.7, 0.7, -0.7, 0.5, -0.3), 0.5),
)


def guess(folder) -> Model:
    """Write the model of another whip on the same robot, and return it."""
    other = dataclasses.replace(TRUTH, whip=dataclasses.replace(WHIP, k=0.1, b=0.008, l=0.19))
    write_model(other, folder / "guess.toml")
    return other


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Markers' files of two strikes that a robot ran from exported trajectories, lagging behind them."""
    folder = tmp_path_factory.mktemp("lab")
    guess(folder)
    for i, strike in enumerate(STRIKES):
        told = robot_lab.exported(strike, TRUTH, folder / f"trajectory{i}.csv")
        robot_lab.run(TRUTH, told, folder, f"strike{i}", seed=i)
    return folder


def test_the_robot_of_the_lab_lags_behind_what_it_is_told(lab):
    """Otherwise what follows could read the command instead of the log."""
    told, log = (
        np.loadtxt(lab / name, delimiter=",", skiprows=1) for name in ("trajectory0.csv", "strike0.joints.csv")
    )
    header = (lab / "strike0.joints.csv").read_text().split("\n", 1)[0].split(",")
    assert header[1:7] != [f"position_{joint}" for joint in TRUTH.arm.joints]
    elbow = log[:, header.index("position_elbow")]
    behind = np.abs(np.interp(log[:, 0] - robot_lab.UPTIME, told[:, 0], told[:, 3]) - elbow)
    assert behind.max() > 0.01


@pytest.mark.slow
def test_a_whip_is_identified_from_files_alone_and_predicts_another_strike(lab, tmp_path, capsys):
    """MuJoCo's whip on MuJoCo's robot: numbers within their intervals, errors as stated, the next strike foreseen."""
    files, out = [str(lab / f"strike{i}.csv") for i in range(2)], tmp_path / "out"
    options = ["--drive", "joints", "--model", str(lab / "guess.toml"), "--free", "k", "b", "l"]
    assert identify.main([*files, *options, "--held-out", "1", "--starts", "1", "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["warning"] is None
    assert summary["plane"] is None
    for found in summary["parameters"]:
        low, high = found["interval"]
        assert low <= TRUE[found["name"]] <= high, found
        assert found["class"] == "well determined"
        assert high - low < 0.05 * found["value"]
    assert summary["rmse"] == pytest.approx(robot_lab.MARKER, rel=0.1)
    assert summary["held_out_rmse"] < 1.3 * robot_lab.MARKER
    identified = read_model(out / "identified.toml")
    assert identified.arm == TRUTH.arm
    assert identified.whip.per_node("l").sum() == pytest.approx(1.0, rel=1e-3)
    assert "seen from the side" in (out / "report.html").read_text()


def flat(text: str) -> str:
    """Markers without their heights."""
    return "\n".join(line.rsplit(",", 1)[0] for line in text.splitlines())


def test_without_a_log_the_command_and_a_lag_tell_the_whip(lab):
    """The lab's robot lags behind what it is told by 20 ms; its joints' log is not looked at."""
    files = [read_recording(lab / f"strike{i}.csv", strike=strike) for i, strike in enumerate(STRIKES)]
    bare = [dataclasses.replace(r, joints_t=None, joints_q=None, joint_names=()) for r in files]
    plant = Plant(read_model(lab / "guess.toml"), Controller())
    found = fit(bare[0], plant, ["k", "b", "l"], held_out=bare[1:], options=Fitting(drive="robot", starts=1))
    for name, true in TRUE.items():
        low, high = found[name].interval
        assert low <= true <= high, found[name]
    for recording in (*found.recordings, *found.held_out):
        assert recording.own["lag"] + recording.own["lag_delay"] == pytest.approx(robot_lab.LAG, abs=1e-3)
    assert found.held_out[0].predicted_from is not None
    assert found.recordings[0].rmse == pytest.approx(robot_lab.MARKER, rel=0.1)
    assert found.held_out[0].rmse < 5 * robot_lab.MARKER  # its lag is known from the slow half only


@pytest.mark.parametrize(
    ("change", "drive", "said"),
    [
        (str, "handle", "drive: got 'handle'; allowed: for a model in space joints, robot, hand or command"),
        (flat, "joints", "points: got '2 coordinates, in a plane'; allowed: 3 coordinates"),
    ],
)
def test_what_cannot_be_identified_is_told(lab, tmp_path, capsys, change, drive, said):
    for name in ("strike0.toml", "strike0.joints.csv"):
        (tmp_path / name).write_text((lab / name).read_text())
    (tmp_path / "strike0.csv").write_text(change((lab / "strike0.csv").read_text()))
    args = ["--model", str(lab / "guess.toml"), "--drive", drive, "--out", str(tmp_path / "out")]
    assert identify.main([str(tmp_path / "strike0.csv"), *args]) == 2
    assert said in capsys.readouterr().err


def test_a_log_of_another_robots_joints_is_refused(lab, tmp_path, capsys):
    for name in ("strike0.toml", "strike0.csv", "strike0.joints.csv"):
        (tmp_path / name).write_text((lab / name).read_text().replace("position_elbow", "position_knee"))
    args = ["--model", str(lab / "guess.toml"), "--drive", "joints", "--out", str(tmp_path / "out")]
    assert identify.main([str(tmp_path / "strike0.csv"), *args]) == 2
    said = capsys.readouterr().err
    assert "joints: got" in said
    assert "knee" in said


LITTLE = PlanningEffort(pool=32, polished=2, steps=4, whips=4, population=4, rounds=0)
AROUND = np.array([*STRIKES[0].q_i, *STRIKES[0].q_f])
BOUNDS = StrikeBounds((*(AROUND - 0.3), 0.5), (*(AROUND + 0.3), 0.6))
GOAL = Target((1.0, 0.2, 0.6))


def adaptation(folder) -> Adaptation:
    """The adaptation of another whip on the same robot, as a new process has it."""
    model = guess(folder)
    belief = default_prior(model, Controller(PositionControl()), whip="uniform")
    keeps = (ArmLimits.of(model.arm, prescribed=True),)
    effort = {"starts": 1, "first": LITTLE, "later": LITTLE}
    options = Options(max_strikes=1, bounds=BOUNDS, limits=keeps, t_stay=0.15, **effort)
    return Adaptation(belief, RobotPort(model, GOAL, execution=Execution(rest=0.1), t_stay=0.15), GOAL, options, folder)


@pytest.mark.slow
def test_learning_takes_the_measured_joints_for_what_the_hand_did(lab, tmp_path):
    """By the command, the robot's lag would be taken for one of the camera's clock, and for another whip."""
    belief = default_prior(guess(tmp_path), Controller(PositionControl()), whip="uniform")
    recording = read_recording(lab / "strike0.csv", strike=STRIKES[0])
    learned = update(belief, [recording], starts=1)
    told = dataclasses.replace(recording, joints_t=None, joints_q=None, joint_names=())
    misled = update(belief, [told], starts=1)
    (rmse,), (other,) = learned.rmse.values(), misled.rmse.values()
    assert rmse < 1.2 * robot_lab.MARKER < other
    assert abs(learned.belief.values()["delay"]) < 0.1 * robot_lab.LAG
    assert misled.belief.values()["delay"] == pytest.approx(robot_lab.LAG, rel=0.2)


@pytest.mark.slow
def test_an_adaptation_waits_for_the_robot_and_goes_on_from_its_files(tmp_path):
    """Look, and strike: every wait ends the process; what is learned is the whip, by the robot's own joints."""
    for seed in range(2):
        with pytest.raises(AwaitsRecording) as asked:
            adaptation(tmp_path).run()
        robot_lab.run(TRUTH, asked.value.trajectory, asked.value.recording.parent, "recorded", seed=seed)
    steps = adaptation(tmp_path).run()
    assert [step.number for step in steps] == [0, 1]
    learned = steps[-1].learned
    assert learned is not None
    assert not learned.refused
    belief, truth = learned.belief, {**TRUE, "whip.m": 0.02, "delay": 0.0}
    off = belief.z - [v.z(truth[v.name]) for v in belief.variables]
    assert off @ np.linalg.solve(belief.covariance, off) < 4 * len(off)
    assert belief.errors()["whip.l"] < 0.002
    assert steps[-1].judged is not None
    assert steps[-1].judged.miss == pytest.approx(steps[-1].outcome.seen_miss, abs=0.01)
