"""Joints of the arm in SI units."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import whiptool as wt
from whiptool.commands import servos as command
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller
from whiptool.limits.arm_limits import XM430
from whiptool.rig.control_loop import RigLoop, StepClock
from whiptool.rig.dynamixel import Joints, Units
from whiptool.rig.dynamixel.joints import ASSUMED, Guards, JointSample, Watch, check_registers, mismatches
from whiptool.rig.emulator import Fault
from whiptool.rig.loop_options import LoopOptions
from whiptool.rig.stops import SafetyError


def test_joints_are_in_si_units(bus):
    joints = Joints(bus, zero=[2048, 2000], direction=[1, -1])
    sample = joints.read()
    np.testing.assert_allclose(sample.q, [0.3, -(0.5 + 48 * Units().position)], atol=Units().position)
    np.testing.assert_array_equal(joints.counts(np.array([1.0, 1.0])), np.array([1, -1]) * round(2.3 / 4.1 / 2.69e-3))
    np.testing.assert_allclose(joints.torque(joints.counts(np.array([2.0, -3.0]))), [2.0, -3.0], atol=0.005)
    joints.current_limit = 100
    assert np.abs(joints.counts(np.array([9.0, -9.0]))).max() == 100
    with pytest.raises(InputError, match="direction"):
        Joints(bus, direction=[1, 2])


@pytest.mark.parametrize("sign", [1, -1])
def test_the_back_emf_tells_the_speed_of_a_motor_whose_encoder_stopped(bus, twin, sign):
    """The arm falls without current, and its motors' voltage is that of a generator."""
    joints = Joints(bus, direction=[sign, sign])
    twin.reset((1.5, 0.5))
    bus.prepare_block()
    bus.write_all("operating_mode", 0)
    bus.write_all("torque_enable", 1)
    np.testing.assert_array_equal(joints.read().emf, [0.0, 0.0])
    for k in range(60):
        if k == 40:
            fallen = joints.read()
            twin.inject(Fault("stuck", servo=0))
        bus.write_currents([0, 0])
    stopped, v = joints.read(), twin.state()["v"][:2]
    assert stopped.v[0] == 0
    assert abs(v[0]) > 1.0
    np.testing.assert_allclose(stopped.emf, sign * np.sign(v) * np.maximum(0, np.abs(v) - 0.4), atol=0.02)
    np.testing.assert_allclose(fallen.emf, np.sign(fallen.v) * np.maximum(0, np.abs(fallen.v) - 0.4), atol=0.02)
    bus.write_currents([300, 0])  # its voltage drop is a third of the supply's, of which a quarter is not believed
    more = joints.read()
    drop = XM430.no_load_speed * more.current[0] / XM430.stall_current
    exact = twin.state()["v"][0] * sign
    assert more.emf[0] == pytest.approx(np.sign(exact) * max(0, abs(exact) - 0.4 - abs(drop) / 4), abs=0.03)


pytest.importorskip("dynamixel_sdk")

WRONG = {
    "drive_mode": 1,
    "homing_offset": 1024,
    "pwm_limit": 400,
    "secondary_id": 1,
    "shutdown": 0,
    "status_return_level": 1,
    "startup_configuration": 1,
}


def test_each_register_has_a_wrong_value_here():
    assert set(WRONG) == {assumed.name for assumed in ASSUMED}


@pytest.mark.parametrize("name", WRONG)
def test_a_servo_that_is_set_up_otherwise_is_refused_with_the_cure(bus, twin, name, tmp_path, capsys):
    """A homing offset of 1024 struck 90 degrees off."""
    check_registers(bus)
    bus.write(2, name, WRONG[name])
    model, options = wt.preset("lemon2024"), LoopOptions(settle=0.0, go_back=False, rehearse=False)
    loop = RigLoop(Joints(bus), model, Controller(OIAC()), options=options, clock=StepClock())
    with pytest.raises(InputError) as refused:
        loop.run(wt.Strike((0.3, 0.5), (0.3, 0.5), 0.1), path=tmp_path / "cycles.log")
    said = str(refused.value)
    assert said.startswith(f"servo 2: {name}: got {WRONG[name]}; allowed: ")
    assert f"--port {twin.port} --baud 1000000 --ids 2 --for-strikes" in said
    assert "\n" not in said
    assert twin.state()["torque_changes"] == []
    assert not (tmp_path / "cycles.log").exists()
    bus.close()
    assert command.main(["--port", twin.port, "--ids", "2", "--for-strikes"]) == 0
    assert f"{name} is {WRONG[name]}, strikes assume" in capsys.readouterr().out
    with twin.bus() as again:
        assert mismatches(again, 2) == []


