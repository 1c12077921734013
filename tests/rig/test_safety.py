"""Nothing but a checked, armed, healthy arm gets a torque; every fault ends in none, in bounded time."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from processes import HANG

import whiptool as wt
from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller, oiac_preset
from whiptool.limits.arm_limits import XM430, limits_preset
from whiptool.rig.control_loop import RigLoop, StepClock
from whiptool.rig.cyclelog import Flag, Phase
from whiptool.rig.dynamixel import Joints, JointSample
from whiptool.rig.dynamixel.joints import Guards, Watch
from whiptool.rig.emulator import Emulator, Fault, Motor, TwinOptions, random_faults
from whiptool.rig.loop_options import CappedLoop, Caps, LoopOptions, default_caps
from whiptool.rig.rehearsal import rehearse
from whiptool.rig.safety import Safety, State
from whiptool.rig.stops import Locked, SafetyError

pytest.importorskip("dynamixel_sdk")

PERIOD = 0.002
MODEL = wt.preset("lemon2024")
# A strike within the XM430's line that hits (1.2, 0.1) under OIAC with the paper's a = 0.2; from a random search
STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])
SHORT = wt.Strike((-0.3, 0.2), (0.0, 0.5), 0.3)
OPTIONS = LoopOptions(settle=0.0, go_back=False, t_stay=0.05, rehearse=False)
FAST_PHYSICS = TwinOptions(timestep=5e-4, integrator="implicitfast", period=PERIOD)


@pytest.fixture(scope="module")
def twin():
    with Emulator(FAST_PHYSICS) as emulator:
        yield emulator


def loop_on(twin, bus, *, guards=None, safety=None, options=OPTIONS, controller=None) -> RigLoop:
    joints = Joints(bus)
    return RigLoop(
        joints,
        MODEL,
        controller or Controller(OIAC()),
        options=options,
        guards=guards,
        clock=StepClock(),
        safety=safety or Safety(joints),
    )


@pytest.fixture
def bus(twin):
    twin.reset(SHORT.q_i)
    with twin.bus(timeout=0.01) as bus:
        yield bus


# -- arming ------------------------------------------------------------------------------------------------------------


def test_arming_leaves_no_current_and_everything_set(bus, twin):
    safety = Safety(Joints(bus), current=1.5, watchdog=0.08)
    assert bus.read(1, "goal_current") == 1193  # a trap: torque on in current mode would go to the limit
    safety.arm()
    state = twin.state()
    assert state["torque_on"] == [True, True]
    assert state["operating_mode"] == [0, 0]
    assert state["goal_current"] == [0, 0]
    assert state["watchdog"] == [4, 4]
    assert bus.read(2, "current_limit") == int(1.5 / 2.69e-3)
    assert safety.state == State.ARMED
    safety.disarm()
    assert safety.state == State.DISARMED
    assert safety.confirmed
    assert twin.state()["torque_on"] == [False, False]


def test_goal_current_is_verified_not_assumed(bus, twin, monkeypatch):
    safety, write = Safety(Joints(bus)), bus.write
    monkeypatch.setattr(
        bus, "write", lambda id, name, value: None if name == "goal_current" else write(id, name, value)
    )
    with pytest.raises(SafetyError, match=r"goal_current is 8[0-9]+, not 0"):
        safety.arm()
    assert safety.state == State.FAULT
    assert twin.state()["torque_on"] == [False, False]


def test_a_servo_with_an_error_is_not_armed(bus, twin):
    twin.inject(Fault("hot", servo=1))
    twin.advance(0.01)
    with pytest.raises(SafetyError, match=r"servo 2 reports overheating.*--reboot 2"):
        Safety(Joints(bus)).arm()
    assert twin.state()["torque_on"] == [False, False]


def test_a_line_that_fails_while_arming(twin):
    for lost in range(0, 24, 5):
        twin.reset()
        with twin.bus(timeout=0.01) as fresh:
            for _ in range(lost):
                fresh.ping(1)
            twin.inject(Fault("drop", count=3))
            safety = Safety(Joints(fresh))
            with pytest.raises(SafetyError, match="line"):
                safety.arm()
            assert safety.state == State.FAULT
            assert twin.state()["torque_on"] == [False, False]


def test_no_torque_unless_armed(bus, twin):
    safety = Safety(Joints(bus))
    for act in (lambda: safety.command(np.ones(2)), safety.hold):
        with pytest.raises(SafetyError, match="no torque while the arm is DISARMED"):
            act()
    safety.arm()
    safety.command(np.ones(2))
    safety.fault(SafetyError("test", "now"))
    with pytest.raises(SafetyError, match="no torque while the arm is FAULT"):
        safety.command(np.ones(2))
    with pytest.raises(SafetyError, match="controller"):
        safety.command(np.array([np.nan, 0]))
    changes = len(twin.state()["torque_changes"])
    with pytest.raises(Locked, match="test: now"):
        safety.arm()
    assert len(twin.state()["torque_changes"]) == changes
    safety.interlock.release()
    safety.arm()  # anew
    assert safety.state == State.ARMED
    safety.disarm()


def test_an_exception_turns_torque_off(bus, twin):
    safety = Safety(Joints(bus))

    def run() -> None:
        with safety:
            safety.arm()
            safety.command(np.ones(2))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run()
    assert safety.state == State.FAULT
    assert twin.state()["torque_on"] == [False, False]


def test_options_of_safety_are_checked(bus):
    for wrong in ({"watchdog": 0.02}, {"watchdog": 0.2}, {"current": 0.0}, {"current": 9.0}):
        with pytest.raises(InputError):
            Safety(Joints(bus), **wrong)
    with pytest.raises(InputError):
        Guards(low=1.0, high=0.0)


# -- guards ------------------------------------------------------------------------------------------------------------

GOOD = JointSample(
    q=np.zeros(2),
    v=np.zeros(2),
    current=np.zeros(2),
    voltage=np.full(2, 12.0),
    temperature=np.full(2, 30),
    hardware_error=np.zeros(2, int),
    torque_on=np.ones(2, int),
    watchdog=np.full(2, 3),
    tick=np.zeros(2, int),
)


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("position", {"q": np.array([0, 5.0])}),
        ("speed", {"v": np.array([-7.0, 0])}),
        ("current", {"current": np.array([0, 2.7])}),
        ("temperature", {"temperature": np.array([71, 30])}),
        ("voltage", {"voltage": np.array([12, 9.0])}),
        ("hardware", {"hardware_error": np.array([0, 8])}),
        ("torque", {"torque_on": np.array([1, 0])}),
        ("watchdog", {"watchdog": np.array([3, -1])}),
        ("tracking", {"q": np.array([1.3, 0])}),
    ],
)
def test_each_guard_sees_its_value_and_only_that(kind, change):
    assert Watch(Guards(), 2).sample(0.0, GOOD, np.zeros(2)) is None
    error = Watch(Guards(), 2).sample(0.0, dataclasses.replace(GOOD, **change), np.zeros(2))
    assert error is not None
    assert error.kind == kind


def test_stale_samples_are_seen_also_over_the_ticks_wrap():
    for start in (0, 32_760):
        watch = Watch(Guards(), 2)
        for k in range(20):
            tick = np.full(2, (start + 2 * k) % 32_768)
            assert watch.sample(k * 0.002, dataclasses.replace(GOOD, tick=tick), np.zeros(2)) is None
        error = watch.sample(19 * 0.002 + 0.015, dataclasses.replace(GOOD, tick=tick), np.zeros(2))
        assert error is not None
        assert error.kind == "stale"


def test_a_still_encoder_is_seen_only_while_it_should_move():
    watch = Watch(Guards(), 2)
    for _ in range(100):
        assert watch.sample(0, GOOD, np.zeros(2)) is None
    moving = [watch.sample(0, GOOD, np.array([0.0, 0.01 * k])) for k in range(40)]
    assert moving[29] is None
    assert moving[31] is not None
    assert moving[31].kind == "frozen"


def test_missed_and_late_cycles_count_in_a_row():
    watch = Watch(Guards(missed=3, overruns=2), 2)
    assert watch.missed() is None
    assert watch.missed() is None
    assert watch.sample(0, GOOD, np.zeros(2)) is None
    assert [watch.missed() is None for _ in range(3)] == [True, True, False]
    assert [watch.timing(x) is None for x in (True, False, True, True)] == [True, True, True, False]


# -- faults, each with a bound -----------------------------------------------------------------------------------------

AT = 0.1  # [s]
MOVING = 0.2  # [s], when both joints of SHORT are faster than 1 rad/s


@pytest.mark.parametrize(
    ("fault", "kind", "bound"),
    [
        # bounds: cycles until it is seen, and one more until zero current acts
        (Fault("drop", at=AT, count=10_000), "missed", 4),
        (Fault("corrupt", at=AT, count=10_000, seed=3), "missed", 6),
        (Fault("lose", at=AT, count=10_000), "missed", 32),  # the stop is lost too: the servos' watchdog, 60 ms
        (Fault("late", at=AT, count=10_000), "missed", 4),
        (Fault("unplug", at=AT), "unplugged", 32),  # the watchdog
        (Fault("dead", at=AT, servo=0), "missed", 4),
        (Fault("dead", at=AT, servo=1), "missed", 4),
        (Fault("hot", at=AT, servo=1), "hardware", 3),
        (Fault("alert", at=AT, servo=0), "hardware", 3),
        (Fault("sag", at=AT, volts=9.0), "voltage", 3),
        (Fault("reboot", at=AT, servo=1), "torque", 3),
        (Fault("same_id", at=AT, servo=1), "missed", 4),
        (Fault("stuck", at=MOVING, servo=1), "encoder", 4),
        (Fault("flicker", at=MOVING, servo=0), "encoder", 4),
        (Fault("flicker", at=MOVING, servo=1), "encoder", 4),
        (Fault("jump", at=AT, servo=0, angle=0.05), "encoder", 3),
        (Fault("jump", at=AT, servo=1, angle=-1.0), "encoder", 3),
        (Fault("jump", at=AT, servo=1, angle=0.4, lasting=PERIOD), "encoder", 3),
        (Fault("stuck", servo=1), "encoder", 150),  # at rest: as soon as the torques tell it
    ],
    ids=lambda x: f"{x.kind}{x.servo}" if isinstance(x, Fault) else None,
)
def test_fault_ends_in_no_current_within_a_bound(bus, twin, fault, kind, bound):
    twin.inject(fault)
    guards = Guards(frozen=0.1)
    run = loop_on(twin, bus, guards=guards).run(SHORT)
    assert run.fault is not None
    assert run.fault.kind == kind
    reached = twin.state()
    if reached["last_driven"] == reached["t"]:  # the line is gone: let the watchdog's time pass
        twin.advance(0.1)
    state = twin.state()
    assert_not_driven(state)
    assert state["last_driven"] <= max(fault.at, AT) + bound * PERIOD + 1e-9
    assert_record_is_whole(run, state)
    assert run.torque_off == (fault.kind not in ("drop", "corrupt", "lose", "late", "unplug", "dead", "same_id"))


def assert_not_driven(state) -> None:
    """No servo is asked for current, and what flows (above the no-load speed, back into the supply) brakes."""
    assert not any(goal for goal, on in zip(state["goal_current"], state["torque_on"], strict=True) if on)
    assert state["last_driven"] < state["t"]
    assert all(current * v <= 0 for current, v in zip(state["current"], state["v"][:2], strict=True))


def assert_record_is_whole(run, state) -> None:
    """Every cycle is there, the last one says fault, and after it no torque was commanded."""
    cycles = run.cycles
    np.testing.assert_allclose(cycles.t, np.arange(len(cycles)) * PERIOD, atol=1e-12)
    if run.fault is None:
        assert not (cycles.flags & Flag.FAULT).any()
        assert (cycles.state == State.RUNNING).all()
        return
    assert cycles.flags[-1] & Flag.FAULT
    assert not (cycles.flags[:-1] & Flag.FAULT).any()
    assert cycles.state[-1] == State.FAULT
    assert not cycles.goal_current[-1].any()
    after = [goal for t, goal in state["goal_writes"] if t >= cycles.t[-1] - 1e-9]
    assert not any(after)


@pytest.mark.parametrize("kind", ["drop", "corrupt", "split", "duplicate", "lose", "late"])
def test_one_bad_packet_is_no_fault(bus, twin, kind):
    twin.inject(Fault(kind, at=AT, seed=1))
    run = loop_on(twin, bus).run(SHORT)
    assert run.fault is None
    assert run.torque_off
    assert run.missed <= 2
    assert len(run.cycles) == round((SHORT.D + OPTIONS.t_stay) / PERIOD)


def test_overload_shuts_the_servo_and_the_run(twin):
    protection = dataclasses.replace(FAST_PHYSICS.protection, overload_current=0.1, overload_time=0.05)
    with (
        Emulator(dataclasses.replace(FAST_PHYSICS, protection=protection, start=SHORT.q_i)) as weak,
        weak.bus() as line,
    ):
        run = loop_on(weak, line).run(SHORT)
        assert run.fault is not None
        assert "overload" in str(run.fault)
        weak.advance(0.01)
        assert_not_driven(weak.state())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_turn_torque_off(bus, twin, number):
    before = signal.getsignal(number)
    loop = loop_on(twin, bus)
    run = loop.run(SHORT, on_cycle=lambda k, phase: os.kill(os.getpid(), number) if k == 20 else None)
    assert run.fault is not None
    assert run.fault.kind == "signal"
    assert len(run.cycles) == 21
    assert run.torque_off
    assert twin.state()["torque_on"] == [False, False]
    assert signal.getsignal(number) is before


PHASES = LoopOptions(rate=100.0, settle=0.05, approach_speed=2.0, t_stay=0.02, rehearse=False)
GENTLE = wt.Strike((0.1, 0.1), (0.2, 0.15), 0.15)


@pytest.fixture(scope="module")
def slow_twin():
    """A twin of few cycles, which goes through all phases."""
    with Emulator(dataclasses.replace(FAST_PHYSICS, period=0.01)) as emulator:
        yield emulator


def phases_on(twin: Emulator, bus, **more) -> RigLoop:
    joints = Joints(bus)
    return RigLoop(joints, MODEL, Controller(OIAC()), options=PHASES, clock=StepClock(), **more)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("phase", Phase)
def test_a_signal_in_any_phase_ends_the_run_however_often_it_comes(slow_twin, phase, number):
    def stop(k, now):
        if now is phase:
            for _ in range(1 if k % 2 else 3):
                os.kill(os.getpid(), number)

    slow_twin.reset((0.0, 0.0))
    with slow_twin.bus() as bus:
        loop = phases_on(slow_twin, bus)
        run = loop.run(GENTLE, on_cycle=stop)
        assert str(run.fault) == f"signal: {signal.Signals(number).name} came"
        assert run.cycles.phase[-1] == phase
        assert run.torque == "torque is off"
        changes = slow_twin.state()["torque_changes"]
        with pytest.raises(Locked):
            loop.run(GENTLE)
    assert [on for _, _, on in changes] == [True, True, False, False]
    assert slow_twin.state()["torque_changes"] == changes


@pytest.mark.parametrize("register", ["current_limit", "bus_watchdog", "torque_enable"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_arming_keeps_torque_off(slow_twin, register, number):
    slow_twin.reset((0.0, 0.0))
    with slow_twin.bus() as bus:
        write = bus.write

        def stopped(id, name, value):
            if (id, name) == (2, register) and value:
                os.kill(os.getpid(), number)
            write(id, name, value)

        bus.write = stopped
        run = phases_on(slow_twin, bus).run(GENTLE)
    assert run.fault is not None
    assert run.fault.kind == "signal"
    assert run.torque_off
    on = [servo for _, servo, on in slow_twin.state()["torque_changes"] if on]
    assert on == ([0] if register == "torque_enable" else [])


def test_a_signal_after_the_last_cycle_is_no_end_like_any_other(slow_twin, monkeypatch):
    slow_twin.reset((0.0, 0.0))
    disarm = Safety.disarm

    def stopped(safety):
        disarm(safety)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Safety, "disarm", stopped)
    with slow_twin.bus() as bus:
        run = phases_on(slow_twin, bus).run(GENTLE)
    assert str(run.fault) == "signal: SIGINT came"
    assert run.torque_off


def test_torque_off_is_completed_however_often_ctrl_c_comes(bus, twin):
    """Also where a person arms from Python, without the loop."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    safety, write_all = Safety(Joints(bus)), bus.write_all

    def interrupted(name, value):
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGINT)
        write_all(name, value)

    bus.write_all = interrupted

    def run() -> None:
        with safety:
            safety.arm()
            os.kill(os.getpid(), signal.SIGINT)

    try:
        with pytest.raises(KeyboardInterrupt):
            run()
    finally:
        signal.signal(signal.SIGINT, before)
    assert safety.confirmed
    assert twin.state()["torque_on"] == [False, False]


