"""Options of what a strike has to keep: limits of joints or motors, and distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from tyro.conf import arg

from whiptool.errors import InputError
from whiptool.options.base import OptionGroup, refuse_idle

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.limits.all_limits import Limits
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
    """Limits that strikes have to keep. arm: those of the joints; xm430: the speed-torque line of that motor. optimize
    counts strikes beyond a limit as misses; simulate reports them. Default: arm, if its joints have limits."""
    keep_free: float = 0.0
    """Fraction of those limits to keep free, such as 0.1."""
    floor: Annotated[str | None, arg(metavar="HEIGHT|none")] = None
    """Height of the floor above the base [m], or none. The base of a planar arm is its shoulder; a floor below it has a
    negative height. Default: 0 for a robot that stands on its base, otherwise none."""
    clearance: float = 0.0
    """Least distance between arm, whip and floor [m]."""
    ignore_collisions: bool = False
    """Do not check collisions of arm, whip and floor. Planar models never check collisions of arm and whip."""

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
        from whiptool.limits.arm_limits import ArmLimits
        from whiptool.limits.clearance import Clearance
        from whiptool.limits.motor_limits import limits_preset

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
