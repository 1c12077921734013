"""What a report's claims come to."""

from __future__ import annotations

from whiptool.viz.report import Claim


def verdicts(claims: list[Claim]) -> list[str]:
    return [claim.verdict for claim in claims]