BAD = {
    "position": {"q": np.array([0, 5.0])},
    "speed": {"v": np.array([-7.0, 0])},
    "current": {"current": np.array([0, 2.7])},
    "temperature": {"temperature": np.array([71, 30])},
    "voltage": {"voltage": np.array([12, 9.0])},
    "hardware": {"hardware_error": np.array([0, 4])},
    "torque": {"torque_on": np.array([1, 0])},
    "watchdog": {"watchdog": np.array([3, -1])},
    "tracking": {"q": np.array([1.6, 0])},
    "stale": {"tick": np.array([0, 0])},
}


@pytest.mark.parametrize("kind", BAD)
def test_a_guard_in_any_phase_ends_the_run_and_locks_the_arm(slow_twin, kind, monkeypatch):
    read, now = Joints.read, {}

    def bad(joints):
        sample = read(joints)
        if now.get("phase") is not now["until"] or now["cycles"] < 2:
            return sample
        change = BAD[kind] if kind != "stale" else {"tick": sample.tick - 500}
        return dataclasses.replace(sample, **change)

    def tell(k, phase):
        now["cycles"] = now["cycles"] + 1 if now.get("phase") is phase else 0
        now["phase"] = phase

    monkeypatch.setattr(Joints, "read", bad)
    for phase in Phase:
        now.clear()
        now.update(until=phase, cycles=0)
        slow_twin.reset((0.0, 0.0))
        with slow_twin.bus() as bus:
            loop = phases_on(slow_twin, bus)
            run = loop.run(GENTLE, on_cycle=tell)
            assert run.fault is not None
            assert run.fault.kind == kind
            assert run.cycles.phase[-1] == phase
            assert run.torque_off
            changes = slow_twin.state()["torque_changes"]
            assert [on for _, _, on in changes] == [True, True, False, False]
            with pytest.raises(Locked, match=kind):
                loop.run(GENTLE)
        assert slow_twin.state()["torque_changes"] == changes