def test_registers_that_older_firmware_lacks_are_not_asked_for(bus, monkeypatch):
    read, asked = bus.read, []

    def old(id: int, name: str) -> int:
        asked.append(name)
        return 41 if name == "firmware_version" else read(id, name)

    monkeypatch.setattr(bus, "read", old)
    assert mismatches(bus, 1) == []
    assert "startup_configuration" not in asked
    assert "shutdown" in asked


def test_the_voltage_limit_of_current_mode_is_set_anew(bus, twin):
    """A client before us may have left a low Goal PWM, which caps the motor in current mode."""
    from whiptool.rig.safety import Safety

    for id in (1, 2):
        bus.write(id, "operating_mode", 0)
        bus.write(id, "goal_pwm", 100)
    safety = Safety(Joints(bus))
    safety.arm()
    assert [bus.read(id, "goal_pwm") for id in (1, 2)] == [885, 885]
    safety.disarm()


GOOD = JointSample(
    q=np.zeros(2),
    v=np.zeros(2),
    current=np.zeros(2),
    voltage=np.full(2, 12.0),
    temperature=np.full(2, 30.0),
    hardware_error=np.zeros(2, int),
    torque_on=np.ones(2, int),
    watchdog=np.full(2, 3),
    tick=np.zeros(2, int),
)
LIMITS = Guards(
    low=(-1.0, -2.0), high=(1.5, 2.5), speed=3.0, current=2.0, temperature=70.0, voltage=9.5, tracking=0.5, frozen=99.0
)


def look(q_d=None, guards: Guards = LIMITS, **change) -> SafetyError | None:
    sample = dataclasses.replace(GOOD, **{name: np.array(x) for name, x in change.items()})
    return Watch(guards, 2).sample(0.0, sample, sample.q if q_d is None else np.array(q_d))


@pytest.mark.parametrize(
    ("kind", "within", "beyond"),
    [
        ("position", {"q": [1.5, 0.0]}, {"q": [1.51, 0.0]}),
        ("position", {"q": [-1.0, 0.0]}, {"q": [-1.01, 0.0]}),
        ("position", {"q": [0.0, 2.5]}, {"q": [0.0, 2.51]}),
        ("position", {"q": [0.0, -2.0]}, {"q": [0.0, -2.01]}),
        ("speed", {"v": [3.0, -3.0]}, {"v": [0.0, -3.01]}),
        ("speed", {"v": [3.0, -3.0]}, {"v": [3.01, 0.0]}),
        ("current", {"current": [2.0, -2.0]}, {"current": [-2.01, 0.0]}),
        ("current", {"current": [2.0, -2.0]}, {"current": [0.0, 2.01]}),
        ("temperature", {"temperature": [70.0, 70.0]}, {"temperature": [30.0, 70.1]}),
        ("voltage", {"voltage": [9.5, 9.5]}, {"voltage": [9.4, 12.0]}),
        ("tracking", {"q_d": [0.5, -0.5]}, {"q_d": [0.0, 0.51]}),
        ("tracking", {"q_d": [0.5, -0.5]}, {"q_d": [-0.51, 0.0]}),
        ("hardware", {}, {"hardware_error": [0, 32]}),
        ("watchdog", {"watchdog": [0, 1]}, {"watchdog": [3, -1]}),
        ("torque", {}, {"torque_on": [0, 1]}),
        ("temperature", {}, {"temperature": [np.nan, 30.0]}),  # what is not a number is not within
        ("tracking", {}, {"q_d": [0.0, np.nan]}),
    ],
)
def test_a_guard_stands_exactly_at_its_limit(kind, within, beyond):
    assert look(**within) is None
    found = look(**beyond)
    assert found is not None
    assert found.kind == kind
    assert str(found).startswith(f"{found.kind}: ")


def test_the_gravest_fault_is_named_first():
    faults = {
        "hardware": {"hardware_error": [0, 32]},
        "watchdog": {"watchdog": [3, -1]},
        "torque": {"torque_on": [1, 0]},
        "position": {"q": [0.0, 9.0]},
        "speed": {"v": [0.0, 9.0]},
        "current": {"current": [0.0, 9.0]},
        "temperature": {"temperature": [30.0, 90.0]},
        "voltage": {"voltage": [12.0, 1.0]},
        "tracking": {"q_d": [0.0, 0.9]},
    }
    kinds = list(faults)
    for first in range(len(kinds)):
        together: dict = {}
        for kind in kinds[first:]:
            together |= faults[kind]
        found = look(**together)
        assert found is not None
        assert found.kind == kinds[first]
        assert "joint 1" in str(found) or kinds[first] in ("watchdog", "torque")


