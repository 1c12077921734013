"""Do the tests notice a wrong formula? Changes one place of one formula at a time and runs its module's tests.

Of the modules in `modules.toml`, places are drawn by seed and package, each gets one mutant (a wrong sign, a boundary,
a number, a function's counterpart), and the fast tests named for the module run on it in a copy of the repository.
Results are kept in `build/mutants/results.jsonl`: a run that was killed goes on where it was, and a result counts for
as long as the module and its tests stay as they are. What no test can kill is in `equivalent.toml`, with the reason.

    python -m tools.mutants [--package rl targets] [--module NAME ...] [--sample 40] [--seed 0] [--workers 2]
"""

from __future__ import annotations

import fcntl
import shutil
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from resource import RLIMIT_DATA, getrlimit, setrlimit

import tyro
from tqdm import tqdm

from tools.mutants.population import Mutant, places, sample
from tools.mutants.results import GOAL, Result, Store, read_equivalents, state_of, table, total
from tools.mutants.trials import Broken, Copy

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
MEMORY = 8 << 30  # [bytes] that one run of tests may allocate


@dataclass
class Options:
    """Change formulas and see whether tests notice."""

    package: tuple[str, ...] = ()
    """Packages, all unless given."""
    module: tuple[str, ...] = ()
    """Modules whose path contains one of these, all unless given."""
    sample: int = 40
    """Mutants of each package."""
    seed: int = 0
    """Of the draw."""
    workers: int = 2
    """Runs of tests at a time, each in a separate copy."""
    keep_kills: bool = False
    """Count what earlier tests or an earlier module killed, to see what grown tests do with the survivors."""
    list: bool = False
    """Print the mutants and run nothing."""


def main(options: Options) -> int:
    """Run what has no result yet, print table and survivors; 0 if the goal is met."""
    modules = chosen_modules(options)
    drawn = {package: sample(ROOT, list(named), options.sample, options.seed) for package, named in modules.items()}
    if options.list:
        for mutant in (mutant for mutants in drawn.values() for mutant in mutants):
            print(described(mutant))
        return 0
    tests = {module: tuple(files) for named in modules.values() for module, files in named.items()}
    equivalents = read_equivalents(HERE / "equivalent.toml")
    build = ROOT / "build" / "mutants"
    build.mkdir(parents=True, exist_ok=True)
    with (build / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print("mutants of this tree are running already", file=sys.stderr)
            return 2
        asked = [x for mutants in drawn.values() for x in mutants if x.identity not in equivalents]
        results = run(asked, tests, Store(build / "results.jsonl"), build, options)
    return report(modules, drawn, results, equivalents)


def chosen_modules(options: Options) -> dict[str, dict[str, list[str]]]:
    """Packages, their modules and the tests of each, as far as asked for."""
    every = tomllib.loads((HERE / "modules.toml").read_text())
    unknown = set(options.package) - set(every)
    if unknown:
        raise SystemExit(f"--package: got {', '.join(sorted(unknown))}; allowed: {', '.join(every)}")
    wanted = options.package or tuple(every)
    named = {
        package: {m: files for m, files in every[package].items() if any(x in m for x in options.module or ("",))}
        for package in wanted
    }
    return {package: part for package, part in named.items() if part}


def run(
    asked: list[Mutant], tests: dict[str, tuple[str, ...]], store: Store, build: Path, options: Options
) -> dict[str, Result]:
    """Results by the mutant's name, kept ones and new ones."""
    states = {module: state_of(ROOT, module, files) for module, files in tests.items()}
    found = {x.name: store.find(x, states[x.place.module], keep_kills=options.keep_kills) for x in asked}
    missing = sorted((x for x in asked if found[x.name] is None), key=lambda x: tests[x.place.module])
    setrlimit(RLIMIT_DATA, (MEMORY, getrlimit(RLIMIT_DATA)[1]))
    for left in build.glob("copy-*"):
        shutil.rmtree(left, ignore_errors=True)
    copies: SimpleQueue[Copy] = SimpleQueue()
    for _ in range(min(options.workers, len(missing))):
        copies.put(Copy.of(ROOT, Path(tempfile.mkdtemp(prefix="copy-", dir=build))))

    def trial(mutant: Mutant) -> Result:
        module = mutant.place.module
        if not tests[module]:
            return Result(mutant.name, states[module], True, "", 0.0)
        copy = copies.get()
        try:
            return Result(mutant.name, states[module], *copy.survives(mutant, tests[module]))
        finally:
            copies.put(copy)

    with ThreadPoolExecutor(options.workers) as pool:
        going = [pool.submit(trial, mutant) for mutant in missing]
        try:
            for done in tqdm(as_completed(going), total=len(going), disable=not going):
                store.add(done.result())
                found[done.result().mutant] = done.result()
        except (Broken, KeyboardInterrupt):
            pool.shutdown(cancel_futures=True)
            raise
        finally:
            for copy in (copies.get() for _ in range(copies.qsize())):
                shutil.rmtree(copy.folder, ignore_errors=True)
    return {name: result for name, result in found.items() if result is not None}


def report(modules, drawn: dict[str, list[Mutant]], results: dict[str, Result], equivalents) -> int:
    """Print the table and the survivors; 0 if the goal is met."""
    rows = [
        (
            package,
            sum(len(places(ROOT, module)) for module in modules[package]),
            len(mutants),
            sum(x.identity in equivalents for x in mutants),
            [results[x.name] for x in mutants if x.name in results],
        )
        for package, mutants in drawn.items()
    ]
    every = total(rows)
    asked = (x for mutants in drawn.values() for x in mutants if x.name in results)
    survivors = [x for x in asked if results[x.name].survived]
    for mutant in survivors:
        print(described(mutant))
    print(table([*rows, every]))
    killed = len(every[4]) - len(survivors)
    return 0 if killed >= GOAL * len(every[4]) else 1


def described(mutant: Mutant) -> str:
    """Where a mutant is and what it changes."""
    place = mutant.place
    return f"{place.module}:{place.number} in {place.scope or 'the module'}\n  - {mutant.was}\n  + {mutant.becomes}"


if __name__ == "__main__":
    try:
        raise SystemExit(main(tyro.cli(Options, description=__doc__)))
    except Broken as broken:
        raise SystemExit(str(broken)) from None
