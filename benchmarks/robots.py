"""Every robot description in some folders is read and makes a strike: it hits, or is refused with what mends it.

`python benchmarks/robots.py FOLDER ... [--read] [--search N] [--most N] [--quick] [--json] [--kept KEPT]`. The folders
are unpacked packages that hold URDF or MJCF files, such as the wheels of `example-robot-data`, `robosuite`,
`gymnasium-robotics` or `pybullet` (`pip download --no-deps` and `python -m zipfile -e`). Files without a joint that
moves, files that others include, and copies of a file are left out and counted. Each robot has its own process, which
may take `TIME` seconds and `MEMORY` bytes. Where a message asks for a tip or for the moving joints, they are given,
once each. The robot then makes one strike within its bounds in MuJoCo (`ReferenceRollout`), which the default limits
judge, and with `--search` a search of N trials for the usual target (`whiptool.search`). It prints what became of each,
and the sum by kind:

- `read`: it was read, which is all that `--read` asks for;
- `hit`: the search hit; `struck`: the strike was simulated, and kept the limits or was refused in words;
- `refused`: an `InputError` with a fix; `no cure`: one without; `traceback`, `time`, `memory`: what should not be.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import resource
import select
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from peers.kept import kept

import whiptool as wt
from whiptool.errors import InputError
from whiptool.limits.all_limits import AllLimits, default_limits
from whiptool.models import default_bounds
from whiptool.models.files import read_robot
from whiptool.models.parameters import Model
from whiptool.models.presets import rope
from whiptool.models.robot_files import ArmChoice

TIME, MEMORY = 240, 2 * 2**30  # [s], [bytes] that a robot may take
QUICK = 6  # robots of `--quick`
_MOVING = re.compile(r'type\s*=\s*"(?:revolute|continuous|prismatic)"')  # of URDF
_INCLUDED = re.compile(r'<include\s+file\s*=\s*["\']([^"\']+)')


def descriptions(folders: list[Path]) -> tuple[list[Path], Counter[str]]:
    """Robots' files in folders, shuffled but always alike, and how many others were left out for which reason."""
    found, left, seen = [], Counter[str](), set[str]()
    files = sorted(f for folder in folders for f in folder.rglob("*") if f.suffix.lower() in (".urdf", ".xml"))
    texts = {file: file.read_text(errors="replace") for file in files if file.is_file()}
    parts = {(file.parent / name).resolve() for file, text in texts.items() for name in _INCLUDED.findall(text)}
    for file, text in texts.items():
        digest = hashlib.sha256(text.encode()).hexdigest()
        if file.suffix == ".xml" and "<mujoco" not in text:
            left["not of a robot"] += 1
        elif file.resolve() in parts:
            left["part of another"] += 1
        elif not (_MOVING.search(text) if file.suffix.lower() == ".urdf" else re.search("<joint|<include", text)):
            left["without a joint that moves"] += 1
        elif digest in seen:
            left["copy of another"] += 1
        else:
            seen.add(digest)
            found.append(file)
    return sorted(found, key=lambda file: hashlib.sha256(file.name.encode()).hexdigest()), left


def chosen(file: Path) -> tuple[Model, list[str]]:
    """The robot with the usual rope, and what had to be named for it, as its messages ask."""
    choice: dict[str, Any] = {}
    while True:
        try:
            return Model(rope(), read_robot(file, ArmChoice(**choice)), name=file.stem), list(choice)
        except InputError as error:
            ends = error.allowed.partition("as the robot branches: ")[2].split(", ")
            joints = error.fix.partition("arm.moving = [")[2].partition("]")[0].split(", ")
            if "tip" not in choice and ends[0]:
                choice["tip"] = deepest(file, ends)
            elif "moving" not in choice and joints[0]:
                choice["moving"] = tuple(joint.strip("\"'") for joint in joints)
            else:
                raise


def deepest(file: Path, ends: list[str]) -> str:
    """The end with most joints before it, of those that are read without a further word; else the first."""
    counts = {}
    for end in ends[:6]:
        try:
            counts[end] = read_robot(file, ArmChoice(tip=end)).n
        except InputError:
            continue
    return max(counts, key=lambda end: counts[end], default=ends[0])


