"""Packets against the maker's manual and the maker's SDK, and a parser that survives any bytes."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ports import sdk
from servos import GOLDEN, bytes_with_headers, h

from whiptool.rig.emulator.packets import LONGEST, Packet, Parser, crc16, encode, fast_status, stuff, unstuff

FAST_SYNC = h("FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08 00 07 1F 08 00 00 16 CA 00 04 FF 03 00 00 D1 9E")
FAST_BULK = h("FF FF FD 00 FE 14 00 55 00 03 A6 00 00 00 67 A4 00 07 A5 01 24 74 00 04 1F D9 C1")


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_packets_parse_and_encode(name):
    data = h(GOLDEN[name])
    (packet,) = Parser().feed(data)
    assert packet.id == data[4]
    assert packet.instruction == data[7]
    assert packet.parameters == data[8:-2]
    assert encode(packet) == data


def test_golden_fast_replies():
    parts = [(3, 0, h("A6 00 00 00")), (7, 0, h("1F 08 00 00")), (4, 0, h("FF 03 00 00"))]
    assert b"".join(fast_status(parts)) == FAST_SYNC
    parts = [(3, 0, h("A6 00 00 00")), (7, 0, h("A5 01")), (4, 0, h("1F"))]
    assert b"".join(fast_status(parts)) == FAST_BULK


def test_the_manuals_crc_of_the_fast_bulk_read_is_a_misprint():
    # It repeats the CRC of the fast sync read's example. The SDK's own table settles it.
    body = h("FF FF FD 00 FE 12 00 9A 03 84 00 04 00 07 7C 00 02 00 04 92 00 01 00")
    assert crc16(body) == sdk.Protocol2PacketHandler().updateCRC(0, body, len(body)) == 0x2DDA


@given(st.binary(max_size=300))
def test_crc_equals_the_sdks(data):
    assert crc16(data) == sdk.Protocol2PacketHandler().updateCRC(0, list(data), len(data))


@given(bytes_with_headers | st.binary(max_size=200))
def test_stuffing_is_undone(body):
    stuffed = stuff(body)
    assert unstuff(stuffed) == body
    assert b"\xff\xff\xfd\x00" not in stuffed


@st.composite
def streams(draw):
    """Packets with noise between them that contains no header, cut anywhere."""
    packets = draw(
        st.lists(
            st.builds(Packet, st.integers(0, 252), st.integers(0, 255), bytes_with_headers | st.binary(max_size=60)),
            max_size=6,
        )
    )
    noise = st.binary(max_size=20).filter(lambda b: b"\xff" not in b)
    data = b"".join(draw(noise) + encode(packet) for packet in packets) + draw(noise)
    cuts = sorted(draw(st.lists(st.integers(0, len(data)), max_size=8)))
    return packets, [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]


@given(streams())
def test_parser_finds_every_packet_however_the_bytes_are_cut(stream):
    packets, pieces = stream
    parser = Parser()
    assert [p for piece in pieces for p in parser.feed(piece)] == packets


good_packets = st.builds(Packet, st.integers(0, 254), st.integers(0, 255), st.binary(max_size=9)).map(encode)


@given(st.lists(st.binary(max_size=80) | bytes_with_headers | good_packets, max_size=20))
@settings(max_examples=300)
def test_parser_survives_any_bytes_and_accepts_only_what_has_its_crc(pieces):
    parser, whole = Parser(), b"".join(pieces)
    valid, crc = set(), sdk.Protocol2PacketHandler().updateCRC
    for i in range(len(whole) - 9):  # by brute force and the SDK's table: every packet that stands anywhere in there
        length = whole[i + 5] | whole[i + 6] << 8
        packet = whole[i : i + 7 + length]
        whole_one = packet[:4] == b"\xff\xff\xfd\x00" and length >= 3 and len(packet) == 7 + length
        if whole_one and crc(0, packet, len(packet) - 2) == packet[-2] | packet[-1] << 8:
            valid.add((packet[4], unstuff(packet[7:-2])))
    for piece in pieces:
        for packet in parser.feed(piece):
            assert (packet.id, bytes([packet.instruction]) + packet.parameters) in valid
    assert parser.pending <= LONGEST + 7  # it never hoards


@given(st.builds(Packet, st.integers(0, 252), st.integers(0, 255), st.binary(max_size=40)), st.data())
@settings(max_examples=300)
def test_no_single_flipped_bit_is_accepted(packet, data):
    good = encode(packet)
    at = data.draw(st.integers(0, len(good) * 8 - 1))
    bad = bytearray(good)
    bad[at // 8] ^= 1 << at % 8
    assert list(Parser().feed(bytes(bad))) == []


def test_a_cut_off_packet_does_not_swallow_the_next():
    parser = Parser()
    assert list(parser.feed(encode(Packet(1, 3, bytes(300)))[:50])) == []  # 250 bytes are still to come
    assert len(list(parser.feed(h(GOLDEN["ping"])))) == 1
