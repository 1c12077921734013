"""Packets as the maker's manual prints them, and one emulated servo."""

from __future__ import annotations

from hypothesis import strategies as st

from whiptool.rig.dynamixel.control_table import register
from whiptool.rig.emulator import Motor
from whiptool.rig.emulator.servo import Servo

h = bytes.fromhex

# (title in https://emanual.robotis.com/docs/en/dxl/protocol2/, packet)
GOLDEN = {
    "ping": "FF FF FD 00 01 03 00 01 19 4E",
    "ping status": "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
    "ping status 2": "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D",
    "ping broadcast": "FF FF FD 00 FE 03 00 01 31 42",
    "read": "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
    "read status": "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
    "write": "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
    "write status": "FF FF FD 00 01 04 00 55 00 A1 0C",
    "reg write": "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
    "action": "FF FF FD 00 01 03 00 05 02 CE",
    "factory reset": "FF FF FD 00 01 04 00 06 01 A1 E6",
    "reboot": "FF FF FD 00 01 03 00 08 2F 4E",
    "clear": "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC",
    "sync read": "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
    "sync read status 2": "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE",
    "sync write": "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
    "bulk read": "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
    "bulk read status 1": "FF FF FD 00 01 06 00 55 00 77 00 C3 69",
    "bulk read status 2": "FF FF FD 00 02 05 00 55 00 24 8B A9",
    "bulk write": "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
    "fast sync read": "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
}

bytes_with_headers = st.lists(st.sampled_from([b"\xff", b"\xfd", b"\x00", b"\xff\xff\xfd", b"\x55", b"\x01"])).map(
    b"".join
)


def servo() -> Servo:
    return Servo(1, Motor())


def put(s: Servo, name: str, value: int) -> int:
    r = register(name)
    return s.write(r.address, value.to_bytes(r.size, "little", signed=value < 0))


OK = (0, 0)  # communication and servo
