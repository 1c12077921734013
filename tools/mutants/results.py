"""What is kept of trials, and the table made of it."""

from __future__ import annotations

import hashlib
import json
import os
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from scipy.stats import binomtest

from tools.mutants.population import Mutant

GOAL = 0.9  # share of mutants that are not equivalent which the tests kill


@dataclass(frozen=True)
class Result:
    """One trial. `state` is a hash of the module and its tests; `by` is what ended it, empty for a survivor."""

    mutant: str
    state: str
    survived: bool
    by: str
    seconds: float


class Store:
    """Results in a file of JSON lines, each written at once; an incomplete line of a killed run is ignored."""

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = path.read_text().split("\n") if path.exists() else [""]
        self._known: dict[tuple[str, str], Result] = {}
        self._kills: dict[str, Result] = {}
        for line in lines[:-1]:
            try:
                self._take(Result(**json.loads(line)))
            except (ValueError, TypeError):
                continue  # an incomplete line that a later run went on behind

    def find(self, mutant: Mutant, state: str, *, keep_kills: bool) -> Result | None:
        """A mutant's result with this module and these tests; or, where kept, its kill by earlier tests."""
        known = self._known.get((mutant.name, state))
        return known or (self._kills.get(mutant.name) if keep_kills else None)

    def add(self, result: Result) -> None:
        """Write a result to the disk."""
        ragged = self.path.exists() and self.path.stat().st_size and not self.path.read_bytes().endswith(b"\n")
        with self.path.open("a") as file:
            file.write(("\n" if ragged else "") + json.dumps(asdict(result)) + "\n")
            file.flush()
            os.fsync(file.fileno())
        self._take(result)

    def _take(self, result: Result) -> None:
        self._known[result.mutant, result.state] = result
        if not result.survived:
            self._kills[result.mutant] = result


def state_of(root: Path, module: str, tests: Sequence[str]) -> str:
    """A hash of a module and of the tests named for it."""
    files = ((root / name).read_bytes() for name in (module, *tests))
    return hashlib.sha256(b"\0".join(files)).hexdigest()[:16]


def read_equivalents(path: Path) -> dict[tuple[str, str, str, str], str]:
    """The mutants that no test can kill, each with the reason."""
    entries = tomllib.loads(path.read_text()).get("equivalent", [])
    return {(x["module"], x["in"], x["was"], x["becomes"]): x["why"] for x in entries}


def table(rows: Sequence[tuple[str, int, int, int, Sequence[Result]]]) -> str:
    """One line a package: places, drawn mutants, equivalent ones, kills, their share and its 95 % interval.

    Args:
        rows: Package, places, drawn, equivalent, and the results of the others.
    """
    head = f"{'package':16}{'places':>8}{'drawn':>7}{'equiv.':>8}{'killed':>8}{'of':>5}{'by time':>9}{'share':>8}  95 %"
    lines = [head]
    for package, places, drawn, equivalent, results in rows:
        killed = sum(not result.survived for result in results)
        late = sum(result.by == "timeout" for result in results)
        line = f"{package:16}{places:8}{drawn:7}{equivalent:8}{killed:8}{len(results):5}{late:9}"
        lines.append(line + interval(killed, len(results)))
    return "\n".join(lines)


def interval(killed: int, count: int) -> str:
    """Share and Clopper-Pearson interval, for the end of a line."""
    if not count:
        return f"{'-':>8}"
    low, high = binomtest(killed, count).proportion_ci(0.95, method="exact")
    return f"{killed / count:8.2f}  {low:.2f} to {high:.2f}"


def total(rows: Iterable[tuple[str, int, int, int, Sequence[Result]]]) -> tuple[str, int, int, int, list[Result]]:
    """The sum of all rows, as a row."""
    rows = list(rows)
    places, drawn, equivalent = (sum(row[i] for row in rows) for i in (1, 2, 3))
    return "all", places, drawn, equivalent, [result for row in rows for result in row[4]]
