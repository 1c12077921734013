"""The rig's loop against the emulator process: cycles per second, missed deadlines, time from a fault to torque off.

`python benchmarks/rig.py [--quick] [--json]`. Unpaced: the whole cycle (sync read, guards, controller with Pinocchio's
gravity, sync write, record) as fast as it goes against an emulator that runs with the wall clock. Paced: at 500 Hz.
Fault to torque off: lock-step, in simulated time, from the fault to the last instant at which a motor was asked for
current; where the line itself is gone, that is the servos' bus watchdog (60 ms). There a cycle without a sample lasts
no longer than another; on a line it lasts until the reply is given up. So one dead servo is measured with the wall
clock, too: from its death to the last current that was asked of the other one.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import platform
import time

import numpy as np

import whiptool as wt
from whiptool.impedance import OIAC, Controller
from whiptool.rig.control_loop import Clock, RigLoop, StepClock, WallClock
from whiptool.rig.cyclelog import Phase
from whiptool.rig.dynamixel import DynamixelBus, Joints, Units
from whiptool.rig.dynamixel.joints import Guards
from whiptool.rig.emulator import Emulator, Fault, Motor, TwinOptions
from whiptool.rig.loop_options import LoopOptions
from whiptool.rig.safety import Safety
from whiptool.rollout.reference import ReferenceRollout

MODEL = wt.preset("lemon2024")
STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])
COARSE = TwinOptions(timestep=5e-4, integrator="implicitfast", start=STRIKE.q_i)  # 2 mm at the tip; fast
IDLE = Guards(
    stale=10.0,
    overruns=10**9,
    missed=10**9,
    low=-99,
    high=99,
    speed=99,
    tracking=99,
    current=99,
    frozen=99,
    jump=99,
    push=99,
)


class Unpaced(StepClock):
    """Deadlines that are always now, so that nothing waits; the stamps are real."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        return


def rig_on(bus: DynamixelBus, options: LoopOptions, clock: Clock) -> RigLoop:
    """A loop whose guards do not end it; a servo's watchdog does, where this machine stalls for a tenth of a second."""
    joints = Joints(bus)
    safety = Safety(joints, watchdog=0.1)
    return RigLoop(joints, MODEL, Controller(OIAC()), options=options, guards=IDLE, clock=clock, safety=safety)


def unpaced(seconds: float) -> dict[str, float]:
    """Cycles per second of the whole loop, and of the line alone (read and write, nothing else)."""
    with Emulator(dataclasses.replace(COARSE, lockstep=False)) as twin:
        loop, stamps = LoopOptions(rate=10_000, settle=0, go_back=False, rehearse=False, t_stay=0), np.zeros(0)
        while len(stamps) < 2:  # a stall may end a run as it begins
            twin.reset(STRIKE.q_i)
            with DynamixelBus(twin.port, [1, 2], timeout=1.0) as bus:
                run = rig_on(bus, loop, Unpaced()).run(wt.Strike(STRIKE.q_i, STRIKE.q_i, seconds))
            stamps = run.cycles.stamp
        whole = (len(stamps) - 1) / (stamps[-1] - stamps[0])
        twin.reset(STRIKE.q_i)
        with DynamixelBus(twin.port, [1, 2], timeout=1.0) as bus:
            bus.prepare_block()
            start, n = time.monotonic(), 0
            while time.monotonic() - start < min(seconds, 1.0):
                bus.read_block()
                bus.write_currents([0, 0])
                n += 1
            alone = n / (time.monotonic() - start)
    return {"cycles_per_second": whole, "line_cycles_per_second": alone, "unpaced_stalled": int(run.fault is not None)}


def paced(strikes: int) -> dict[str, float]:
    """Share of deadlines missed at 500 Hz, how late cycles began [us], strikes ended by a stall of this machine."""
    late, cycles, overruns, missed, stalled = [], 0, 0, 0, 0
    with Emulator(dataclasses.replace(COARSE, lockstep=False)) as twin:
        for _ in range(strikes):
            twin.reset(STRIKE.q_i)
            with DynamixelBus(twin.port, [1, 2], timeout=0.05) as bus:
                loop = LoopOptions(settle=0, go_back=False, rehearse=False)
                run = rig_on(bus, loop, WallClock()).run(STRIKE)
            late.append(run.cycles.late)
            cycles, overruns, missed = cycles + len(run.cycles), overruns + run.overruns, missed + run.missed
            stalled += run.fault is not None
    all_late = np.concatenate(late) * 1e6
    return {
        "missed_deadlines_500Hz": overruns / cycles,
        "missed_samples_500Hz": missed / cycles,
        "late_median_us": float(np.median(all_late)),
        "late_99_us": float(np.percentile(all_late, 99)),
        "paced_cycles": cycles,
        "paced_stalled": stalled,
    }


