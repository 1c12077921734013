"""A training that is followed by its table of episodes: its learning curve, and a strike of its best policy."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from whiptool.following.followed import Followed, GrowingFile
from whiptool.following.run_view import Chart, Chosen, Curve, RunView, ShownMotion
from whiptool.rl.trained import BEST, EPISODES, held_out_strike

_CHARTS = {  # title, unit, and the columns that are drawn together, with a name of each
    "reward": ("", {"mean_reward": "mean of the episode"}),
    "share of hits": ("", {"share_hit": "trials of the episode"}),
    "share of hits at held-out goals": ("", {"held_out_hit": "first strikes"}),
    "cost at held-out goals": ("m", {"held_out_cost": "mean of first strikes"}),
}
_COUNTS = ("number", "strikes", "diverged")


class FollowedTraining(Followed):
    """A run of `train`.

    Args:
        folder, heading: As for `Followed`.
        episodes: Number of episodes.
    """

    def __init__(self, folder: Path, heading: str, *, episodes: int) -> None:
        super().__init__(folder, heading)
        self._episodes, self._file = episodes, GrowingFile(folder / EPISODES)
        self._names: list[str] = []
        self._rows: list[dict[str, float]] = []

    def _read(self) -> bool:
        anew, lines = self._file.new_lines()
        if anew:
            self._names, self._rows = [], []
        for row in csv.reader(line.decode("utf-8", "replace") for line in lines):
            if self._names:
                self._rows.append({name: float(cell or "nan") for name, cell in zip(self._names, row, strict=True)})
            else:
                self._names = row
        return anew or bool(lines)

    def _view(self, finished: bool) -> RunView:
        facts = {"episodes": f"{len(self._rows)} of {self._episodes}"}
        chosen = None
        if self._rows:
            last = self._rows[-1]
            facts |= {"strikes": f"{last['strikes']:.0f}", "mean reward": f"{last['mean_reward']:.2f}"}
            facts |= {"hits of the last episode": f"{last['share_hit']:.0%}"}
            facts |= {"diverged": f"{last['diverged']:.0f}"} if last["diverged"] else {}
        scored = [row for row in self._rows if np.isfinite(row.get("held_out_hit", np.nan))]
        if scored and (self.folder / BEST).is_file():
            best = max(scored, key=lambda row: (row["held_out_hit"], -row["held_out_cost"]))
            number = int(best["number"])
            facts["best policy"] = f"of episode {number}: {best['held_out_hit']:.0%} of held-out goals"
            chosen = Chosen(number, f"best policy, of episode {number}, at its first held-out goal")
        return RunView(self.heading, finished, facts, tuple(self._charts()), chosen=chosen)

    def _charts(self) -> list[Chart]:
        """The learning curve, and the losses."""
        named = {column for _, columns in _CHARTS.values() for column in columns}
        losses = [name for name in self._names if name not in (*named, *_COUNTS)]
        charts = {**_CHARTS, "losses": ("", {name: name for name in losses})}
        found = []
        for title, (unit, columns) in charts.items():
            curves = [self._curve(column, name) for column, name in columns.items()]
            if drawn := tuple(curve for curve in curves if len(curve.x)):
                found.append(Chart(title, "episode", unit, drawn))
        return found

    def _curve(self, column: str, name: str) -> Curve:
        """A column where it has values."""
        x, y = (np.array([row.get(key, np.nan) for row in self._rows]) for key in ("number", column))
        known = np.isfinite(y)
        return Curve(name, x[known], y[known])

    def motion(self, chosen: Chosen) -> ShownMotion:
        policy, target, strike = held_out_strike(self.folder)
        rollout = policy.task.rollout
        return ShownMotion(rollout.model, rollout.trajectory(strike, t_stay=policy.task.t_stay), target)
