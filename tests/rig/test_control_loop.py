"""The loop against the twin: the same path as the plain simulation, on time, on record."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import whiptool as wt
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller
from whiptool.rig.control_loop import RigLoop, StepClock, WallClock, move
from whiptool.rig.cyclelog import Cycles, Flag, Phase
from whiptool.rig.dynamixel import Joints, Units
from whiptool.rig.dynamixel.joints import Guards
from whiptool.rig.emulator import Emulator, Motor, TwinOptions
from whiptool.rig.loop_options import CappedLoop, LoopOptions
from whiptool.rollout.reference import ReferenceRollout

pytest.importorskip("dynamixel_sdk")

PERIOD, FINE = 0.002, 2**14
MODEL = wt.preset("lemon2024")
STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])  # within the XM430's line, hits (1.2, 0.1)
AT_ONCE = LoopOptions(settle=0.0, go_back=False, rehearse=False)


def play(options: TwinOptions, *, loop: LoopOptions = AT_ONCE, path: Path | None = None, controller=None):
    """A strike on a lock-step twin: the run and what arm and whip did."""
    with Emulator(options) as twin, twin.bus() as bus:
        joints = Joints(bus, units=Units(options.fineness))
        rig = RigLoop(joints, MODEL, controller or Controller(OIAC()), options=loop, clock=StepClock())
        return rig.run(STRIKE, path=path), twin.trajectory()


@pytest.fixture(scope="module")
def plain():
    """The plain simulation, sampled as the rig is."""
    rollout = ReferenceRollout(MODEL, Controller(OIAC(), control_period=PERIOD))
    return rollout.trajectory(STRIKE, t_stay=AT_ONCE.t_stay)


def gap(path, plain) -> float:
    """Largest distance of the tips at equal times [m]."""
    tip = np.stack([np.interp(plain.t, path["t"], path["tip"][:, i]) for i in (0, 1)], axis=1)
    return float(np.hypot(*(tip - plain.tip).T).max())


@pytest.mark.slow
def test_twin_is_the_plain_simulation_and_what_opens_the_gap(plain):
    ideal = TwinOptions(start=STRIKE.q_i, fineness=FINE, period=PERIOD)
    friction = dataclasses.replace(Motor(), viscous_friction=0.03, dry_friction=0.08)
    gaps, runs = {}, {}
    for name, options in {
        "none": ideal,
        "quantisation": dataclasses.replace(ideal, fineness=1),
        "latency": dataclasses.replace(ideal, sample_delay=0.001),
        "friction": dataclasses.replace(ideal, motor=friction),
    }.items():
        runs[name], path = play(options)
        assert runs[name].fault is None
        gaps[name] = gap(path, plain)
    print({name: f"{1e3 * x:.3f} mm" for name, x in gaps.items()})
    assert gaps["none"] < 1e-4  # ten times better than asked
    assert gaps["none"] < min(gaps["quantisation"], gaps["latency"], gaps["friction"]) / 5
    assert gaps["quantisation"] < 5e-3
    # what the loop asked for is what the simulation's controller asked for, cycle by cycle
    cycles = runs["none"].cycles
    at_cycles = np.searchsorted(plain.t, cycles.t - 1e-9)
    np.testing.assert_allclose(cycles.tau, plain.tau[at_cycles], atol=2e-3)
    np.testing.assert_allclose(cycles.q, plain.q[at_cycles, :2], atol=1e-4)


def test_a_whole_run_goes_there_waits_strikes_and_comes_back(tmp_path):
    path = tmp_path / "strike.cycles"
    loop = LoopOptions(approach_speed=1.5, settle=1.0, delay=0.0)  # rehearsed
    options = TwinOptions(start=(0.0, 0.0), period=PERIOD, timestep=5e-4, integrator="implicitfast")
    run, truth = play(options, loop=loop, path=path)
    assert run.fault is None
    assert run.torque_off
    cycles = run.cycles
    phases = [Phase(p) for p in dict.fromkeys(cycles.phase.tolist())]
    assert phases == [Phase.APPROACH, Phase.SETTLE, Phase.STRIKE, Phase.RETURN]
    np.testing.assert_allclose(cycles.t, np.arange(len(cycles)) * PERIOD, atol=1e-12)  # not one is missing
    approach, strike, back = (cycles.during(p) for p in (Phase.APPROACH, Phase.STRIKE, Phase.RETURN))
    assert np.abs(np.diff(approach.q_d, axis=0)).max() / PERIOD <= 1.5 * 1.001
    assert len(strike) == round((STRIKE.D + loop.t_stay) / PERIOD)
    np.testing.assert_allclose(strike.q[0], STRIKE.q_i, atol=0.05)
    np.testing.assert_allclose(strike.q[int(STRIKE.D / PERIOD)], STRIKE.q_f, atol=0.25)
    np.testing.assert_allclose(back.q[-1], [0, 0], atol=0.3)  # the whip still swings
    # what it measured is what was there
    q = np.stack([np.interp(cycles.t, truth["t"], truth["q"][:, i]) for i in (0, 1)], axis=1)
    assert np.abs(cycles.q - q).max() <= Units().position / 2 + 1e-6
    # and the file is the same record
    loaded = Cycles.load(path)
    for name in ("t", "q", "goal_current", "flags"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(cycles, name))
    assert loaded.about == {"strike": STRIKE.vector.tolist(), "rate": 500.0}

    from whiptool.rig.struck import build_recording

    recording = build_recording(cycles, MODEL, target=(1.2, 0.1))
    assert recording.strike == STRIKE
    assert recording.joints_t is not None
    assert recording.joints_t[0] == 0
    assert recording.markers == ("elbow", "handle")
    hand = recording.points[0, 1]
    s, e = strike.q[0]
    np.testing.assert_allclose(
        hand, [0.31 * np.sin(s) + 0.34 * np.sin(s + e), -0.31 * np.cos(s) - 0.34 * np.cos(s + e)], atol=1e-9
    )
    seen = build_recording(cycles, MODEL, track=dataclasses.replace(recording, markers=("tip", "handle")))
    assert seen.markers == ("tip", "handle")
    recording.save(tmp_path / "r.npz")
    with pytest.raises(InputError, match="reached its strike"):
        build_recording(approach, MODEL)


class Stalling(StepClock):
    """A clock on which cycle `k` takes `extra` seconds: time jumps before the cycle's end is looked at."""

    def __init__(self, stalls: dict[int, float]) -> None:
        super().__init__()
        self.stalls, self.k = stalls, 0

    def stall(self, k: int, phase: Phase) -> None:
        self._t += self.stalls.get(k, 0.0)


