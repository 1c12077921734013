"""One mutant's trial: a copy of the repository, one changed module, the tests that are named for it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from tools.mutants.population import Mutant

GENEROUS, SLACK = 10.0, 30.0  # a mutant has ten times what the tests took without it, and [s] on top
TOO_LONG = {124, 137, 152}  # as coreutils' timeout exits, for its own limit and for that of processor time
NO_TESTS = 5  # as pytest exits where nothing was selected
STAGES = "not slow", "slow"  # marks of tests; the second try what survives the first
QUIET = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class Broken(Exception):
    """Tests that fail without a mutant, or select nothing: their verdict on mutants would mean nothing."""


@dataclass(frozen=True)
class Run:
    """One run of tests: exit status, output, [s] on the clock and of the processor."""

    code: int
    output: str
    seconds: float
    processor: float

    @property
    def ended_by(self) -> str:
        """ "timeout", or the first test that failed; empty where all passed."""
        if self.code in TOO_LONG:
            return "timeout"
        failed = (line.split(" - ")[0] for line in self.output.splitlines() if line.startswith(("FAILED", "ERROR")))
        return next(failed, f"exit {self.code}") if self.code else ""


@dataclass
class Copy:
    """A copy of the working tree, for one worker alone: its files, its caches, its temporary files.

    Python's compiled files are checked by hash: by time and size, a mutant of the same length within the same second
    would run as the module before it.
    """

    root: Path
    folder: Path
    usual: dict[tuple[tuple[str, ...], str], Run | None] = field(default_factory=dict)  # without a mutant

    @classmethod
    def of(cls, root: Path, folder: Path) -> Copy:
        """Copy what git tracks or would track, as it stands in the working tree."""
        listed = ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split("\0")
        for name in filter(None, names):
            if (root / name).is_file():
                target = folder / "tree" / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(root / name, target)
        (folder / "tmp").mkdir()
        compiling = [sys.executable, "-m", "compileall", "-q", "--invalidation-mode", "checked-hash"]
        subprocess.run([*compiling, "whiptool", "papers"], cwd=folder / "tree", check=True)
        return cls(root, folder)

    def survives(self, mutant: Mutant, tests: tuple[str, ...]) -> tuple[bool, str, float]:
        """Whether the tests pass on a mutant, what ended them ("timeout", or the first test that failed), and [s].

        Raises:
            Broken: They do not pass without it.
        """
        seconds = 0.0
        for which in STAGES:
            usual = self._usual(tests, which)
            if usual is None:
                continue
            limits = {"clock": GENEROUS * usual.seconds + SLACK, "processor": GENEROUS * usual.processor + SLACK}
            module = self.folder / "tree" / mutant.place.module
            original = module.read_text()
            module.write_text(mutant.code)
            try:
                run = self._run(tests, which, **limits)
            finally:
                module.write_text(original)
            seconds += run.seconds
            if run.code != 0:
                return False, run.ended_by, seconds
        return True, "", seconds

    def _usual(self, tests: tuple[str, ...], which: str) -> Run | None:
        """Result of tests without a mutant; None without tests of that mark."""
        if (tests, which) not in self.usual:
            run = self._run(tests, which, clock=3600.0, processor=3600.0)
            if run.code not in (0, NO_TESTS):
                tail = "\n".join(run.output.splitlines()[-15:])
                raise Broken(f"{' '.join(tests)}: pytest exits with {run.code} without a mutant\n{tail}")
            self.usual[tests, which] = run if run.code == 0 else None
        return self.usual[tests, which]

    def _run(self, tests: tuple[str, ...], which: str, *, clock: float, processor: float) -> Run:
        """Run tests within limits [s], which end them also where whoever started them was killed.

        The processor's limit is the one that counts: it is the same on a busy machine.
        """
        tree = self.folder / "tree"
        limits = ["timeout", "--kill-after=10", f"{clock:.0f}", "prlimit", f"--cpu={processor:.0f}"]
        pytest = [sys.executable, "-m", "pytest", "-x", "-q", "-m", which, "-p", "no:cacheprovider", *tests]
        surroundings = {
            **os.environ,
            **QUIET,
            "PYTHONPATH": str(tree),
            "PYTHONDONTWRITEBYTECODE": "1",
            "XDG_CACHE_HOME": str(self.folder / "cache"),
            "TMPDIR": str(self.folder / "tmp"),
            "WHIPTOOL_DATA": os.environ.get("WHIPTOOL_DATA", str(self.root.parent / "shared" / "data")),
        }
        started = time.monotonic()
        with (self.folder / "output.txt").open("w+") as output:
            process = subprocess.Popen([*limits, *pytest], cwd=tree, env=surroundings, stdout=output, stderr=output)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            output.seek(0)
            text = output.read()
        return Run(process.returncode, text, time.monotonic() - started, used.ru_utime + used.ru_stime)
