"""Faults that tests can inject into the emulated bus."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.models.numbers import LARGEST, MOST, number, whole

KINDS: dict[str, tuple[str, ...]] = {  # the values besides `at` that each kind of fault takes
    "drop": ("count",),  # a reply never comes
    "corrupt": ("count", "seed"),  # a bit of a reply is flipped
    "late": ("count",),  # a reply comes with the next one
    "split": ("count", "seed"),  # a reply comes in two pieces
    "duplicate": ("count",),  # a reply comes twice
    "lose": ("count",),  # an instruction never arrives
    "unplug": (),  # the adapter is pulled out
    "dead": ("servo",),  # a servo loses power
    "hot": ("servo",),  # a servo gets too hot
    "stuck": ("servo",),  # an encoder stops
    "flicker": ("servo",),  # an encoder stops, and its reading flickers by a count
    "jump": ("servo", "angle", "lasting"),  # an encoder's reading jumps
    "alert": ("servo",),  # a servo reports a hardware error that does not shut it down
    "sag": ("volts", "lasting"),  # the supply of all servos sags
    "reboot": ("servo",),  # a servo reboots by itself
    "same_id": ("servo",),  # a servo has the id of the one before it, so that both answer at once
}
RANGES: dict[str, tuple[type, float, float]] = {
    "at": (float, 0.0, LARGEST),
    "count": (int, 1, MOST),
    "servo": (int, 0, 252),
    "seed": (int, 0, MOST),
    "volts": (float, 0.1, 24.0),
    "angle": (float, -2 * math.pi, 2 * math.pi),
    "lasting": (float, 1e-3, LARGEST),
}
OF_THE_LINE = ("drop", "corrupt", "late", "split", "duplicate", "lose")


@dataclass(frozen=True)
class Fault:
    """One fault of the emulated bus or of a servo.

    Args:
        kind: Kind of the fault: `drop`, `corrupt`, `dead`, ...; the comments in `KINDS` say what each does, and
            `RANGES` the least and largest of the other values.
        at: Simulated time from which it occurs [s].
        count: Number of packets that a fault of the bus affects.
        servo: Index of the servo that a fault affects, from 0.
        seed: Seed of the fault's random choices: which bit flips, where a reply is split.
        volts: Voltage to which the supply sags [V].
        angle: Angle by which an encoder's reading jumps [rad].
        lasting: Time after which the supply, or an encoder that jumped, is as before [s]; default: it stays.

    Raises:
        InputError: The kind is unknown, or a value is out of range.
    """

    kind: str
    at: float = 0.0
    count: int = 1
    servo: int = 0
    seed: int = 0
    volts: float = 8.0
    angle: float = 0.3
    lasting: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError("fault", self.kind, ", ".join(KINDS))
        for name, (kind, low, high) in RANGES.items():
            value = getattr(self, name)
            if kind is int:
                object.__setattr__(self, name, whole(name, value, low=int(low), high=int(high)))
            elif value is not None:
                object.__setattr__(self, name, number(name, value, low=low, high=high))

    @classmethod
    def parse(cls, text: str) -> Fault:
        """Return the fault that a text such as `sag:at=2:volts=8:lasting=0.5` describes: its kind, then other values by
        name.

        Raises:
            InputError: The text describes no fault, or a value that the kind does not take; the message names those.
        """
        kind, *rest = text.split(":")
        values: dict[str, Any] = {}
        taken = ("at", *KINDS.get(kind, ()))
        for item in rest if kind in KINDS else ():
            name, _, value = item.partition("=")
            try:
                number_in(value)
                if name in values or name not in taken:
                    raise ValueError
                values[name] = RANGES[name][0](value)
            except ValueError:
                allowed = f"{kind}:NAME=NUMBER:.. with any of {', '.join(taken)} as names, each once"
                raise InputError("fault", text, allowed) from None
        return cls(kind, **values)

    def check_servo(self, servos: int) -> None:
        """Refuse a fault of a servo that is not there.

        Raises:
            InputError: There are only `servos` servos, or, for a fault of two, only one.
        """
        whole("servo of the fault", self.servo, low=0, high=servos - 1)
        if self.kind == "same_id" and servos < 2:
            raise InputError("fault", self.kind, "a fault of one servo, as there is one")


def random_faults(rng: np.random.Generator, *, duration: float, servos: int, most: int = 3) -> list[Fault]:
    """Return up to `most` faults at random times within `duration` [s]."""
    kinds = list(KINDS)
    return [
        Fault(
            kind=kinds[int(rng.integers(len(kinds)))],
            at=float(rng.uniform(0, duration)),
            count=int(rng.choice([1, 2, 10, 1000])),
            servo=int(rng.integers(servos)),
            seed=int(rng.integers(2**31)),
            volts=float(rng.uniform(6.0, 11.0)),
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
