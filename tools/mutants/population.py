"""All places where a module's formulas can be changed, and a seeded sample of mutants."""

from __future__ import annotations

import ast
import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path

from cosmic_ray.ast import Visitor, get_ast
from cosmic_ray.mutating import MutationVisitor

from tools.mutants.formulas import Span, left_out, scopes, within
from tools.mutants.operators import operators

OPERATORS = operators()


@dataclass(frozen=True)
class Place:
    """One place of one module, with the changes that apply to it.

    Args:
        module: Path of the module from the repository's root.
        scope: Qualified name of the function or class around it, empty for the module itself.
        line: The line, without indentation, and `column`, where in it the place begins.
        nth: Counts what is alike in all of these, from 0.
        number: The line's number in the present source.
        changes: Operators, each with the occurrence by which cosmic-ray finds the place again in the present source.
    """

    module: str
    scope: str
    line: str
    column: int
    nth: int
    number: int
    changes: tuple[tuple[str, int], ...]

    @property
    def key(self) -> tuple:
        """What stays when lines elsewhere in the file come and go."""
        return self.module, self.scope, self.line, self.column, self.nth


@dataclass(frozen=True)
class Mutant:
    """A module with one change; `was` and `becomes` are the statement's changed lines, spaces collapsed."""

    place: Place
    change: str
    was: str
    becomes: str
    code: str

    @property
    def name(self) -> str:
        """The same for as long as its line stays as it is."""
        return hashlib.sha256(repr((self.place.key, self.change, self.becomes)).encode()).hexdigest()[:16]

    @property
    def identity(self) -> tuple[str, str, str, str]:
        """As the list of equivalent mutants has it."""
        return self.place.module, self.place.scope, self.was, self.becomes


class _Places(Visitor):
    """Collects where each operator applies, outside the spans that are left out."""

    def __init__(self, spans: list[Span]) -> None:
        self.spans, self.counts = spans, Counter()
        self.found: dict[Span, list[tuple[str, int]]] = defaultdict(list)

    def visit(self, node):
        for name, operator in OPERATORS.items():
            for start, end in operator.mutation_positions(node):
                if not within(start, self.spans):
                    self.found[start, end].append((name, self.counts[name]))
                self.counts[name] += 1
        return node


@cache
def places(root: Path, module: str) -> tuple[Place, ...]:
    """Every place of a module's formulas that some operator changes, in the order of the source."""
    source = (root / module).read_text()
    visitor = _Places(left_out(source))
    visitor.walk(get_ast(source))
    named, lines = scopes(source), source.splitlines()
    alike: Counter = Counter()
    found = []
    for (start, end), changes in sorted(visitor.found.items()):
        scope = next((label for span, label in reversed(named) if within(start, [span])), "")
        line = lines[start[0] - 1]
        column = start[1] - (len(line) - len(line.lstrip()))
        key = (scope, line.strip(), column, end)
        found.append(Place(module, scope, line.strip(), column, alike[key[:3]], start[0], tuple(changes)))
        alike[key[:3]] += 1
    return tuple(found)


def mutate(root: Path, place: Place, change: tuple[str, int]) -> Mutant | None:
    """The module with one change; none where the change leaves no program, or the same one."""
    source = (root / place.module).read_text()
    name, occurrence = change
    code = MutationVisitor.mutate_code(source, OPERATORS[name], occurrence)
    try:
        if code is None or ast.dump(ast.parse(code)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    return Mutant(place, name, *_changed(source, code), code)


def sample(root: Path, modules: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Mutants at `count` places of the modules, drawn without replacement, one at each place.

    The order is that of a hash of seed and place, so that a larger sample holds the smaller one and a change in one
    module moves no draw in another.
    """

    def draw(*key) -> bytes:
        return hashlib.sha256(repr((seed, *key)).encode()).digest()

    def drawn() -> Iterator[Mutant]:
        found = [place for module in modules for place in places(root, module)]
        for place in sorted(found, key=lambda place: draw(place.key)):
            changes = sorted(enumerate(place.changes), key=lambda item: draw(place.key, item[0], item[1][0]))
            mutants = (mutate(root, place, change) for _, change in changes)
            yield from islice((mutant for mutant in mutants if mutant is not None), 1)

    return list(islice(drawn(), count))


def _changed(source: str, code: str) -> tuple[str, str]:
    """The lines that differ; a mutant changes one place, hence one stretch of lines."""
    old, new = source.splitlines(), code.splitlines()
    first = next(i for i, (a, b) in enumerate(zip(old, new)) if a != b)
    last = next(i for i, (a, b) in enumerate(zip(reversed(old), reversed(new))) if a != b)
    was, becomes = (" ".join(" ".join(lines[first : len(lines) - last]).split()) for lines in (old, new))
    return was, becomes
