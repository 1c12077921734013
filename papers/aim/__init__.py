"""Aimed strikes: a point, an arrival angle and a speed, from a strike map, compared with "Point It, Strike It" (2026).

`python -m whiptool.reproduce aim`. Where goals are drawn is theirs; the robot's limits are those of its maker.
"""

from __future__ import annotations

from papers.aim.published import CONTROLLER, MODEL
from papers.context import Context
from whiptool.rollout.batch import TOLERANCE
from whiptool.viz.report import Section

__all__ = ["CONTROLLER", "MODEL", "SUBTITLE", "TITLE", "facts", "sections"]

TITLE = "Aimed strikes: a point and a direction, in one shot"
SUBTITLE = (
    "A UR5e with a stick and a rope strikes points at arrival angles, from a map of strikes and after refinement, "
    'compared with "Point It, Strike It" (2026), in whose region the goals are drawn.'
)


def facts() -> dict[str, str]:
    """What was run, for the report's head."""
    from whiptool.runs import code_version

    return {
        "code": f"whiptool {code_version()}",
        "model": f"{MODEL.name}: stick of 0.65 m, rope of 1 m in {MODEL.whip.N} rods; joints on their reference "
        f"(position control), distances right to {1e3 * TOLERANCE:g} mm",
        "goals": "1.6 to 2.3 m from the base, 1.4 m below it to 0.8 m above, up to 30 degrees to either side; arrival "
        "angles from the full turn; within 5 cm and 10 degrees, at 1 m/s or more along the direction",
        "limits": "of the joints: position, velocity, acceleration, jerk, torque and its change, as far as the arm's "
        "maker tells them; arm, whip and floor keep clear of each other",
    }


def sections(context: Context) -> list[Section]:
    """The UR5e's goals and the published figures, where they are missed, and the planar hard task."""
    from papers.aim import report

    return report.sections(context)