def detection() -> dict[str, float]:
    """Simulated time from each fault to the last current asked for [ms]."""
    at, times = 0.2, {}
    cases = {
        kind: Fault(kind, at=at, count=10**6, servo=1)
        for kind in (
            "drop",
            "corrupt",
            "late",
            "lose",
            "unplug",
            "dead",
            "hot",
            "alert",
            "stuck",
            "flicker",
            "jump",
            "sag",
            "reboot",
            "same_id",
        )
    }
    with Emulator(COARSE) as twin:
        for kind, fault in cases.items():
            twin.reset(STRIKE.q_i)
            with twin.bus(timeout=0.02) as bus:
                twin.inject(fault)
                loop = LoopOptions(settle=0, go_back=False, rehearse=False)
                rig = RigLoop(Joints(bus), MODEL, Controller(OIAC()), options=loop, clock=StepClock())
                run = rig.run(STRIKE)
                assert run.fault is not None, kind
            twin.advance(0.12)
            times[kind] = round(1e3 * (twin.state()["last_driven"] - at), 2)
    return times


def one_dead(strikes: int) -> dict[str, list[float]]:
    """Wall-clock time from the death of each servo to the last current asked of the other [ms], in rising order."""
    times = {}
    with Emulator(dataclasses.replace(COARSE, lockstep=False)) as twin:
        for servo in (0, 1):
            found: list[float] = []
            for _ in range(5 * strikes):  # a busy machine stalls in some, and then the other guards end them
                if len(found) == strikes:
                    break
                twin.reset(STRIKE.q_i)
                died: list[float] = []

                def die(k: int, phase: Phase, servo: int = servo, died: list[float] = died) -> None:
                    if k == 100:
                        twin.inject(Fault("dead", servo=servo))
                        died.append(twin.state()["t"])

                with DynamixelBus(twin.port, [1, 2]) as bus:
                    loop, joints = LoopOptions(settle=0, go_back=False, rehearse=False), Joints(bus)
                    safety = Safety(joints, watchdog=0.1)
                    rig = RigLoop(joints, MODEL, Controller(OIAC()), options=loop, safety=safety)
                    run = rig.run(STRIKE, on_cycle=die)
                if run.fault is not None and run.fault.kind == "missed" and died:  # else this machine stalled
                    found.append(round(1e3 * (twin.state()["last_driven"] - died[0]), 1))
            times[f"servo {servo + 1}"] = sorted(found)
    return times


def gaps() -> dict[str, float]:
    """Largest distance between the tips of twin and plain simulation at equal times [mm]."""
    plain = ReferenceRollout(MODEL, Controller(OIAC(), control_period=0.002)).trajectory(STRIKE, t_stay=0.3)
    ideal = TwinOptions(start=STRIKE.q_i, fineness=2**14)
    rough = dataclasses.replace(Motor(), viscous_friction=0.03, dry_friction=0.08)
    cases = {
        "none": ideal,
        "quantisation": dataclasses.replace(ideal, fineness=1),
        "latency 0.5 ms": dataclasses.replace(ideal, sample_delay=0.0005),
        "latency 1 ms": dataclasses.replace(ideal, sample_delay=0.001),
        "friction 0.08 N m + 0.03 N m s/rad": dataclasses.replace(ideal, motor=rough),
        "rotor inertia 0.008 kg m2": dataclasses.replace(ideal, motor=dataclasses.replace(Motor(), inertia=0.008)),
        "all of them": dataclasses.replace(
            ideal, fineness=1, sample_delay=0.001, motor=dataclasses.replace(rough, inertia=0.008)
        ),
    }
    found = {}
    for name, options in cases.items():
        with Emulator(options) as twin, twin.bus() as bus:
            loop = LoopOptions(settle=0, go_back=False, rehearse=False)
            joints = Joints(bus, units=Units(options.fineness))
            run = RigLoop(joints, MODEL, Controller(OIAC()), options=loop, clock=StepClock()).run(STRIKE)
            path = twin.trajectory()
        tip = np.stack([np.interp(plain.t, path["t"], path["tip"][:, i]) for i in (0, 1)], axis=1)
        found[name] = round(1e3 * float(np.hypot(*(tip - plain.tip).T).max()), 3) if run.fault is None else float("nan")
    return found


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    result = {
        **{name: round(value, 1) for name, value in unpaced(0.5 if args.quick else 5.0).items()},
        **paced(1 if args.quick else 20),
        "detection_ms": detection(),
        "one_dead_servo_ms": one_dead(2 if args.quick else 20),
        "python": platform.python_version(),
    }
    if not args.quick:
        result["gap_mm"] = gaps()
    if args.json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        if isinstance(value, dict):
            print(f"{name}:")
            for key, x in value.items():
                shown = f"{x:10.3f}" if isinstance(x, float) else ", ".join(f"{y:g}" for y in x)
                print(f"  {key:36s} {shown}")
        else:
            print(f"{name:26s} {value if isinstance(value, str) else f'{value:.5g}'}")


if __name__ == "__main__":
    main()
