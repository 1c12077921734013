"""The parts of `python -m whiptool.reproduce`, one function each: from a context to the sections of a report.

A further one is added to `PARTS`, and, unless it takes hours, to `ALL`. `nah2023` is another paper,
`adapt`, `aim`, `spaces` and `crack` are other tasks, each with its own models.
"""

from __future__ import annotations

from collections.abc import Callable

from papers import aim, crack, nah2023, unknown
from papers.aim import spaces
from papers.context import Context
from papers.lemon2024 import fig5, fig6, fig7, hard, sim2real, table4
from whiptool.viz.report import Section

__all__ = ["ALL", "PARTS", "Context"]

PARTS: dict[str, Callable[[Context], list[Section]]] = {
    "fig5": fig5.sections,
    "fig6": fig6.sections,
    "fig7": fig7.sections,
    "table4": table4.sections,
    "hard": hard.sections,
    "sim2real": sim2real.sections,
    "adapt": unknown.sections,
    "nah2023": nah2023.sections,
    "aim": aim.sections,
    "spaces": spaces.sections,
    "crack": crack.sections,
}
ALL = ("fig5", "fig6", "fig7", "table4", "hard", "sim2real")
