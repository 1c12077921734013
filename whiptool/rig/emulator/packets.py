"""Protocol 2.0 on the servo's side: checksum, byte stuffing, and a parser that accepts any bytes.

Source: https://emanual.robotis.com/docs/en/dxl/protocol2/ and https://emanual.robotis.com/docs/en/dxl/crc/. It shares
no code with the manufacturer's SDK, so that each checks the other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import and_

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
STATUS = 0x55
LONGEST = 1024  # largest length field that is accepted [bytes]; nothing on this bus is longer


def _table() -> tuple[int, ...]:
    """CRC-16 of every byte: polynomial 0x8005, not reflected."""
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC = _table()


def crc16(data: bytes | bytearray, crc: int = 0) -> int:
    """Return the CRC-16 of `data`, continued from `crc`."""
    for byte in data:
        crc = (crc << 8 & 0xFF00) ^ _CRC[crc >> 8 ^ byte]
    return crc


@dataclass(frozen=True)
class Packet:
    """Content of a packet of Dynamixel Protocol 2.0.

    Args:
        id: Identifier of the servo; 254 addresses all.
        instruction: Code of the instruction; 0x55 is the reply of a servo (status packet).
        parameters: Bytes after the instruction; of a status packet the first is the error.
    """

    id: int
    instruction: int
    parameters: bytes = b""


def stuff(body: bytes) -> bytes:
    """Replace FF FF FD in a packet by FF FF FD FD, so that it is not taken for a header."""
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def unstuff(body: bytes) -> bytes:
    """Reverse `stuff`: replace FF FF FD FD by FF FF FD."""
    return body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def encode(packet: Packet, *, stuffed: bool = True) -> bytes:
    """Return the bytes of a packet; replies to fast reads are not stuffed."""
    body = bytes([packet.instruction]) + packet.parameters
    body = stuff(body) if stuffed else body
    head = HEADER + bytes([packet.id]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16(head).to_bytes(2, "little")


def status(id: int, error: int, data: bytes = b"") -> bytes:
    """Return the bytes of a status packet."""
    return encode(Packet(id, STATUS, bytes([error]) + data))


def fast_length(parts: list[tuple[int, int, bytes]]) -> int:
    """Return the length field [bytes] of the reply to a fast read; `parts` are (id, error, data) of each servo."""
    return 1 + sum(len(data) + 4 for _, _, data in parts)


def fast_status(parts: list[tuple[int, int, bytes]]) -> list[bytes]:
    """Return the reply to a fast read, one part for each servo (id, error, data).

    The first part contains the header; each part ends with the CRC of everything sent so far. Nothing is stuffed.
    """
    piece = HEADER + bytes([BROADCAST]) + fast_length(parts).to_bytes(2, "little") + bytes([STATUS])
    pieces, crc = [], 0
    for id, error, data in parts:
        piece += bytes([error, id]) + data
        crc = crc16(piece, crc)
        end = crc.to_bytes(2, "little")
        crc = crc16(end, crc)
        pieces.append(piece + end)
        piece = b""
    return pieces


def overlaid(replies: Sequence[bytes]) -> bytes:
    """Return what is read where several servos reply at once: a 0 wins, bit by bit, as on a TTL line. Equal replies
    stay whole. An idealization: real servos do not begin at the very same instant.
    """
    if len(replies) < 2:
        return replies[0] if replies else b""
    longest = max(map(len, replies))
    padded = [reply.ljust(longest, b"\xff") for reply in replies]
    return bytes(reduce(and_, column) for column in zip(*padded, strict=True))


class Parser:
    """Extracts packets from a stream of bytes that arrives in pieces of any size.

    Bytes that are not a valid packet are skipped: wrong CRC, length above `LONGEST`, unescaped header inside. The
    search for the next header then starts at the second byte, so that a good packet after a damaged one is found.

    Args:
        stuffed: Whether packets are stuffed; the replies to fast reads are not.
    """

    def __init__(self, *, stuffed: bool = True) -> None:
        self._buffer = bytearray()
        self._stuffed = stuffed
        self.skipped = 0  # bytes that belonged to no packet
        self.broken = 0  # whole packets with a wrong CRC

    @property
    def pending(self) -> int:
        """Number of bytes of an incomplete packet."""
        return len(self._buffer)

    def reset(self) -> None:
        """Discard an incomplete packet, because the line was silent for too long."""
        self.skipped += len(self._buffer)
        self._buffer.clear()

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Yield the packets that these bytes complete, in order."""
        buffer = self._buffer
        buffer += data
        while True:
            start = buffer.find(HEADER)
            if start < 0:
                # the last three bytes may be the beginning of a header
                keep = next((n for n in (3, 2, 1) if buffer.endswith(HEADER[:n])), 0)
                self._skip(len(buffer) - keep)
                return
            self._skip(start)
            if len(buffer) < 8:
                return
            length = buffer[5] | buffer[6] << 8
            if not 3 <= length <= LONGEST or buffer[4] in (0xFD, 0xFF):
                self._skip(1)
                continue
            # A header inside means that this packet was cut off; do not wait for the rest of it
            inside = buffer.find(HEADER, 4, 7 + length - 2) if self._stuffed else -1
            if inside >= 0:
                self._skip(inside)
                continue
            if len(buffer) < 7 + length:
                return
            whole = bytes(buffer[: 7 + length])
            if crc16(whole[:-2]) != whole[-2] | whole[-1] << 8:
                self.broken += 1
                self._skip(1)
                continue
            body = whole[7:-2]
            if self._stuffed:
                body = unstuff(body)
            del buffer[: 7 + length]
            yield Packet(whole[4], body[0], body[1:])

    def _skip(self, n: int) -> None:
        self.skipped += n
        del self._buffer[:n]