def test_a_dead_servo_is_named_and_so_is_the_cure(slow_twin):
    slow_twin.reset((0.0, 0.0))
    with slow_twin.bus() as bus:
        slow_twin.inject(Fault("dead", at=0.1, servo=1))
        run = phases_on(slow_twin, bus).run(GENTLE)
    assert run.fault is not None
    said = f"{run.fault}; {run.torque}"
    assert "status packet" not in said
    assert "no sample in 3 cycles in a row: " in said
    assert f"--port {slow_twin.port}` lists the servos" in said
    assert "CUT THE POWER (servo 2 did not confirm that it is off)" in said
    assert not slow_twin.state()["torque_on"][0]


def test_an_exception_in_a_callback_keeps_the_record(bus, twin, tmp_path):
    def fail(k, phase):
        if k == 30:
            raise RuntimeError("camera")

    path = tmp_path / "run.cycles"
    with pytest.raises(RuntimeError, match="camera"):
        loop_on(twin, bus).run(SHORT, path=path, on_cycle=fail)
    assert twin.state()["torque_on"] == [False, False]
    from whiptool.rig.cyclelog import Cycles

    cycles = Cycles.load(path)
    assert len(cycles) == 31
    assert cycles.flags[-1] == Flag.FAULT | Flag.OUTSIDE


