"""An emulated Universal Robots UR5e, which the maker's protocols reach: RTDE, programs and dashboard."""

from whiptool.rig.ur_emulator.ur_controller import UrFault, UrOptions
from whiptool.rig.ur_emulator.ur_process import UrEmulator

__all__ = ["UrEmulator", "UrFault", "UrOptions"]
