"""Random stops of whole sessions on the lock-step twin: after a stop, torque is never switched on again.

`python benchmarks/rig_stops.py [--stops 300] [--seed 0] [--quick] [--json]`. A session makes strikes one after another:
a script, a script that goes on after every `Exception`, a search, an adaptation, the commands `rig strike`, `rig learn`
and `adapt`, each with the twin's code or the hardware's. Each is stopped once: by one to three signals before a random
instruction on the bus or between two strikes, or by a fault of a servo or the line at a random time. The emulator tells
when torque was switched on. Counted as a violation: torque switched on after the stop; torque on at the end; a session
that went on; an exit status other than 130 after a signal and 1 after a fault; a strike that was not carried out among
the trials; a resumed run that arms after a fault without a person's answer.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import whiptool as wt
from whiptool.adaptation.adapter import Options
from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.ports import RigPort
from whiptool.adaptation.prior import default_prior
from whiptool.commands import adapt, rig
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, Controller
from whiptool.models.strike import StrikeBounds
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rig import session as sessions
from whiptool.rig.control_loop import StepClock
from whiptool.rig.emulator import Emulator, Fault, TwinOptions
from whiptool.rig.loop_options import LoopOptions
from whiptool.rig.session import HardwareRig, RigRollout, ServoLine, TwinRig
from whiptool.rig.stops import STOPPED, Interlock, StrikeStopped

MODEL, CONTROLLER = wt.preset("lemon2024"), Controller(OIAC())
RATE, STRIKES = 100.0, 3  # cycles per second; strikes of a session that nothing stops
OPTIONS = LoopOptions(rate=RATE, settle=0.05, approach_speed=2.0, t_stay=0.02, rehearse=False)
LOWER, UPPER = np.array([0.05, 0.05, 0.15, 0.1, 0.14]), np.array([0.1, 0.1, 0.2, 0.15, 0.16])
PHYSICS = TwinOptions(timestep=5e-4, integrator="implicitfast", period=1 / RATE)
TARGET = Target((1.2, 0.1))
SESSIONS = ("script", "careless", "search", "adaptation", "rig strike", "rig learn", "adapt")
FAULTS = ("hot", "alert", "dead", "unplug", "drop", "corrupt", "lose", "late")  # each ends a run
LONGEST = 0.4  # [s] of simulated time that a strike lasts at least, with its way there and back


@dataclass
class Stop:
    """When and how a session is stopped.

    Args:
        strike: In which strike, from 1.
        signals: Numbers of the signals, one after the other; none: a fault.
        before: Before which instruction of the strike they come; beyond the last: between two strikes.
        fault: What breaks; None: nothing.
    """

    strike: int
    signals: tuple[int, ...] = ()
    before: int = 0
    fault: Fault | None = None


def random_stop(rng: np.random.Generator) -> Stop:
    """Draw a stop."""
    strike = int(rng.integers(1, STRIKES + 1))
    if rng.random() < 0.5:
        numbers = rng.choice([signal.SIGINT, signal.SIGTERM], size=int(rng.integers(1, 4)))
        return Stop(
            strike, tuple(map(int, numbers)), before=int(rng.choice([60, 300])) * int(rng.integers(0, 101)) // 100
        )
    kind: Any = str(rng.choice(FAULTS))
    at, servo, seed = float(rng.uniform(0.01, LONGEST - 0.05)), int(rng.integers(2)), int(rng.integers(99))
    return Stop(strike, fault=Fault(kind, at=at, count=100_000, servo=servo, seed=seed))


@dataclass
class Watched:
    """Stands in the place of the emulator's class: one process for all strikes, which is watched and stopped.

    Attributes:
        strikes: So many were begun.
        armed: Strike and simulated time [s] of every switching on of a servo's torque.
        known: So many of these were there when the signals came; None: they did not.
    """

    emulator: Emulator
    stop: Stop
    strikes: int = 0
    armed: list[tuple[int, float]] = field(default_factory=list)
    known: int | None = None
    left_on: bool = False

    def __call__(self, options: TwinOptions) -> Watched:
        self.emulator.reset(options.start)
        return self

    def __enter__(self) -> Watched:
        self.strikes += 1
        self._asked = 0
        if self.stop.fault is not None and self.strikes == self.stop.strike:
            self.emulator.inject(self.stop.fault)
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(KeyboardInterrupt):
            self.emulator.advance(0.12)  # the longest watchdog
        state = self.emulator.state()
        self.armed += [(self.strikes, t) for t, _, on in state["torque_changes"] if on]
        driven = [g for g, on in zip(state["goal_current"], state["torque_on"], strict=True) if on and g]
        self.left_on = self.left_on or bool(driven)
        if self.stop.signals and self.strikes == self.stop.strike and self.known is None:
            self._signal(len(self.armed))

    def bus(self, ids: Any = (), *, baud: int | None = None) -> Any:
        """A bus on which the signals come."""
        bus = self.emulator.bus(timeout=0.006)
        transact = bus._transaction

        def counted(*args: Any, **named: Any) -> Any:
            self._asked += 1
            if self.stop.signals and self.strikes == self.stop.strike and self._asked > self.stop.before:
                state = self.emulator.state()
                self._signal(len(self.armed) + sum(on for _, _, on in state["torque_changes"]))
            return transact(*args, **named)

        bus._transaction = counted
        return bus

    def _signal(self, known: int) -> None:
        if self.known is None:
            self.known = known
            for number in self.stop.signals:
                os.kill(os.getpid(), number)

    def trajectory(self) -> dict[str, np.ndarray]:
        return self.emulator.trajectory()

    def state(self) -> dict[str, Any]:
        return self.emulator.state()

    @property
    def armed_after(self) -> int:
        """How often torque was switched on after the stop."""
        if self.stop.fault is None:
            return 0 if self.known is None else len(self.armed) - self.known
        late = (self.stop.strike, self.stop.fault.at)
        return sum(when > late for when in self.armed)


class HardwareOnTwin(HardwareRig):
    """The hardware's code on the lock-step twin."""

    def strike(self, strike: Any, **named: Any) -> Any:
        with sessions.Emulator(TwinOptions(start=(0.0, 0.0))) as twin:
            there = {"DynamixelBus": lambda port, ids, baud: twin.bus(), "WallClock": StepClock}
            with mock.patch.multiple(sessions, **there):
                return super().strike(strike, **named)