CLIENT = """
import sys, whiptool as wt
from pathlib import Path
from whiptool.rig.dynamixel import DynamixelBus, Joints
from whiptool.rig.control_loop import RigLoop, StepClock, posture_controller
from whiptool.rig.loop_options import LoopOptions
from whiptool.rig.safety import Safety
model = wt.preset("lemon2024")
options = LoopOptions(settle=30.0, rehearse=False)
bus = DynamixelBus(sys.argv[1], [1, 2], timeout=float(sys.argv[3]))
joints = Joints(bus)
safety, posture = Safety(joints, watchdog=0.1), posture_controller(model, options)
loop = RigLoop(joints, model, posture, options=options, safety=safety, clock=StepClock())
tell = lambda k, phase: print(k, flush=True) if k == 60 else None
loop.run(wt.Strike((0.6, 0.4), (0.7, 0.5), 1.0), path=Path(sys.argv[2]), on_cycle=tell)
"""


def test_sigkill_leaves_it_to_the_watchdog_and_keeps_the_record(tmp_path):
    from whiptool.rig.cyclelog import Cycles

    path = tmp_path / "run.cycles"
    with Emulator(dataclasses.replace(FAST_PHYSICS, start=(0.6, 0.4))) as twin:
        words = [sys.executable, "-c", CLIENT, twin.port, str(path), str(HANG)]
        client = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert client.stdout is not None
        assert client.stdout.readline().strip() == "60"
        assert any(twin.state()["current"])
        client.kill()
        client.wait()
        twin.advance(0.2)
        state = twin.state()
    assert_not_driven(state)
    assert state["watchdog"] == [-1, -1]
    last_heard = state["goal_writes"][-1][0] + PERIOD  # or before: a read may have come after the last write
    aged = 10 * FAST_PHYSICS.timestep  # servos look at their watchdog every ten steps
    assert last_heard < state["last_driven"] <= last_heard + 0.1 + aged + 1e-9
    cycles = Cycles.load(path)
    assert len(cycles) >= 60
    assert np.abs(cycles.goal_current).max() > 0.1


