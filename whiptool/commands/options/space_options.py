"""Options of the coordinates of strikes: joints or hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, cast

import numpy as np

from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.option_group import Conditions, when
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.commands.options.target_options import ModelOptions
    from whiptool.impedance import Controller
    from whiptool.impedance.controller import HandControl

_GAINS = ("stiffness", "damping", "turn_stiffness", "turn_damping")
_OF_CONSTANT = when("controller", "constant", of="law_or_file")
Matrix = tuple[tuple[float, ...], ...]
Space = Literal["joint", "hand", "pose"]


@dataclass(frozen=True, kw_only=True)
class SpaceOptions(SimulatedControllerOptions):
    """Options for the coordinates of strikes (joint or hand space), and for the controller in these coordinates."""

    first: ClassVar[tuple[str, ...]] = ("space",)
    takes_hand: ClassVar[bool] = True
    only_with: ClassVar[Conditions] = {
        **dict.fromkeys(("home", "null_damping"), when("space", "hand", "pose")),
        **dict.fromkeys(_GAINS[:2], (when("space", "hand", "pose"), _OF_CONSTANT)),
        **dict.fromkeys(_GAINS[2:], (when("space", "pose"), _OF_CONSTANT)),
        "feedforward": when("space", "joint"),
    }

    space: Space = "joint"
    """Coordinates of a strike: joints, hand or hand pose. hand is the position of the hand; its pose includes the
    orientation and takes an arm with enough joints. In hand space the impedance acts on the errors of the hand [m, m/s;
    rad, rad/s]; with --controller position the joints follow the path of the hand exactly."""
    home: tuple[float, ...] | None = None
    """Home posture for hand space [rad], near which the arm stays. Default: a posture in which the hand moves
    easily."""
    null_damping: float = 1.0
    """Damping of joint motions that do not move the hand, in hand space [N m s/rad]."""
    stiffness: float | None = None
    """Stiffness of the hand in all directions, for --controller constant in hand space [N/m]; default: a natural
    frequency of 3 Hz, critically damped."""
    damping: float | None = None
    """Damping of the hand in all directions, for --controller constant in hand space [N s/m]; default: as for
    --stiffness."""
    turn_stiffness: float | None = None
    """Rotational stiffness of the hand about all axes, for --space pose [N m/rad]; default: a natural frequency of 3
    Hz, critically damped."""
    turn_damping: float | None = None
    """Rotational damping of the hand about all axes, for --space pose [N m s/rad]; default: as for --turn-stiffness."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        for name in ("null_damping", *_GAINS):
            if getattr(self, name) is not None:
                number("--" + name.replace("_", "-"), getattr(self, name), low=0)
        super().check()

    def build_controller(self) -> Controller:
        """Return the controller that the options or the file describe.

        Raises:
            InputError: An option is given that belongs in the file, or that has no effect in hand space.
        """
        controller = super().build_controller()
        if self.space == "joint":
            return controller
        if self.in_file:
            raise InputError("--space", self.space, f"only without --controller {self.law_or_file}",
                             "write a table [controller.hand] into the file")  # fmt: skip
        return replace(controller, hand=self._hand())

    def law_label(self) -> str:
        """Return a description of the control law; constant impedance of the hand has no presets."""
        if self.space == "joint":
            return super().law_label()
        named = "constant impedance" if self.law_or_file == "constant" else super().law_label()
        return named + (" of the hand's pose" if self.space == "pose" else " of the hand")

    def _hand(self) -> HandControl:
        from whiptool.impedance.controller import HandControl

        try:
            return HandControl(self.home, self.null_damping, orientation=self.space == "pose")
        except InputError as error:
            raise error.renamed("--home" if "posture" in error.name else "--null-damping") from None

    def _named_law(self):
        if self.space == "joint" or self.law_or_file != "constant":
            return super()._named_law()
        if self.preset is not None:
            raise InputError(
                "--preset", self.preset, f"only without --space {self.space}; give --stiffness and --damping"
            )
        from whiptool.impedance import ConstantImpedance
        from whiptool.impedance.controller import hand_impedance

        model = cast("ModelOptions", self).find_model()  # every command with a space has a model
        usual, d = hand_impedance(model, self._hand()), model.dimension
        K = _with_blocks(usual.K, d, self.stiffness, self.turn_stiffness)
        return ConstantImpedance(K, _with_blocks(usual.B, d, self.damping, self.turn_damping))


def _with_blocks(usual: Matrix | float, d: int, of_place: float | None, of_turn: float | None) -> Matrix:
    """Return gains, those of place or turns alike in all directions and on their own where they are given."""
    gains = np.array(usual)
    for block, others, given in ((slice(d), slice(d, None), of_place), (slice(d, None), slice(d), of_turn)):
        if given is not None:
            gains[block, block] = given * np.eye(len(gains[block]))
            gains[block, others] = gains[others, block] = 0.0
    return tuple(map(tuple, gains.tolist()))
