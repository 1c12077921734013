"""The building of a strike map that is followed by its parts: how many answers it has, and where they hit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from whiptool.following.followed import Followed
from whiptool.following.run_view import Chart, Chosen, Curve, RunView, ShownMotion
from whiptool.goals.target import Target
from whiptool.models.strike import Strike
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.building import Building
from whiptool.strike_map.map_files import load_parts

_SHOWN = 3000  # answers whose places are shown, spread over all


class FollowedMap(Followed):
    """A run of `map build`.

    Args:
        folder, heading: As for `Followed`.
        building: What is built, before its first part.
    """

    def __init__(self, folder: Path, heading: str, building: Building) -> None:
        super().__init__(folder, heading)
        self._building = building
        self._parts: list[Answers] = []

    def _read(self) -> bool:
        new = load_parts(self.folder, self._building.plan.parts, first=len(self._parts))
        self._parts += new
        return bool(new)

    def _view(self, finished: bool) -> RunView:
        counts, plan = np.array([len(part) for part in self._parts], int), self._building.plan
        facts = {"parts": f"{len(counts)} of {plan.parts}", "answers": str(counts.sum())}
        if not len(counts):
            return RunView(self.heading, finished, facts, ())
        x = np.arange(1, len(counts) + 1)
        curves = (Curve("in all", x, counts.cumsum()), Curve("of the part", x, counts))
        answers = Answers.joined(self._parts)
        rows = np.unique(np.linspace(0, len(answers) - 1, _SHOWN).astype(int)) if len(answers) else []
        chosen = self._chosen(len(counts))
        return RunView(
            self.heading,
            finished,
            facts,
            (Chart("answers", "part", "", curves),),
            {"places that answers hit": answers.tips[rows]},
            chosen,
        )

    def _chosen(self, parts: int) -> Chosen | None:
        """The last answer of the last part that has one."""
        last = next((part for part in reversed(self._parts) if len(part)), None)
        if last is None:
            return None
        return Chosen(parts, "last answer, at the place that it hits", tuple(map(float, last.strikes[-1])))

    def motion(self, chosen: Chosen) -> ShownMotion:
        last = next(part for part in reversed(self._parts) if len(part))
        row = int(np.flatnonzero((last.strikes == np.array(chosen.vector)).all(axis=1))[-1])
        striker = self._building.striker
        target = Target(tuple(map(float, last.tips[row])), hit_radius=self._building.region.hit_radius)
        trajectory = striker.rollout.trajectory(Strike.from_vector(chosen.vector), t_stay=striker.t_stay)
        return ShownMotion(striker.rollout.model, trajectory, target)
