"""A search that is followed by its log of trials: how it converges, and its best strike so far."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.following.followed import Followed, GrowingFile
from whiptool.following.run_view import Chart, Chosen, Curve, RunView, ShownMotion
from whiptool.goals.criteria import CRITERIA
from whiptool.goals.target import Target
from whiptool.objective import Trial
from whiptool.optimizers.trial_log import TRIALS, TrialColumns
from whiptool.rollout.interface import Rollout
from whiptool.words import counted

SHOWN = 500  # trials whose closest points are shown, the last ones


class FollowedSearch(Followed):
    """A run of `optimize`.

    Args:
        folder, heading: As for `Followed`.
        rollout: Simulator with which the best strike is played.
        target: Target of the search.
        t_stay: Time after a strike's end for which it is watched [s].
        budget: Largest number of trials.
    """

    def __init__(
        self, folder: Path, heading: str, rollout: Rollout, target: Target, *, t_stay: float, budget: int
    ) -> None:
        super().__init__(folder, heading)
        self._rollout, self._target, self._t_stay, self._budget = rollout, target, t_stay, budget
        self._file = GrowingFile(folder / TRIALS)
        self._forget()

    def _forget(self) -> None:
        self._columns: TrialColumns | None = None
        self._best: list[Trial] = []  # each better than those before it
        self._misses: list[float] = []
        self._tips: list[tuple[float, ...]] = []
        self._status: Counter[str] = Counter()

    def _read(self) -> bool:
        anew, lines = self._file.new_lines()
        if anew:
            self._forget()
        for line in lines:
            self._take(line)
        return anew or bool(lines)

    def _take(self, line: bytes) -> None:
        """Add the trial of a line, or take the names of the columns from the first line."""
        if self._columns is None:
            try:
                self._columns = TrialColumns.named(line.decode("utf-8", "replace").split(","))
            except ValueError as error:
                raise InputError(str(self._file.path), str(line[:80]), "a log of trials", str(error)) from None
            return
        trial = self._columns.trial(line)
        if trial is None:
            raise InputError(str(self._file.path), str(line[:80]), "a line that holds a trial")
        outcome = trial.outcome
        if not self._best or outcome.cost < self._best[-1].outcome.cost:
            self._best.append(trial)
        self._misses.append(math.nan if outcome.known_miss is None else outcome.known_miss)
        self._status[outcome.status] += 1
        if not outcome.lost:
            self._tips = [*self._tips[1 - SHOWN :], outcome.tip]

    def _view(self, finished: bool) -> RunView:
        best = self._best[-1] if self._best else None
        made = len(self._misses)
        facts = {"trials": f"{made} of at most {self._budget}"}
        facts |= {status: str(count) for status, count in self._status.items() if status not in ("hit", "miss")}
        chosen = None
        if best is not None and not best.outcome.lost:
            verdict = "hits" if best.outcome.hit else "misses"
            facts["best trial"] = f"{best.number}, {verdict}: {_millimetres(best.outcome.miss_distance)}"
            facts["tip speed"] = f"{best.outcome.tip_speed:.3g} m/s"
            chosen = Chosen(best.number, f"best of {counted(made, 'trial')}", best.strike)
        points = {"closest points of the last trials": np.array(self._tips)} if self._tips else {}
        return RunView(self.heading, finished, facts, tuple(self._charts(made)), points, chosen)

    def _charts(self, made: int) -> list[Chart]:
        """How the search converged: what it minimises, and what else is asked for, of the best trial so far."""
        best = [trial.outcome for trial in self._best if not trial.outcome.lost]
        if not best:
            return []
        x = np.arange(1, made + 1)
        misses = self._stairs([outcome.miss_distance for outcome in best], made)
        found = [Chart("miss distance", "trial", "m", (Curve("each trial", x, np.array(self._misses)), misses), True)]
        if arrivals := [outcome.arrival for outcome in best if outcome.arrival is not None]:
            costs = self._stairs([arrival.cost for arrival in arrivals], made)
            found.append(Chart("cost of miss and arrival", "trial", "m", (costs,), True))
            if arrivals[-1].angle is not None:
                angles = [math.degrees(arrival.angle or 0.0) for arrival in arrivals]
                found.append(Chart("angle of arrival", "trial", "deg", (self._stairs(angles, made),)))
        criteria = [] if self._columns is None else self._columns.parts.get("values", [])
        for i, name in enumerate(criteria):
            values = [outcome.values[i] if outcome.values else math.nan for outcome in best]
            found.append(Chart(name, "trial", CRITERIA.find(name).unit, (self._stairs(values, made),)))
        return found

    def _stairs(self, values: list[float], made: int) -> Curve:
        """A value of the best trial at every trial, which stays until a better trial is made."""
        starts = np.array([trial.number for trial in self._best if not trial.outcome.lost])
        x = np.arange(starts[0], made + 1)
        return Curve("best so far", x, np.array(values)[np.searchsorted(starts, x, side="right") - 1])

    def motion(self, chosen: Chosen) -> ShownMotion:
        strike = self._rollout.space.strike(np.array(chosen.vector))
        return ShownMotion(self._rollout.model, self._rollout.trajectory(strike, t_stay=self._t_stay), self._target)


def _millimetres(miss: float) -> str:
    return f"{1e3 * miss:.3g} mm" if miss >= 1e-5 else "< 0.01 mm"
