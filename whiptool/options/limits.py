"""Options of what a strike has to keep: limits of joints or motors, and distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from tyro.conf import arg

from whiptool.errors import InputError
from whiptool.options.base import OptionGroup, refuse_idle

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.limits import Limits
    from whiptool.models import Model


@dataclass(frozen=True, kw_only=True)
class LimitOptions(OptionGroup):
    """What a strike has to keep."""

    heading: ClassVar[str] = "limits"
    first: ClassVar[tuple[str, ...]] = (
        "limits",
        "floor",
    )

    limits: Literal["xm430", "arm", "none"] | None = None
    """Limits that strikes have to keep: this motor's speed-torque line, or those of the arm's joints; none: nothing at
    all. Default: arm, where its joints have limits. optimize refuses strikes beyond, which count as misses; simulate
    tells."""
    keep_free: float = 0.0
    """Share of those limits that is kept free, such as 0.1."""
    floor: Annotated[str | None, arg(metavar="HEIGHT|none")] = None
    """Height of the floor [m], above the base (shoulder), below it negative; none: there is none. Default: 0 of a robot
    that stands on its base, else none."""
    clearance: float = 0.0
    """Distance that arm, whip and floor have to keep from each other [m]."""
    ignore_collisions: bool = False
    """Arm and whip may go through each other, as in the plane, where they do not lie in one."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import LARGEST_GAP, metres
        from whiptool.models.spatial_arm import kept_free

        super().check()
        try:
            kept_free(self.keep_free)
        except InputError as error:
            raise error.renamed("--keep-free") from None
        metres("--clearance", self.clearance, longest=LARGEST_GAP, strict=False)
        if self.floor is not None and self.floor != "none":
            self._height(self.floor)
        if self.limits == "none":
            idle = ("keep_free", "floor", "clearance", "ignore_collisions")
            refuse_idle(self, dict.fromkeys(idle, "only without --limits none"))
        if self.ignore_collisions:
            refuse_idle(self, dict.fromkeys(("floor", "clearance"), "only without --ignore-collisions"))

    def build_limits(self, model: Model, controller: Controller) -> list[Limits]:
        """Return the limits that strikes have to keep.

        Raises:
            InputError: The arm has none, its torques are not known, or there is nothing of which a share or a distance
                could be kept.
        """
        from whiptool.models.arm_limits import ArmLimits
        from whiptool.models.clearance import Clearance
        from whiptool.models.motor_limits import limits_preset

        found: list[Limits] = []
        if self.limits == "none":
            return found
        if self.limits == "arm" or (self.limits is None and ArmLimits.are_in(model.arm)):
            found.append(ArmLimits.of(model.arm, keep_free=self.keep_free, prescribed=controller.prescribed))
        elif self.limits is not None:
            if model.arm.weightless:
                rule = "arm or none, as the inertia of the arm is not known, nor are its torques"
                raise InputError("--limits", self.limits, rule, "write an <inertial> of each link into the file")
            if model.arm.slides:
                rule = f"arm or none, as no such motor turns what slides: {', '.join(model.arm.slides)}"
                raise InputError("--limits", self.limits, rule)
            found.append(limits_preset(self.limits).keeping_free(self.keep_free))
        elif self.keep_free:
            raise InputError("--keep-free", self.keep_free, "0 for an arm without limits", "give --limits")
        floor = self._floor(model)
        if not self.ignore_collisions and (floor is not None or Clearance.is_of(model)):
            found.append(Clearance(model, floor, self.clearance))
        elif self.clearance:
            raise InputError("--clearance", self.clearance, "0 for an arm without capsules, above no floor")
        return found

    def _floor(self, model: Model) -> float | None:
        from whiptool.models.mount import default_floor

        if self.floor is None:
            return default_floor(model.arm)
        return None if self.floor == "none" else self._height(self.floor)

    @staticmethod
    def _height(given: str) -> float:
        from whiptool.models.numbers import LONGEST, metres

        try:
            height = float(given)
        except ValueError:
            raise InputError("--floor", given, "a number [m], or none") from None
        return metres("--floor", height, low=-LONGEST, strict=False)
