"""One thing that was understood of a recording, with its reason and how certain it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

STATED, MEASURED, ASSUMED, DOUBTFUL = "stated", "measured", "assumed", "doubtful"


@dataclass(frozen=True)
class Finding:
    """One thing that was understood of a recording.

    Args:
        topic: What it is about, such as `clock`, `rate`, `axes` or `units`.
        value: What was understood, in words and with units.
        certainty: `stated` (a file says so), `measured` (computed from the data; the value has its standard error),
            `assumed` (nothing says so), or `doubtful` (the data contradict what was stated or assumed).
        reason: On what it rests.
        fix: What to write into the sidecar or to do, if something is to be done.
        numbers: The value as plain numbers and texts by name, in SI units, for programs.
    """

    topic: str
    value: str
    certainty: str = STATED
    reason: str = ""
    fix: str = ""
    numbers: Mapping[str, Any] = field(default_factory=dict)

    @property
    def table(self) -> dict[str, Any]:
        """The finding as plain data."""
        said = {name: getattr(self, name) for name in ("topic", "value", "certainty", "reason", "fix")}
        return said | {"numbers": dict(self.numbers)}
