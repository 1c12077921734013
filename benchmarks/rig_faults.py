"""Strikes on the lock-step twin with random faults: never a torque command after a fault, never a lost record.

`python benchmarks/rig_faults.py [--strikes 10000] [--seed 0] [--quick] [--json]`. Every strike gets up to three faults
of random kind, time, servo and duration; shortened strikes, real physics. Counted as a violation: a Goal Current other
than zero written after the fault's cycle; a motor still asked for current after the longest watchdog; a record whose
cycles are not all there; a run without a fault that is cut short.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter

import numpy as np

import whiptool as wt
from whiptool.impedance import OIAC, Controller
from whiptool.rig.control_loop import RigLoop, StepClock
from whiptool.rig.cyclelog import Flag
from whiptool.rig.dynamixel import Joints
from whiptool.rig.emulator import Emulator, TwinOptions, random_faults
from whiptool.rig.loop_options import LoopOptions

PERIOD, CYCLES = 0.002, 85
STRIKE = wt.Strike((-0.3, 0.2), (0.0, 0.5), 0.15)
OPTIONS = LoopOptions(settle=0.0, go_back=False, rehearse=False, t_stay=0.02)


def strike_once(twin: Emulator, rng: np.random.Generator, model, n: int) -> tuple[str, list[str]]:
    """How a strike ended, and what was wrong with that."""
    twin.reset(STRIKE.q_i)
    counted = 0

    def count(k, phase) -> None:
        nonlocal counted
        counted = k + 1

    with twin.bus(timeout=0.006, fast=bool(n % 2)) as bus:
        twin.inject(*random_faults(rng, duration=CYCLES * PERIOD, servos=2))
        rig = RigLoop(Joints(bus), model, Controller(OIAC()), options=OPTIONS, clock=StepClock())
        run = rig.run(STRIKE, on_cycle=count)
    twin.advance(0.12)
    state, cycles, wrong = twin.state(), run.cycles, []
    end = cycles.t[-1] if len(cycles) else 0.0
    if run.fault is not None and any(goal for t, goal in state["goal_writes"] if t >= end - 1e-9):
        wrong.append("torque after fault")
    if any(goal for goal, on in zip(state["goal_current"], state["torque_on"], strict=True) if on):
        wrong.append("still driven")
    outside = int((cycles.flags & Flag.OUTSIDE > 0).sum())  # a fault while arming or disarming has a separate row
    if len(cycles) - outside != counted or not np.allclose(cycles.t, np.arange(len(cycles)) * PERIOD):
        wrong.append("lost record")
    if run.fault is None and len(cycles) != CYCLES:
        wrong.append("cut short")
    if run.fault is not None and not (len(cycles) and cycles.flags[-1] & Flag.FAULT):
        wrong.append("fault not on record")
    return ("good" if run.fault is None else run.fault.kind), wrong


def main() -> int:
    """Print how the strikes ended; the exit status is 1 if there was a violation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strikes", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    strikes = 30 if args.quick else args.strikes
    rng, model = np.random.default_rng(args.seed), wt.preset("lemon2024")
    ends, violations, start = Counter(), Counter(), time.monotonic()
    with Emulator(TwinOptions(timestep=5e-4, integrator="implicitfast", period=PERIOD)) as twin:
        for n in range(strikes):
            end, wrong = strike_once(twin, rng, model, n)
            ends[end] += 1
            violations.update(wrong)
            if wrong or (not args.json and n % 500 == 499):
                print(f"{n + 1} strikes, {sum(violations.values())} violations {wrong or ''}", file=sys.stderr)
    result = {
        "strikes": strikes,
        "violations": sum(violations.values()),
        "kinds_of_violation": dict(violations),
        "ends": dict(ends.most_common()),
        "seconds": round(time.monotonic() - start, 1),
    }
    print(json.dumps(result) if args.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 1 if violations else 0


if __name__ == "__main__":
    sys.exit(main())
