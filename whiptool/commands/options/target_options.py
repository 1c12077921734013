"""Options of target, zone of targets and model."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar

from whiptool.commands.options.option_group import Condition, Conditions, Names, OptionGroup, unless
from whiptool.commands.options.whip_options import WhipOptions
from whiptool.errors import InputError
from whiptool.models.strike import T_STAY

if TYPE_CHECKING:
    from whiptool.goals.arrival_rule import ArrivalRule
    from whiptool.goals.target import Target
    from whiptool.goals.zone import Zone
    from whiptool.models.parameters import Model

LONGEST_STAY = 60.0  # [s]
ModelName = Annotated[str, Names("whiptool.models.presets:PRESETS", beside="|FILE.toml|FILE.urdf|FILE.xml")]


@dataclass(frozen=True, kw_only=True)
class TargetOptions(OptionGroup):
    """Options for the target, and for the time during which the tip is observed."""

    heading: ClassVar[str] = "target"
    first: ClassVar[tuple[str, ...]] = (
        "target",
        "hit_radius",
    )

    target: tuple[float, ...] | None = None
    """Target position x y, in space x y z [m]. The origin is the shoulder and y is up; in space the origin is the base,
    y is to the left and z is up. Default: 1.3 0; in space it depends on the model's reach, 1.2 0.3 0.5 for ur5e and
    panda."""
    hit_radius: float = 0.06
    """Largest distance between tip and target at a hit [m]."""
    t_stay: float = T_STAY
    """Time after the movement in which the tip can still hit [s]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        super().check()
        self.build_target()
        number("--t-stay", self.t_stay, low=0, high=LONGEST_STAY)

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target; default: the usual target of the model, or without a model the one in the plane."""
        from whiptool.goals.target import TARGET, Target, usual_target

        if self.target is not None:
            return Target(self.target, self.hit_radius)
        return Target(TARGET if model is None else usual_target(model).position, self.hit_radius)


DIRECTED = {
    "cone": Condition(
        "only with --direction or --arrival-angle",
        lambda o: o.direction is not None or o.arrival_angle is not None,
    ),
    "arrival_angle": unless("direction"),
}


@dataclass(frozen=True, kw_only=True)
class GoalOptions(TargetOptions):
    """Options for the target and the required arrival of the tip."""

    first: ClassVar[tuple[str, ...]] = ("direction",)
    only_with: ClassVar[Conditions] = DIRECTED

    direction: tuple[float, ...] | None = None
    """Direction of the tip's velocity at a hit: x y, in space x y z. The vector can have any length. Default: any
    direction."""
    arrival_angle: float | None = None
    """Angle of the tip's velocity at a hit [degrees]. In the plane 0 is forward and 90 is upward. In space, seen from
    the base, 0 is upward and 90 is to the left; motion along the line of sight is ignored. Default: any angle."""
    cone: float = 10.0
    """Largest angle at a hit between the tip's velocity and the required direction [degrees]."""
    least_speed: float | None = None
    """Least speed of the tip at a hit [m/s], along the required direction if there is one. Default: any speed."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        number("--cone", self.cone, low=0, high=180, strict=True)
        if self.arrival_angle is not None:
            number("--arrival-angle", self.arrival_angle, low=-360, high=360)
        super().check()

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target with the required arrival of the tip.

        Raises:
            InputError: The direction is zero or has a wrong dimension, or the arrival angle is not defined at the
                target.
        """
        from whiptool.goals.target import Target

        point, cone = super().build_target(model), math.radians(self.cone)
        if model is None and self.target is None:
            return point  # before the model is known, so is not how many coordinates there are
        if self.arrival_angle is not None:
            angle = math.radians(self.arrival_angle)
            return Target.arriving(
                point.position, angle, hit_radius=point.hit_radius, cone=cone, speed=self.least_speed
            )
        return replace(point, direction=self.direction, cone=cone, speed=self.least_speed)