@pytest.mark.slow
def test_a_hundred_strikes_with_random_faults(twin):
    """Never a torque after a fault, never a lost record, whatever breaks when."""
    rng, ended = np.random.default_rng(0), {"good": 0, "fault": 0}
    strike = wt.Strike((-0.3, 0.2), (0.0, 0.5), 0.15)
    options = LoopOptions(settle=0.0, go_back=False, t_stay=0.02, rehearse=False)
    for n in range(100):
        faults = random_faults(rng, duration=0.17, servos=2)
        twin.reset(strike.q_i)
        with twin.bus(timeout=0.006, fast=bool(n % 2)) as bus:
            twin.inject(*faults)
            counted = [0]

            def count(k, phase, counted=counted):
                counted[0] = k + 1

            run = loop_on(twin, bus, options=options).run(strike, on_cycle=count)
        twin.advance(0.12)  # the longest watchdog
        state = twin.state()
        assert_not_driven(state)
        outside = run.cycles.flags & Flag.OUTSIDE > 0  # a fault while arming or disarming has a row of its own
        assert len(run.cycles) - outside.sum() == counted[0], (n, faults)
        assert_record_is_whole(run, state)
        if run.fault is None:
            assert len(run.cycles) == 85
            assert run.torque_off
        ended["fault" if run.fault else "good"] += 1
    assert min(ended.values()) > 15, ended


