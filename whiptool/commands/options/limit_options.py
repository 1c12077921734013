"""Options of the limits of strikes: joints or motors, clearance and floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import arg

from whiptool.commands.options.option_group import Conditions, Names, OptionGroup, options_named, unless
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.limits.all_limits import Limits
    from whiptool.models import Model


@dataclass(frozen=True, kw_only=True)
class LimitOptions(OptionGroup):
    """Options for the limits that strikes have to keep."""

    heading: ClassVar[str] = "limits"
    first: ClassVar[tuple[str, ...]] = (
        "limits",
        "floor",
    )
    only_with: ClassVar[Conditions] = {
        "keep_free": (unless("limits", "none"),),
        "floor": (unless("limits", "none"), unless("ignore_collisions")),
        "clearance": (unless("limits", "none"), unless("ignore_collisions")),
        "ignore_collisions": (unless("limits", "none"),),
    }

    limits: Annotated[str, Names("whiptool.limits.arm_limits:LIMITS", others=("arm", "none"))] | None = None
    """Limits of a motor (xm430) or of the joints (arm: default if any). xm430 is the speed-torque line of that motor.
    optimize counts strikes that exceed a limit as misses; simulate reports them."""
    keep_free: float = 0.0
    """Fraction of the limits that strikes leave unused, such as 0.1 (default: 0)."""
    floor: Annotated[str | None, arg(metavar="HEIGHT|none")] = None
    """Height of the floor above the base [m], or none. The base of a planar arm is its shoulder; a floor below it has a
    negative height. Default: 0 for a robot that stands on its base, otherwise none."""
    clearance: float = 0.0
    """Least distance between arm, whip and floor [m] (default: 0)."""
    ignore_collisions: bool = False
    """Do not check collisions of arm, whip and floor. Planar models never check collisions of arm and whip."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.limits.all_limits import floor_height
        from whiptool.models.numbers import LARGEST_GAP, metres
        from whiptool.models.spatial_arm import kept_free

        super().check()
        try:
            kept_free(self.keep_free)
        except InputError as error:
            raise error.renamed("--keep-free") from None
        metres("--clearance", self.clearance, longest=LARGEST_GAP, strict=False)
        if self.floor is not None:
            with options_named(self):
                floor_height(self.floor)

    def build_limits(self, model: Model, controller: Controller) -> list[Limits]:
        """Return the limits that strikes have to keep.

        Raises:
            InputError: The arm has no limits, its torques are not available, or --keep-free or --clearance is given
                without limits to apply to.
        """
        from whiptool.limits.all_limits import named_limits

        with options_named(self):
            return named_limits(vars(self), model, prescribed=controller.prescribed)
