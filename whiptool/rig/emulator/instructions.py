"""Replies of a chain of servos to the instructions of Protocol 2.0.

Source: https://emanual.robotis.com/docs/en/dxl/protocol2/, "Instruction Details".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import zip_longest

from whiptool.rig.dynamixel.control_table import XM430_W350
from whiptool.rig.emulator.memory import ACCESS_ERROR, LENGTH_ERROR, RESULT_FAIL
from whiptool.rig.emulator.packets import BROADCAST, Packet, fast_length, fast_status, overlaid, status
from whiptool.rig.emulator.servo import Servo

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR, BACKUP = 1, 2, 3, 4, 5, 6, 8, 0x10, 0x20
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ, BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A
INSTRUCTION_ERROR, CRC_ERROR = 2, 3
CLEAR_TURNS = bytes([0x01, 0x44, 0x58, 0x4C, 0x22])
STORE, RESTORE = bytes([0x01, 0x43, 0x54, 0x52, 0x4C]), bytes([0x02, 0x43, 0x54, 0x52, 0x4C])
LAST_ID = 252
GOAL_CURRENT = XM430_W350["goal_current"].address


def _words(data: bytes) -> list[int]:
    return [data[i] | data[i + 1] << 8 for i in range(0, len(data) - 1, 2)]


class ServoChain:
    """Servos on one bus.

    Args:
        servos: Servos in their order on the line.
        on_goal: Called after any write to Goal Current, accepted or not, while a servo's torque is on; it advances time
            in lock step.
    """

    def __init__(self, servos: Sequence[Servo], on_goal: Callable[[], None] | None = None) -> None:
        self.servos, self._beat = servos, on_goal or (lambda: None)

    def _on_goal(self) -> None:
        if any(servo.torque_on for servo in self.servos):
            self._beat()

    def find(self, id: int) -> list[Servo]:
        """Return the servos with that id that hear; more than one only if an id was given twice."""
        return [s for s in self.servos if s.memory[7] == id and s.hears]

    def _shadows(self, id: int) -> list[Servo]:
        """Servos that obey this id as their Secondary ID(12), without a reply and without EEPROM."""
        return [s for s in self.servos if s.memory[12] == id != s.memory[7] and id <= LAST_ID and s.hears]

    def handle(self, packet: Packet) -> list[bytes]:
        """Return the replies to an instruction, in the order of transmission; empty if no reply is due."""
        for servo in self.servos:
            servo.heard()
        if packet.instruction in (*_READS, SYNC_WRITE, BULK_WRITE):
            return self._many(packet) if packet.id == BROADCAST else []
        if packet.id == BROADCAST:
            hearing = sorted((s for s in self.servos if s.hears), key=lambda s: s.get("id"))
            replies = [self._one(servo, packet, broadcast=True) for servo in hearing]
        else:
            replies = [overlaid([self._one(servo, packet) for servo in self.find(packet.id)])]
            if packet.instruction not in (PING, READ, FACTORY_RESET, BACKUP):
                for servo in self._shadows(packet.id):
                    self._one(servo, packet, shadow=True)
        if packet.instruction == ACTION or beats(packet):
            self._on_goal()
        return [reply for reply in replies if reply]

    def _one(self, servo: Servo, packet: Packet, *, broadcast: bool = False, shadow: bool = False) -> bytes:
        """Reply of one servo to an instruction to one; empty where it is silent. `shadow`: the instruction was to its
        Secondary ID.
        """
        id, data, instruction = servo.get("id"), packet.parameters, packet.instruction
        level = servo.get("status_return_level")  # before it is changed
        address = data[0] | data[1] << 8 if len(data) >= 2 else -1
        error, answer, least = 0, b"", 2
        if instruction == PING:
            answer = servo.get("model_number").to_bytes(2, "little") + bytes([servo.get("firmware_version")])
            return status(id, servo.alert, answer)  # at any level
        if instruction == READ:
            least = 1
            if len(data) != 4:
                error = LENGTH_ERROR
            else:
                error, answer = servo.read(address, data[2] | data[3] << 8)
        elif instruction == WRITE:
            error = LENGTH_ERROR if len(data) < 3 else servo.write(address, data[2:], eeprom=not shadow)
        elif instruction == REG_WRITE:
            error = LENGTH_ERROR if len(data) < 3 else servo.check(address, data[2:], eeprom=not shadow)[0]
            if not error:
                servo.registered = address, data[2:]
                servo.set("registered_instruction", 1)
        elif instruction == ACTION:
            if servo.registered is None:
                error = INSTRUCTION_ERROR
            else:
                error = servo.write(*servo.registered)
                servo.registered = None
                servo.set("registered_instruction", 0)
        elif instruction == FACTORY_RESET:
            if broadcast and data == b"\xff":
                return b""  # never all ids at once, since firmware 42
            error = ACCESS_ERROR if servo.torque_on else 0
            if not error and not (len(data) == 1 and servo.factory_reset(data[0])):
                error = RESULT_FAIL
        elif instruction == REBOOT:
            servo.boot()
        elif instruction == CLEAR:
            error = 0 if data == CLEAR_TURNS and servo.clear_turns() else RESULT_FAIL
        elif instruction == BACKUP:
            does = {STORE: servo.backup, RESTORE: servo.restore}.get(data)
            error = 0 if does is not None and does() else RESULT_FAIL
        else:
            error = INSTRUCTION_ERROR
        if broadcast or level < least:
            return b""
        return status(id, servo.alert | error, answer)

    # -- several servos at once ----------------------------------------------------------------------------------

    def _many(self, packet: Packet) -> list[bytes]:
        """Replies to an instruction to several servos."""
        data = packet.parameters
        if packet.instruction == SYNC_WRITE:
            return self._sync_write(data)
        if packet.instruction == BULK_WRITE:
            return self._bulk_write(data)
        parse, fast = _READS[packet.instruction]
        wanted = parse(data)
        answer, servos = self._fast if fast else self._in_turn, [self.find(id) for id, _, _ in wanted]
        most = max(map(len, servos), default=0)
        several = [answer(wanted, [s[k % len(s)] if s else None for s in servos]) for k in range(max(most, 1))]
        return [overlaid(pieces) for pieces in zip_longest(*several, fillvalue=b"")] if most > 1 else several[0]

    def _in_turn(self, wanted: list[tuple[int, int, int]], servos: list[Servo | None]) -> list[bytes]:
        parts = _parts(wanted, servos)
        return [status(id, error, answer) for id, error, answer in parts if answer is not None]

    def _fast(self, wanted: list[tuple[int, int, int]], servos: list[Servo | None]) -> list[bytes]:
        """Each servo adds its part when the one before has sent its own: a dead one ends the reply there."""
        parts = _parts(wanted, servos)
        whole = [
            (id, error, answer if answer else bytes(length))
            for (id, error, answer), (_, _, length) in zip(parts, wanted, strict=True)
        ]
        if not whole or fast_length(whole) > 0xFFFF:  # more than a packet can say: there is no such reply
            return []
        pieces = fast_status(whole)
        alive = next((i for i, (_, _, answer) in enumerate(parts) if answer is None), len(parts))
        return pieces[:alive]

    def _put(self, id: int, address: int, data: bytes) -> None:
        """Write to the servos with an id, and to those with it as their Secondary ID."""
        for servo in self.find(id):
            servo.write(address, data)
        for servo in self._shadows(id):
            servo.write(address, data, eeprom=False)

    def _sync_write(self, data: bytes) -> list[bytes]:
        if len(data) < 4:
            return []
        address, length = _words(data[:4])
        rest = data[4:]
        for i in range(0, len(rest) - length, length + 1):
            self._put(rest[i], address, rest[i + 1 : i + 1 + length])
        if address <= GOAL_CURRENT < address + length:
            self._on_goal()
        return []

    def _bulk_write(self, data: bytes) -> list[bytes]:
        beat = False
        while len(data) >= 5:
            id, (address, length) = data[0], _words(data[1:5])
            value, data = data[5 : 5 + length], data[5 + length :]
            if len(value) == length:
                self._put(id, address, value)
            beat = beat or address <= GOAL_CURRENT < address + length
        if beat:
            self._on_goal()
        return []


def _parts(wanted: list[tuple[int, int, int]], servos: list[Servo | None]) -> list[tuple[int, int, bytes | None]]:
    """(id, error, data) of each servo asked; data None: it does not answer."""
    parts: list[tuple[int, int, bytes | None]] = []
    for (id, address, length), servo in zip(wanted, servos, strict=True):
        if servo is None or servo.get("status_return_level") < 1:
            parts.append((id, 0, None))
        else:
            error, answer = servo.read(address, length)
            parts.append((id, servo.alert | error, answer))
    return parts


def _sync(data: bytes) -> list[tuple[int, int, int]]:
    """Ids, addresses and lengths of a sync read; nothing if it is cut off."""
    if len(data) <= 4:
        return []
    address, length = _words(data[:4])
    return [(id, address, length) for id in data[4:]]


def _bulk(data: bytes) -> list[tuple[int, int, int]]:
    """Likewise of a bulk read."""
    if len(data) % 5:
        return []
    found = [(data[i], _words(data[i + 1 : i + 5])) for i in range(0, len(data), 5)]
    return [(id, address, length) for id, (address, length) in found]


# how what is asked for is parsed, and whether the reply is that of a fast read
_READS = {
    SYNC_READ: (_sync, False), FAST_SYNC_READ: (_sync, True), BULK_READ: (_bulk, False), FAST_BULK_READ: (_bulk, True),
}  # fmt: skip


def _reaches_goal(parameters: bytes) -> bool:
    if len(parameters) < 3:
        return False
    address = parameters[0] | parameters[1] << 8
    return address <= GOAL_CURRENT < address + len(parameters) - 2


def beats(packet: Packet) -> bool:
    """Whether an instruction writes Goal Current, which advances time by one control period in lock step."""
    data = packet.parameters
    if packet.instruction == SYNC_WRITE and len(data) >= 4:
        address, length = _words(data[:4])
        return address <= GOAL_CURRENT < address + length
    return packet.instruction == WRITE and _reaches_goal(data)
