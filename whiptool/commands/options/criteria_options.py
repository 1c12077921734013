"""Options of the criteria by which hits are ranked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from whiptool.commands.options.option_group import Condition, Conditions, Names, OptionGroup, unless
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.goals.criteria import Criterion
    from whiptool.models.strike import StrikeBounds

CriterionName = Annotated[str, Names("whiptool.goals.criteria:CRITERIA")]


@dataclass(frozen=True, kw_only=True)
class CriteriaOptions(OptionGroup):
    """Options for the criteria by which hits are ranked."""

    heading: ClassVar[str] = "search"
    first: ClassVar[tuple[str, ...]] = ("minimise",)
    only_with: ClassVar[Conditions] = {
        "minimise": unless("pareto"),
        "noise": Condition(
            "only with --minimise robustness or robustness in --pareto",
            lambda o: "robustness" in (o.minimise, *(o.pareto or ())),
        ),
    }

    minimise: CriterionName = "miss"
    """Criterion to minimise among hits (speed: maximise). miss: miss distance; effort: integral of the squared torques;
    peak-torque: largest torque; speed: that of the tip at the target; robustness: root mean square miss under noise.
    With any criterion other than miss the search continues after the first hit."""
    pareto: tuple[CriterionName, CriterionName] | None = None
    """Find the Pareto front of these two criteria among the hits, with derivatives."""
    noise: tuple[float, ...] = (0.01,)
    """Standard deviation of the noise on each coordinate of a strike [rad, s], for robustness; one value, or one per
    coordinate."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.goals.criteria import Robustness
        from whiptool.models.numbers import number

        super().check()
        if self.pareto is not None and self.pareto[0] == self.pareto[1]:
            raise InputError("--pareto", self.pareto, "two different criteria")
        for deviation in self.noise:
            number("--noise", deviation)
        Robustness(self.noise)

    @property
    def judged(self) -> bool:
        """Whether hits are ranked by a criterion other than the miss distance."""
        return self.pareto is not None or self.minimise != "miss"

    def build_criteria(self, bounds: StrikeBounds) -> tuple[Criterion, ...]:
        """Return the criteria: two for a Pareto front, one, or none if only the cost counts.

        Args:
            bounds: Bounds of the strikes.

        Raises:
            InputError: The noise does not fit them.
        """
        from whiptool.goals.criteria import find_criterion

        names = self.pareto or ((self.minimise,) if self.judged else ())
        return tuple(find_criterion(name, bounds, noise=self.noise) for name in names)