@dataclass(frozen=True, kw_only=True)
class ZoneOptions(TargetOptions):
    """Options for the zone from which targets are drawn; --target is its centre."""

    of_disc: ClassVar[tuple[str, ...]] = ("target", "zone_radius")
    first: ClassVar[tuple[str, ...]] = ("zone_radius",)

    zone_radius: float = 0.1
    """Radius of the zone of targets around --target [m]. The zone is a disc, in space a ball; targets out of reach are
    left out."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        super().check()
        number("--zone-radius", self.zone_radius, low=0, strict=True)

    def build_arrival(self) -> ArrivalRule:
        """Return the required arrival of the tip; any, if the command has no options for it.

        Raises:
            InputError: The direction is zero, or the speed is not positive.
        """
        from whiptool.goals.arrival_rule import named_rule

        return named_rule(vars(self))

    def build_zone(self, model: Model) -> Zone:
        """Return the zone from which targets are drawn.

        Raises:
            InputError: The zone has another dimension than the model or is out of its reach, or its file cannot be
                read; or no tip moves along the direction at the target.
        """
        from whiptool.goals.arrival_rule import named_zone

        return named_zone(vars(self), model)


@dataclass(frozen=True, kw_only=True)
class ModelOptions(WhipOptions):
    """Options for the model of whip and arm."""

    heading: ClassVar[str] = "model"
    first: ClassVar[tuple[str, ...]] = (
        "model",
        "arm",
    )
    in_space: ClassVar[bool] = False  # whether the command takes models in space

    model: ModelName = "lemon2024"
    """Model of arm and whip: a preset or a file. The presets nah2023, ur5e and panda are in space. A robot in URDF or
    MJCF gets the rope of ur5e."""

    arm: str | None = None
    """Use the arm of this preset or file with the whip of --model. The file can be a robot's URDF. If only one of the
    two models is in space, the arm keeps its own whip."""

    arm_tip: str | None = None
    """Link, body or site of the robot's file to which the whip is attached; needed if the robot's chain branches.
    Default: the last link."""

    base: tuple[str, ...] = ("floor",)
    """Mounting of the base of an arm in space: floor, wall (its z axis points forward), ceiling, or its roll, pitch and
    yaw [rad]."""

    def build_model(self) -> Model:
        """Return the model of `--model` with the arm of `--arm`; assumptions about the arm are printed on stderr.

        Raises:
            InputError: No model has that name, the arm does not fit the whip, or the command takes no models in space.
        """
        model = self.find_model()
        for note in model.arm.notes:
            print(f"whiptool: {self.arm or self.model}: {note}", file=sys.stderr)
        return model

    def find_model(self) -> Model:
        """Return the model as `build_model` does, without printing; files are read only once."""
        return self._model_found

    @cached_property
    def _model_found(self) -> Model:
        from whiptool.models.files import load_model

        of_model, of_arm = (self.arm_tip or "", "") if self.arm is None else ("", self.arm_tip or "")
        model = load_model(self.model, tip=of_model)
        if self.arm is not None:
            try:
                other = load_model(self.arm, tip=of_arm)
            except InputError as error:
                raise error.renamed("--arm") if error.name == "model" else error from None
            model = replace(other, whip=model.whip) if other.dimension == model.dimension else other
        if model.dimension == 3 and not self.in_space:
            option, given = ("--model", self.model) if self.arm is None else ("--arm", self.arm)
            raise InputError(option, given, "a model in the plane, for this command")
        return self._mounted(self.changed_whip(model))

    def _mounted(self, model: Model) -> Model:
        """The model with its base as `--base` says."""
        from whiptool.models.mount import MOUNT_RULE, mounted

        if self.base == ("floor",):
            return model
        if model.dimension == 2:
            raise InputError("--base", self.base, "nothing but floor for an arm in the plane")
        try:
            angles = self.base[0] if len(self.base) == 1 else [float(x) for x in self.base]
            return replace(model, arm=mounted(model.arm.in_space(), angles))
        except InputError as error:
            raise error.renamed("--base") from None
        except ValueError:
            raise InputError("--base", " ".join(self.base), MOUNT_RULE) from None
