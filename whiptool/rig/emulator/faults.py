"""Faults that tests can inject into the emulated bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.models.numbers import number, whole

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
    "flicker",  # an encoder stops, and its reading flickers by a count
    "jump",  # an encoder's reading jumps
    "alert",  # a servo reports a hardware error that does not shut it down
    "sag",  # the supply of all servos sags
    "reboot",  # a servo reboots by itself
    "same_id",  # a servo has the id of the one before it, so that both answer at once
]
OF_THE_LINE = ("drop", "corrupt", "late", "split", "duplicate", "lose")


@dataclass(frozen=True)
class Fault:
    """One fault of the emulated bus or of a servo.

    Args:
        kind: Kind of the fault: `drop`, `corrupt`, `dead`, ...; the comments in `Kind` say what each does.
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

    kind: Kind
    at: float = 0.0
    count: int = 1
    servo: int = 0
    seed: int = 0
    volts: float = 8.0
    angle: float = 0.3
    lasting: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError("fault", self.kind, ", ".join(get_args(Kind)))
        number("at", self.at, low=0)
        number("volts", self.volts, low=0, strict=True)
        object.__setattr__(self, "angle", number("angle", self.angle))
        if self.lasting is not None:
            number("lasting", self.lasting, low=0, strict=True)
        for name in ("count", "servo", "seed"):
            object.__setattr__(self, name, whole(name, getattr(self, name), low=int(name == "count")))

    @classmethod
    def parse(cls, text: str) -> Fault:
        """Return the fault that a text such as `sag:at=2:volts=8:lasting=0.5` describes: its kind, then other values by
        name.

        Raises:
            InputError: The text describes no fault; the message names what it may hold.
        """
        kind, *rest = text.split(":")
        types = {"at": float, "count": int, "servo": int, "seed": int, "volts": float, "angle": float, "lasting": float}
        values: dict[str, Any] = {}
        for item in rest:
            name, _, value = item.partition("=")
            try:
                number_in(value)
                values[name] = types[name](value)
            except (KeyError, ValueError):
                allowed = f"KIND:NAME=NUMBER:.. with any of {', '.join(types)} as names"
                raise InputError("fault", text, allowed) from None
        return cls(cast(Kind, kind), **values)

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
    kinds = get_args(Kind)
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
