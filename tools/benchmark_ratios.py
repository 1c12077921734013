"""How fast is this checkout, in units of another one? Runs the quick form of benchmarks in both, one after the other.

    python -m tools.benchmark_ratios OTHER [--only rollout batch ...] [--rounds 2] [--least 0.97] [--json]

OTHER is a checkout of another version, which runs the benchmarks that it holds. Each benchmark runs so many rounds in
both checkouts by turns, and of each of its figures the best of the rounds counts: the largest rate, the shortest time.
A ratio is above 1 where this checkout is faster. The exit status is 1 if a benchmark's mean ratio is below `--least`.
The ratios mean something on an idle machine only.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
SPEEDS = (  # benchmarks whose quick form measures speeds
    "rollout.py", "batch.py", "space.py", "defaults.py", "gradient.py", "reach.py", "limits.py", "learn.py",
    "identify.py", "moving.py", "replan.py", "replan.py --space", "rig.py",
)  # fmt: skip
RATE = re.compile(r"per_second$")
TIME = re.compile(r"(^|\.)(?!largest|compile|cold|warm)\w*(seconds|wall_time|both|_time\.median)$")


def figures(found: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Rates and times in a benchmark's JSON by their dotted names; times are negative."""
    if isinstance(found, dict):
        for key, value in found.items():
            yield from figures(value, f"{name}.{key}" if name else key)
    elif isinstance(found, int | float) and not isinstance(found, bool) and found > 0:
        if RATE.search(name):
            yield name, float(found)
        elif TIME.search(name):
            yield name, -float(found)


def measured(checkout: Path, words: str) -> dict[str, float]:
    """Figures of the quick form of a benchmark in a checkout; none where it fails."""
    script, *options = words.split()
    command = [sys.executable, f"benchmarks/{script}", "--quick", "--json", *options]
    surroundings = {**os.environ, "PYTHONPATH": str(checkout)}
    done = subprocess.run(command, cwd=checkout, env=surroundings, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no word"])[-1]
        print(f"{words} fails in {checkout}: {last}", file=sys.stderr)
        return {}
    return dict(figures(json.loads(done.stdout.strip().splitlines()[-1])))


def ratios(other: Path, words: str, rounds: int) -> dict[str, float]:
    """Ratio of each figure that both checkouts have, above 1 where this one is faster."""
    best: dict[Path, dict[str, float]] = {other: {}, HERE: {}}
    for number in range(rounds):
        for checkout in (other, HERE) if number % 2 == 0 else (HERE, other):
            for name, value in measured(checkout, words).items():
                best[checkout][name] = max(value, best[checkout].get(name, -math.inf))
    pairs = {name: (best[HERE][name], best[other][name]) for name in best[HERE] if name in best[other]}
    return {name: here / there if here > 0 else there / here for name, (here, there) in pairs.items()}


def main() -> int:
    """Measure and print; 0 if every mean ratio is large enough."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, help="checkout of another version")
    parser.add_argument(
        "--only", nargs="+", default=SPEEDS, help="benchmarks, such as `rollout` or `replan.py --space`"
    )
    parser.add_argument("--rounds", type=int, default=2, help="runs of each benchmark in each checkout")
    parser.add_argument("--least", type=float, default=0.97, help="mean ratio that each benchmark has to reach")
    parser.add_argument("--json", action="store_true", help="one JSON object of all ratios at the end")
    arguments = parser.parse_args()
    every: dict[str, dict[str, float]] = {}
    low = []
    for words in arguments.only:
        words = words if ".py" in words else f"{words}.py"
        clock = time.monotonic()
        every[words] = found = ratios(arguments.other.resolve(), words, arguments.rounds)
        spent = time.monotonic() - clock
        if not found:
            print(f"{words:20s} nothing that both measure ({spent:.0f} s)", file=sys.stderr)
            continue
        mean = math.exp(sum(map(math.log, found.values())) / len(found))
        lowest = min(found, key=lambda name: found[name])
        print(f"{words:20s} {mean:6.3f}   lowest {found[lowest]:6.3f} of {len(found)}: {lowest} ({spent:.0f} s)")
        low += [words] if mean < arguments.least else []
    if arguments.json:
        print(json.dumps(every))
    print(f"below {arguments.least:g}: {', '.join(low) or 'none'}", file=sys.stderr)
    return 1 if low else 0


if __name__ == "__main__":
    raise SystemExit(main())
