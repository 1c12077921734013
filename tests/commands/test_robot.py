"""One strike with a robot from the command line: its run folder, and what is refused before the robot hears of it."""

from __future__ import annotations

import io
import json
import os
import signal
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from repository import ROOT

import whiptool as wt
from whiptool.adaptation.ports import AwaitsRecording
from whiptool.commands import adapt, rig, robot, run_folders
from whiptool.commands.options.rig_options import AdaptOptions, mark_of_port
from whiptool.commands.simulate import SimulateOptions
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.robots.addresses import ROBOTS
from whiptool.rig.stops import STOPPED, Interlock, SafetyError, StrikeStopped
from whiptool.runs import RunFolder, RunLock

sys.path.insert(0, str(ROOT / "examples" / "extending"))
from add_robot import LaggingRobot

VECTOR = (-1.63, -1.07, -0.22, -0.49, 2.16, 0.42, -2.17, -2.07, -0.33, -1.73, -0.35, 2.09, 1.5)
WORDS = [*map(str, VECTOR)]


ADDRESS = "lab://127.0.0.1"


class Counted(LaggingRobot):
    """A robot that counts; `happens` is called as it begins to move."""

    moved = recovered = 0
    happens = staticmethod(lambda: None)

    def follow(self, trajectory, record, stop) -> None:
        Counted.moved += 1
        Counted.happens()
        super().follow(trajectory, record, stop)

    def recover(self) -> None:
        Counted.recovered += 1


@pytest.fixture(autouse=True)
def lab(monkeypatch, tmp_path):
    """A robot at `lab://`, and a home of its own for what a stop leaves."""
    monkeypatch.setitem(ROBOTS, "lab", Counted)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(Counted, "moved", 0)
    monkeypatch.setattr(Counted, "recovered", 0)


