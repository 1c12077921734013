"""Five simulated ropes that hang and swing: whiptool, mujoco.sysid and dismech-newton fit them from equal data.

Each rope is a Cosserat rod in PyElastica, which shares no code with any of the three. Its upper end hangs on a hand by
a ball joint and follows the hand's path through a swing of 1.2 s; four points along the rope are seen 100 times a
second with 2 mm noise. Two swings are fitted, a third is predicted from the hand's path alone. Sought are bending
stiffness and bending damping from one first guess; length and mass per length are known, as by rule and balance. All
three have 20 links. Printed are the RMS distance per coordinate of the held-out swing to the truth without noise, the
time of the processor for the fit after compilation, and the intervals that each one states; of whiptool also the shares
of the held-out readings in its 50 and 90 % predictive intervals, and half the width of the latter.

whiptool steps at 1 ms with its integrator, and reads the hand's poses from a log, 500 a second; mujoco.sysid steps with
`implicitfast` at 1 ms and differences, the hand being a mass of 1e6 kg that a force moves; dismech-newton with the
implicit midpoint rule at 2 ms, gradients by its adjoint; its hand is put where it is in the middle of a step, and after
the step where it is at the end, which the solver would not do.
dismech-newton (GPL-3) is installed into an environment of its packages only, in the user's cache, on first use
(0.7 GB; without network it is left out, which is said). Needs `pip install 'whiptool[oracle]' 'mujoco[sysid]'`.

    python benchmarks/ropes.py [--quick] [--json] [--ropes 5] [--folder FOLDER]

With `--folder` every simulated rope and every fit is kept, and the same command goes on.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from peers.kept import kept
from scipy.interpolate import CubicHermiteSpline

from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.models import WhipProfile, preset
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.cosserat import CosseratWhip

LINKS, ELEMENTS = 20, 40
WAVE_SPEED = 300.0  # [m/s] of stretching
MARKERS = np.array([5, 10, 15, 20])  # numbers of the links at whose ends the rope is seen
SIGMA, RATE, END, HELD_OUT = 2e-3, 100, 1.2, 2
FRAMES = np.arange(10, int(1000 * END) + 1, 1000 // RATE)  # [ms]
GUESS = (0.4, 3.0)  # first guess over the truth
DISMECH = ("dismech-newton==0.1.0.post2", "warp-lang==1.19.0")  # post3 and post4 are not imported by Python 3.11
SET_UP = (LINKS, ELEMENTS, WAVE_SPEED, MARKERS.tolist(), SIGMA, RATE, END, HELD_OUT)  # of the simulated ropes
Found = dict[str, Any]


@dataclass(frozen=True)
class Rope:
    """A rope and its swings.

    Args:
        profile: The truth.
        t: Times of the frames [s], (F,).
        hands: Paths of the hands.
        places: True places of the markers at the frames, (swings, F, M, 3) [m].
        seen: The same with noise.
    """

    profile: WhipProfile
    t: np.ndarray
    hands: list[CubicHermiteSpline]
    places: np.ndarray
    seen: np.ndarray


def hand_path(rng: np.random.Generator) -> CubicHermiteSpline:
    """A swing in the plane of x and z: two sines whose amplitudes grow from rest and fade out."""
    t = np.arange(0, END + 0.2, 1e-3)
    rise = np.sin(np.pi * np.clip(t / (0.75 * END), 0, 1)) ** 2
    x = rise * (rng.uniform(0.12, 0.25) * np.sin(2 * np.pi * rng.uniform(1.0, 1.6) * t) * rng.choice([-1, 1]))
    z = rise * (rng.uniform(0.02, 0.08) * np.sin(2 * np.pi * rng.uniform(1.0, 1.6) * t))
    place = np.stack([x, 0 * x, z], axis=1)
    return CubicHermiteSpline(t, place, np.gradient(place, t, axis=0))


def rope(number: int) -> Rope:
    """Simulate one of the ropes."""
    rng = np.random.default_rng(number)
    profile = drawn_profile(rng)
    hands = [hand_path(rng) for _ in range(HELD_OUT + 1)]
    paths = CosseratWhip(profile, elements=ELEMENTS, wave_speed=WAVE_SPEED, radius=0.008).swing(hands, rate=1000.0)
    assert paths.nodes is not None
    places = paths.nodes[:, FRAMES][:, :, MARKERS * ELEMENTS // LINKS]
    return Rope(profile, FRAMES / 1000, hands, places, places + SIGMA * rng.standard_normal(places.shape))


def kept_rope(number: int, folder: Path | None) -> Rope:
    """One of the ropes, whose places are read from a folder, or simulated and kept there."""

    def simulated() -> dict[str, Any]:
        made = rope(number)
        return {"places": made.places.tolist(), "seen": made.seen.tolist()}

    numbers = kept(folder, f"rope{number}", (number, *SET_UP), simulated)
    rng = np.random.default_rng(number)
    profile = drawn_profile(rng)
    hands = [hand_path(rng) for _ in range(HELD_OUT + 1)]
    return Rope(profile, FRAMES / 1000, hands, np.array(numbers["places"]), np.array(numbers["seen"]))


def first_guess(profile: WhipProfile) -> WhipProfile:
    """The rope with a wrong stiffness and damping."""
    stiffness, damping = profile.bending_stiffness * GUESS[0], profile.bending_damping * GUESS[1]
    return replace(profile, bending_stiffness=stiffness, bending_damping=damping)


def ours(rope: Rope) -> Found:
    """Fit of whiptool, and what it predicts."""
    robot = preset("ur5e")
    profile = first_guess(rope.profile)
    plant = Plant(replace(robot, whip=profile.lump(LINKS, joints="rod")), None, profile)
    names = tuple("tip" if m == LINKS else f"node{m}" for m in MARKERS.tolist())
    log = np.arange(0, END + 0.1, 2e-3)
    films = []
    for i, hand in enumerate(rope.hands):
        pose = np.hstack([hand(log), np.tile([0.0, 0.0, 0.0, 1.0], (len(log), 1))])
        films.append(
            StrikeRecording(rope.t, rope.seen[i], names, SIGMA, hand_t=log, hand_pose=pose, source=f"swing {i}")
        )
    free = ("profile.bending_stiffness", "profile.bending_damping")
    options = FitOptions(drive="hand")
    fit(films[:1], plant, free, options=replace(options, max_iterations=1))  # compiles before the clock starts
    began = time.process_time()
    found = fit(films[:HELD_OUT], plant, free, options=options)
    seconds = time.process_time() - began
    outside = fit(films[:HELD_OUT], found.plant, free, held_out=films[HELD_OUT:], options=options).held_out[0]
    predicted = (outside.residuals + outside.measured).reshape(len(rope.t), len(MARKERS), 3)
    stated = [found[name].interval for name in free]
    return {
        "values": [found[name].value for name in free],
        "seconds": seconds,
        "error": error(rope, predicted),
        "intervals": stated,
        "coverage": {str(level): outside.coverage(level) for level in (0.5, 0.9)},
        "half_width": float(np.median(outside.half_widths(0.9))),
    }


def error(rope: Rope, predicted: np.ndarray) -> float:
    """RMS per coordinate of the plane of motion of what was predicted of the held-out swing, (F, M, 3) [m]."""
    return float(np.sqrt(np.mean((predicted - rope.places[HELD_OUT])[..., [0, 2]] ** 2)))


def mujoco_sysid(rope: Rope) -> Found:
    """The same of mujoco.sysid."""
    from peers.mujoco_rope import MujocoRope

    guess = first_guess(rope.profile)
    peer = MujocoRope(guess, LINKS, MARKERS)
    began = time.process_time()
    values, intervals = peer.fit(rope.t, rope.hands[:HELD_OUT], rope.seen[:HELD_OUT], SIGMA)
    seconds = time.process_time() - began
    predicted = peer.predicted(values, rope.t, rope.hands[HELD_OUT])
    return {"values": values, "seconds": seconds, "error": error(rope, predicted), "intervals": intervals}


def environment() -> Path | None:
    """Python of an environment with dismech-newton, made on first use; None, saying why, where it cannot be made."""
    home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "whiptool-benchmarks" / DISMECH[0]
    python, ready = home / "bin" / "python", home / "ready"
    if ready.exists():
        return python
    pip = [str(python), "-m", "pip", "install", "--quiet", *DISMECH]
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(home)],
        pip,
        [str(python), "-c", "import dismech_newton"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["no reason was given"])[-1]
            print(f"dismech-newton is left out, because it cannot be installed: {reason}", file=sys.stderr)
            return None
    ready.touch()
    return python


def dismech(rope: Rope, *, iterations: int = 25) -> Found | None:
    """The same of dismech-newton; None where it cannot be installed."""
    python = environment()
    if python is None:
        return None
    h = 2e-3
    ends, guess = np.arange(0, END + h / 2, h), first_guess(rope.profile)
    middles = (ends - h / 2).clip(0)  # where an implicit midpoint step holds what is prescribed
    stretch = guess.linear_density * WAVE_SPEED**2 / (guess.length / LINKS)

    def hands(which: slice) -> np.ndarray:
        return np.array([[hand(t) for hand in rope.hands[which]] for t in (middles, ends)]).swapaxes(1, 2)

    given = {
        "segments": LINKS, "h": h, "every": round(1 / RATE / h), "markers": MARKERS, "length": guess.length,
        "density": guess.linear_density, "gravity": 9.81, "stretch": stretch, "sigma": SIGMA, "iterations": iterations,
        "hands": hands(slice(HELD_OUT)), "held_out_hands": hands(slice(HELD_OUT, None)),
        "seen": rope.seen[:HELD_OUT].swapaxes(0, 1),
        "guess": np.array([guess.bending_stiffness, guess.bending_damping]),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "given.npz", Path(folder) / "found.npz"
        np.savez(files[0], **given)
        script = Path(__file__).parent / "peers" / "dismech_rope.py"
        outer = {name: x for name, x in os.environ.items() if name != "PYTHONPATH"}
        outer["WARP_CACHE_PATH"] = str(python.parents[1] / "warp")
        done = subprocess.run([python, script, *files], capture_output=True, text=True, env=outer, check=False)
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            print(f"dismech-newton failed: {reason}", file=sys.stderr)
            return {"failed": reason}
        found = np.load(files[1])
        predicted = found["predicted"][:, 0]
        values, seconds = found["values"].tolist(), float(found["seconds"])
    return {"values": values, "seconds": seconds, "error": error(rope, predicted), "intervals": None}


PEERS: dict[str, Callable[[Rope], Found | None]] = {
    "whiptool": ours, "mujoco.sysid": mujoco_sysid, "dismech-newton": dismech,
}  # fmt: skip


def study(count: int, folder: Path | None, peers: tuple[str, ...] = tuple(PEERS)) -> dict[str, Any]:
    """All fits of all ropes, and how they compare."""
    rows = []
    for number in range(count):
        simulated = cache(lambda number=number: kept_rope(number, folder))
        row: dict[str, Any] = {"rope": number}
        for name in peers:
            of = (number, *SET_UP, GUESS, DISMECH)
            row[name] = kept(
                folder, f"rope{number} {name}", of, lambda name=name, simulated=simulated: PEERS[name](simulated())
            )
        rows.append(row)
    truth = [
        [r.bending_stiffness, r.bending_damping]
        for r in (drawn_profile(np.random.default_rng(number)) for number in range(count))
    ]
    return {"rows": rows, "truth": truth, "summary": {name: summary(rows, truth, name) for name in peers}}


def drawn_profile(rng: np.random.Generator) -> WhipProfile:
    """The first numbers that a rope's generator draws: the rope itself."""
    stiffness = rng.uniform(0.005, 0.03)
    length, density, ratio = rng.uniform(0.7, 1.0), rng.uniform(0.04, 0.1), rng.uniform(0.02, 0.06)
    return WhipProfile(length, density, stiffness, stiffness * ratio)