def struck(file: Path, trials: int) -> dict[str, Any]:
    """What became of one robot, with a search of so many trials; none at 0, and at -1 no strike either."""
    model, named = chosen(file)
    controller = wt.default_controller(model)
    found: dict[str, Any] = {"joints": model.arm.n, "named": named, "notes": list(model.arm.notes)}
    if trials < 0:
        return found | {"kind": "read", "said": f"{model.arm.n} joints"}
    rollout = wt.ReferenceRollout(model, controller)
    limits = AllLimits(default_limits(model, prescribed=controller.prescribed))
    strike = limits.random_strikes(default_bounds(model), np.random.default_rng(0), 1)[0]
    strike = model_strike(model, strike)
    said = limits.explain(rollout.trajectory(strike), model.arm.joints, strike)
    found |= {"kind": "struck", "said": said}
    if trials:
        result = wt.search(wt.CompiledRollout(model, controller), limits="default", max_trials=trials)
        found |= {"kind": "hit" if result.hit else "struck", "search": repr(result)}
        if result.strike is not None:
            found["end"] = limits.explain(rollout.trajectory(result.strike), model.arm.joints, result.strike)
    return found


def model_strike(model: Model, vector: np.ndarray) -> wt.Strike:
    """A strike from its vector (2 a + 1,)."""
    a = model.arm.n
    return wt.Strike(tuple(vector[:a]), tuple(vector[a:-1]), float(vector[-1]))


def apart(file: Path, trials: int) -> dict[str, Any]:
    """The same in its own process, and the time [s] and memory [bytes] that it took."""
    reads, writes = os.pipe()
    began = time.monotonic()
    child = os.fork()
    if not child:
        resource.setrlimit(resource.RLIMIT_AS, (8 * MEMORY, 8 * MEMORY))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        try:
            found = struck(file, trials)
        except InputError as error:
            found = {"kind": "refused" if error.fix else "no cure", "said": str(error)}
        except BaseException:  # what a user would see
            found = {"kind": "traceback", "said": traceback.format_exc()}
        os.write(writes, json.dumps(found).encode()[:65000])  # one write of a pipe
        os._exit(0)
    os.close(writes)
    ready = select.select([reads], [], [], TIME)[0]
    if not ready:
        os.kill(child, signal.SIGKILL)
    text = os.read(reads, 65536) if ready else b""
    os.close(reads)
    _, status, usage = os.wait4(child, 0)
    found = json.loads(text) if text else {"kind": "traceback" if ready else "time", "said": f"status {status}"}
    if 1024 * usage.ru_maxrss > MEMORY:
        found["kind"] = "memory"
    return found | {"seconds": time.monotonic() - began, "memory": 1024 * usage.ru_maxrss}


def rows(files: list[Path], trials: int, folder: Path | None) -> Iterator[dict[str, Any]]:
    for file in files:
        name = f"{'/'.join(file.parts[-4:])} {hashlib.sha256(str(file).encode()).hexdigest()[:8]}"
        yield {"file": str(file)} | kept(
            folder, name, (file.read_bytes(), trials), lambda file=file: apart(file, trials)
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="folders with robots' files, searched to any depth")
    parser.add_argument("--search", type=int, default=0, metavar="N", help="trials of a search as well; default: none")
    parser.add_argument("--read", action="store_true", help="read the robots alone, and make no strike")
    parser.add_argument("--most", type=int, default=None, metavar="N", help="at most so many robots; default: all")
    parser.add_argument("--quick", action="store_true", help=f"the first {QUICK} robots")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    parser.add_argument("--kept", type=Path, help="keep results there, and go on where it was left")
    options = parser.parse_args()
    files, left = descriptions(options.folders)
    kinds, found = Counter[str](), []
    trials, files = -1 if options.read else options.search, files[: QUICK if options.quick else options.most]
    for row in rows(files, trials, options.kept):
        kinds[row["kind"]] += 1
        found.append(row)
        if not options.json:
            last = (row.get("search") or row.get("said") or "within its limits").strip().splitlines()[-1]
            print(
                f"{row['kind']:9s} {row['seconds']:5.1f} s {row['memory'] / 2**20:5.0f} MiB {row['file']}: {last}",
                flush=True,
            )
    if options.json:
        print(json.dumps({"kinds": kinds, "left_out": left, "rows": found}))
    else:
        print(", ".join(f"{kind} {count}" for kind, count in kinds.items()) + f"; left out: {dict(left)}")
    sys.exit(any(kinds[kind] for kind in ("traceback", "time", "memory")))


if __name__ == "__main__":
    main()