@pytest.fixture
def undrawn(monkeypatch, tmp_path):
    """A folder in which reports are empty pages, since drawing takes seconds."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rig, "_report", lambda folder, *_: (folder / "report.html").touch())


def call(capsys, *words: str) -> tuple[int, dict, str]:
    status = robot.main(["strike", "--robot", "lab://127.0.0.1", "--json", "--yes", *words])
    said = capsys.readouterr()
    last = said.out.strip().splitlines()[-1:] or ["{}"]
    return status, json.loads(last[0]) if last[0].startswith("{") else {}, said.err


def test_a_strike_is_made_and_recorded(tmp_path, capsys):
    out = tmp_path / "run"
    status, result, _ = call(capsys, "--model", "ur5e", "--strike", *WORDS, "--out", str(out))
    assert status == 0
    assert (Counted.moved, result["fault"], result["torque_off"], result["hit"]) == (1, None, None, None)
    recording = StrikeRecording.load(out / "recording.npz")
    assert recording.strike == wt.Strike.from_vector(VECTOR)
    np.testing.assert_allclose(recording.joints_q[-1], VECTOR[6:12], atol=1e-6)
    assert json.loads((out / "result.json").read_text())["cycles"] == result["cycles"] > 900
    assert "lab://127.0.0.1" in (out / "report.html").read_text()


def test_the_strike_of_a_run_is_made_with_the_runs_model(tmp_path, capsys):
    options = SimulateOptions(model="ur5e", target=(1.0, 0.2, 0.6), strike=VECTOR)
    folder = RunFolder.create(tmp_path / "run", {"version": "1", **run_folders.configuration(options, "simulate")})
    folder.write_result({"strike": dict(zip(range(13), VECTOR, strict=True))})
    folder.close()
    status, _, error = call(capsys, str(tmp_path / "run"), "--out", str(tmp_path / "struck"))
    assert (status, Counted.moved) == (0, 1), error
    assert "1.000, 0.200, 0.600" in (tmp_path / "struck" / "report.html").read_text()


def test_a_run_of_another_arm_is_refused_by_its_name(tmp_path, capsys):
    """No --strike was typed: its numbers are those of the run."""
    options = SimulateOptions(model="ur5e", target=(1.0, 0.2, 0.6), strike=VECTOR)
    folder = RunFolder.create(tmp_path / "run", {"version": "1", **run_folders.configuration(options, "simulate")})
    folder.write_result({"strike": dict(zip(range(13), VECTOR, strict=True))})
    folder.close()
    status, _, error = call(capsys, str(tmp_path / "run"), "--model", "panda")
    assert (status, Counted.moved) == (2, 0)
    assert f"RUN: got '{tmp_path / 'run'}'; allowed: a run whose strike has 15 numbers" in error
    assert "its strike has 13: give --model of its arm" in error
    status, _, error = call(capsys, str(tmp_path / "run"), "--model", "panda", "--strike", *WORDS[1:])
    assert error.startswith("whiptool: --strike: got (-1.07, ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--model", "ur5e"], r"--strike: got nothing; allowed: joint angles"),
        (["--model", "panda", "--strike", *WORDS], "--strike: got"),
        (["--model", "ur5e", "--strike", *WORDS[:-1], "0.4"], "the velocity of"),
        (["--model", "ur5e", "--strike", *WORDS, "--camera", "realsense"], "--camera: got 'realsense'"),
        (["--model", "ur5e", "--strike", *WORDS, "--true-model", "ur5e"], "only with a virtual --camera"),
    ],
)
def test_what_cannot_be_struck_is_refused_in_one_line(tmp_path, capsys, words, said):
    status, _, error = call(capsys, *words, "--out", str(tmp_path / "run"))
    assert (status, Counted.moved) == (2, 0)
    assert said in error
    assert len(error.strip().splitlines()) == 1


def test_an_address_is_asked_for(capsys):
    assert robot.main(["strike", "--model", "ur5e", "--strike", *WORDS]) == 2
    assert "--robot: got nothing; allowed: franka://HOST, ur://HOST" in capsys.readouterr().err
    assert robot.main(["strike", "--robot", "192.168.0.1", "--model", "ur5e", "--strike", *WORDS]) == 2
    assert "--robot: got '192.168.0.1'; allowed: franka://HOST" in capsys.readouterr().err


def test_nothing_moves_without_a_yes(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", open("/dev/null"))  # noqa: SIM115, PTH123
    words = [
        "strike",
        "--robot",
        "lab://127.0.0.1",
        "--model",
        "ur5e",
        "--strike",
        *WORDS,
        "--out",
        str(tmp_path / "run"),
    ]
    assert robot.main(words) == 2
    assert robot.main(["recover", "--robot", "lab://127.0.0.1"]) == 2
    assert (Counted.moved, Counted.recovered) == (0, 0)
    assert robot.main(["recover", "--robot", "lab://127.0.0.1", "--yes"]) == 0
    assert Counted.recovered == 1


@pytest.mark.parametrize(
    ("given", "port"),
    [
        (["--robot", "twin"], ["--port", "twin"]),
        (["--robot=twin"], ["--port", "twin"]),
        (["--robot", "dynamixel:/dev/ttyUSB0", "--yes"], ["--port", "/dev/ttyUSB0", "--yes"]),
    ],
)
def test_servos_and_their_twin_are_those_of_the_rig(monkeypatch, given, port):
    monkeypatch.setattr(rig, "main", lambda words: words)
    assert robot.main(["strike", *given, "--json"]) == ["strike", *port, "--json"]


STRUCK = ["strike", "--robot", ADDRESS, "--model", "ur5e", "--strike", *WORDS]


def answers(monkeypatch, text: str) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))


def lose(monkeypatch) -> None:
    """Have the connection lost in a strike."""

    def lost() -> None:
        raise SafetyError("lost", "no state came")

    monkeypatch.setattr(Counted, "happens", staticmethod(lost))
    assert robot.main([*STRUCK, "--yes"]) == 1
    monkeypatch.setattr(Counted, "happens", staticmethod(lambda: None))


def run_of_adapt(folder) -> None:
    options = AdaptOptions(model="ur5e", target=(1.0, 0.2, 0.6), port=ADDRESS, camera="none", yes=True)
    RunFolder.create(folder, {"version": "1", **run_folders.configuration(options, "adapt")}).close()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("resumed", [False, True])
def test_adapt_asks_after_a_lost_connection_and_then_goes_on(resumed, tmp_path, monkeypatch, capsys):
    """Each further call failed without a question, whatever was answered to the first."""
    lose(monkeypatch)
    went_on: list[str] = []

    def prepare(options):
        interlock = Interlock()

        def run(on_step):
            interlock.watch(tmp_path / "learned" / STOPPED)  # as of the run, and of each robot that is built
            interlock.watch(mark_of_port(ADDRESS))
            interlock.check()
            went_on.append("yes")
            raise StrikeStopped("enough")

        return SimpleNamespace(interlock=interlock, recordings=[], run=run)

    monkeypatch.setattr(adapt, "prepare", prepare)
    words = ["--port", ADDRESS, "--camera", "none", "--model", "ur5e", "--target", "1", "0.2", "0.6", "--yes"]
    words = ["--resume", "learned"] if resumed else [*words, "--out", "learned"]
    if resumed:
        run_of_adapt(tmp_path / "learned")
    answers(monkeypatch, "no\n")
    assert adapt.main(words) == 1
    assert "The arm was stopped: lost: no state came" in capsys.readouterr().err
    assert (tmp_path / "learned").exists() == resumed
    assert not went_on
    answers(monkeypatch, "yes\n")
    assert adapt.main(words) == 1
    assert went_on == ["yes"]
    assert not mark_of_port(ADDRESS).exists()


@pytest.mark.usefixtures("undrawn")
def test_recovery_clears_a_stop_and_asks_also_with_yes(monkeypatch, tmp_path, capsys):
    lose(monkeypatch)
    answers(monkeypatch, "no\n")
    assert robot.main(["recover", "--robot", ADDRESS, "--yes"]) == 2
    said = capsys.readouterr().err
    assert "The arm was stopped: lost: no state came. Acknowledge" in said
    assert said.splitlines()[-1].endswith("whiptool: not confirmed; nothing was acknowledged")
    assert Counted.recovered == 0
    answers(monkeypatch, "yes\n")
    assert robot.main(["recover", "--robot", ADDRESS, "--yes"]) == 0
    assert Counted.recovered == 1
    answers(monkeypatch, "")
    assert robot.main([*STRUCK, "--yes"]) == 0


def test_an_arm_that_another_command_uses_is_no_option(capsys):
    """The option --arm names a preset, and was blamed although nobody had typed it."""
    mark = mark_of_port(ADDRESS)
    mark.parent.mkdir(parents=True, exist_ok=True)
    lock = RunLock(mark.parent, mark.stem + ".lock")
    for words in ([*STRUCK, "--yes"], ["recover", "--robot", ADDRESS]):
        assert robot.main(words) == 2
        assert "whiptool: lock of the arm: got " in capsys.readouterr().err
    lock.release()


@pytest.mark.usefixtures("undrawn")
def test_a_strike_whose_program_is_killed_makes_the_next_call_ask(monkeypatch, tmp_path, capsys):
    """The mark that a killed program leaves is there while the arm moves, and gone after an orderly end."""
    left: list[str] = []
    monkeypatch.setattr(Counted, "happens", staticmethod(lambda: left.append(mark_of_port(ADDRESS).read_text())))
    assert robot.main([*STRUCK, "--yes"]) == 0
    assert not mark_of_port(ADDRESS).exists()
    mark_of_port(ADDRESS).write_text(left[0])
    answers(monkeypatch, "no\n")
    assert robot.main([*STRUCK, "--yes"]) == 1
    assert "a program was moving it, and was killed, or still runs. Is the cause" in capsys.readouterr().err
    assert Counted.moved == 1


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("words", "unchecked"),
    [
        (["--ignore-collisions"], "collisions, floor"),
        (["--floor", "none"], "floor"),
        (["--limits", "none"], "collisions, floor, torques and speeds of the joints in the simulated strike"),
    ],
)
def test_what_is_not_checked_is_said_and_asked_in_any_case(words, unchecked, monkeypatch, tmp_path, capsys):
    assert robot.main([*STRUCK, *words, "--yes"]) == 2
    assert f"--yes: got 'with NOT checked: {unchecked}'; allowed: only if all is checked" in capsys.readouterr().err
    answers(monkeypatch, "no\n")
    assert robot.main([*STRUCK, *words]) == 2
    asked = capsys.readouterr().err
    assert f"). NOT checked: {unchecked}. Is everybody away, the emergency stop in hand? Type yes" in asked
    assert f"The arm at {ADDRESS} will move for " in asked
    assert Counted.moved == 0
    assert not list(tmp_path.glob("runs/*"))


@pytest.mark.usefixtures("undrawn")
def test_the_model_is_by_default_that_of_the_address(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(ROBOTS, "ur", Counted)
    assert robot.main(["strike", "--robot", "UR://127.0.0.1", "--yes", "--strike", *WORDS]) == 0
    assert Counted.moved == 1
    assert robot.main(["strike", "--robot", ADDRESS, "--strike", *WORDS]) == 2
    assert "--model: got nothing; allowed: the model of the robot's arm" in capsys.readouterr().err
    assert robot.main(["strike", "--robot", "franka://127.0.0.1", "--model", "ur5e", "--strike", *WORDS]) == 2
    assert "--model: got 'ur5e, with 6 joints'; allowed: a model of the robot, such as fr3" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
def test_a_strike_without_a_camera_does_not_read_like_a_hit(monkeypatch, tmp_path, capsys):
    assert robot.main([*STRUCK, "--target", "1", "0.2", "0.6", "--yes"]) == 0
    assert "made the strike at the target (1.000, 0.200, 0.600) m; no camera" in capsys.readouterr().out


@pytest.mark.usefixtures("undrawn")
def test_a_fault_is_said_once_and_ctrl_c_leaves_a_report(monkeypatch, tmp_path, capsys):
    lose(monkeypatch)
    assert "".join(capsys.readouterr()).count("no state came") == 1
    answers(monkeypatch, "yes\n")
    monkeypatch.setattr(Counted, "happens", staticmethod(lambda: os.kill(os.getpid(), signal.SIGINT)))
    assert robot.main([*STRUCK, "--yes", "--out", "run"]) == 130
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.endswith(
        "whiptool: interrupted; the arm is at rest, and the robot's own controller holds the arm; kept in run"
    )
    assert (tmp_path / "run" / "report.html").exists()
    assert not mark_of_port(ADDRESS).exists()


@pytest.mark.parametrize("command", [["--robot", "ur://"], ["--robot=ur://"]])
def test_an_address_without_a_host_is_an_option(command, capsys):
    assert robot.main(["strike", *command, "--model", "ur5e", "--strike", *WORDS]) == 2
    assert capsys.readouterr().err.startswith("whiptool: --robot: got 'ur://'; allowed: franka://HOST")


def test_an_arm_has_one_mark_however_its_address_is_spelled(tmp_path):
    assert mark_of_port("UR://localhost") == mark_of_port("ur://127.0.0.1") != mark_of_port("ur://127.0.0.2")
    (tmp_path / "ttyUSB0").touch()
    (tmp_path / "arm").symlink_to("ttyUSB0")
    assert mark_of_port(str(tmp_path / "arm")) == mark_of_port(str(tmp_path / "ttyUSB0"))


@pytest.mark.parametrize(("port", "said"), [(ADDRESS, False), ("robot", True)])
def test_where_the_robot_has_to_stand_is_said_only_where_it_is_not_asked(port, said, tmp_path, capsys):
    """A driver reads the posture; the user's own program begins at the strike's start."""
    options = AdaptOptions(model="ur5e", target=(1.0, 0.2, 0.6), port=port, camera="none")
    waits = AwaitsRecording(wt.Strike.from_vector(VECTOR), 1, tmp_path / "recording.npz", tmp_path / "recorded.csv")
    assert adapt._ask(waits, tmp_path, options) == adapt.AWAITS
    assert ("--posture says where it stands" in capsys.readouterr().err) == said
