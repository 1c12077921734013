"""Strikes on the lock-step twin with random faults: never a torque command after a fault, never a lost record.

`python benchmarks/rig_faults.py [--strikes 10000] [--encoders 1000] [--seed 0] [--quick] [--json]`. Every strike gets
up to three faults of random kind, time, servo and duration; shortened strikes, real physics. Counted as a violation: a
Goal Current other than zero written after the fault's cycle; a motor still asked for current after the longest
watchdog; a record whose cycles are not all there; a run without a fault that is cut short; a fault of an encoder in a
strike without one.

With `--encoders`, so many strikes get a fault of a random encoder at a random cycle. Random strikes of the default
bounds, half of them with the friction of real servos, are each made nine times: without a fault, and twice with an
encoder that jumps by 0.05 to 3 rad for a cycle, jumps so for good, stops, or stops and flickers by a count. A reading
is wrong from the first cycle in which it differs from the true position by more than three counts; cycles are counted
from there to the fault. `slow` are encoders that stop while their joint is slower than 0.6 rad/s, which looks like a
joint that comes to rest.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np

import whiptool as wt
from whiptool.impedance import OIAC, Controller, oiac_preset
from whiptool.models import default_bounds
from whiptool.rig.control_loop import RigLoop, StepClock
from whiptool.rig.cyclelog import Flag
from whiptool.rig.dynamixel import Joints
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.dynamixel.encoders import MOVES
from whiptool.rig.emulator import HARDWARE, Emulator, Fault, Motor, TwinOptions, random_faults
from whiptool.rig.emulator.server import Server
from whiptool.rig.loop_options import LoopOptions

PERIOD, CYCLES = 0.002, 85
STRIKE = wt.Strike((-0.3, 0.2), (0.0, 0.5), 0.15)
OPTIONS = LoopOptions(settle=0.0, go_back=False, rehearse=False, t_stay=0.02)
AT_ONCE = LoopOptions(settle=0.0, go_back=False, rehearse=False, t_stay=0.1)
WRONG = 3.01 * 2 * np.pi / 4096  # [rad]
ENCODERS = ("jump for a cycle", "jump for good", "stop", "flicker")


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


class TwinHere:
    """A lock-step twin in this process, so that no strike waits for two processes to take turns."""

    def __init__(self, options: TwinOptions) -> None:
        self.server = Server(options, control=object())

    def bus(self) -> DynamixelBus:
        """A bus whose instructions are answered at once."""
        bus = DynamixelBus(self.server.port, self.server.options.ids)
        write = bus._port.writePort

        def answered(packet: list[int]) -> int:
            sent = write(packet)
            self.server._take()
            return sent

        bus._port.writePort = answered
        bus.follow(self)
        return bus

    def follow(self, client) -> None:
        """Count a client's bytes."""
        self.server._count()
        client.sent = client.received = 0

    def given(self) -> int:
        """Number of bytes that it has written."""
        return self.server._given


def encoder_fault(rng: np.random.Generator, kind: str) -> Fault:
    """A random fault of an encoder, which happens when it is injected."""
    servo, angle = int(rng.integers(2)), float(rng.uniform(0.05, 3) * rng.choice([-1, 1]))
    if kind.startswith("jump"):
        return Fault("jump", servo=servo, angle=angle, lasting=PERIOD if kind.endswith("cycle") else None)
    return Fault("stuck" if kind == "stop" else "flicker", servo=servo)


def strike_of(twin: TwinHere, model, x: np.ndarray, n: int, begins: int, fault: Fault | None) -> dict:
    """Make a strike whose encoder has a fault from cycle `begins` on; what came of it."""
    strike, first = wt.Strike.from_vector(x), []
    server = twin.server
    server._reset(strike.q_i)

    def on_cycle(k, phase) -> None:
        if not first:
            first.append(server.t)
        if k == begins and fault is not None:
            server._add(replace(fault, at=server.t))

    with twin.bus() as line:
        law = oiac_preset("table4") if n % 4 == 0 else OIAC()
        rig = RigLoop(Joints(line), model, Controller(law), options=AT_ONCE, clock=StepClock())
        run = rig.run(strike, on_cycle=on_cycle)
    cycles, true = run.cycles, server.physics.trajectory()
    kind = "good" if run.fault is None else run.fault.kind
    found = {"end": kind, "cycles": len(cycles)}
    if fault is not None and len(cycles) > begins:
        i, t = fault.servo, first[0] + cycles.t
        q = np.interp(t, true["t"], true["q"][:, i])
        off = np.abs(q - cycles.q[:, i])[begins:]
        speed = abs(float(np.interp(t[begins], true["t"], true["v"][:, i])))
        wrong = np.flatnonzero(off > WRONG)
        found |= {"slow": speed <= MOVES, "off": float(off.max()), "servo": i, "speed": speed}
        found |= {"after": None if not len(wrong) else len(off) - 1 - int(wrong[0])}
    return found


def encoder_study(strikes: int, rng: np.random.Generator, model, said: bool) -> dict:
    """How soon faults of encoders are found, and what strikes without one end in."""
    box, found, free = default_bounds(model).box, [], Counter()
    motors = (HARDWARE, Motor())
    physics = [TwinOptions(motor=m, timestep=5e-4, integrator="implicitfast", period=PERIOD) for m in motors]
    twins, n = [TwinHere(options) for options in physics], 0
    while len(found) < strikes:
        n, twin, x = n + 1, twins[n % 2], rng.uniform(*box)
        whole = strike_of(twin, model, x, n, 0, None)
        free[whole["end"]] += 1
        if whole["end"] != "good":
            continue  # other guards end it
        for kind in 2 * ENCODERS:
            begins, fault = int(rng.integers(10, whole["cycles"] - 10)), encoder_fault(rng, kind)
            found.append({"kind": kind} | strike_of(twin, model, x, n, begins, fault))
        if said:
            print(json.dumps(table(found) | {"free": dict(free)}), file=sys.stderr, flush=True)
    return table(found) | {"without_fault": dict(free.most_common()), "false_alarms": free["encoder"]}


def table(found: list[dict]) -> dict:
    """The strikes by kind of fault: how many, how many found within two cycles, cycles until found, how far off."""
    rows = {}
    for slow in (False, True):
        for kind in ENCODERS:
            of = [x for x in found if x["kind"] == kind and (x["slow"] and not kind.startswith("jump")) == slow]
            wrong = [x for x in of if x["after"] is not None]
            ended = [x for x in wrong if x["end"] != "good"]
            if of:
                rows[kind + (", slow" if slow else "")] = {
                    "strikes": len(of),
                    "wrong": len(wrong),
                    "found": len(ended),
                    "within_two_cycles": sum(x["after"] <= 2 for x in ended),
                    "cycles": np.quantile([x["after"] for x in ended] or [0], [0, 0.5, 0.95, 1]).round(1).tolist(),
                    "off_rad": round(max(x["off"] for x in of), 3),
                    "ends": dict(Counter(x["end"] for x in of)),
                }
    return rows


def main() -> int:
    """Print how the strikes ended; the exit status is 1 if there was a violation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strikes", type=int, default=10_000)
    parser.add_argument("--encoders", type=int, default=1000)
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
    }
    encoders = encoder_study(4 if args.quick else args.encoders, rng, model, not args.json)
    violations["false alarm"] += encoders["false_alarms"]
    result |= {"encoders": encoders, "violations": sum(violations.values())}
    result["seconds"] = round(time.monotonic() - start, 1)
    print(json.dumps(result) if args.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 1 if result["violations"] else 0


if __name__ == "__main__":
    sys.exit(main())
