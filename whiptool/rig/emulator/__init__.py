"""An emulated rig: servos with the real protocol on a pseudo-terminal, and a simulated arm and whip."""

from whiptool.rig.emulator.faults import Fault, random_faults
from whiptool.rig.emulator.motor import HARDWARE, Motor
from whiptool.rig.emulator.physics import TwinOptions
from whiptool.rig.emulator.process import Emulator

__all__ = ["HARDWARE", "Emulator", "Fault", "Motor", "TwinOptions", "random_faults"]
