import struct

import numpy as np
import pytest

from whiptool.rig.ur_emulator.rtde_packets import INPUT_KINDS, OUTPUT_KINDS, Recipe, packet, packets
from whiptool.rig.ur_emulator.ur_controller import UrController, UrOptions


def test_packets_are_found_in_pieces_of_a_stream():
    whole = packet(ord("V"), b"\x00\x02") + packet(ord("S"))
    assert whole == bytes.fromhex("0005560002" + "000353")  # length, kind, payload: the guide's protocol
    buffer, found = bytearray(), []
    for byte in whole:
        buffer.append(byte)
        found += packets(buffer)
    assert found == [(ord("V"), b"\x00\x02"), (ord("S"), b"")]
    assert not buffer


def test_a_packet_shorter_than_its_header_is_refused():
    with pytest.raises(ValueError, match="2 bytes"):
        list(packets(bytearray(b"\x00\x02\x56")))


def test_values_have_the_types_and_the_order_of_the_recipe():
    recipe = Recipe.of(b"timestamp,actual_q,robot_mode,", OUTPUT_KINDS)
    data = recipe.pack({"timestamp": 1.5, "actual_q": range(6), "robot_mode": -7})
    assert data == struct.pack(">d6di", 1.5, *range(6), -7)
    assert recipe.unpack(data) == {"timestamp": 1.5, "actual_q": [0, 1, 2, 3, 4, 5], "robot_mode": -7}
    assert Recipe.of(b"robot_mode", OUTPUT_KINDS).pack({}) == b"\0\0\0\0"


def test_an_unknown_variable_is_told():
    recipe = Recipe.of(b"input_int_register_0,input_int_register_48", INPUT_KINDS)
    assert recipe.kinds == ("INT32", "NOT_FOUND")
    assert recipe.refused == ("input_int_register_48 (NOT_FOUND)",)


def test_an_input_of_another_client_is_in_use():
    recipe = Recipe.of(b"input_int_register_0,input_int_register_1", INPUT_KINDS, {"input_int_register_1"})
    assert recipe.kinds == ("INT32", "IN_USE")
    assert recipe.refused == ("input_int_register_1 (IN_USE)",)


def test_every_output_that_is_confirmed_is_computed():
    """21 were confirmed and sent as zeros; registers are 0 until a program writes them."""
    values = UrController(UrOptions()).outputs()
    for name, kind in OUTPUT_KINDS.items():
        if not name.startswith("output_"):
            count = int(kind.removeprefix("VECTOR")[0]) if kind.startswith("VECTOR") else 1
            assert np.size(values[name]) == count, name


def test_every_input_that_is_confirmed_reaches_the_program():
    assert all("_register_" in name and "_bit_" not in name for name in INPUT_KINDS)


def test_data_of_another_length_are_refused():
    with pytest.raises(ValueError, match="3 bytes of data for a recipe of 4"):
        Recipe.of(b"input_int_register_0", INPUT_KINDS).unpack(b"\0\0\0")
