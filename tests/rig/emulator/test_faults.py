"""Faults of the supply, of ids and of boots, as clients see them, and how they are described on a command line."""

from __future__ import annotations

import inspect
import re

import pytest
from ports import RawLine, sdk
from repository import ROOT
from servos import GOLDEN, OK, h

from whiptool.commands import emulators as command
from whiptool.commands.emulators import EmulatorOptions
from whiptool.errors import InputError
from whiptool.rig.emulator import Fault, TwinOptions
from whiptool.rig.emulator.faults import KINDS, RANGES
from whiptool.rig.emulator.instructions import ServoChain
from whiptool.rig.emulator.motor import Motor
from whiptool.rig.emulator.packets import Packet, encode, overlaid, status
from whiptool.rig.emulator.servo import Servo

ALERT = 0x80


def test_a_sag_is_seen_bounds_the_motors_and_ends(line, twin):
    port, handler = line
    for id in (1, 2):
        assert handler.write1ByteTxRx(port, id, 11, 16) == OK  # PWM mode
        assert handler.write1ByteTxRx(port, id, 64, 1) == OK
    twin.advance(0.05)
    usual = twin.state()["current"][0]
    twin.inject(Fault("sag", at=0.05, volts=6.0, lasting=0.2))
    twin.advance(0.1)
    assert handler.read2ByteTxRx(port, 2, 144) == (60, 0, ALERT)  # the reply has the alert bit ..
    assert handler.read1ByteTxRx(port, 1, 70) == (1, 0, ALERT)  # .. and the error is the input voltage
    assert 0 < twin.state()["current"][0] < usual
    assert twin.state()["torque_on"] == [True, True]  # the factory's Shutdown does not have it
    twin.advance(0.2)
    assert handler.read2ByteTxRx(port, 2, 144) == (120, 0, ALERT)
    assert handler.reboot(port, 2)[0] == 0
    assert handler.read1ByteTxRx(port, 2, 70) == (0, *OK)


def test_two_servos_of_one_id_talk_at_once(line, twin):
    port, handler = line
    twin.reset((0.3, 0.5))
    port.settle()
    twin.inject(Fault("same_id", servo=1))
    assert handler.ping(port, 2)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.ping(port, 1) == (1020, *OK)  # equal replies stay whole
    assert handler.read4ByteTxRx(port, 1, 132)[1] in (sdk.COMM_RX_CORRUPT, sdk.COMM_RX_TIMEOUT)
    assert handler.write1ByteTxRx(port, 1, 64, 1) == OK
    assert twin.state()["torque_on"] == [True, True]  # both obey


def test_replies_at_once_are_what_a_zero_wins_of():
    assert overlaid([b"\xf0\x0f", b"\xaa\xff"]) == b"\xa0\x0f"
    assert overlaid([b"\x55", b"\xff\x0f"]) == b"\x55\x0f"
    assert overlaid([]) == b""
    first, second = Servo(1, Motor()), Servo(1, Motor())
    second.feel(0.5, 0, 0, 0)
    chain = ServoChain([first, second])
    wanted = bytes([132, 0, 4, 0])
    answers = [status(1, 0, s.get("present_position").to_bytes(4, "little")) for s in (first, second)]
    assert chain.handle(Packet(1, 2, wanted)) == [overlaid(answers)]
    assert chain.handle(Packet(254, 0x82, wanted + b"\x01")) == [overlaid(answers)]
    (fast,) = chain.handle(Packet(254, 0x8A, wanted + b"\x01"))
    assert fast != overlaid([fast, answers[0]])


def test_a_reboot_takes_its_time():
    s = Servo(1, Motor(), reboot_time=0.4)
    chain = ServoChain([s])
    assert chain.handle(Packet(1, 1)) != []
    s.write(60, b"\x01")  # torque on at startup
    s.write(64, b"\x01")
    assert chain.handle(Packet(1, 8)) == [status(1, 0)]  # it answers, and is gone
    assert not s.torque_on
    for elapsed in (0.2, 0.19):
        s.age(elapsed)
        assert chain.handle(Packet(1, 1)) == []
        assert not s.torque_on
    s.feel(0.2, 0.0, 0.0, 0.4)  # it falls meanwhile
    chain.handle(Packet(1, 3, bytes([65, 0, 1])))
    s.age(0.02)
    assert chain.handle(Packet(1, 1)) != []
    assert s.get("led") == 0
    assert s.torque_on
    assert s.get("goal_position") == s.get("present_position") == 2048 + 130


