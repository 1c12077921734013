"""Packets of the Real-Time Data Exchange (RTDE) of robots by Universal Robots, protocol version 2.

Source: https://docs.universal-robots.com/tutorials/communication-protocol-tutorials/rtde-guide.html
"""

from __future__ import annotations

import struct
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

VERSION, CONTROLLER, MESSAGE = ord("V"), ord("v"), ord("M")
OUTPUTS, INPUTS, START, PAUSE, DATA = ord("O"), ord("I"), ord("S"), ord("P"), ord("U")
_HEADER = struct.Struct(">HB")  # length of the whole packet, kind

_FORMATS = {
    "UINT32": "I", "INT32": "i", "DOUBLE": "d", "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i",
}  # fmt: skip
_OUTPUTS = {  # what the emulated controller computes
    "VECTOR6D": (
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current actual_TCP_pose "
        "target_TCP_pose joint_temperatures payload_inertia"
    ),
    "VECTOR3D": "payload_cog",
    "VECTOR6INT32": "joint_mode",
    "DOUBLE": "timestamp speed_scaling target_speed_fraction payload",
    "INT32": "robot_mode safety_mode safety_status",
    "UINT32": "runtime_state robot_status_bits safety_status_bits",
}
REGISTERS = 48  # of integers and of doubles, in either direction


def _kinds(table: Mapping[str, str], direction: str) -> dict[str, str]:
    """Types of variables by their names, registers among them."""
    kinds = {name: kind for kind, names in table.items() for name in names.split()}
    for i in range(REGISTERS):
        kinds |= {f"{direction}_int_register_{i}": "INT32", f"{direction}_double_register_{i}": "DOUBLE"}
    return kinds


OUTPUT_KINDS, INPUT_KINDS = _kinds(_OUTPUTS, "output"), _kinds({}, "input")
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"  # in place of the type of a variable that is unknown, or another client's


def packet(kind: int, payload: bytes = b"") -> bytes:
    """Return a packet: a header and its payload."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


def packets(buffer: bytearray) -> Iterator[tuple[int, bytes]]:
    """Yield kind and payload of each whole packet at the beginning of a buffer, from which it is removed.

    Raises:
        ValueError: A packet is shorter than its header, so that no further packet can be found.
    """
    while len(buffer) >= _HEADER.size:
        size, kind = _HEADER.unpack_from(buffer)
        if size < _HEADER.size:
            raise ValueError(f"an RTDE packet of {size} bytes")
        if len(buffer) < size:
            return
        payload = bytes(buffer[_HEADER.size : size])
        del buffer[:size]
        yield kind, payload


@dataclass(frozen=True)
class Recipe:
    """Order of the variables in a data packet.

    Args:
        names: Names of the variables.
        kinds: Their types; `NOT_FOUND` for an unknown name, `IN_USE` for an input that another client writes.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, text: bytes, known: Mapping[str, str], in_use: Container[str] = ()) -> Recipe:
        """Return the recipe of comma-separated names, of which the last may be empty."""
        names = tuple(name for name in text.decode("ascii", "replace").split(",") if name)
        return cls(names, tuple(IN_USE if name in in_use else known.get(name, NOT_FOUND) for name in names))

    @property
    def refused(self) -> tuple[str, ...]:
        """Variables that are unknown or another client's, with the answer."""
        answers = zip(self.names, self.kinds, strict=True)
        return tuple(f"{name} ({kind})" for name, kind in answers if kind in (NOT_FOUND, IN_USE))

    @property
    def layout(self) -> struct.Struct:
        """Binary layout, big-endian, of a packet's values, which follow the recipe's number."""
        return struct.Struct(">" + "".join(_FORMATS[kind] for kind in self.kinds))

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """Return the variables' values as bytes; a register that no program has written is 0."""
        flat: list[Any] = []
        for name, kind in zip(self.names, self.kinds, strict=True):
            count = int(_FORMATS[kind][0]) if kind.startswith("VECTOR") else 1
            value = values.get(name, [0] * count if count > 1 else 0)
            flat += list(value) if count > 1 else [value]
        return self.layout.pack(*flat)

    def unpack(self, data: bytes) -> dict[str, Any]:
        """Return the values of the variables by name.

        Raises:
            ValueError: The data have another length.
        """
        layout = self.layout
        if len(data) != layout.size:
            raise ValueError(f"{len(data)} bytes of data for a recipe of {layout.size}")
        flat, values = list(layout.unpack(data)), {}
        for name, kind in zip(self.names, self.kinds, strict=True):
            count = int(_FORMATS[kind][0]) if kind.startswith("VECTOR") else 1
            taken, flat = flat[:count], flat[count:]
            values[name] = taken if count > 1 else taken[0]
        return values
