"""State of one page: model, controller, target and strike, and what the strike does. It knows nothing of the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.criteria import NOISE
from whiptool.goals.target import Target, usual_target
from whiptool.impedance.controller import Controller, default_controller
from whiptool.live_page.aim import aimed, map_name
from whiptool.live_page.heat_map import HeatMap, Sampled, azimuth_of, drawn_strikes, heat_map, same_everywhere, sampled
from whiptool.live_page.knobs import changed_law, changed_model, law_named, with_law
from whiptool.live_page.remembered import RememberingRollout
from whiptool.live_page.spread import TipSpread, spread
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike, strike_names
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.strike_map.answers import bounds_all_around
from whiptool.strike_map.striker import Striker

FREE = ("whip.drag", "whip.hinge_mass")  # terms that the engine has from the beginning, so that sliders compile nothing


@dataclass(frozen=True)
class StudioSettings:
    """What the user of a page has chosen.

    Args:
        origin: Preset or file of the model.
        base: The model as it was loaded.
        controller: Controller of the arm.
        target: The target.
        whip: Numbers of the whip that were changed, see `whip_changes`.
        strike: Strike vector; empty: none yet.
        noise: Standard deviation of each number of an executed strike [rad, m, s].
        follows: Whether the strike is aimed again after a change of whip or controller.
        t_stay: Time after the movement in which the tip can still hit [s].
    """

    origin: str
    base: Model
    controller: Controller
    target: Target
    whip: Mapping[str, float] = field(default_factory=dict)
    strike: tuple[float, ...] = ()
    noise: float = NOISE
    follows: bool = False
    t_stay: float = T_STAY

    @property
    def model(self) -> Model:
        """The model with the changed numbers of its whip."""
        return changed_model(self.base, self.whip)


@dataclass(frozen=True, eq=False)
class Shown:
    """What a strike does.

    Args:
        settings: The settings.
        model: Their model.
        trajectory: Trajectory of the strike.
        near: Its closest approach to the target.
        hit: Whether it hits within the limits.
        beyond: The limit that it exceeds most, in words; None: it keeps all.
        source: Where the strike came from, in words.
        number: Number of this result, from 1.
    """

    settings: StudioSettings
    model: Model
    trajectory: Trajectory
    near: Approach
    hit: bool
    beyond: str | None
    source: str
    number: int


class Session:
    """One user's model, controller, target and strike.

    Every change is made as a whole, or refused with an `InputError` that leaves everything as it was.

    Args:
        model: Model of arm and whip.
        controller: Controller; default: that of the model.
        origin: Preset or file of the model.
        target: Target; default: the usual one of the model.
        t_stay: Time after the movement in which the tip can still hit [s].
        strike: Strike vector at first; empty: one is found for the target.
    """

    def __init__(
        self,
        model: Model,
        controller: Controller | None = None,
        *,
        origin: str = "",
        target: Target | None = None,
        t_stay: float = T_STAY,
        strike: tuple[float, ...] = (),
    ) -> None:
        controller = default_controller(model) if controller is None else controller
        target = usual_target(model) if target is None else target
        target.check_fits(model)
        self._count, self._source = 0, ""
        self._found_for: tuple[Model, Controller] | None = None  # model and controller that a strike was found for
        self._drawn: np.ndarray | None = None
        self._sampled: Sampled | None = None
        self._heat: tuple[Sampled, HeatMap] | None = None
        self.usual_law = controller.law
        settings = StudioSettings(origin or model.name, model, controller, target, t_stay=t_stay)
        self.striker = _striker(settings)
        self.settings = settings
        self.of_map = map_name(model) if controller == default_controller(model) else None
        if strike:
            self._set_strike(np.array(strike), "from the file")
        else:
            self.aim()

    @property
    def model(self) -> Model:
        """The model with the changed numbers of its whip."""
        return self.striker.rollout.model

    def aim(self) -> None:
        """Find a strike for the target."""
        present = np.array(self.settings.strike) if self.settings.strike else None
        found = aimed(
            self.striker, self.settings.target, of_map=self.of_map, others=self.random_strikes, present=present
        )
        self.settings = replace(self.settings, strike=tuple(found.strike.tolist()))
        self._source, self._found_for = found.source, (self.model, self.settings.controller)

    def move_target(self, target: Target) -> None:
        """Take another target, and find a strike for it."""
        target.check_fits(self.model)
        self.settings = replace(self.settings, target=target)
        self.aim()

    def turn_whip(self, name: str, value: float) -> None:
        """Change a number of the whip, see `whip_changes`; the strike stays, unless it follows."""
        self._take(replace(self.settings, whip={**self.settings.whip, name: value}))

    def reset_whip(self) -> None:
        """Take the numbers of the whip as they were loaded."""
        self._take(replace(self.settings, whip={}))

    def turn_law(self, name: str, value: float) -> None:
        """Change a number of the control law, see `law_knobs`; the strike stays, unless it follows."""
        controller = self.settings.controller
        law = changed_law(controller.law, name, value)
        self._take(replace(self.settings, controller=replace(controller, law=law)))

    def choose_law(self, kind: str) -> None:
        """Take another control law with its usual numbers, or the present one with its own."""
        law = law_named(kind, self.settings.base)
        self._take(replace(self.settings, controller=with_law(self.settings.controller, law)))
        self.usual_law, self._drawn = law, None  # what is commanded may be closer to the limits

    def turn_strike(self, name: str, value: float) -> None:
        """Change a number of the strike, such as `D` [s] or `q_si` [rad]."""
        names = strike_names(self.model.arm)
        if name not in names:
            raise InputError("number of the strike", name, ", ".join(names))
        numbers = list(self.settings.strike)
        numbers[names.index(name)] = value
        self._set_strike(np.array(numbers), "set by hand")

    def set_noise(self, noise: float) -> None:
        """Take another standard deviation of an executed strike's numbers."""
        self.settings = replace(self.settings, noise=noise)

    def set_follows(self, follows: bool) -> None:
        """Choose whether the strike is aimed again after a change of whip or controller."""
        self.settings = replace(self.settings, follows=follows)
        if follows:
            self.aim()

    def shown(self) -> Shown:
        """Return what the strike does now."""
        settings, striker = self.settings, self.striker
        vector = np.array(settings.strike)
        strike = Strike.from_vector(vector)
        trajectory = striker.rollout.trajectory(strike, t_stay=striker.t_stay)
        near = striker.rollout.approach(vector[None], settings.target, t_stay=striker.t_stay)
        beyond = None
        if striker.limits and not trajectory.diverged:
            beyond = striker.limits.explain(trajectory, self.model.arm.joints, strike)
        hit = bool(settings.target.goals.hit_by(near)[0]) and beyond is None
        self._count += 1
        source = self._source
        if self._found_for not in (None, (self.model, settings.controller)):
            source += "; found for the whip or control law before, Aim again finds one for this"
        return Shown(settings, self.model, trajectory, near, hit, beyond, source, self._count)

    def spread(self) -> TipSpread:
        """Return the errors of the tip if the strike is executed with errors."""
        settings = self.settings
        return spread(self.striker, np.array(settings.strike), settings.target.goals, settings.noise)

    def sample(self) -> Iterator[None]:
        """Draw the random strikes of `random_strikes` in parts, if they are not there yet."""
        striker = self.striker
        if self._drawn is None:
            drawn = np.empty(0)
            for drawn in drawn_strikes(striker):  # noqa: B007  # the last are all
                yield
            self._drawn = drawn
        if self._sampled is None:
            for found in sampled(striker, self._drawn):
                if found is not None and striker is self.striker:
                    self._sampled = found
                yield

    def random_strikes(self) -> Sampled:
        """Return random strikes of the present model, see `Sampled`."""
        for _ in self.sample():
            pass
        assert self._sampled is not None
        return self._sampled

    def heat_map(self) -> HeatMap:
        """Return where random strikes of the present model hit, in the vertical plane through the target."""
        found, place = self.random_strikes(), np.array(self.settings.target.position)
        if self._heat is not None and self._heat[0] is found and same_everywhere(self.model):
            return replace(self._heat[1], azimuth=azimuth_of(place))
        self._heat = found, heat_map(self.striker, found, place)
        return self._heat[1]

    def _take(self, settings: StudioSettings) -> None:
        striker = _striker(settings)
        self.striker, self.settings, self._sampled = striker, settings, None
        if settings.follows:
            self.aim()

    def _set_strike(self, vector: np.ndarray, source: str) -> None:
        self.striker.rollout.vectors(vector)
        self.settings = replace(self.settings, strike=tuple(vector.tolist()))
        self._source, self._found_for = source, None


def _striker(settings: StudioSettings) -> Striker:
    """Return the simulator of strikes of the settings' model and controller."""
    model = settings.model
    rollout = RememberingRollout(model, settings.controller, free=FREE)
    return Striker(rollout, bounds=bounds_all_around(model.arm), t_stay=settings.t_stay)
