"""An adaptation that is followed by its strikes: how they miss, and how the belief about the whip narrows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.adaptation.adapter import JUDGED, OUTCOME, PLAN, POSTERIOR, RECORDING, strike_folder
from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.following.followed import Followed
from whiptool.following.run_view import Chart, Chosen, Curve, RunView, ShownMotion
from whiptool.given_files import read_json
from whiptool.goals.target import Target
from whiptool.identification.variables import with_unit
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

SHOWN = 6  # numbers of the belief that are shown, those that narrowed most
_FILES = (PLAN, OUTCOME, POSTERIOR, JUDGED)


@dataclass(frozen=True)
class _Read:
    """What a strike's folder holds so far; a table is empty while its file is missing."""

    number: int
    plan: Mapping[str, Any]
    outcome: Mapping[str, Any]
    posterior: Mapping[str, Any]
    judged: Mapping[str, Any]

    @property
    def complete(self) -> bool:
        """Whether nothing more is awaited: each file is written once, the judgement last."""
        return bool(self.judged)


class FollowedAdaptation(Followed):
    """A run of `adapt`.

    Args:
        folder, heading: As for `Followed`.
        prior: Belief before the first strike.
        target: Target of the strikes.
        t_stay: Time after a strike's end for which it is watched [s].
        budget: Largest number of strikes.
    """

    def __init__(
        self, folder: Path, heading: str, prior: Belief, target: Target, *, t_stay: float, budget: int
    ) -> None:
        super().__init__(folder, heading)
        self._prior, self._target, self._t_stay, self._budget = prior, target, t_stay, budget
        self._steps: dict[int, _Read] = {}
        self._beliefs: dict[int, Belief] = {}

    def _read(self) -> bool:
        """Read the folders of strikes that were not complete, up to the first that is missing."""
        new = False
        number = max((n for n, step in self._steps.items() if step.complete), default=-1) + 1
        while number <= self._budget:
            place = strike_folder(self.folder, number)
            tables = [read_json(place / name) if (place / name).is_file() else {} for name in _FILES]
            if not any(tables) and number > 0:  # the measurement before the first strike may be left out
                break
            step = _Read(number, *tables)
            if any(tables) and step != self._steps.get(number):
                new, self._steps[number] = True, step
                if step.posterior:
                    self._beliefs[number] = Belief.from_table(self._prior.plant, step.posterior)
            number += 1
        return new

    def _belief_after(self, number: int) -> Belief:
        """The belief after a strike, or after the last one before it that was learned from."""
        learned = [n for n in self._beliefs if n <= number]
        return self._beliefs[max(learned)] if learned else self._prior

    def _view(self, finished: bool) -> RunView:
        strikes = [step for number, step in sorted(self._steps.items()) if number]
        made = [step for step in strikes if step.outcome]
        facts = {"strikes": f"{len(made)} of at most {self._budget}"}
        if strikes and (chance := strikes[-1].plan.get("probability")) is not None:
            facts["planned chance to hit"] = f"{chance:.0%}"
        if made and (judged := made[-1].judged).get("miss") is not None:
            facts["last miss"] = f"{1e3 * judged['miss']:.3g} ± {1e3 * judged['error']:.2g} mm"
            facts["chance that it hit"] = f"{judged['probability']:.0%}"
        last = max(self._steps, default=None)
        facts |= self._narrowed_facts()
        charts = tuple(chart for chart in (self._misses(made), self._narrowing()) if chart is not None)
        if last is None:
            return RunView(self.heading, finished, facts, charts)
        which = f"strike {last}" if last else "first look at the whip"
        said, vector = f"{which}, with the whip as it is estimated now", tuple(self._steps[last].plan["strike"])
        chosen = Chosen(last, said, vector, state=len(self._beliefs))
        return RunView(self.heading, finished, facts, charts, self._recorded(last), chosen)

    def _misses(self, made: list[_Read]) -> Chart | None:
        """The miss of each strike, as judged and as a twin knows it."""
        x = np.array([step.number for step in made])
        found = []
        for name, values in {
            "estimated": [step.judged.get("miss") for step in made],
            "in the camera's frames": [step.outcome.get("seen_miss") for step in made],
            "true, of a twin": [step.outcome.get("true_miss") for step in made],
        }.items():
            y = np.array([math.nan if value is None else value for value in values])
            found += [Curve(name, x[np.isfinite(y)], y[np.isfinite(y)])] if np.isfinite(y).any() else []
        return Chart("miss distance", "strike", "m", tuple(found), logarithmic=True) if found else None

    def _shown(self) -> list[str]:
        """Numbers of the belief, those first that narrowed most."""
        before, after = self._prior.errors(), self._belief_after(max(self._steps, default=0)).errors()
        return sorted(after, key=lambda name: after[name] / before.get(name, math.inf))[:SHOWN]

    def _narrowing(self) -> Chart | None:
        """Standard errors in parts of those of the prior."""
        if not self._beliefs:
            return None
        x = np.array(sorted(self._beliefs))
        before = self._prior.errors()
        curves = []
        for name in self._shown():
            errors = [self._beliefs[number].errors()[name] for number in x]
            curves.append(Curve(name, np.r_[x[0] - 1, x], np.r_[100.0, 100 * np.array(errors) / before[name]]))
        return Chart("standard error, prior = 100 %", "strike", "", tuple(curves), logarithmic=True)

    def _narrowed_facts(self) -> dict[str, str]:
        """Values of the numbers that narrowed most, with their standard errors."""
        if not self._beliefs:
            return {}
        belief = self._beliefs[max(self._beliefs)]
        values, errors, found = belief.values(), belief.errors(), {}
        for v in (v for name in self._shown() for v in belief.variables if v.name == name):
            error = f"{100 * errors[v.name]:.2g} %" if v.log else with_unit(errors[v.name], v.unit, 2)
            found[v.name] = f"{with_unit(values[v.name], v.unit, 3)} ± {error}"
        return found

    def _recorded(self, number: int) -> dict[str, np.ndarray]:
        """The tip as a strike's camera saw it."""
        path = strike_folder(self.folder, number) / RECORDING
        if not path.is_file():
            return {}
        recording = StrikeRecording.load(path)
        if "tip" not in recording.markers:
            return {}
        seen = recording.marker("tip")
        return {"tip, as recorded": seen[np.isfinite(seen).all(axis=1)]}

    def motion(self, chosen: Chosen) -> ShownMotion:
        belief = self._belief_after(chosen.number)
        plant, path = belief.at(), strike_folder(self.folder, chosen.number) / RECORDING
        assert plant.controller is not None
        stood = StrikeRecording.load(path).stood if path.is_file() else None
        rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief), sag=stood)
        trajectory = rollout.trajectory(Strike.from_vector(chosen.vector), t_stay=self._t_stay)
        return ShownMotion(plant.model, trajectory, self._target)
