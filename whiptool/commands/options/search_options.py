"""Options of searches and trainings: methods, bounds, numbers of trials and episodes, and criteria."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from whiptool.commands.options.option_group import (
    MANY_TARGETS,
    Condition,
    Conditions,
    Count,
    Interval,
    Names,
    OptionGroup,
    Ranges,
    unless,
)
from whiptool.errors import InputError
from whiptool.words import method_name

if TYPE_CHECKING:
    from whiptool.goals.criteria import Criterion
    from whiptool.impedance.controller import Controller
    from whiptool.limits.all_limits import AllLimits
    from whiptool.models.hand_space import StrikeSpace
    from whiptool.models.parameters import Model
    from whiptool.models.strike import StrikeBounds

Learner = Annotated[str, Names("whiptool.rl.settings:SETTINGS")]
Observation = Annotated[str, Names("whiptool.rl.task:OBSERVATIONS")]
WITH_DERIVATIVES = ("gradient", "map")
METHODS = Names("whiptool.optimizers:METHODS", others=("nlopt:NAME",), beside="")  # `find_method` checks them
WITHOUT_DERIVATIVES = Names("whiptool.optimizers:METHODS", others=METHODS.others, without=WITH_DERIVATIVES, beside="")
Methods = tuple[Annotated[str, METHODS], ...]


def spell_methods(options: OptionGroup, name: str) -> None:
    """Replace method names that were given with capital letters or hyphens by their standard spelling.

    Args:
        options: Options that are being constructed.
        name: Name of the field that holds one method or several.
    """
    written = getattr(options, name)
    spelled = method_name(written) if isinstance(written, str) else tuple(map(method_name, written))
    object.__setattr__(options, name, spelled)


def learned_with(methods: Iterable[str]) -> tuple[str, ...]:
    """Return the optional modules that some methods need: learners need PyTorch."""
    from whiptool.rl.settings import SETTINGS

    return ("torch",) if SETTINGS.keys() & set(methods) else ()


@dataclass(frozen=True, kw_only=True)
class SearchOptions(OptionGroup):
    """Options for the bounds of a search and its number of trials."""

    heading: ClassVar[str] = "search"
    first: ClassVar[tuple[str, ...]] = ("max_trials",)
    ranges: ClassVar[Ranges] = {"max_trials": Count()}

    lower: tuple[float, ...] | None = None
    """Lower bounds of q_si q_ei q_sf q_ef [rad] and D [s]: joint angles at the start and at the end, for any number of
    joints, and duration. In hand space they are those of x_i y_i x_f y_f [m] and D, in space of x_i y_i z_i x_f y_f z_f
    and D. Default: those of the model."""
    upper: tuple[float, ...] | None = None
    """Upper bounds, in the order of --lower. Default: those of the model."""
    max_trials: int = 600
    """Largest number of trials, each of which is one strike."""

    def build_bounds(self, model: Model, space: StrikeSpace | None = None) -> StrikeBounds:
        """Return the bounds of strikes from `--lower` and `--upper`, or the default bounds.

        Args:
            model: Model with the arm that strikes.
            space: Coordinates of the strikes; default: joint space.

        Raises:
            InputError: A bound has a wrong length, or a lower bound is not below the upper one.
        """
        from whiptool.models.hand_space import numbers_of
        from whiptool.models.strike import JointSpace

        space = JointSpace(model.arm) if space is None else space
        for name, given in (("--lower", self.lower), ("--upper", self.upper)):
            if given is not None and len(given) != space.width:
                raise InputError(name, given, numbers_of(space))
        bounds = self._bounds(space)
        space.check_turns("--lower", bounds.lower)
        space.check_turns("--upper", bounds.upper)
        return bounds

    def _bounds(self, space: StrikeSpace) -> StrikeBounds:
        from whiptool.models.strike import StrikeBounds

        if self.lower is not None and self.upper is not None:
            return StrikeBounds(self.lower, self.upper)
        try:
            usual = space.bounds
        except InputError as error:  # of two joints alone there are usual ones
            raise InputError(error.name, error.given, error.allowed, "give --lower and --upper") from None
        return StrikeBounds(self.lower or usual.lower, self.upper or usual.upper)


@dataclass(frozen=True, kw_only=True)
class TrainingOptions(OptionGroup):
    """Options for the length of a training (Algorithm 1)."""

    heading: ClassVar[str] = "training"
    first: ClassVar[tuple[str, ...]] = ("episodes", "random_episodes")
    ranges: ClassVar[Ranges] = {
        "episodes": Count(),
        "trials": Count(2, MANY_TARGETS),
        "hindsight": Count(0, 1000),
    }

    episodes: int = 500
    """Number of training episodes."""
    trials: int = 100
    """Strikes per episode."""
    random_episodes: int = 50
    """Number of episodes with random strikes at the start."""
    hindsight: int = 0
    """Number of relabelled copies of every strike in the replay buffer (sac, td3, ddpg with observation goal; default:
    0)."""

    def check(self) -> None:
        """Refuse lengths of a training with which nothing would be learned, or that need too much memory."""
        super().check()
        if not 0 <= self.random_episodes < self.episodes:
            fewer = f"a whole number from 0 to {self.episodes - 1}, fewer than --episodes {self.episodes}"
            allowed = f"{fewer}: random episodes come first, and nothing is learned in them"
            fix = f"give --random-episodes {self.episodes // 5}; it is 50 unless given"
            raise InputError("--random-episodes", self.random_episodes, allowed, fix)


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

    ranges: ClassVar[Ranges] = {"noise": Interval()}

    minimise: CriterionName = "miss"
    """Criterion that ranks hits: least, or highest speed. miss: miss distance; effort: integral of the squared torques;
    peak-torque: largest torque; speed: that of the tip at the target; robustness: root mean square miss under noise.
    With any criterion other than miss the search continues after the first hit."""
    pareto: tuple[CriterionName, CriterionName] | None = None
    """Find the Pareto front of these two criteria among the hits, with derivatives."""
    noise: tuple[float, ...] = (0.01,)
    """Standard deviation of the noise on each coordinate of a strike [rad, s], for robustness; one value, or one per
    coordinate."""

    def check(self) -> None:
        from whiptool.goals.criteria import Robustness

        super().check()
        if self.pareto is not None and self.pareto[0] == self.pareto[1]:
            raise InputError("--pareto", self.pareto, "two different criteria")
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


_SURELY = 0.02  # beyond the limits, in parts of them: a posture between those tried may ask for a little less
_LIGHTER = "take a lighter whip or arm, or stronger motors"


def refuse_unheld(
    model: Model, controller: Controller, limits: AllLimits, bounds: StrikeBounds, *, easier: str = _LIGHTER
) -> None:
    """Refuse bounds of strikes in joint space if the arm can hold none of the start postures, or none of the end
    postures, within the limits.

    Args:
        model: Model of arm and whip, with what the whip holds.
        controller, limits, bounds: Those of the strikes.
        easier: Text on what reduces the torques.

    Raises:
        InputError: Gravity alone needs more torque than the motors or joints give at every start posture within the
            bounds, or at every end posture.
    """
    if not limits or controller.hand is not None or model.arm.weightless:
        return
    from whiptool.impedance.arm import Arm
    from whiptool.limits.postures import least_beyond

    a, arm = model.arm.n, Arm(model)

    def held(q: np.ndarray) -> np.ndarray:
        return np.abs(controller.clipped(arm.gravity_compensation(q, controller.compensated)))

    for name, part in (("start", slice(a)), ("end", slice(a, 2 * a))):
        low, high = (x[part] for x in bounds.box)
        beyond, q, tried = least_beyond(
            lambda q: _beyond_at_rest(limits, q, held(q), model.dimension), low, high, enough=_SURELY
        )
        if beyond > _SURELY:
            rule = f"within {' and '.join(each.words for each in limits.members)}"
            units = ["N" if joint in model.arm.slides else "N m" for joint in model.arm.joints]
            each = zip(model.arm.joints, held(q), units, strict=True)
            torques = ", ".join(f"{joint} {torque:.2f} {unit}" for joint, torque, unit in each)
            given = f"none that the arm can hold: the easiest of {tried} needs {torques}"
            raise InputError(f"{name} postures", given, rule, f"{easier}, or {name} elsewhere (--lower, --upper)")


def _beyond_at_rest(limits: AllLimits, q: np.ndarray, tau: np.ndarray, dimension: int) -> float:
    """Return how far beyond the limits an arm is that is still at joint positions q (a,), with torques tau (a,)."""
    from whiptool.models.trajectory import Approach

    nowhere, still = np.zeros((1, dimension)), np.zeros(1)
    at_rest = Approach(
        distance=still,
        time=still,
        velocity=nowhere,
        tip=nowhere,
        max_joint_speed=np.zeros((1, len(q))),
        max_torque=tau[None],
        diverged=np.zeros(1, bool),
        positions=np.stack([q, q])[None],
    )
    return float(limits.violation_of_peaks(at_rest)[0])