def rig_of(hardware: bool, interlock: Interlock | None = None) -> TwinRig | HardwareRig:
    """A rig that films nothing."""
    own: dict[str, Any] = {"target": TARGET.position, "options": OPTIONS, "interlock": interlock}
    if hardware:
        return HardwareOnTwin(MODEL, CONTROLLER, ServoLine("twin"), **own)
    return TwinRig(MODEL, CONTROLLER, camera="none", **own)


def strikes_of(rng: np.random.Generator) -> list[wt.Strike]:
    """The strikes of a session."""
    return [wt.Strike.from_vector(x) for x in rng.uniform(LOWER, UPPER, (STRIKES, 5))]


def adaptation_of(hardware: bool, strike: wt.Strike, folder: Path | None) -> wt.Adaptation:
    """One that strikes the same again and again, and learns nothing."""
    plan = Plan(tuple(map(float, strike.vector)), None, None, None, None, "as given", 0.0)
    options = Options(max_strikes=STRIKES, stop_at=0.0, still=False, adapt=False, t_stay=OPTIONS.t_stay)
    interlock = Interlock()
    port = RigPort(lambda number: rig_of(hardware, interlock), TARGET.position)
    prior = default_prior(MODEL, CONTROLLER)
    return wt.Adaptation(prior, port, TARGET, options, folder, opening=plan, interlock=interlock)


def run_session(kind: str, hardware: bool, rng: np.random.Generator, folder: Path) -> int:
    """Make the strikes of a session; the exit status that it has or would have."""
    strikes = strikes_of(rng)
    if kind == "careless":
        one, status = rig_of(hardware), 0
        for strike in strikes:
            try:
                one.strike(strike)
            except KeyboardInterrupt:
                return status or 130
            except Exception:  # as a script may have it
                status = 1
        return status
    if kind in ("rig strike", "rig learn", "adapt"):
        return command(kind, hardware, strikes, folder)
    try:
        if kind == "script":
            one = rig_of(hardware)
            for strike in strikes:
                one.strike(strike)
        elif kind == "adaptation":
            adaptation_of(hardware, strikes[0], folder).run()
        else:
            one = rig_of(hardware)
            rollout = RigRollout(lambda number: one, MODEL, folder=folder)
            bounds = StrikeBounds(tuple(LOWER), tuple(UPPER))
            objective = Objective(rollout, TARGET, t_stay=OPTIONS.t_stay, bounds=bounds, max_trials=STRIKES)
            method = str(rng.choice(["random", "cmaes", "directl", "ga", "nlopt:GN_CRS2_LM"]))
            search(objective, method, seed=int(rng.integers(99))).uninterrupted()
    except KeyboardInterrupt:
        return 130
    except StrikeStopped:
        return 1
    return 0


