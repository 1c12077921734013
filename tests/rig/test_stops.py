"""A stop is a stop: whatever layer it passes, nothing is armed after it before a person has said so."""

from __future__ import annotations

import csv
import importlib.util
import io
import json
import os
import signal
import sys
import threading
import time
from contextlib import nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pretended_rig import Pretend
from repository import ROOT

import whiptool as wt
from whiptool import stop_signals
from whiptool.commands import rig as command
from whiptool.commands.options.rig_options import mark_of_port
from whiptool.errors import InputError, WhiptoolError
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, Controller
from whiptool.objective import Objective
from whiptool.optimizers import METHODS, search
from whiptool.recording.camera import camera_preset
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig import session as sessions
from whiptool.rig import stops
from whiptool.rig.cyclelog import Phase
from whiptool.rig.emulator import Emulator
from whiptool.rig.filming import Filming
from whiptool.rig.session import HardwareRig, RigRollout, TwinRig
from whiptool.rig.stops import (
    STOPPED,
    Interlock,
    Locked,
    SafetyError,
    StrikeInterrupted,
    StrikeRefused,
    StrikeStopped,
    torque_in_words,
)
from whiptool.rig.struck import Motion
from whiptool.rig.virtual_film import VirtualFilm
from whiptool.vision.source import Frame

pytest.importorskip("dynamixel_sdk")

_SCRIPT = ROOT / "benchmarks" / "rig_stops.py"
_SPEC = importlib.util.spec_from_file_location("rig_stops", _SCRIPT)
assert _SPEC is not None
assert _SPEC.loader is not None
rig_stops = importlib.util.module_from_spec(_SPEC)
sys.modules["rig_stops"] = rig_stops  # its dataclasses look there
_SPEC.loader.exec_module(rig_stops)

MODEL, CONTROLLER = wt.preset("lemon2024"), Controller(OIAC())


