"""Options of searches and trainings: methods, bounds, numbers of trials and episodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from whiptool.commands.options.option_group import MANY_TARGETS, Names, OptionGroup, whole
from whiptool.errors import InputError
from whiptool.words import method_name

if TYPE_CHECKING:
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

    lower: tuple[float, ...] | None = None
    """Lower bounds of q_si q_ei q_sf q_ef [rad] and D [s]: joint angles at the start and at the end, for any number of
    joints, and duration. In hand space they are those of x_i y_i x_f y_f [m] and D, in space of x_i y_i z_i x_f y_f z_f
    and D. Default: those of the model."""
    upper: tuple[float, ...] | None = None
    """Upper bounds, in the same order. Default: those of the model."""
    max_trials: int = 600
    """Largest number of trials, each of which is one strike."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        whole("--max-trials", self.max_trials)

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
    first: ClassVar[tuple[str, ...]] = ("episodes",)

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
        whole("--episodes", self.episodes)
        whole("--trials", self.trials, low=2, high=MANY_TARGETS)
        whole("--hindsight", self.hindsight, low=0, high=1000)
        if not 0 <= self.random_episodes < self.episodes:
            fewer = f"a whole number from 0 to {self.episodes - 1}, fewer than --episodes {self.episodes}"
            allowed = f"{fewer}: random episodes come first, and nothing is learned in them"
            fix = f"give --random-episodes {self.episodes // 5}; it is 50 unless given"
            raise InputError("--random-episodes", self.random_episodes, allowed, fix)
