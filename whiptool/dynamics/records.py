"""Records of symbols, and the choice of their entries that the compiled code stores in columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, Protocol, TypeVar

import casadi as ca


class Record(Protocol):
    """A record of CasADi expressions, such as a frame or an articulated inertia."""

    def entries(self) -> list[ca.SX]:
        """All entries of the record as scalars."""
        ...

    def with_entries(self: R, entries: Sequence[ca.SX]) -> R:
        """Return the same record with other entries."""
        ...


R = TypeVar("R", bound=Record)


class Nothing:
    """An empty record."""

    def entries(self) -> list[ca.SX]:
        """Return an empty list, as this record has no entries."""
        return []

    def with_entries(self, entries: Sequence[ca.SX]) -> Nothing:
        """Return this record, as it has no entries to replace."""
        return self


class Stored(Generic[R]):
    """The entries of a record that the compiled code stores as variables, with their `symbols` (size, 1); the others
    are constants in the code. `record` has both, and `where` is each entry's index in `symbols`, None for a constant.
    """

    def __init__(self, record: R, where: Sequence[int | None], name: str) -> None:
        self.where = list(where)
        size = len({column for column in where if column is not None})
        self.symbols = ca.SX.sym(name, size)
        entries = [
            entry if i is None else self.symbols[i] for i, entry in zip(self.where, record.entries(), strict=True)
        ]
        self.record: R = record.with_entries(entries)

    @property
    def size(self) -> int:
        """The number of variables, which is the length of `symbols`."""
        return self.symbols.numel()

    def column(self, record: R) -> ca.SX:
        """Return the stored entries of a record in the order of `symbols`, (size, 1)."""
        found = dict(zip(reversed(self.where), reversed(record.entries())))
        return ca.vertcat(*(found[i] for i in range(self.size)))

    @classmethod
    def of(cls, record: R, name: str) -> Stored[R]:
        """Return the storage of the entries that are not constant; entries with equal expressions share a symbol."""
        different: list[ca.SX] = []
        where: list[int | None] = []
        for entry in record.entries():
            same = [i for i, x in enumerate(different) if ca.is_equal(x, entry)]
            if not same and not entry.is_constant():
                same = [len(different)]
                different.append(entry)
            where.append(same[0] if same else None)
        return cls(record, where, name)

    @classmethod
    def along(cls, start: R, name: str, follow: Callable[[R], R], *, always: Sequence[int] = ()) -> Stored[R]:
        """Return the storage of the entries that vary from link to link of a chain, are not constants, or are among
        `always`, by the first link's record `start` and the function `follow` from a record to the next link's. It
        leaves out those that are the same constant in the records of all links.
        """
        free = {i for i, x in enumerate(start.entries()) if not x.is_constant()} | set(always)
        while True:
            stored = cls(start, _numbered(free, len(start.entries())), name)
            after = follow(stored.record).entries()
            differs = {i for i, (x, y) in enumerate(zip(start.entries(), after, strict=True)) if not ca.is_equal(x, y)}
            if differs <= free:
                return stored
            free |= differs

    def needed(self, start: R, name: str, uses: Callable[[R], ca.SX], follow: Callable[[R], R]) -> Stored[R]:
        """Return the storage without variables that no result depends on; results are what `uses` takes of each record,
        from the first, `start`, to those that `follow` returns for the record before.
        """
        wanted, after = uses(self.record), self.column(follow(self.record))
        live: set[int] = set()
        while True:
            outputs = ca.vertcat(wanted, *(after[i] for i in sorted(live)))
            found = set(_columns(ca.jacobian_sparsity(outputs, self.symbols)))
            if found <= live:
                break
            live |= found
        where = [i if i in live else None for i in self.where]
        renumbered = {i: k for k, i in enumerate(sorted(live))}
        return Stored(start, [None if i is None else renumbered[i] for i in where], name)


def _numbered(chosen: set[int], count: int) -> list[int | None]:
    columns = {i: k for k, i in enumerate(sorted(chosen))}
    return [columns.get(i) for i in range(count)]


def _columns(sparsity: ca.Sparsity) -> list[int]:
    """Return which columns of a matrix are not empty."""
    starts = sparsity.colind()
    return [i for i in range(sparsity.size2()) if starts[i + 1] > starts[i]]
