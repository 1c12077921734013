"""What an adaptation did: each strike with its plan, its outcome and what it taught, and all strikes together."""

from __future__ import annotations

from dataclasses import dataclass

from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.ports import Seen
from whiptool.adaptation.posterior import Learned
from whiptool.identification.film_judgement import Judgement
from whiptool.models.strike import Strike

_SHOWN = 5  # strikes that the representation of a whole adaptation shows, the last ones


@dataclass(frozen=True, repr=False)
class Step:
    """One strike: its plan, its outcome, and the belief after it.

    Args:
        number: Counted from 1; 0 is the measurement of the whip before the first strike.
        plan: The strike that was planned, and its predicted probability of a hit.
        outcome: The recording, and the miss distance that it shows.
        learned: The belief about the whip after this strike; None if the adaptation does not identify the whip.
        judged: The estimated miss distance with its standard error: from the belief and the camera if the recording was
            used for identification, else from the camera alone; the true path of a twin is not used. None: the tip was
            not seen.
    """

    number: int
    plan: Plan
    outcome: Seen
    learned: Learned | None
    judged: Judgement | None

    def __repr__(self) -> str:
        if not self.number:
            return "Step(first look at the whip)"
        verdict = "not seen" if self.judged is None else f"{self.judged.verdict}, {_millimetres(self)}"
        return f"Step(strike {self.number}: {verdict}; probability of a hit as planned {_planned(self)})"

    @property
    def strike(self) -> Strike:
        """The strike that was planned."""
        return Strike.from_vector(self.plan.strike)

    @property
    def hit(self) -> bool | None:
        """Whether a hit is claimed; None: the tip was not seen."""
        return None if self.judged is None else self.judged.hit


class Steps(list[Step]):
    """All steps of an adaptation in order, beginning with the measurement before the first strike, number 0, if any."""

    def __repr__(self) -> str:
        strikes = self.strikes
        if not strikes:
            return "Steps(0 strikes)"
        count = f"{len(strikes)} strike{'s' * (len(strikes) > 1)}, {sum(bool(s.hit) for s in strikes)} hit"
        of = "" if len(strikes) <= _SHOWN else f" of the last {_SHOWN}"
        misses = ", ".join(_millimetres(step) for step in strikes[-_SHOWN:])
        planned = ", ".join(_planned(step) for step in strikes[-_SHOWN:])
        return f"Steps({count}; misses{of}: {misses}; probability of a hit as planned: {planned})"

    @property
    def strikes(self) -> list[Step]:
        """The steps of strikes at the target: all except number 0, the measurement before the first strike."""
        return [step for step in self if step.number]


def percent(probability: float) -> str:
    """Return a probability as text in percent, never rounded to 0 % or 100 %."""
    if 0.995 <= probability < 1 or 0 < probability < 0.005:
        return "> 99 %" if probability > 0.5 else "< 1 %"
    return f"{100 * probability:.0f} %"


def _millimetres(step: Step) -> str:
    """The judged miss distance with its standard error."""
    judged = step.judged
    return "not seen" if judged is None else f"{1e3 * judged.miss:.0f} ± {1e3 * judged.error:.0f} mm"


def _planned(step: Step) -> str:
    """The probability of a hit that was stated before the strike."""
    return "unknown" if step.plan.probability is None else percent(step.plan.probability)