def summary(rows: list[dict[str, Any]], truth: list[list[float]], name: str) -> dict[str, Any] | None:
    """Medians over the ropes that were fitted; None of a peer that was left out."""
    found = [(row[name], true) for row, true in zip(rows, truth, strict=True) if row[name] and "error" in row[name]]
    if not found:
        return None
    predictive = [row for row, _ in found if "coverage" in row]
    held = [
        low <= x <= high for row, true in found for x, (low, high) in zip(true, row["intervals"] or [], strict=False)
    ]
    return {
        "ropes": len(found),
        "error": float(np.median([row["error"] for row, _ in found])),
        "seconds": float(np.median([row["seconds"] for row, _ in found])),
        "off": [float(np.median([abs(row["values"][i] / true[i] - 1) for row, true in found])) for i in (0, 1)],
        "intervals": len(held),
        "intervals_that_hold": sum(held),
        "coverage": {
            x: float(np.mean([row["coverage"][x] for row in predictive])) for x in ("0.5", "0.9") if predictive
        },
        "half_width": float(np.median([row["half_width"] for row in predictive])) if predictive else None,
    }


def print_study(study: dict[str, Any]) -> None:
    """A line for each program."""
    for name, row in study["summary"].items():
        if row is None:
            print(f"  {name:15s} left out")
            continue
        stated = (
            f"{row['intervals_that_hold']} of {row['intervals']} hold the truth" if row["intervals"] else "none stated"
        )
        print(
            f"  {name:15s} held-out error {1e3 * row['error']:.2f} mm, fit {row['seconds']:.1f} s of a processor, "
            f"stiffness off by "
            f"{100 * row['off'][0]:.1f} %, damping by {100 * row['off'][1]:.1f} %, 95 % intervals: {stated} "
            f"({row['ropes']} ropes, medians)"
        )
        if row["coverage"]:
            half, most = row["coverage"]["0.5"], row["coverage"]["0.9"]
            print(
                f"  {'':15s} of the held-out readings {half:.0%} are in the 50 % predictive intervals, {most:.0%} in "
                f"those of 90 %, half of which is {1e3 * row['half_width']:.2f} mm"
            )
    for row in study["rows"]:
        each = [
            f"{name} {1e3 * row[name]['error']:.2f} mm" for name in study["summary"] if "error" in (row[name] or {})
        ]
        print(f"  rope {row['rope']}: " + ", ".join(each))


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one rope, without dismech-newton")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--ropes", type=int, default=5)
    parser.add_argument("--folder", type=Path, help="keep each fit there, and go on where it was left")
    arguments = parser.parse_args()
    logging.getLogger("absl").setLevel(logging.ERROR)
    with contextlib.redirect_stdout(sys.stderr):
        few = arguments.quick
        found = study(1 if few else arguments.ropes, arguments.folder, tuple(PEERS)[: 2 if few else 3])
    if arguments.json:
        print(json.dumps(found))
    else:
        print_study(found)


if __name__ == "__main__":
    main()