def stalled(stalls: dict[int, float], guards: Guards):
    options = TwinOptions(start=STRIKE.q_i, period=PERIOD, timestep=5e-4, integrator="implicitfast")
    clock = Stalling(stalls)
    with Emulator(options) as twin, twin.bus() as bus:
        rig = RigLoop(Joints(bus), MODEL, Controller(OIAC()), options=AT_ONCE, guards=guards, clock=clock)
        return rig.run(STRIKE, on_cycle=clock.stall)


def test_overruns_are_counted_and_deadlines_stay_absolute():
    run = stalled({50: 0.0031, 51: 0.0, 100: 0.0095}, Guards(stale=1.0))
    assert run.fault is None
    # 3.1 ms end one deadline late; 9.5 ms are nearly five periods
    assert run.overruns == 2
    t = run.cycles.t / PERIOD
    steps = np.diff(np.rint(t))
    assert set(steps) <= {1.0, 4.0, 5.0}  # what is past is not made up for
    assert t[-1] == pytest.approx(round((STRIKE.D + 0.3) / PERIOD) - 1)  # and the end comes when it was due
    late = run.cycles.late
    assert late[:50].max() == 0
    assert np.sort(late)[-3] < PERIOD  # all but the two that stalled


def test_overruns_in_a_row_are_a_fault():
    run = stalled(dict.fromkeys(range(20, 200), 0.0025), Guards(stale=1.0, overruns=5))
    assert run.fault is not None
    assert run.fault.kind == "overrun"
    assert run.torque_off


