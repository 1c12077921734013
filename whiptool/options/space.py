"""Options of what strikes are told by: the joints, or the hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from whiptool.errors import InputError
from whiptool.options.base import refuse_idle
from whiptool.options.controller import SimulatedControllerOptions

if TYPE_CHECKING:
    from whiptool.impedance import Controller
    from whiptool.impedance.hand import HandControl
    from whiptool.models.parameters import Model

Space = Literal["joint", "hand"]


@dataclass(frozen=True, kw_only=True)
class SpaceOptions(SimulatedControllerOptions):
    """What strikes are told by, and the controller that goes with it."""

    takes_hand: ClassVar[bool] = True

    space: Space = "joint"
    """What a strike is told by: where the joints begin and end, or where the hand does. In hand space the law is one of
    the hand's errors [m, m/s], and with --controller position the joints follow the hand's path exactly."""
    home: tuple[float, ...] | None = None
    """Home posture in hand space, near which the arm holds its hand [rad]; default: one in which it moves easily."""
    null_damping: float = 1.0
    """In hand space, damping of what joints do that does not move the hand [N m s/rad]."""
    stiffness: float | None = None
    """Of the hand in all directions, for --controller constant in hand space [N/m]; default: 3 Hz, damped
    critically."""
    damping: float | None = None
    """Likewise its damping [N s/m]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number

        names = ("home", "null_damping", "stiffness", "damping")
        if self.space == "joint":
            refuse_idle(self, dict.fromkeys(names, "nothing without --space hand"))
        for name in ("null_damping", "stiffness", "damping"):
            if getattr(self, name) is not None:
                number("--" + name.replace("_", "-"), getattr(self, name), low=0)
        super().check()

    def build_controller(self) -> Controller:
        """The controller that the options describe, or that of the file.

        Raises:
            InputError: An option is given that the file has, or that has no meaning in hand space.
        """
        controller = super().build_controller()
        if self.space == "joint":
            return controller
        if self.in_file:
            raise InputError("--space", self.space, f"nothing beside --controller {self.law_or_file}",
                             "write a table [controller.hand] into the file")  # fmt: skip
        if self.feedforward:
            raise InputError("--feedforward", True, "nothing in hand space")
        return replace(controller, hand=self._hand())

    def _hand(self) -> HandControl:
        from whiptool.impedance.hand import HandControl

        try:
            return HandControl(posture=self.home, null_damping=self.null_damping)
        except InputError as error:
            raise error.renamed("--home" if "posture" in error.name else "--null-damping") from None

    def _named_law(self):
        if self.space == "joint" or self.law_or_file != "constant":
            for name in ("stiffness", "damping"):
                if getattr(self, name) is not None:
                    raise InputError("--" + name, getattr(self, name), "nothing without --controller constant")
            return super()._named_law()
        if self.preset is not None:
            raise InputError("--preset", self.preset, "nothing beside --space hand; give --stiffness and --damping")
        from whiptool.impedance import ConstantImpedance
        from whiptool.impedance.hand import hand_impedance

        usual = hand_impedance(self._model(), self._hand())
        gains = ((given, usual_one) for given, usual_one in ((self.stiffness, usual.K), (self.damping, usual.B)))
        K, B = (matrix if given is None else _diagonal(given, len(matrix)) for given, matrix in gains)
        return ConstantImpedance(K, B)

    def _model(self) -> Model:
        return self.build_model()  # type: ignore[attr-defined]  # every command with a space has a model


def _diagonal(value: float, m: int) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(value if i == j else 0.0 for j in range(m)) for i in range(m))
