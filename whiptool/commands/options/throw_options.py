"""Options of throws: the box, the thing, and its release."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from tyro.conf import arg

from whiptool.commands.options.model_options import WhipOptions
from whiptool.commands.options.option_group import Conditions, Interval, Ranges, unless, when
from whiptool.commands.options.strike_options import SimulatorOptions
from whiptool.commands.options.target_options import GoalOptions
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.goals.target import Target
    from whiptool.impedance import Controller
    from whiptool.models.parameters import Model
    from whiptool.rollout.interface import Rollout
    from whiptool.throws.box import Box
    from whiptool.throws.flight import Thing

_OF_THROWS = (
    "box", "box_normal", "box_velocity", "most_speed", "thing_mass", "thing_diameter", "release_from", "release_time",
    "release_noise",
)  # fmt: skip
_IN = {2: ("X Y SIZE", "such as 1.8 -0.5 0.2", "in the plane"), 3: ("X Y Z SIZE", "such as 1.8 0 0 0.2", "in space")}


@dataclass(frozen=True, kw_only=True)
class ThrowOptions(SimulatorOptions, WhipOptions, GoalOptions):
    """Options for throws of a thing into a box."""

    heading: ClassVar[str] = "throw"
    only_with: ClassVar[Conditions] = {
        "throw": unless("simulator", "reference"),
        **dict.fromkeys(_OF_THROWS, when("throw")),
        **dict.fromkeys(("target", "hit_radius", "arrival_angle", "timestep"), unless("throw")),
    }
    ranges: ClassVar[Ranges] = {
        "most_speed": Interval(0, strict=True),
        "thing_mass": Interval(0, strict=True),
        "thing_diameter": Interval(0),
        "release_time": Interval(0),
        "release_noise": Interval(0, 0.2),
    }

    throw: bool = False
    """Throw a thing into a box: it is released within the strike, and has to fall through the opening of --box.
    Direction, cone and speeds are those of the thing at the opening."""
    box: Annotated[tuple[float, ...] | None, arg(metavar="X Y SIZE|X Y Z SIZE")] = None
    """Centre of the box's opening, and its width [m]; a round opening, in the plane a gap. The box may be out of the
    arm's reach."""
    box_normal: tuple[float, ...] | None = None
    """Vector out of the opening; it has to point upward (default: straight up)."""
    box_velocity: tuple[float, ...] | None = None
    """Constant velocity of the box [m/s]; --box is its place when the strike begins. Default: it stands."""
    most_speed: float | None = None
    """Largest speed of the thing at the opening [m/s]. Default: any."""
    thing_mass: float = 0.02
    """Mass of the thing [kg]."""
    thing_diameter: float = 0.04
    """Diameter of the thing, a smooth ball with air drag [m]; 0: a point without drag. All of the ball has to pass."""
    release_from: Literal["tip", "hand"] = "tip"
    """Where the thing is until its release."""
    release_time: float | None = None
    """Time of the release [s] (default: the time at which the line of flight is best)."""
    release_noise: float = 0.0
    """Standard deviation of the release time [s], such as 0.005. The thing then has to enter at five release times up
    to two standard deviations early or late."""

    def check(self) -> None:
        if self.throw:
            if self.box is None:
                rule = "--box with the opening's centre and width, such as 1.8 0 0.2"
                raise InputError("--throw", "without --box", rule)
            if len(self.box) not in (3, 4) or not all(map(math.isfinite, self.box)):
                raise InputError("--box", self.box, "X Y SIZE, or in space X Y Z SIZE, finite numbers")
        super().check()

    def build_thing(self) -> Thing:
        """Return the thing."""
        from whiptool.throws.flight import Thing

        return Thing.of_ball(self.thing_mass, self.thing_diameter)

    def build_box(self) -> Box:
        """Return the box, with the required arrival of the thing.

        Raises:
            InputError: The thing does not fit through the opening, or the opening does not face upward.
        """
        from whiptool.throws.box import Box

        assert self.box is not None
        *centre, width = self.box
        if width <= self.thing_diameter:
            raise InputError("--box", self.box, f"an opening wider than the thing, of {self.thing_diameter:g} m")
        return Box(
            tuple(centre),
            hit_radius=(width - self.thing_diameter) / 2,
            direction=self.direction,
            cone=math.radians(self.cone),
            speed=self.least_speed,
            normal=self.box_normal,
            velocity=self.box_velocity,
            most_speed=self.most_speed,
        )

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target of a strike, or the box of a throw."""
        if not self.throw or self.box is None:
            return super().build_target(model)
        if model is not None and len(self.box) != model.dimension + 1:
            asked, such, where = _IN[model.dimension]
            raise InputError("--box", self.box, f"{asked} in m, for the model {model.name}, which is {where}", such)
        return self.build_box()

    def build_rollout(self, model: Model, controller: Controller) -> Rollout:
        """Return the simulator of strikes, or that of throws."""
        if not self.throw:
            return super().build_rollout(model, controller)
        from whiptool.throws.rollout import ThrowRollout

        return ThrowRollout(
            model,
            self.build_box(),
            controller,
            thing=self.build_thing(),
            place=self.release_from,
            release_time=self.release_time,
            release_noise=self.release_noise,
            tolerance=self.tolerance,
        )
