"""The learners' task with an arm of one joint."""

from __future__ import annotations

from functools import cache

from whiptool.goals.arrival_rule import GoalRegion
from whiptool.goals.target import HIT_RADIUS
from whiptool.goals.zone import Disc
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import ArmLink, ArmParameters, Model, WhipParameters
from whiptool.models.strike import StrikeBounds
from whiptool.rl.task import StrikeTask
from whiptool.rollout import CompiledRollout


@cache
def one_joint() -> CompiledRollout:
    """Compiled when it is first asked for, and not by every process that collects tests."""
    model = Model(
        whip=WhipParameters(N=3, l=0.15, m=0.02, k=0.2, b=0.05), arm=ArmParameters((ArmLink(mass=0.3, length=0.5),))
    )
    return CompiledRollout(model, Controller(ConstantImpedance(K=((30.0,),), B=((3.0,),))), timestep=1e-3)


def one_joint_task(*, hit_radius: float = HIT_RADIUS, **options) -> StrikeTask:
    """Three numbers, q_1i, q_1f and D, and targets that one strike in six hits by chance."""
    bounds = StrikeBounds((-1.2, 0.3, 0.3), (0.0, 2.8, 1.0))
    region = GoalRegion(Disc((0.75, 0.0), 0.15), hit_radius=hit_radius)
    return StrikeTask(one_joint(), region, bounds=bounds, **options)
