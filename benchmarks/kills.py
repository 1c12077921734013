"""Runs killed at random moments and resumed: the end is that of a run that was left alone, wall times aside.

`python benchmarks/kills.py [--kills 50] [--seed 0] [--commands optimize train ...] [--out build/kills] [--quick]
[--json]`. Each command runs once undisturbed; while it is stopped in the middle, a second process tries its folder and
must be refused. Then it is killed with SIGKILL (one kill in ten before it has a folder to resume), resumed, and what it
leaves is compared file by file. Every kill is a line in `OUT/kills.jsonl`; what is there is not done again. Counted as
wrong: a difference, an exit status other than that of the undisturbed run, a second process that was not refused.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

import whiptool as wt
from whiptool.impedance import Controller
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.whole_files import append_whole

RUN, RECORD = "run", "kills.jsonl"
STRIKES = ((-1.2, 0.9, 1.2, 0.3, 0.7), (-1.0, 0.5, 1.4, 0.6, 0.8), (-0.8, 0.7, 1.1, 0.4, 0.6))
COMMANDS = {
    "optimize": "optimize --method cmaes --target 1.25 0.05 --no-stop-at-hit --max-trials 600 --timestep 0.002 "
    "--no-video --preset printed",
    "train": "train --episodes 8 --random-episodes 2 --trials 8 --tests 5 --checkpoint-every 2 --timestep 0.001",
    "compare": "compare --targets 4 --seeds 1 --max-trials 8 --episodes 10 --trials 8 --random-episodes 2 "
    "--methods ga sac --observation goal --tighter 0.03 --workers 2",
    "adapt": "adapt --target 1.2 0.1 --camera tip --family kin --seed 5 --whip uniform --preset table4 --max-strikes 2 "
    "--starts 1 --no-still",
    "identify": "identify ../strike1.npz ../strike2.npz ../strike3.npz --starts 2 --free k m",
    "learn": "rig learn --camera points --method cmaes --max-trials 2 --settle 0.1 --approach-speed 1 "
    "--hit-radius 0.001 --lower -0.7 0.1 0.6 2.0 1.1 --upper -0.5 0.3 0.8 2.2 1.3",
}
ASIDE = ("wall_time", "fit_time", "seconds", "version")  # what a clock says, and the code's own state
LOOKED_AT = (".json", ".csv", ".toml", ".npz", ".log", ".pt")  # pictures and pages tell the same, and the time


def command(*words: str) -> list[str]:
    """A command line of whiptool."""
    return [sys.executable, "-m", f"whiptool.{words[0]}", *words[1:]]


def start(name: str, place: Path, *, resume: bool = False) -> subprocess.Popen:
    """Start a command in a new folder, where it makes or resumes `run`."""
    words = COMMANDS[name].split()
    named = words[: 1 + words.index(name)]
    resumed = [*named, "--resume", RUN, *(word for word in words if word == "--no-video")]  # is not a part of a run
    words = resumed if resume else [*words, "--out", RUN]
    with (place / "said.txt").open("ab") as said:
        return subprocess.Popen(command(*words), cwd=place, stdout=said, stderr=said)


def begun(place: Path) -> bool:
    """Whether there is a run to resume."""
    return (place / RUN / "config.toml").exists()


def undisturbed(name: str, place: Path) -> dict[str, Any]:
    """Run to the end, with a second process that tries the folder in the middle; seconds, exit status, refusal."""
    place.mkdir(parents=True)
    clock, process = time.monotonic(), start(name, place)
    while not begun(place) and process.poll() is None:
        time.sleep(0.005)
    until_begun = time.monotonic() - clock
    process.send_signal(signal.SIGSTOP)  # it holds its lock, and cannot end before the other has tried
    second = start(name, place, resume=True)
    refused = second.wait() == 2
    said = (place / "said.txt").read_text().splitlines()[-1]
    process.send_signal(signal.SIGCONT)
    clock = time.monotonic()
    status = process.wait()
    named = f"process {process.pid} on " in said
    return {
        "status": status,
        "refused": refused and named and said.startswith("whiptool: --resume"),
        "said": said,
        "until_begun": until_begun,
        "seconds": time.monotonic() - clock,
    }


def killed(name: str, place: Path, number: int, whole: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Kill at a random moment, resume, and say how the end differs."""
    early, lasts = number % 10 == 9, rng.random()
    while True:
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        process = start(name, place)
        while not early and not begun(place) and process.poll() is None:
            time.sleep(0.005)
        moment = lasts * (whole["until_begun"] if early else whole["seconds"])
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            break
        lasts *= 0.7  # it was faster than the undisturbed run, and had ended
    left = sorted(str(path.relative_to(place / RUN)) for path in (place / RUN).rglob("*") if path.is_file())
    status = start(name, place, resume=begun(place)).wait()
    wrong = differences(place.parent / "whole" / RUN, place / RUN)
    wrong += [] if status == whole["status"] else [f"exit status {status}: {last_line(place)}"]
    return {"command": name, "number": number, "moment": moment, "left": left, "wrong": wrong}


