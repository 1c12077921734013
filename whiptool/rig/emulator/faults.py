"""Faults that tests can inject into the emulated bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from whiptool.errors import InputError

Kind = Literal[
    "drop",  # a reply never comes
    "corrupt",  # a bit of a reply is flipped
    "late",  # a reply comes with the next one
    "split",  # a reply comes in two pieces
    "duplicate",  # a reply comes twice
    "lose",  # an instruction never arrives
    "unplug",  # the adapter is pulled out
    "dead",  # a servo loses power
    "hot",  # a servo gets too hot
    "stuck",  # an encoder stops
    "alert",  # a servo reports a hardware error that does not shut it down
]
OF_THE_LINE = ("drop", "corrupt", "late", "split", "duplicate", "lose")


@dataclass(frozen=True)
class Fault:
    """One fault of the emulated bus or of a servo.

    Args:
        kind: Kind of the fault.
        at: Simulated time from which it occurs [s].
        count: Number of packets that a fault of the bus affects.
        servo: Index of the servo that a fault affects, from 0.
        seed: Seed of the fault's random choices: which bit flips, where a reply is split.

    Raises:
        InputError: The kind is unknown.
    """

    kind: Kind
    at: float = 0.0
    count: int = 1
    servo: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError("fault", self.kind, ", ".join(get_args(Kind)))


def random_faults(rng: np.random.Generator, *, duration: float, servos: int, most: int = 3) -> list[Fault]:
    """Return up to `most` faults at random times within `duration` [s]."""
    kinds = get_args(Kind)
    return [
        Fault(
            kind=kinds[int(rng.integers(len(kinds)))],
            at=float(rng.uniform(0, duration)),
            count=int(rng.choice([1, 2, 10, 1000])),
            servo=int(rng.integers(servos)),
            seed=int(rng.integers(2**31)),
        )
        for _ in range(int(rng.integers(0, most + 1)))
    ]


class Faults:
    """The pending faults, and the active faults of the bus."""

    def __init__(self) -> None:
        self.waiting: list[Fault] = []
        self.line: list[tuple[Fault, int, np.random.Generator]] = []

    def add(self, fault: Fault) -> None:
        """Schedule a fault."""
        self.waiting.append(fault)

    def due(self, t: float) -> list[Fault]:
        """Return, once each, the faults due at time t [s]; those of the bus are activated here."""
        if not self.waiting:
            return []
        now = [f for f in self.waiting if f.at <= t + 1e-12]
        if now:
            self.waiting = [f for f in self.waiting if f.at > t + 1e-12]
            for fault in now:
                if fault.kind in OF_THE_LINE:
                    self.line.append((fault, fault.count, np.random.default_rng(fault.seed)))
        return [f for f in now if f.kind not in OF_THE_LINE]

    def strike(self, *, instruction: bool) -> tuple[str, np.random.Generator] | None:
        """Return the kind of the bus fault that affects the next packet, and the fault's random generator; None without
        a fault. `instruction` states whether the packet comes from the client.
        """
        for i, (fault, left, rng) in enumerate(self.line):
            if (fault.kind == "lose") == instruction:
                if left > 1:
                    self.line[i] = fault, left - 1, rng
                else:
                    del self.line[i]
                return fault.kind, rng
        return None


def mangle(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes with one random bit flipped."""
    at = int(rng.integers(len(data) * 8))
    return data[: at // 8] + bytes([data[at // 8] ^ 1 << at % 8]) + data[at // 8 + 1 :]
