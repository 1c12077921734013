"""The servos of the rig, driven with dynamixel-sdk."""

from whiptool.rig.dynamixel.bus import BLOCK, DynamixelBus
from whiptool.rig.dynamixel.control_table import XM430_W350, Register, Units, register
from whiptool.rig.dynamixel.joints import Joints, JointSample
from whiptool.rig.dynamixel.line import BusError, NoReply, Refused, Unplugged

__all__ = [
    "BLOCK",
    "XM430_W350",
    "BusError",
    "DynamixelBus",
    "JointSample",
    "Joints",
    "NoReply",
    "Refused",
    "Register",
    "Units",
    "Unplugged",
    "register",
]