def test_the_value_that_broke_it_is_told():
    assert str(look(v=[0.0, -3.2])) == "speed: joint 1: -3.2"
    assert str(look(q_d=[0.75, 0.0])) == "tracking: joint 0: 0.75"


def clocked(watch: Watch, t: float, ticks: float) -> SafetyError | None:
    return watch.sample(t, dataclasses.replace(GOOD, tick=np.full(2, round(ticks) % 32_768)), np.zeros(2))


@pytest.mark.parametrize("start", [0, 32_767])
@pytest.mark.parametrize(("seconds", "ticks", "stale"), [
    (0.010, 10, False), (0.019, 10, False), (0.021, 10, True), (0.010, 19, False), (0.010, 21, True), (0.5, 500, False)
])  # fmt: skip
def test_clocks_of_servos_and_loop_may_differ_by_ten_milliseconds(start, seconds, ticks, stale):
    watch = Watch(LIMITS, 2)
    assert clocked(watch, 3.0, start) is None
    found = clocked(watch, 3.0 + seconds, start + ticks)
    assert (found is not None) is stale
    if found is not None:
        assert found.kind == "stale"
        assert str(found).endswith(f"differ by {abs(seconds - ticks / 1000):.3f} s")


def test_one_clock_is_enough_to_be_stale():
    watch = Watch(LIMITS, 2)
    assert clocked(watch, 0.0, 0) is None
    found = watch.sample(0.010, dataclasses.replace(GOOD, tick=np.array([10, 21])), np.zeros(2))
    assert found is not None
    assert str(found) == "stale: the servos' clocks and the loop's differ by 0.011 s"


def test_clocks_are_compared_between_neighbouring_samples():
    watch = Watch(LIMITS, 2)
    for k in range(50):  # 2 ms of drift each: never 10 ms between two
        assert clocked(watch, 0.010 * k, 12 * k) is None


def test_an_encoder_that_stands_still_is_seen_when_the_reference_has_moved_on():
    guards = dataclasses.replace(LIMITS, frozen=0.2, tracking=9.0, jump=9.0)
    watch = Watch(guards, 2)

    def at(q, q_d):
        return watch.sample(0.0, dataclasses.replace(GOOD, q=np.array(q)), np.array(q_d))

    assert at([0.1, 0.0], [0.1, 0.0]) is None
    assert at([0.1, 0.1], [0.3, 0.1]) is None  # 0.2: within
    assert at([0.11, 0.2], [0.5, 0.2]) is None  # it has moved
    assert at([0.11, 0.3], [0.69, 0.3]) is None
    found = at([0.11, 0.4], [0.71, 0.4])
    assert found is not None
    assert found.kind == "frozen"
    assert "joint 0" in str(found)
    watch = Watch(guards, 2)
    at([0.0, 0.0], [0.0, 0.0])
    found = at([0.1, 0.0], [0.0, -0.21])
    assert found is not None
    assert "joint 1" in str(found)


def test_misses_and_overruns_count_in_a_row():
    watch = Watch(Guards(missed=2, overruns=3), 2)
    assert watch.missed() is None
    assert watch.sample(0, GOOD, np.zeros(2)) is None
    assert watch.missed() is None
    found = watch.missed()
    assert found is not None
    assert str(found) == "missed: no sample in 2 cycles in a row"
    late = [watch.timing(x) for x in (True, True, False, True, True, True)]
    assert [x is None for x in late] == [True] * 5 + [False]
    assert str(late[-1]) == "overrun: 3 cycles in a row ended too late"


def test_defaults_and_rules():
    g = Guards()
    assert g.speed == pytest.approx(1.25 * XM430.no_load_speed)
    assert (g.low, g.high, g.current, g.temperature, g.voltage) == (-3.5, 4.5, 2.6, 70.0, 9.5)
    assert (g.tracking, g.stale, g.frozen, g.missed, g.overruns) == (1.2, 0.01, 0.3, 3, 5)
    assert (g.jump, g.push) == (0.01, 1.5)
    for bad in (
        *({name: 0.0} for name in ("speed", "current", "temperature", "tracking", "stale", "frozen", "jump", "push")),
        {"low": (0.0, 1.0), "high": (1.0, 1.0)}, {"low": 5.0}, {"missed": 0}, {"overruns": 0},
    ):  # fmt: skip
        with pytest.raises(InputError):
            Guards(**bad)
    Guards(missed=1, overruns=1)
