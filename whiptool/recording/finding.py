"""One thing that was understood of a recording, with its reason and how certain it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

STATED, MEASURED, ASSUMED, DOUBTFUL = "stated", "measured", "assumed", "doubtful"


@dataclass(frozen=True)
class Finding:
    """One thing that was understood of a recording.

    Its certainty is `stated` (a file says so), `measured` (computed from the data; the value has its standard error),
    `assumed` (nothing says so), or `doubtful` (the data contradict what was stated or assumed).
    """

    topic: str  # what it is about, such as `clock`, `rate`, `axes` or `units`
    value: str  # what was understood, in words and with units
    certainty: str = STATED
    reason: str = ""  # on what it rests
    fix: str = ""  # what to write into the sidecar or to do, if something is to be done
    numbers: Mapping[str, Any] = field(default_factory=dict)  # the value in SI units, for programs

    @property
    def table(self) -> dict[str, Any]:
        """The finding as plain data."""
        said = {name: getattr(self, name) for name in ("topic", "value", "certainty", "reason", "fix")}
        return said | {"numbers": dict(self.numbers)}