# -- limits, caps, rehearsal -------------------------------------------------------------------------------------------


def test_usage_is_one_on_the_line_and_only_there():
    w = np.linspace(0, XM430.no_load_speed, 9)
    line = XM430.stall_torque * (1 - w / XM430.no_load_speed)
    np.testing.assert_allclose(XM430.usage(w, line), 1.0)
    np.testing.assert_allclose(XM430.usage(-w, -line), 1.0)
    np.testing.assert_allclose(XM430.available(w, np.ones(9)), line)
    assert XM430.usage(np.array(-2.0), np.array(4.0)) == pytest.approx(4.0 / 4.1)  # braking
    assert XM430.usage(np.array(6.0), np.array(-0.1)) > 1  # too fast, whatever the torque
    assert limits_preset("xm430") is XM430
    with pytest.raises(InputError, match="xm430"):
        limits_preset("mx28")


def test_the_line_is_where_the_emulated_motor_saturates():
    motor = Motor()
    for v in np.linspace(-4, 4.5, 18):
        most = motor.torque(motor.current(100.0, v), v)
        if v >= 0:
            assert most == pytest.approx(float(XM430.available(np.array(v), np.array(1.0))))
            assert XM430.usage(np.array(v), np.array(most)) == pytest.approx(1.0)


def test_peaks_bound_the_trajectory_and_catch_divergence():
    strikes = wt.default_bounds(MODEL.arm).sample(np.random.default_rng(0), 40)
    controller = Controller(ConstantImpedance())
    near = wt.CompiledRollout(MODEL, controller).approach(strikes, np.array([1.2, 0.1]), t_stay=0.3)
    peaks = XM430.violation_of_peaks(near)
    rollout = wt.CompiledRollout(MODEL, controller)
    for i in range(6):
        path = rollout.trajectory(wt.Strike.from_vector(strikes[i]), t_stay=0.3)
        assert XM430.violation(path) <= peaks[i] + 0.02
    assert np.isinf(XM430.violation_of_peaks(dataclasses.replace(near, diverged=np.ones(40, bool)))).all()


