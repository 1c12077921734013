"""An emulated rig: servos that speak the real protocol on a pseudo-terminal, with arm and whip behind them."""

from whiptool.rig.emulator.faults import Fault, random_faults
from whiptool.rig.emulator.motor import HARDWARE, Motor
from whiptool.rig.emulator.process import Emulator
from whiptool.rig.emulator.twin_options import TwinOptions

__all__ = ["HARDWARE", "Emulator", "Fault", "Motor", "TwinOptions", "random_faults"]