def test_a_reboot_by_itself_loses_torque_and_ram(line, twin):
    port, handler = line
    for address in (64, 65):
        assert handler.write1ByteTxRx(port, 1, address, 1) == OK
    twin.inject(Fault("reboot", servo=0))
    assert [handler.read1ByteTxRx(port, 1, address)[0] for address in (64, 65)] == [0, 0]


def test_in_real_time_servos_need_as_long_as_real_ones_to_reboot():
    assert TwinOptions(lockstep=False).make_servos()[0].reboot_time == 0.4
    assert TwinOptions().make_servos()[0].reboot_time == 0.0
    assert TwinOptions(reboot_time=1.5).make_servos()[0].reboot_time == 1.5
    with pytest.raises(InputError, match="reboot_time"):
        TwinOptions(reboot_time=-1)


def test_a_backup_is_made_over_the_line(twin):
    twin.reset()
    with RawLine(twin) as raw:
        raw.write(h("FF FF FD 00 01 08 00 20 01 43 54 52 4C 16 F5"))  # the manual's example
        assert raw.answer() == h(GOLDEN["write status"])
        raw.write(encode(Packet(1, 0x20, b"\x02CTRL")))  # restore; the manual's example has another CRC, a misprint
        assert raw.answer() == h(GOLDEN["write status"])


# -- text ------------------------------------------------------------------------------------------------------------


def test_faults_are_described_in_words():
    assert Fault.parse("dead") == Fault("dead")
    assert Fault.parse("sag:at=2:volts=8.5:lasting=0.5") == Fault("sag", at=2.0, volts=8.5, lasting=0.5)
    assert Fault.parse("split:count=10:seed=3") == Fault("split", count=10, seed=3)
    for text, named in (
        ("explode", "same_id"),
        ("sag:volts=low", "volts"),
        ("sag:watts=3", "lasting"),
        ("sag:at", "sag:NAME"),
        ("sag:volts=0", "volts"),
        ("dead:servo=-1", "servo"),
        ("jump:at=5:angle=\u0660.\u0663", "angle"),
        ("drop:count=1_0", "count"),
        ("flicker:angle=1", "flicker:NAME=NUMBER:.. with any of at, servo as names"),
        ("drop:seed=3", "with any of at, count as names"),
        ("dead:volts=3", "with any of at, servo as names"),
        ("jump:at=1:at=2", "each once"),
        ("jump:angle=100", "angle: got 100.*<= 6.28"),
        ("sag:volts=400", "volts: got 400.*<= 24"),
    ):
        with pytest.raises(InputError, match=named):
            Fault.parse(text)


def test_pages_and_help_name_what_each_kind_takes():
    page = (ROOT / "docs/rig-safety.md").read_text().partition("| fault | what happens |")[2].partition("\n\n")[0]
    told = {}
    for row in page.splitlines()[2:]:
        _, kinds, _, values, _ = row.split("|")
        told |= {kind: tuple(re.findall("`([a-z]+)`", values)) for kind in re.findall("`([a-z_]+)`", kinds)}
    assert told == KINDS
    assert {"at", *(name for names in KINDS.values() for name in names)} == {*RANGES}
    assert not {*KINDS, *RANGES} - {*re.findall("[a-z_]+", inspect.getsource(EmulatorOptions))}


def test_a_fault_needs_its_servo(twin):
    with pytest.raises(InputError, match="servo of the fault: got 2"):
        twin.inject(Fault("dead", servo=2))
    with pytest.raises(InputError, match="one servo"):
        Fault("same_id").check_servo(1)


def test_the_command_line_refuses_other_faults(capsys):
    assert command.servos(["--faults", "dead", "explode:at=2"]) == 2
    assert "--faults: got 'explode'; allowed: drop, corrupt" in capsys.readouterr().err
    assert command.servos(["--faults", "dead:servo=7"]) == 2
    assert "servo of the fault: got 7" in capsys.readouterr().err
    assert command.servos(["--faults", "jump:angle=\u0660.3"]) == 2
    assert "--faults: got 'jump:angle=\u0660.3'; allowed: jump:NAME" in capsys.readouterr().err