def test_the_tests_strike_hits_and_is_within_the_line():
    r = rehearse(MODEL, Controller(OIAC()), STRIKE)
    assert r.refused is None
    assert 0.5 < r.usage < 0.95
    assert r.trajectory.approach(np.array([1.2, 0.1])).distance[0] < 0.06


def test_a_strike_beyond_the_motors_is_refused_with_the_reason():
    papers = wt.Strike.from_vector([-1.36, 0.47, 1.73, 1.41, 0.95])
    caps = default_caps(MODEL, period=PERIOD)
    r = rehearse(MODEL, Controller(ConstantImpedance()), papers, LoopOptions(delay=0.0, caps=caps))
    assert r.usage > 2
    assert r.refused is not None
    assert "shoulder turns at" in r.refused
    assert "XM430-W350 gives" in r.refused


def test_what_is_stable_in_continuous_time_is_refused_or_capped():
    controller = Controller(oiac_preset("table4"))
    continuous = wt.CompiledRollout(MODEL, controller).approach(STRIKE.vector[None], (1.2, 0.1), t_stay=0.3)
    assert not continuous.diverged[0]
    assert XM430.violation_of_peaks(continuous)[0] < 0
    r = rehearse(MODEL, controller, STRIKE)
    assert r.refused is not None
    assert "unstable at 500 Hz" in r.refused
    caps = default_caps(MODEL, period=PERIOD)
    assert rehearse(MODEL, controller, STRIKE, LoopOptions(delay=0.0, caps=caps)).refused is None
    # and the default caps are not idle caution: a few times as much is unstable
    beyond = LoopOptions(delay=0.0, caps=Caps(6 * caps.K, 2.5 * caps.B))
    assert "unstable" in str(rehearse(MODEL, controller, STRIKE, beyond).refused)


