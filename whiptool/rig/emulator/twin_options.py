"""Options of the emulated rig."""

from __future__ import annotations

from dataclasses import dataclass, field

from whiptool.errors import InputError
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.presets import preset
from whiptool.rig.dynamixel.control_table import BAUD_RATES, Units
from whiptool.rig.emulator.motor import Motor
from whiptool.rig.emulator.servo import Protection, Servo


@dataclass(frozen=True)
class TwinOptions:
    """Options of an emulated arm with servos.

    Args:
        model: Model of arm and whip; default: the preset `lemon2024`.
        motor: Motor of every joint; default: the XM430-W350 without friction. `HARDWARE` includes friction and inertia.
        start: Posture of the arm at time 0 [rad], with the whip hanging; default: straight down.
        lockstep: Time only advances with writes of Goal Current, by `period` each, so that runs are reproducible.
            False: real time.
        period: Control period in lock step [s].
        command_delay: Delay from writing a goal to its effect [s].
        sample_delay: Age of the state in the servos' registers [s].
        fineness: Factor by which the registers' counts are finer than those of real servos, a power of 2, to study
            quantisation.
        ids: Ids of the servos, shoulder first; default: 1, 2, ..
        baud: Baud rate to which the servos are set [bit/s].
        return_delay: Value of Return Delay Time(9) [2 us]; the factory setting is 250.
        timestep, integrator: MuJoCo's time step [s] and integrator; default: as in `ReferenceRollout`.
        protection: Thresholds at which a servo shuts itself down.
    """

    model: Model = field(default_factory=lambda: preset("lemon2024"))
    motor: Motor = field(default_factory=Motor)
    start: tuple[float, ...] | None = None
    lockstep: bool = True
    period: float = 0.002
    command_delay: float = 0.0
    sample_delay: float = 0.0
    fineness: int = 1
    ids: tuple[int, ...] = ()
    baud: int = 1_000_000
    return_delay: int = 0
    timestep: float | None = None
    integrator: str | None = None
    protection: Protection = field(default_factory=Protection)

    def __post_init__(self) -> None:
        number("period", self.period, low=1e-5, high=1.0)
        for name in ("command_delay", "sample_delay"):
            number(name, getattr(self, name), low=0, high=0.5)
        if self.baud not in BAUD_RATES.values():
            raise InputError("baud", self.baud, ", ".join(map(str, BAUD_RATES.values())))
        ids = self.ids or tuple(range(1, self.model.arm.n + 1))
        if len(set(ids)) != self.model.arm.n or not all(0 <= id <= 252 for id in ids):
            raise InputError("ids", ids, f"{self.model.arm.n} different numbers from 0 to 252")
        object.__setattr__(self, "ids", ids)

    def make_servos(self) -> list[Servo]:
        """Return the servos in their state after power-on."""
        rate = next(value for value, bps in BAUD_RATES.items() if bps == self.baud)
        return [
            Servo(
                id,
                self.motor,
                units=Units(self.fineness),
                baud=rate,
                return_delay=self.return_delay,
                protection=self.protection,
            )
            for id in self.ids
        ]
