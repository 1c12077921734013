"""How long a UR moves on after a stop at a strike's fastest instant, on the emulated robot in lock-step.

`python benchmarks/ur_stops.py [--strikes 5] [--seed 0] [--quick] [--json]`. Strikes are planned at random points within
reach, and made through the client ur_rtde, commands leading by the lag that a first movement showed. At the instant at
which a joint is fastest, SIGINT reaches this process in one run, and in another nothing passes the network any more.
Times are those of the emulated controller, whose `servoj` is modelled after the script manual, whose own braking is
assumed (20 rad/s^2), and whose time waits for the client, so that they do not depend on this machine. A real computer
adds what its network and its processes take.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import time
from typing import Any

import numpy as np
from tqdm import tqdm

import whiptool as wt
from whiptool.goals.target import Target
from whiptool.identification.servo_lag import ServoLag, fit_servo_lag
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rig.robots.robot import Sample
from whiptool.rig.robots.ur import UniversalRobot
from whiptool.rig.stops import SafetyError
from whiptool.rig.ur_emulator import UrEmulator, UrFault, UrOptions
from whiptool.rollout import CompiledRollout
from whiptool.stop_signals import StopSignals

MODEL = wt.preset("ur5e")
ARM, PERIOD, RESTS = MODEL.arm, 0.002, 1e-3  # [s], [rad/s] of a joint at rest
ENDS = {"signal": "signal", "silence": "lost"}  # kind of the error with which the strike ends
PATIENCE = 10.0  # [s] of real time that the driver waits for a state: the machine may be busy


def planned(count: int, seed: int) -> list[Strike]:
    """Strikes at points, each the best of at most 60 trials."""
    rollout, rng, found = CompiledRollout(MODEL), np.random.default_rng(seed), []
    for k in range(count):
        azimuth, height, r = rng.uniform((-1.0, 0.1, 0.9), (1.0, 1.0, 1.6))
        target = Target((r * np.cos(azimuth), r * np.sin(azimuth), height), hit_radius=0.05)
        objective = Objective(rollout, target, max_trials=60, stop_at_hit=True)
        found.append(search(objective, "cma-es", seed=k).strike)
    return found


class Followed:
    """A strike on an emulated robot that stands at its start, and what happens at its fastest instant.

    Args:
        strike: The strike.
        happens: `signal`, `silence`, or nothing.
        lag: Lag by which commands lead.
    """

    def __init__(self, strike: Strike, happens: str = "", lag: ServoLag | None = None) -> None:
        self.samples: list[Sample] = []
        options = UrOptions(f"127.0.1.{1 + os.getpid() % 250}", strike.q_i, latency=3, lockstep=True)
        path = JointTrajectory.of_strike(strike, ARM.names, rest=0.05, t_stay=0.1)
        late = 0.0 if lag is None else lag.delay
        self._fastest = float(path.t[np.abs(path.v).max(axis=1).argmax()]) + late
        self._happens, self._signalled = happens, 0
        patience = 0.5 if happens == "silence" else PATIENCE
        with UrEmulator(options) as emulator, StopSignals() as signals:
            robot = UniversalRobot(emulator.host, ARM.joint_limits, lag=lag, patience=patience)
            with robot:
                if happens == "silence":
                    emulator.inject(UrFault("silence", self._fastest))
                try:
                    robot.follow(path, self._seen, lambda: signals.received or None)
                except SafetyError as error:
                    if error.kind != ENDS.get(happens):
                        raise
            signals.answered = True
            state = emulator.state()
            while happens == "silence" and (state["program"] or np.abs(state["v"]).max() > RESTS):
                time.sleep(0.01)
                state = emulator.state()
            self.history, self.log = emulator.history(), state["log"]

    def _seen(self, sample: Sample) -> None:
        self.samples.append(sample)
        if self._happens == "signal" and not self._signalled and sample.t >= self._fastest:
            self._signalled = len(self.samples) - 1
            os.kill(os.getpid(), signal.SIGINT)

    def after(self) -> dict[str, float]:
        """How fast the arm was when it happened, how long and how far it went on, and when its program ended."""
        t, q, v = self.history[:, 0], self.history[:, 1:7], self.history[:, 7:13]
        if self._happens == "signal":
            at = int(np.flatnonzero((q == self.samples[self._signalled].q).all(axis=1))[0])
        else:
            at = int(np.searchsorted(t, self._time(r"([\d.]+) s: fault silence")))
        moving = np.flatnonzero(np.abs(v).max(axis=1) > RESTS)
        found = {
            "speed": float(np.abs(v[at]).max()),
            "rest": float(t[moving[-1]] + PERIOD - t[at]),
            "travel": float(np.abs(q[-1] - q[at]).max()),
        }
        ended = {"program": self._time(r"([\d.]+) s: the program ended") - float(t[at])}
        return found | (ended if self._happens == "silence" else {})

    def _time(self, pattern: str) -> float:
        return float(next(m[1] for m in map(re.compile(pattern).match, self.log) if m))


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strikes", type=int, default=5, choices=range(1, 101), metavar="1..100")
    parser.add_argument("--quick", action="store_true", help="one strike")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    o = parser.parse_args()
    strikes = planned(1 if o.quick else o.strikes, o.seed)
    first = Followed(strikes[0]).samples
    lag = fit_servo_lag(*(np.array([getattr(x, name) for x in first]) for name in ("t", "q_d", "q")))
    found: dict[str, Any] = {"lag": lag.lag, "stiffness": lag.stiffness, "delay": lag.delay}
    for happens in ("signal", "silence"):
        rows = [Followed(strike, happens, lag).after() for strike in tqdm(strikes, desc=happens, disable=o.json)]
        found[happens] = {name: [row[name] for row in rows] for name in rows[0]}
    if o.json:
        print(json.dumps(found))
        return
    units = {"speed": "rad/s", "rest": "s", "travel": "rad", "program": "s"}
    print(lag)
    for happens in ("signal", "silence"):
        for name, values in found[happens].items():
            low, middle, high = np.quantile(values, (0, 0.5, 1))
            print(f"{happens:8s} {name:8s} {low:.3f} to {high:.3f}, median {middle:.3f} {units[name]}")


if __name__ == "__main__":
    main()
