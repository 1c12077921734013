"""Unknown whips, struck by the command `adapt`: on the paper's arm in the plane, and on a UR5e in space.

`python -m whiptool.reproduce adapt`, with `--space` for the UR5e.
"""

from __future__ import annotations

from papers.context import Context
from whiptool import default_controller, preset
from whiptool.viz.report import Section

__all__ = ["CONTROLLER", "MODEL", "SUBTITLE", "TITLE", "facts", "sections"]

MODEL = preset("lemon2024")
CONTROLLER = default_controller(MODEL)
TITLE = "Unknown whips, strike by strike"
SUBTITLE = (
    "Simulated whips of which the material alone is known, struck by runs of `python -m whiptool.adapt`: strike, film, "
    "identify again, plan again, until it hits."
)


def facts() -> dict[str, str]:
    """What was run, for the report's head."""
    from whiptool.runs import code_version

    return {
        "code": f"whiptool {code_version()}",
        "strikes, limits, effort, steps": "as the command has them by default",
    }


def sections(context: Context) -> list[Section]:
    """Hits by strike, misses, and whether the stated probabilities came true."""
    from papers.unknown import report

    return report.sections(context)