def last_line(place: Path) -> str:
    """What a command said last."""
    return ((place / "said.txt").read_text().strip().splitlines() or [""])[-1]


def differences(one: Path, two: Path) -> list[str]:
    """Files in which two run folders differ, wall times aside."""
    files = [
        {path.relative_to(run) for path in run.rglob("*") if path.is_file() and path.parent.name != "tensorboard"}
        for run in (one, two)
    ]
    lost = [f"only in {'one' if path in files[0] else 'the resumed'}: {path}" for path in files[0] ^ files[1]]
    both = [path for path in files[0] & files[1] if path.suffix in LOOKED_AT]
    return sorted(lost + [f"differs: {path}" for path in both if not same(content(one / path), content(two / path))])


def content(path: Path) -> Any:
    """What a file says, without what is left aside."""
    if path.suffix == ".json":
        return told(json.loads(path.read_text()))
    if path.suffix == ".toml":
        return told(tomllib.loads(path.read_text()))
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as data:
            return {name: data[name] for name in data.files}
    if path.suffix == ".pt":
        from whiptool.rl.training import load_checkpoint

        return load_checkpoint(path)
    if path.suffix == ".csv":
        header, *rows = [line.split(",") for line in path.read_text().splitlines()]
        return [[x for name, x in zip(header, row, strict=False) if name not in ASIDE] for row in rows]
    return path.read_bytes()


def told(said: Any) -> Any:
    """A table without what is left aside."""
    if isinstance(said, dict):
        return {name: told(value) for name, value in said.items() if name not in ASIDE}
    return [told(value) for value in said] if isinstance(said, list) else said


def same(a: Any, b: Any) -> bool:
    """Whether two contents are equal to the last bit."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "numpy") or isinstance(a, np.ndarray):
        return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=np.asarray(a).dtype.kind == "f")
    return a == b or (a != a and b != b)


def write_recordings(folder: Path) -> None:
    """Three strikes to identify, with noise."""
    model, controller, rng = wt.preset("lemon2024"), Controller(), np.random.default_rng(0)
    rollout = wt.CompiledRollout(model.with_parameters({"whip.k": 0.3, "whip.m": 0.013}), controller)
    for number, vector in enumerate(STRIKES, start=1):
        t, paths, _ = rollout.tip_path(np.array([vector]), t_stay=0.1, rate=100.0)
        seen = np.isfinite(paths[0]).all(axis=1)
        points = paths[0, seen] + 0.002 * rng.standard_normal((int(seen.sum()), 2))
        strike, sigma = wt.Strike.from_vector(vector), np.full((1, 1), 0.002)
        recording = StrikeRecording(
            t=t[seen], points=points[:, None], markers=("tip",), sigma=sigma, strike=strike, t_stay=0.1
        )
        recording.save(folder / f"strike{number}.npz")


def all_kills(name: str, folder: Path, kills: int, seed: int) -> list[dict[str, Any]]:
    """Everything about a command: what is on record, and what is still to do."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / RECORD).exists():
        shutil.rmtree(folder / "whole", ignore_errors=True)
        write_recordings(folder)
        append_whole(folder / RECORD, json.dumps(undisturbed(name, folder / "whole")) + "\n")
    whole, *done = [json.loads(line) for line in (folder / RECORD).read_text().splitlines()]
    for number in range(len(done), kills):
        rng = np.random.default_rng([seed, list(COMMANDS).index(name), number])
        done.append(killed(name, folder / "killed", number, whole, rng))
        append_whole(folder / RECORD, json.dumps(done[-1]) + "\n")
        if done[-1]["wrong"]:
            (folder / "killed").rename(folder / f"wrong-{number}")
            print(f"{name}, kill {number}: {'; '.join(done[-1]['wrong'])}", file=sys.stderr)
    return [whole, *done]


def main() -> int:
    """Print how many kills of each command ended as if nothing had happened; the exit status is 1 if one did not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=list(COMMANDS), default=list(COMMANDS))
    parser.add_argument("--out", type=Path, default=Path("build/kills"))
    parser.add_argument("--quick", action="store_true", help="one kill of one short command")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    if args.quick:
        args.kills, args.commands, args.out = 1, ["optimize"], args.out / "quick"
    result = {}
    for name in args.commands:
        whole, *kills = all_kills(name, args.out.resolve() / f"{name}-{args.seed}", args.kills, args.seed)
        result[name] = {
            "kills": len(kills),
            "wrong": sum(bool(kill["wrong"]) for kill in kills),
            "second_refused": whole["refused"],
            "seconds": round(whole["until_begun"] + whole["seconds"], 1),
        }
        if not args.json:
            print(f"{name}: {result[name]}", flush=True)
    if args.json:
        print(json.dumps(result))
    return 1 if any(one["wrong"] or not one["second_refused"] for one in result.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