def command(kind: str, hardware: bool, strikes: list[wt.Strike], folder: Path, *more: str) -> int:
    """Call a command in this process; rig and plans are those of this file."""

    def make(options: Any, model: Any, controller: Any, interlock: Interlock) -> Any:
        return rig_of(hardware, interlock)

    words = list(more) or ["--target", "1.2", "0.1", "--out", str(folder)]
    quiet = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
    with quiet[0], quiet[1], mock.patch.object(rig, "_make_rig", make), mock.patch.object(rig, "_report"):
        if kind == "rig strike":
            return rig.main(["strike", *words, "--camera", "none", "--strike", *map(str, strikes[0].vector)])
        if kind == "rig learn":
            box = ["--lower", *map(str, LOWER), "--upper", *map(str, UPPER)]
            given = [] if more else [*box, "--max-trials", str(STRIKES), "--method", "random", "--camera", "points"]
            return rig.main(["learn", *words, *given])
        with mock.patch.object(adapt, "prepare", return_value=adaptation_of(hardware, strikes[0], None)):
            return adapt.main(words)


@contextlib.contextmanager
def usual_signals() -> Iterator[None]:
    """Ctrl-C and SIGTERM as KeyboardInterrupt, whatever a command left behind."""
    before = {n: signal.signal(n, signal.default_int_handler) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def stopped_once(emulator: Emulator, rng: np.random.Generator, folder: Path) -> tuple[str, list[str]]:
    """Run a session that is stopped: how, and what was wrong with that; an empty end: the stop came too late."""
    kind, hardware, stop = str(rng.choice(SESSIONS)), bool(rng.integers(2)), random_stop(rng)
    if kind == "rig strike":
        stop.strike = 1
    watched = Watched(emulator, stop)
    with usual_signals(), mock.patch.object(sessions, "Emulator", watched):
        status = run_session(kind, hardware, rng, folder)
        wrong = []
        if status == 0 and watched.known is None and not (stop.fault and watched.strikes >= stop.strike):
            return "", []
        if status != (130 if stop.signals else 1):
            wrong.append(f"status {status}")
        if watched.strikes > stop.strike and kind != "careless":
            wrong.append("went on")
        if kind == "rig learn":
            wrong += resumed(watched, folder, hardware, trials=stop.strike - 1)
    if watched.armed_after:
        wrong.append("armed after the stop")
    if watched.left_on:
        wrong.append("torque on")
    how = f"{len(stop.signals)} signals" if stop.signals else stop.fault.kind if stop.fault else ""
    return f"{kind}: {how}", wrong


def resumed(watched: Watched, folder: Path, hardware: bool, trials: int) -> list[str]:
    """What is wrong with the folder of a search that was stopped, and with going on without a person."""
    table = folder / "trials.csv"
    kept = len(table.read_text().splitlines()) - 1 if table.exists() else 0
    wrong = [] if kept == trials else [f"{kept} trials, {trials} strikes were carried out"]
    if watched.stop.fault is None:
        return wrong
    if not (folder / STOPPED).exists():
        wrong.append("no reason in the folder")
    with mock.patch.object(sys, "stdin", io.StringIO("")):
        if command("rig learn", hardware, [], folder, "--resume", str(folder), "--yes") != 1:
            wrong.append("resumed without a person")
    return wrong


def main() -> int:
    """Print how the sessions were stopped; the exit status is 1 if there was a violation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args()
    result = stops(15 if args.quick else args.stops, args.seed)
    print(json.dumps(result) if args.json else "\n".join(f"{k}: {v}" for k, v in result.items()))
    return 1 if result["violations"] else 0


def stops(count: int, seed: int) -> dict[str, Any]:
    """So many random stops: how often which ended what, and the violations."""
    rng, start = np.random.default_rng(seed), time.monotonic()
    ends, violations, number = Counter[str](), list[str](), 0
    with tempfile.TemporaryDirectory() as folder, Emulator(PHYSICS) as emulator:
        while sum(ends.values()) < count:
            number += 1
            end, wrong = stopped_once(emulator, rng, Path(folder) / str(number))
            ends.update([end] if end else [])
            violations += [f"session {number}, {end}: {what}" for what in wrong]
    return {
        "stops": count,
        "armed_after_a_stop": sum("armed" in what for what in violations),
        "violations": len(violations),
        "what": violations[:20],
        "ends": dict(sorted(ends.items())),
        "seconds": round(time.monotonic() - start, 1),
    }


if __name__ == "__main__":
    sys.exit(main())
