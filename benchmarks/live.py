"""What `--live` costs a search: equal searches with and without it, one after the other in turns.

`python benchmarks/live.py [--repeats 3] [--page] [--quick] [--json]`. Two searches, in the plane and of a UR5e, whose
trials are the same with and without `--live`. Printed are the processor time and the wall time of the search itself,
with `--live` in parts of those without: the median of the ratios of neighbouring runs, and the range; and as `shown`
the processor time of the process that shows the run, its start included, in parts of the search's. With `--page` a
browser looks at the page, too (playwright and /usr/bin/chromium), which draws without a graphics card and takes what
the machine has: its own cost is in that.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import subprocess
import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

SEARCHES = {  # trials, trials in the quick form, and words of the command
    "plane": (8_000, 300, "--target 1.2 0.1 --method directl"),
    "ur5e": (2_000, 100, "--model ur5e --target 1.1 0.3 0.6 --method cmaes"),
}
TIMED = """
import json, resource, sys, time
from whiptool import optimizers
from whiptool.commands import optimize

plain = optimizers.run_search

def timed(*given, **named):
    began = time.process_time(), time.perf_counter()
    found = plain(*given, **named)
    print(json.dumps([time.process_time() - began[0], time.perf_counter() - began[1]]))
    return found

optimizers.run_search = timed
status, used = optimize.main(sys.argv[1:]), resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps(used.ru_utime + used.ru_stime))
sys.exit(status)
"""
MODES = {"without": (), "live": ("--live",), "page": ("--live",)}


def browser(address: str, stack: ExitStack) -> None:
    """Open a page in a browser without a window."""
    from playwright.sync_api import sync_playwright

    play = stack.enter_context(sync_playwright())
    opened = play.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
    stack.callback(opened.close)
    opened.new_page(viewport={"width": 1400, "height": 900}).goto(address)


def searched(words: list[str], mode: str) -> tuple[float, float, float]:
    """Processor time and wall time of a search, and processor time of the process that shows it [s]."""
    with TemporaryDirectory() as folder, ExitStack() as stack:
        command = [sys.executable, "-c", TIMED, *words, "--no-video", "--no-stop-at-hit", "--json", "--out"]
        process = subprocess.Popen(
            [*command, str(Path(folder) / "run"), *MODES[mode]],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr is not None
        assert process.stdout is not None
        if mode == "page":
            said = next((m[0] for line in process.stderr if (m := re.search(r"http://\S+", line))), None)
            if said is None:
                raise RuntimeError("the run ended before its page was there")
            browser(said, stack)
        threading.Thread(target=process.stderr.read, daemon=True).start()  # bars, which would fill the pipe
        told, rest = process.stdout.readline(), process.stdout.read()
        if process.wait() != 0:
            raise RuntimeError(f"the search ended with {process.returncode}")
        processor, wall = json.loads(told)
        return processor, wall, json.loads(rest.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    modes, repeats = ["live", "page"] if options.page else ["live"], 1 if options.quick else options.repeats
    result: dict = {"machine": platform.machine(), "repeats": repeats}
    for name, (trials, few, words) in SEARCHES.items():
        given = [*words.split(), "--max-trials", str(few if options.quick else trials)]
        searched(given, "without")  # what has to be compiled is
        ratios: dict[str, list[np.ndarray]] = {mode: [] for mode in modes}
        for _ in range(repeats):
            plain = np.array(searched(given, "without")[:2])
            for mode in modes:
                *times, shown = searched(given, mode)
                ratios[mode].append(np.array([*(times / plain), shown / plain[0]]))
            print(
                f"{name}: without {plain[1]:.2f} s",
                {m: np.round(r[-1], 3).tolist() for m, r in ratios.items()},
                file=sys.stderr,
            )
        result[name] = {"trials": int(given[-1]), "seconds": float(plain[1])}
        for mode, found in ratios.items():
            for i, what in enumerate(("processor", "wall", "shown")):
                each = [float(ratio[i]) for ratio in found]
                result[name][f"{mode}_{what}"] = {"median": float(np.median(each)), "each": each}
    if options.json:
        print(json.dumps(result))
        return
    for name in SEARCHES:
        told = result[name]
        print(f"{name}: {told['trials']} trials, {told['seconds']:.1f} s without --live")
        for what in (what for what in told if isinstance(told[what], dict)):
            each = told[what]["each"]
            print(
                f"  {what:16s} {told[what]['median']:.3f} times that without, from {min(each):.3f} to {max(each):.3f}"
            )


if __name__ == "__main__":
    main()
