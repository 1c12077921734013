"""Aimed strikes in the Cosserat oracle: the arm's motion swings a rod in PyElastica, not our chain."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from papers.aim.task import AimTask
from whiptool import WhipParameters, WhipProfile
from whiptool.comparison.units import Unit
from whiptool.errors import InputError
from whiptool.models.trajectory import closest_on_curve
from whiptool.rollout.cosserat import CosseratWhip, hand_path

ELEMENTS = 32  # of the finer rod; what `benchmarks/cosserat.py` has for this robot


def uniform_profile(whip: WhipParameters) -> WhipProfile:
    """Return the uniform profile of which a whip is the lumping.

    Raises:
        InputError: It is that of none.
    """
    link = float(whip.per_node("l")[-1])
    profile = WhipProfile(
        length=whip.length,
        linear_density=whip.mass / whip.length,
        bending_stiffness=float(whip.per_node("k")[-1]) * link,
        bending_damping=float(whip.per_node("b")[-1]) * link,
    )
    lumped = profile.lump(whip.N, joints=whip.joints)
    if not all(np.allclose(whip.per_node(x), lumped.per_node(x), rtol=1e-9) for x in ("l", "m", "k", "b")):
        raise InputError("whip", f"{whip.N} nodes", "the lumping of a uniform profile, for the Cosserat oracle")
    return profile


@dataclass(frozen=True, kw_only=True)
class OracleUnit(Unit):
    """Strikes of a task, played with a Cosserat rod.

    Args:
        task: Which they are of; its arm moves as commanded, whatever the whip does.
        goals: Which of its goals each is for, (B,).
        strikes: Strike vectors, (B, m).
    """

    task: AimTask
    goals: tuple[int, ...]
    strikes: tuple[tuple[float, ...], ...]

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Play them all at once.

        Returns:
            Of each strike, under `played`, whether it hits, its miss [m] and angle [rad], how far the rod's tip then is
            from ours [m], and by how much the extrapolation to infinitely many elements moved it [m].
        """
        task = self.task
        goals = task.goals().rows(np.array(self.goals))
        paths = list(task.striker(threads).rollout.trajectories(np.array(self.strikes), t_stay=task.t_stay))
        rod = CosseratWhip(uniform_profile(task.model.whip), elements=ELEMENTS, gravity=task.model.gravity)
        limits, finite = rod.limit([hand_path(task.model, path) for path in paths])
        played = []
        for i, path in enumerate(paths):
            watched = limits.t <= path.t[-1] + 1e-9  # others of the batch may last longer
            goal = goals.rows(np.array([i]))
            tip = CubicHermiteSpline(limits.t[watched], limits.tip[i, watched], limits.velocity[i, watched])
            at = closest_on_curve(tip, goal.positions[0], samples=int(watched.sum()))
            velocity, miss = tip(at, 1)[None], float(np.linalg.norm(tip(at) - goal.positions[0]))
            ours = np.array([np.interp(at, path.t, x) for x in path.tip.T])
            played.append(
                {
                    "hit": bool(goal.hit(np.array([miss]), velocity)[0]),
                    "miss": miss,
                    "angle": None if goal.directions is None else float(goal.angle(velocity)[0]),
                    "apart": float(np.linalg.norm(tip(at) - ours)),
                    "extrapolated": float(np.linalg.norm(tip(at) - finite.curve(i)(at))),
                }
            )
        return {"played": played}