def test_the_loop_refuses_a_strike_before_it_arms(bus, twin):
    papers = wt.Strike.from_vector([-1.36, 0.47, 1.73, 1.41, 0.95])
    options = dataclasses.replace(OPTIONS, rehearse=True, caps=default_caps(MODEL, period=PERIOD, delay=0.001))
    loop = loop_on(twin, bus, options=options, controller=Controller(ConstantImpedance()))
    with pytest.raises(InputError, match=r"strike: got \[-1.36.*XM430-W350 gives"):
        loop.run(papers)
    assert twin.state()["torque_changes"] == []
    loop_on(twin, bus, options=options).check(STRIKE)


def test_a_strike_is_rehearsed_with_the_whip_that_is_believed():
    controller = Controller(OIAC())
    heavy = MODEL.with_parameters({"whip.m": 1.5 * MODEL.whip.m})
    light, believed, other = (
        rehearse(model, controller, STRIKE, **more)
        for model, more in ((MODEL, {}), (MODEL, {"believed": heavy}), (heavy, {}))
    )
    assert believed.usage > light.usage + 0.05
    sags = np.abs(believed.trajectory.q - other.trajectory.q).max()  # the loop compensates the weight it knows of
    assert sags > 0.01


def test_a_diverging_rehearsal_is_a_refusal_not_a_crash():
    """A light whip that hardly bends, and a controller far too stiff for the loop."""
    whip = dataclasses.replace(MODEL.whip, m=MODEL.whip.m / 10)
    wild = Controller(ConstantImpedance(K=((500, 0), (0, 500)), B=((80, 0), (0, 80))))
    r = rehearse(dataclasses.replace(MODEL, whip=whip), wild, STRIKE)
    assert "unstable" in str(r.refused)


def test_a_delay_can_make_a_strike_unstable():
    assert rehearse(MODEL, Controller(OIAC()), STRIKE).refused is None
    r = rehearse(MODEL, Controller(OIAC()), STRIKE, LoopOptions(delay=0.002))
    assert "unstable" in str(r.refused)


def test_capped_loop_is_the_law_below_its_caps_and_bounded_above():
    from whiptool.impedance.arm import Arm

    arm, rng = Arm(MODEL), np.random.default_rng(1)
    for law in (OIAC(), ConstantImpedance()):
        controller = Controller(law)
        plain = controller.bind(arm, STRIKE)
        loose = CappedLoop(controller, arm, STRIKE, Caps(1e9, 1e9))
        tight = CappedLoop(controller, arm, STRIKE, Caps(5.0, 0.5))
        for _ in range(20):
            q, v = rng.normal(0, 1, 2), rng.normal(0, 3, 2)
            np.testing.assert_allclose(loose.torque(0.3, q, v), plain.torque(0.3, q, v), rtol=1e-12)
            q_d, v_d, _ = STRIKE.reference(0.3)
            feedback = tight.torque(0.3, q, v) - arm.gravity_compensation(q)
            assert np.linalg.norm(feedback) <= 5 * np.linalg.norm(q_d - q) + 0.5 * np.linalg.norm(v_d - v) + 1e-9
