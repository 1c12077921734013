"""What is emulated, and how its time runs."""

from __future__ import annotations

from dataclasses import dataclass, field

from whiptool.errors import InputError
from whiptool.models.parameters import Model, number
from whiptool.models.presets import preset
from whiptool.rig.dynamixel.control_table import BAUD_RATES, Units
from whiptool.rig.emulator.motor import Motor
from whiptool.rig.emulator.servo import Protection, Servo


@dataclass(frozen=True)
class TwinOptions:
    """What is emulated, and how its time runs.

    Args:
        model: Whip, arm, gravity; default: the preset `lemon2024`.
        motor: Motor of every joint; default: the XM430-W350 without friction. `HARDWARE` has friction and inertia.
        start: Arm posture at time 0 [rad], the whip hanging; default: straight down.
        lockstep: Time advances by `period` with every write of Goal Current, and not otherwise: runs repeat exactly.
            False: it runs with the wall clock.
        period: Control period in lock-step [s].
        command_delay: A goal acts this long after it was written [s].
        sample_delay: The servos show the state of this long ago [s].
        fineness: Counts of the registers are this many times finer than the real ones (1); a power of 2, to see what
            quantisation costs.
        ids: Ids of the servos, shoulder first; default: 1, 2, ..
        baud: Bits per second that the servos are set to.
        return_delay: Value of Return Delay Time(9), in 2 us; the factory's is 250.
        timestep, integrator: MuJoCo's step [s], and how it steps; default: the reference rollout's.
        protection: When a servo shuts itself down.
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
        """The servos, as they are after power on."""
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