def test_a_clock_that_jumps_makes_samples_stale():
    run = stalled({60: 0.5}, Guards())
    assert run.fault is not None
    assert run.fault.kind == "stale"
    assert run.torque_off


class Machine:
    """Stands for the module `time`: a look at the clock takes a microsecond, and a sleep lasts a little too long."""

    def __init__(self) -> None:
        self.t = 1000.0

    def monotonic(self) -> float:
        self.t += 1e-6
        return self.t

    def sleep(self, seconds: float) -> None:
        self.t += seconds + 1e-4


def test_wall_clock_loop_keeps_its_rate(monkeypatch):
    monkeypatch.setattr("whiptool.rig.control_loop.time", Machine())
    options = TwinOptions(start=(0.1, 0.1), period=0.01, timestep=5e-4, integrator="implicitfast")
    strike = wt.Strike((0.1, 0.1), (0.3, 0.2), 0.5)
    with Emulator(options) as twin, twin.bus() as bus:
        loop = LoopOptions(rate=100, settle=0.0, go_back=False, t_stay=0.1, rehearse=False)
        run = RigLoop(Joints(bus), MODEL, Controller(OIAC()), options=loop, clock=WallClock()).run(strike)
    assert run.fault is None
    assert run.torque_off
    assert run.overruns == 0
    strike_cycles = run.cycles.during(Phase.STRIKE)
    assert strike_cycles.t[-1] - strike_cycles.t[0] == pytest.approx(0.59)
    np.testing.assert_allclose(np.diff(run.cycles.stamp), 0.01, atol=1e-5)
    assert (run.cycles.late >= 0).all()
    assert run.cycles.late.max() < 1e-5


def test_saturated_cycles_are_flagged():
    from whiptool.rig.safety import Safety

    options = TwinOptions(start=STRIKE.q_i, period=PERIOD, timestep=5e-4, integrator="implicitfast")
    with Emulator(options) as twin, twin.bus() as bus:
        joints = Joints(bus)
        safety = Safety(joints, current=0.6)  # 1.07 N m; the strike asks for 1.3
        loop = RigLoop(joints, MODEL, Controller(OIAC()), options=AT_ONCE, safety=safety, clock=StepClock())
        run = loop.run(STRIKE)
    cut = run.cycles.flags & Flag.SATURATED > 0
    most = int(0.6 / 2.69e-3) * 2.69e-3
    assert cut.any()
    assert np.abs(run.cycles.goal_current).max() == pytest.approx(most)
    np.testing.assert_array_equal(cut, (np.abs(run.cycles.tau) > most * 4.1 / 2.3 + 0.005).any(axis=1))


def test_move_keeps_its_speed():
    path = move(np.array([0.0, 1.0]), np.array([0.9, 0.2]), 0.5)
    speed = np.abs(path.reference(np.linspace(0, path.D, 2001))[1]).max()
    assert speed == pytest.approx(0.5, rel=1e-4)


def test_loop_refuses_what_does_not_fit():
    options = TwinOptions(timestep=5e-4, integrator="implicitfast")
    with (
        Emulator(options) as twin,
        twin.bus(ids=[1]) as bus,
        pytest.raises(InputError, match="servos: got 1"),
    ):
        RigLoop(Joints(bus), MODEL, Controller(OIAC()))


def test_reference_of_the_loop_is_the_strikes():
    from whiptool.impedance.arm import Arm

    loop = CappedLoop(Controller(OIAC()), Arm(MODEL), STRIKE, None)
    np.testing.assert_allclose(
        loop.torque(0.0, np.array(STRIKE.q_i), np.zeros(2)), loop.arm.gravity_compensation(np.array(STRIKE.q_i))
    )


pytest.importorskip("dynamixel_sdk")


def test_clocks_do_not_go_back():
    clock = StepClock()
    clock.sleep_until(1.0)
    clock.sleep_until(0.5)
    assert clock.now() == 1.0
    wall = WallClock()
    start = wall.now()
    wall.sleep_until(start + 0.01)
    assert wall.now() - start >= 0.01