@pytest.fixture(autouse=True)
def usual_signals():
    """As in a terminal: who starts tests in the background may have them ignore signals."""
    before = {n: signal.signal(n, signal.default_int_handler) for n in stop_signals.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


# -- the lock ----------------------------------------------------------------------------------------------------------


def test_a_lock_stays_shut_until_a_person_opens_it(tmp_path: Path) -> None:
    lock = Interlock()
    lock.check()
    lock.watch(tmp_path / "run" / STOPPED)
    lock.trip("hardware: joint 1 reports overheating", torque="torque is off")
    lock.trip("line: later")
    with pytest.raises(Locked, match=r"nothing is armed.*joint 1 reports overheating"):
        lock.check()
    later = Interlock()  # of another call
    later.watch(tmp_path / "run" / STOPPED)
    with pytest.raises(Locked, match="overheating"):
        later.check()
    later.release()
    later.check()
    after = Interlock()
    after.watch(tmp_path / "run" / STOPPED)
    after.check()
    assert "overheating" in (tmp_path / "run" / "stopped-1.json").read_text()  # what happened stays on record


def test_a_signal_locks_this_process_and_a_damaged_mark_locks_all(tmp_path: Path) -> None:
    lock = Interlock()
    lock.watch(tmp_path / STOPPED)
    lock.trip("signal: SIGINT came", lasting=False)
    with pytest.raises(Locked):
        lock.check()
    assert not (tmp_path / STOPPED).exists()
    (tmp_path / STOPPED).write_text("{")
    other = Interlock()
    other.watch(tmp_path / STOPPED)
    with pytest.raises(Locked, match="cannot be read"):
        other.check()


def test_a_mark_that_cannot_be_written_is_said_and_does_not_keep_torque_on(tmp_path: Path, capsys) -> None:
    (tmp_path / "file").write_text("")
    lock = Interlock()
    lock.watch(tmp_path / "file" / STOPPED)
    lock.trip("line: gone")
    assert "cannot be written" in capsys.readouterr().err
    with pytest.raises(Locked):
        lock.check()


def test_a_motion_leaves_a_mark_only_while_it_lasts_or_after_a_fault(tmp_path: Path) -> None:
    """What a program that is killed in a motion leaves is what later calls ask about."""
    lock, mark = Interlock(), tmp_path / STOPPED

    def later() -> str | None:
        other = Interlock()
        other.watch(mark)
        return other.stop

    lock.watch(mark)
    with lock.moving():
        assert later() == stops.UNENDED
    assert later() is None
    with suppress(KeyboardInterrupt), lock.moving():
        raise KeyboardInterrupt
    assert later() is None
    with lock.moving():
        lock.trip("signal: SIGINT came", lasting=False)
    assert later() is None
    lock.release()
    with lock.moving():
        lock.trip("line: gone")
    assert later() == "line: gone"


def test_a_motion_whose_mark_cannot_be_written_does_not_begin(tmp_path: Path, monkeypatch, capsys) -> None:
    """A full disk: only who stops an arm may go on without the mark."""
    lock, one, other = Interlock(), tmp_path / "arm.json", tmp_path / STOPPED
    lock.watch(one)
    lock.watch(other)
    write = stops.write_whole

    def full(path: Path, text: str) -> None:
        if path == other:
            raise OSError(28, "No space left on device")
        write(path, text)

    monkeypatch.setattr(stops, "write_whole", full)
    with pytest.raises(InputError, match=r"stopped\.json.*nothing moved; .*No space left"), lock.moving():
        pytest.fail("it moved")
    assert list(tmp_path.iterdir()) == []
    lock.trip("line: gone")
    assert "cannot be written" in capsys.readouterr().err
    with pytest.raises(Locked), lock.moving():
        pytest.fail("it moved")


class Arm(sessions.FilmedRig):
    """An arm of which another program has a fault while this one connects, or that has one in its motion."""

    def __init__(self, interlock: Interlock, fault: str = "", connecting=lambda: None) -> None:
        super().__init__(MODEL, CONTROLLER, interlock=interlock)
        self.fault, self.connecting, self.done = fault, connecting, []

    def _connected(self):
        self.connecting()
        self.done.append("connected")
        return nullcontext()

    def _planned(self, arm, attempt):
        return Motion(attempt.strike, "arm", "shoulder", 1.0, 1.0)

    def _run(self, arm, attempt, motion):
        self.done.append("moved")
        if self.fault:
            self.interlock.trip(self.fault)
        raise RuntimeError(self.fault or "the end of the pretence")


def test_a_fault_of_another_program_is_heard_before_the_arm_is_connected_and_never_erased(tmp_path: Path) -> None:
    """Both read the mark before either moved; the second erased what the first had left."""
    mark, strike = tmp_path / "arm.json", wt.Strike((0.1, 0.1), (0.2, 0.2), 1.0)
    first, second = Interlock(), Interlock()
    first.watch(mark)
    second.watch(mark)
    with pytest.raises(RuntimeError, match="line: gone"):
        Arm(first, "line: gone").strike(strike)
    late = Arm(second)
    with pytest.raises(Locked, match="line: gone"):
        late.strike(strike)
    assert late.done == []
    assert "line: gone" in mark.read_text()


def test_a_run_folder_that_is_not_there_is_not_made_by_its_mark(tmp_path: Path) -> None:
    lock = Interlock()
    lock.watch(tmp_path / "nowhere" / STOPPED)
    with lock.held():
        assert not (tmp_path / "nowhere").exists()


def test_two_programs_do_not_use_one_arm_at_once(tmp_path: Path) -> None:
    mark, strike = tmp_path / "arm.json", wt.Strike((0.1, 0.1), (0.2, 0.2), 1.0)
    first, second = Interlock(), Interlock()
    for lock in (first, second):
        lock.watch(mark)
    other = Arm(second)

    def meanwhile() -> None:
        for act in (lambda: other.strike(strike), second.release, lambda: second.moving().__enter__()):
            with pytest.raises(
                InputError, match=rf"arm: got .*arm\.lock'.*no other command uses.*process {os.getpid()}"
            ):
                act()

    one = Arm(first, connecting=meanwhile)
    with pytest.raises(RuntimeError, match="pretence"):
        one.strike(strike)
    assert (one.done, other.done) == (["connected", "moved"], [])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(RuntimeError, match="pretence"):
        other.strike(strike)  # the first has left


def test_an_answer_at_the_arm_holds_for_the_run_that_was_stopped(tmp_path: Path) -> None:
    """A run that went on asked again after `robot recover` had asked; a run of another arm is not released."""
    arm, run, other = tmp_path / "arm.json", tmp_path / "run" / STOPPED, tmp_path / "other" / STOPPED
    for marks in ([arm, run], [other]):
        lock = Interlock()
        for mark in marks:
            lock.watch(mark)
        lock.trip("line: gone")
    person = Interlock()
    person.watch(arm)
    person.release()
    assert [mark.exists() for mark in (arm, run, other)] == [False, False, True]
    assert (run.parent / "stopped-1.json").exists()


@pytest.mark.parametrize("answer", [True, False])
def test_a_person_is_asked_about_servos_that_are_connected_and_before_they_are_armed(answer, monkeypatch) -> None:
    asked: list[Motion] = []
    rig = rig_stops.rig_of(True)
    rig.confirm = lambda motion: bool(asked.append(motion)) or answer
    run: list[Motion] = []
    monkeypatch.setattr(HardwareRig, "_run", lambda self, arm, attempt, motion: run.append(motion) or [].pop())
    strike = rig_stops.strikes_of(np.random.default_rng(0))[0]
    with pytest.raises(IndexError if answer else stops.NotConfirmed):
        rig.strike(strike)
    assert run == asked * answer
    (motion,) = asked
    assert motion.reach == pytest.approx(np.ptp([[0, 0], strike.q_i, strike.q_f], axis=0).max(), abs=0.01)
    assert motion.duration > strike.D + rig.options.settle + rig.options.t_stay
    assert motion.unchecked == ("collisions", "floor")


def test_torque_is_told_in_words() -> None:
    assert torque_in_words(True) == "torque is off"
    assert "CUT THE POWER (servo 2 did not confirm" in torque_in_words(False, [2])
    assert str(StrikeStopped("hot", None, "torque is off")) == "the strike was stopped: hot; torque is off"


# -- signals -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", stop_signals.SIGNALS)
def test_signals_are_noted_and_none_of_many_raises(number: int) -> None:
    before = signal.getsignal(number)
    with stop_signals.StopSignals() as signals:
        for _ in range(3):
            os.kill(os.getpid(), number)
        assert signals.received == signal.Signals(number).name
        with pytest.raises(KeyboardInterrupt), signals.interruptible(4):  # a callback that hangs
            os.kill(os.getpid(), number)
        with pytest.raises(KeyboardInterrupt), signals.interruptible():  # torque is not switched on any more
            pytest.fail("it came before")
        signals.answered = True
    assert signal.getsignal(number) is before


def test_signals_wait_for_a_block_and_then_come() -> None:
    done = []

    def off() -> None:
        with stop_signals.signals_held():
            for _ in range(3):
                os.kill(os.getpid(), signal.SIGINT)
            done.append("torque off")

    with pytest.raises(KeyboardInterrupt):
        off()
    assert done == ["torque off"]


class Handlers(stop_signals.Listener):
    """Of a program around a strike; they note what they are told."""

    def __init__(self) -> None:
        self.noted: list[int] = []

    def note(self, number: int) -> None:
        self.noted.append(number)

    def on_signal(self, number: int, frame) -> None:
        raise KeyboardInterrupt


def test_a_signal_that_is_answered_is_noted_outside_and_another_comes_again() -> None:
    outside = Handlers()
    signal.signal(signal.SIGINT, outside.on_signal)
    with stop_signals.StopSignals() as signals:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        signals.answered = True
    assert outside.noted == [signal.SIGINT]

    def unanswered() -> None:
        with stop_signals.StopSignals():
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        unanswered()
    assert outside.noted == [signal.SIGINT]


def pressed_in(monkeypatch, place: object, name: str) -> None:
    """Press Ctrl-C twice when a function is called."""
    call = getattr(place, name)

    def pressed(*args, **named):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        return call(*args, **named)

    monkeypatch.setattr(place, name, pressed)


@pytest.fixture
def interrupted_strike(emulator, monkeypatch):
    """Have Ctrl-C pressed during the strike and while its joints are recorded, or while its film is looked at."""

    def prepare(during: bool) -> None:
        stop = rig_stops.Stop(1, (signal.SIGINT,), before=200) if during else rig_stops.Stop(9)
        monkeypatch.setattr(sessions, "Emulator", rig_stops.Watched(emulator, stop))
        pressed_in(monkeypatch, *((TwinRig, "_recorded") if during else (VirtualFilm, "of")))
        monkeypatch.setattr(command, "_make_rig", lambda o, m, c, interlock: rig_stops.rig_of(False, interlock))

    return prepare


@pytest.mark.slow
@pytest.mark.parametrize("during", [True, False])
def test_a_second_signal_loses_neither_the_joints_nor_the_word_on_torque(
    during, interrupted_strike, tmp_path: Path, capsys
) -> None:
    interrupted_strike(during)
    vector = map(str, rig_stops.strikes_of(np.random.default_rng(0))[0].vector)
    words = ["strike", "--target", "1.2", "0.1", "--camera", "points", "--strike", *vector, "--json"]
    assert command.main([*words, "--out", str(tmp_path / "run")]) == 130
    said = capsys.readouterr()
    assert said.err == f"whiptool: interrupted; torque is off; kept in {tmp_path / 'run'}\n"
    summary = json.loads(said.out)
    assert summary == json.loads((tmp_path / "run" / "result.json").read_text())
    assert Path(summary["report"]).exists()
    assert summary["torque_off"]
    assert "SIGINT came" in summary["fault"]
    joints = StrikeRecording.load(tmp_path / "run" / "recording.npz").joints_q
    assert joints is not None
    assert len(joints) > 1
    assert {p.name for p in (tmp_path / "run").iterdir()} >= {"result.json", "cycles.log"}
    assert not (tmp_path / "run" / STOPPED).exists()


@pytest.mark.slow
def test_a_signal_while_the_report_is_drawn_hides_no_fault(emulator, tmp_path: Path, monkeypatch, capsys) -> None:
    fault = rig_stops.Fault("hot", at=0.2, count=100_000, servo=0, seed=0)
    monkeypatch.setattr(sessions, "Emulator", rig_stops.Watched(emulator, rig_stops.Stop(1, fault=fault)))
    monkeypatch.setattr(command, "_make_rig", lambda o, m, c, interlock: rig_stops.rig_of(False, interlock))
    monkeypatch.setattr(command, "_report", lambda *_: os.kill(os.getpid(), signal.SIGINT))
    vector = map(str, rig_stops.strikes_of(np.random.default_rng(0))[0].vector)
    words = ["strike", "--target", "1.2", "0.1", "--camera", "none", "--strike", *vector, "--json"]
    assert command.main([*words, "--out", str(tmp_path / "run")]) == 1
    said = capsys.readouterr()
    summary = json.loads(said.out)
    assert summary["report"] is None
    assert summary["fault"] in said.err
    assert said.err.endswith(f"; torque is off; kept in {tmp_path / 'run'}\n")


@pytest.mark.slow
@pytest.mark.parametrize("during", [True, False])
def test_a_search_that_is_interrupted_tells_what_became_of_torque(
    during, interrupted_strike, tmp_path: Path, capsys
) -> None:
    interrupted_strike(during)
    box = ["--lower", *map(str, rig_stops.LOWER), "--upper", *map(str, rig_stops.UPPER)]
    words = ["learn", "--target", "1.2", "0.1", "--camera", "points", "--method", "random", *box]
    assert command.main([*words, "--out", str(tmp_path / "run")]) == 130
    assert "; torque is off" in capsys.readouterr().out.splitlines()[0]
    assert json.loads((tmp_path / "run" / "result.json").read_text())["torque_off"]
    assert (tmp_path / "run" / "strike-0001" / "recording.npz").exists()


def test_a_search_that_is_interrupted_between_strikes_tells_that_nothing_was_armed(tmp_path, monkeypatch, capsys):
    rig = Ends(KeyboardInterrupt())
    monkeypatch.setattr(command, "_make_rig", lambda *_: rig)
    words = ["learn", "--method", "random", "--max-trials", "5", "--hit-radius", "1e-6", "--out", str(tmp_path / "run")]
    assert command.main(words) == 130
    assert capsys.readouterr().out.splitlines()[0].endswith("; nothing was armed")


# -- the layers above a strike -----------------------------------------------------------------------------------------


class Ends(Pretend):
    """A rig whose second strike ends in an exception."""

    def __init__(self, error: BaseException) -> None:
        super().__init__()
        self.error, self.interlock = error, Interlock()

    def strike(self, strike, *, folder=None, believed=None):
        super().strike(strike, folder=folder)
        if self.calls == 2:
            if isinstance(self.error, StrikeStopped):
                self.interlock.trip(self.error.reason, torque=self.error.torque)
            raise self.error
        return self


ENDS = {
    "fault": StrikeStopped("hardware: joint 1 reports overheating", None, "torque is off"),
    "signal": StrikeInterrupted("signal: SIGINT came", None, "torque is off"),
    "locked": Locked("nothing is armed"),
    "servo": InputError("servo 1: homing_offset", 1024, "0"),
    "line": SafetyError("line", "gone"),
    "bug": ZeroDivisionError("in a driver"),
}
SEARCHES = [m for m in METHODS if m not in ("gradient", "td3", "ddpg", "ppo")] + ["nlopt:GN_CRS2_LM", "nlopt:GN_MLSL"]


@pytest.mark.parametrize("method", SEARCHES)
@pytest.mark.parametrize("end", ENDS)
def test_no_search_strikes_on_after_a_strike_that_was_ended(method: str, end: str) -> None:
    rig = Ends(ENDS[end])
    objective = Objective(RigRollout(lambda number: rig, MODEL), Target(), max_trials=20)
    if end == "signal":
        assert search(objective, method, seed=1).status.value == "interrupted"
    else:
        with pytest.raises(type(ENDS[end])):
            search(objective, method, seed=1)
    assert rig.calls == 2
    assert len(objective.trials) == 1  # what was not carried out is no trial
    assert objective.best is not None
    assert objective.best.outcome.miss_distance == 0.5


def test_a_refused_strike_is_told_and_the_search_goes_on() -> None:
    rollout = RigRollout(lambda number: Pretend(refuse=True), MODEL)
    objective = Objective(rollout, Target(), max_trials=3)
    search(objective, "random", seed=1)
    assert (objective.n_refused, objective.n_unseen, objective.n_diverged) == (3, 0, 0)
    assert sorted(rollout.refused) == [1, 2, 3]


def test_the_command_tells_of_a_refused_strike_why_and_no_more(tmp_path: Path, monkeypatch, capsys) -> None:
    class Refuses(Pretend):
        def strike(self, strike, **named):
            raise StrikeRefused("strike", [1.0], "what the motors can carry", "it asks more of joint 1 than it gives")

    monkeypatch.setattr(command, "_make_rig", lambda *_: Refuses())
    words = ["learn", "--method", "random", "--max-trials", "2", "--out", str(tmp_path / "run")]
    assert command.main(words) == 0
    refused = [line for line in capsys.readouterr().err.splitlines() if "strike" in line]
    assert refused == [f"strike {i} was refused: it asks more of joint 1 than it gives" for i in (1, 2)]


class Turns(Pretend):
    """A rig that refuses its first strike, does not see the second, and misses and hits with those after."""

    def strike(self, strike, *, folder=None):
        self.calls += 1
        if self.calls == 1:
            raise StrikeRefused("strike", [1.0], "what the motors can carry", "it asks more of joint 1 than it gives")
        return self

    def judged(self, target):
        return None if self.calls == 2 else super().judged(target)


def test_the_log_tells_what_each_strike_came_to(tmp_path: Path, monkeypatch, capsys) -> None:
    rig, run = Turns(), tmp_path / "run"
    monkeypatch.setattr(command, "_make_rig", lambda *_: rig)
    words = ["learn", "--method", "random", "--max-trials", "4", "--hit-radius", "0.15", "--out", str(run)]
    assert command.main(words) == 0
    rows = list(csv.DictReader((run / "trials.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["refused", "unseen", "miss", "hit"]
    said = capsys.readouterr()
    assert "4 strikes, 1 refused, 1 not seen" in said.out
    assert "strike 2: the tip was not seen" in said.err
    assert command.main(["learn", "--resume", str(run), "--json"]) == 0  # the log is all that it has
    summary = json.loads(capsys.readouterr().out)
    assert [summary[name] for name in ("n_trials", "n_refused", "n_unseen", "hit")] == [4, 1, 1, True]


@pytest.mark.parametrize(("end", "status"), [("fault", 1), ("signal", 130), ("servo", 2), ("line", 1)])
def test_the_command_tells_why_it_ended_and_asks_before_it_goes_on(end, status, tmp_path, monkeypatch, capsys) -> None:
    run, rig = tmp_path / "run", Ends(ENDS[end])

    def make(options, model, controller, interlock):
        rig.interlock = interlock
        return rig

    monkeypatch.setattr(command, "_make_rig", make)
    words = ["learn", "--method", "random", "--max-trials", "5", "--hit-radius", "1e-6", "--out", str(run), "--yes"]
    assert command.main(words) == status
    said = "".join(capsys.readouterr())
    told = {"fault": "overheating; torque is off", "signal": "kept; torque is off", "servo": "1024", "line": "gone"}
    assert told[end] in said
    assert len((run / "trials.csv").read_text().splitlines()) == 1 + 1
    monkeypatch.setattr(sys, "stdin", io.StringIO("no\n"))
    if end != "fault":
        assert command.main(["learn", "--resume", str(run)]) == 0
        return
    assert "overheating" in (run / STOPPED).read_text()
    assert "overheating" in (run / "result.json").read_text()
    assert command.main(["learn", "--resume", str(run)]) == 1
    assert rig.calls == 2
    assert "Is the cause found and gone" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    assert command.main(["learn", "--resume", str(run)]) == 0
    assert rig.calls == 2 + 4
    assert not (run / STOPPED).exists()


# -- cameras, prompts, later calls -------------------------------------------------------------------------------------


class Camera:
    """A camera that gives black frames up to a phase of the strike, or none at all."""

    def __init__(self, frames: bool = True) -> None:
        self.settings, self.frames = camera_preset("d435-infrared"), frames
        self.fails, self.closed, self.n = threading.Event(), False, 0

    def open(self) -> None:
        pass

    def read(self, timeout: float) -> Frame | None:
        if self.fails.is_set():
            raise OSError("the camera was unplugged")
        time.sleep(0.002)
        if not self.frames:
            return None
        self.n += 1
        image = np.zeros((self.settings.height, self.settings.width), np.uint8)
        return Frame(image, t=0.01 * self.n, clock="camera", sequence=self.n, settings=self.settings)

    def close(self) -> None:
        self.closed = True


@pytest.fixture(scope="module")
def emulator():
    with Emulator(rig_stops.PHYSICS) as one:
        yield one


@pytest.fixture
def filmed(emulator, monkeypatch):
    """Strike with a camera and the hardware's code on the twin: the rig, and how often torque was switched on."""

    def strike(camera: Camera, folder: Path, at: Phase | None = None):
        watched = rig_stops.Watched(emulator, rig_stops.Stop(9))
        monkeypatch.setattr(sessions, "Emulator", watched)
        during = Filming.during

        def fails(filming: Filming, striking: bool) -> None:
            filming.phases = getattr(filming, "phases", 0) + 1
            if (
                at is not None
                and (striking if at is Phase.STRIKE else filming.phases == 5)
                and not camera.fails.is_set()
            ):
                during(filming, striking)
                camera.fails.set()
                filming._thread.join()
            during(filming, striking)

        monkeypatch.setattr(Filming, "during", fails)
        monkeypatch.setattr(Filming, "wait", lambda self, wait=Filming.wait: wait(self, 0.2))
        rig = rig_stops.rig_of(True)
        rig.camera = camera
        with pytest.raises(WhiptoolError) as ended:
            rig.strike(rig_stops.strikes_of(np.random.default_rng(0))[0], folder=folder)
        assert camera.closed
        return rig, ended.value, len(watched.armed)

    return strike


@pytest.mark.slow
def test_a_camera_without_frames_is_no_strike(filmed, tmp_path: Path) -> None:
    _, error, armed = filmed(Camera(frames=False), tmp_path)
    assert "the camera gives no frames (no frame in 0.2 s); the arm has not moved" in str(error)
    assert armed == 0


@pytest.mark.slow
def test_a_camera_that_is_lost_on_the_way_stops_the_strike(filmed, tmp_path: Path) -> None:
    rig, error, armed = filmed(Camera(), tmp_path, at=Phase.APPROACH)
    assert str(error) == "the strike was stopped: camera: the camera was unplugged; torque is off"
    assert armed == 2
    assert error.struck.recording is None
    with pytest.raises(Locked):
        rig.interlock.check()


@pytest.mark.slow
def test_a_camera_that_is_lost_during_a_strike_leaves_the_joints(filmed, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(sessions, "_tracked", lambda frames, run: None)
    rig, error, _ = filmed(Camera(), tmp_path, at=Phase.STRIKE)
    assert "camera: the camera was unplugged; the joints were recorded; torque is off" in str(error)
    joints = StrikeRecording.load(tmp_path / "recording.npz").joints_q
    assert joints is not None
    assert len(joints) > 10
    with pytest.raises(Locked):
        rig.interlock.check()


STRUCK = ["--strike", "0.1", "0.1", "0.2", "0.15", "0.5"]


@pytest.fixture
def port(tmp_path: Path, monkeypatch) -> str:
    """A device that is there, and is told by its name when it is opened: it is no serial line."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    device = tmp_path / "no-serial-line"
    device.touch()
    return str(device)


class Person(io.StringIO):
    """A person at the keyboard who presses Ctrl-C instead of answering."""

    def readline(self, *args) -> str:
        os.kill(os.getpid(), signal.SIGINT)
        return ""


@pytest.mark.parametrize(("answer", "status"), [("no\n", 2), ("y\n", 2), ("\n", 2), ("", 2), (None, 130)])
def test_nothing_is_armed_without_an_answer(answer, status, port, tmp_path: Path, monkeypatch, capsys) -> None:
    planned = Motion(wt.Strike((0.1, 0.1), (0.2, 0.15), 0.5), port, "elbow", 0.1, 3.0, sessions.UNCHECKED)
    monkeypatch.setattr(HardwareRig, "_connected", lambda self: nullcontext())
    monkeypatch.setattr(HardwareRig, "_planned", lambda self, arm, attempt: planned)
    monkeypatch.setattr(HardwareRig, "_run", lambda *_: pytest.fail("the arm was moved"))
    monkeypatch.setattr(sys, "stdin", Person() if answer is None else io.StringIO(answer))
    assert (
        command.main(["strike", "--port", port, "--camera", "none", *STRUCK, "--out", str(tmp_path / "run")]) == status
    )
    *_, asked, last = ("\n" + capsys.readouterr().err.replace("on: w", "on: \nw")).splitlines()
    assert asked.endswith("the power switch at hand? Type yes to go on: ")
    assert last == "whiptool: " + (
        "not confirmed; nothing was armed" if status == 2 else "interrupted; nothing was armed"
    )


class Nobody(io.StringIO):
    """A keyboard that must not be read."""

    def readline(self, *args) -> str:
        raise AssertionError("a question was asked")


@pytest.mark.parametrize(
    ("place", "camera", "said"),
    [
        ("/dev/nowhere", "none", "--port: got '/dev/nowhere'; allowed: a serial device"),
        (None, "realsense", "--camera: got 'realsense'; allowed: a RealSense camera that is plugged in"),
    ],
)
def test_what_is_not_there_is_refused_before_a_question(place, camera, said, port, tmp_path, monkeypatch, capsys):
    sdk = SimpleNamespace(context=lambda: SimpleNamespace(query_devices=list), camera_info=None)
    monkeypatch.setattr("whiptool.vision.source.realsense", lambda: sdk)
    monkeypatch.setattr(sys, "stdin", Nobody())
    words = ["strike", "--port", place or port, "--camera", camera, *STRUCK]
    assert command.main([*words, "--out", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err.startswith(f"whiptool: {said}")


def test_a_later_call_with_the_port_asks_whatever_its_options(port, tmp_path: Path, monkeypatch, capsys) -> None:
    before = Interlock()
    before.watch(mark_of_port(port))
    before.trip("hardware: joint 1 reports overheating")
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    assert (
        command.main(["strike", "--port", port, "--camera", "none", *STRUCK, "--yes", "--out", str(tmp_path / "run")])
        == 1
    )
    assert "nothing is armed: the arm was stopped (hardware: joint 1 reports overheating)" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", io.StringIO("yes\n"))
    assert (
        command.main(["strike", "--port", port, "--camera", "none", *STRUCK, "--yes", "--out", str(tmp_path / "run")])
        == 2
    )
    assert "no-serial-line" in capsys.readouterr().err  # so far it came


@pytest.mark.slow
def test_after_random_stops_of_whole_sessions_nothing_is_armed() -> None:
    """24 of the 300 that `benchmarks/rig_stops.py` makes; what is counted is what the emulated servos were told."""
    result = rig_stops.stops(24, seed=1)
    assert result["violations"] == 0, result["what"]
    assert any(" signals" in end for end in result["ends"])
    assert len(result["ends"]) > 10
    assert np.sum(list(result["ends"].values())) == 24
