"""Strikes on the lock-step twin with random faults: never a torque command after a fault, never a lost record.

`python benchmarks/rig_faults.py [--strikes 10000] [--encoders 1000] [--free 500] [--seed 0] [--quick] [--json]`.
Every strike gets up to three faults of random kind, time, servo and duration; shortened strikes, real physics. Counted
as a violation: a Goal Current other than zero written after the fault's cycle; a motor still asked for current after
the longest watchdog; a record whose cycles are not all there; a run without a fault that is cut short; a fault of an
encoder in a strike without one.

With `--encoders`, so many strikes get a fault of a random encoder at a random cycle. Random strikes of the default
bounds, half of them with the friction of real servos, are each made nine times: without a fault, and twice with an
encoder that jumps by 0.05 to 3 rad for a cycle, jumps so for good, stops, or stops and flickers by a count. A reading
is wrong from the first cycle in which it differs from the true position by more than three counts; cycles are counted
from there to the fault. Of encoders that stop there are three classes. `visible`: at that moment the joint turns by a
count or more in two cycles, which is faster than 0.38 rad/s. `slow`: it turns slower, and the reading becomes wrong
later; at the fault, position and velocity are what a joint that comes to rest may read. `never wrong`: the joint does
not turn by three counts until the fault is found or the strike ends. `off_rad` is the largest true movement that the
readings did not show.

With `--free`, so many strikes without a fault are made on twins that differ from the model: friction up to 0.2 N m,
rotors up to 0.012 kg m^2, masses, inertias and windings by 15 %, the torque constant by 5 %, another whip, delays, and
in half of them cycles of 1.5 to 2.5 ms. A fault of an encoder among them is a false alarm.
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
from whiptool.rig.emulator import HARDWARE, Emulator, Fault, Motor, TwinOptions, random_faults
from whiptool.rig.emulator.server import Server
from whiptool.rig.loop_options import LoopOptions

PERIOD, CYCLES = 0.002, 85
STRIKE = wt.Strike((-0.3, 0.2), (0.0, 0.5), 0.15)
SOLVER = {"timestep": 5e-4, "integrator": "implicitfast", "period": PERIOD}
OPTIONS = LoopOptions(settle=0.0, go_back=False, rehearse=False, t_stay=0.02)
AT_ONCE = LoopOptions(settle=0.0, go_back=False, rehearse=False, t_stay=0.1)
COUNT = 2 * np.pi / 4096  # [rad]
WRONG, TURNED = 3.01 * COUNT, 10 * COUNT  # [rad]
VISIBLE = COUNT / (2 * PERIOD)  # [rad/s]
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
        kind = "never wrong" if not len(wrong) else "visible" if speed >= VISIBLE or fault.kind == "jump" else "slow"
        found |= {"class": kind, "off": float(off.max()), "after_fault": len(off) - 1}
        for name, most in (("after", WRONG), ("after_turned", TURNED)):
            beyond = np.flatnonzero(off > most)
            found[name] = len(off) - 1 - int(beyond[0]) if len(beyond) else None
    return found


def encoder_study(strikes: int, rng: np.random.Generator, model, said: bool) -> dict:
    """How soon faults of encoders are found, and what strikes without one end in."""
    box, found, free = default_bounds(model).box, [], Counter()
    motors = (HARDWARE, Motor())
    twins, n = [TwinHere(TwinOptions(motor=m, **SOLVER)) for m in motors], 0
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


def soon(found: list[dict], name: str) -> int:
    """How many ended in a fault within two cycles, or before the reading came to be so far off."""
    return sum(x["end"] != "good" and (x[name] or 0) <= 2 for x in found)


def table(found: list[dict]) -> dict:
    """The strikes by kind and class of fault: how many were found within two cycles, after how many, how far off."""
    rows = {}
    for kind in ENCODERS:
        for name in ("visible", "slow", "never wrong"):
            of = [x for x in found if x["kind"] == kind and x["class"] == name]
            ended = [x["after"] for x in of if x["end"] != "good" and x["after"] is not None]
            if of:
                rows[f"{kind}, {name}"] = {
                    "strikes": len(of),
                    "found": sum(x["end"] != "good" for x in of),
                    "within_two_cycles": soon(of, "after"),
                    "within_two_cycles_of_ten_counts": soon(of, "after_turned"),
                    "turned_ten_counts": sum(x["after_turned"] is not None for x in of),
                    "cycles": np.quantile(ended or [0], [0, 0.5, 0.95, 1]).round(1).tolist(),
                    "off_rad": np.quantile([x["off"] for x in of], [0.5, 0.95, 1]).round(3).tolist(),
                    "ends": dict(Counter(x["end"] for x in of)),
                }
    rows["all"] = {
        "strikes": len(found),
        "wrong": sum(x["after"] is not None for x in found),
        "found": sum(x["end"] != "good" for x in found),
        "within_two_cycles_of_wrong": soon([x for x in found if x["after"] is not None], "after"),
        "within_two_cycles_of_fault": soon(found, "after_fault"),
    }
    return rows


def unlike(rng: np.random.Generator, model) -> TwinOptions:
    """A twin of the arm that differs from the model."""
    motor = Motor(
        viscous_friction=rng.uniform(0, 0.06),
        dry_friction=rng.uniform(0, 0.2),
        friction_velocity=rng.uniform(0.02, 0.05),
        inertia=rng.uniform(0, 0.012),
        resistance=Motor().resistance * rng.uniform(0.85, 1.15),
        back_emf=Motor().back_emf * rng.uniform(0.95, 1.05),
    )
    off = rng.uniform(0.85, 1.15, (len(model.arm.links), 2))
    links = [replace(x, mass=x.mass * m, inertia=x.inertia * i) for x, (m, i) in zip(model.arm.links, off, strict=True)]
    whip = model.whip
    factors = {"m": rng.uniform(0.6, 1.6), "k": rng.uniform(0.5, 2), "b": rng.uniform(0.3, 2)}
    whip = replace(whip, **{name: getattr(whip, name) * x for name, x in factors.items()})
    true = replace(model, arm=replace(model.arm, links=tuple(links)), whip=whip)
    delays = {name: float(rng.choice([0, 5e-4, 1e-3])) for name in ("command_delay", "sample_delay")}
    return TwinOptions(model=true, motor=motor, **SOLVER, **delays)


def free_study(strikes: int, seed: int, model, said: bool) -> dict:
    """How strikes without a fault end on twins that differ from the model; every ten on another one."""
    ends, rng, twin = Counter(), np.random.default_rng([seed, 1]), None
    for n in range(strikes):
        if n % 10 == 0:
            twin = TwinHere(unlike(rng, model))
            server, jitter = twin.server, bool(rng.integers(2))
            server._pass_period = lambda s=server, j=jitter: s.advance(PERIOD + j * 5e-4 * int(rng.integers(-1, 2)))
        ends[strike_of(twin, model, rng.uniform(*default_bounds(model).box), n, 0, None)["end"]] += 1
        if said and n % 100 == 99:
            print(f"{n + 1} strikes without a fault: {dict(ends)}", file=sys.stderr, flush=True)
    return dict(ends.most_common())


def main() -> int:
    """Print how the strikes ended; the exit status is 1 if there was a violation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strikes", type=int, default=10_000)
    parser.add_argument("--encoders", type=int, default=1000)
    parser.add_argument("--free", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    strikes = 30 if args.quick else args.strikes
    rng, model = np.random.default_rng(args.seed), wt.preset("lemon2024")
    ends, violations, start = Counter(), Counter(), time.monotonic()
    with Emulator(TwinOptions(**SOLVER)) as twin:
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
    free = free_study(4 if args.quick else args.free, args.seed, model, not args.json)
    violations["false alarm"] += encoders["false_alarms"] + free.get("encoder", 0)
    result |= {"encoders": encoders, "free": free, "violations": sum(violations.values())}
    result["seconds"] = round(time.monotonic() - start, 1)
    print(json.dumps(result) if args.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 1 if result["violations"] else 0


if __name__ == "__main__":
    sys.exit(main())
