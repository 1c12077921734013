"""The serial port: its rate, its latency timer, and what the SDK's handler gets wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from ports import sdk

from whiptool.errors import InputError
from whiptool.rig.dynamixel.port import check_rate, latency_timer


def test_trap_sdk_removes_too_much():
    reply = list(bytes.fromhex("FFFFFD00010C0055 00 FFFFFDFD 00FFFDFD 00 0000".replace(" ", "")))
    reply[5] = len(reply) - 7
    body = bytes(sdk.Protocol2PacketHandler().removeStuffing(list(reply)))[9:]
    assert not body.startswith(bytes.fromhex("FFFFFD 00FFFDFD"))
    from whiptool.rig.dynamixel.port import make_handler

    assert bytes(make_handler().removeStuffing(list(reply)))[9:].startswith(bytes.fromhex("FFFFFD 00FFFDFD"))


def test_rates_and_what_mends_them():
    ok: dict = {"device": "/dev/ttyUSB0", "bytes_per_cycle": 88}
    assert check_rate(500, baud=1_000_000, latency=1e-3, **ok) == pytest.approx(88e-5 + 1e-3)
    with pytest.raises(InputError, match=r"latency timer: got '16 ms'.*echo 1 \| sudo tee /sys/class/tty/ttyUSB0/"):
        check_rate(500, baud=1_000_000, latency=16e-3, **ok)
    with pytest.raises(InputError, match="--set-return-delay 0"):
        check_rate(500, baud=1_000_000, delays=2e-3, **ok)
    with pytest.raises(InputError, match="--set-baud 2000000"):
        check_rate(2000, baud=1_000_000, **ok)
    with pytest.raises(InputError, match="take a lower rate"):
        check_rate(9000, baud=4_000_000, **ok)


def test_latency_timer_comes_from_the_driver(tmp_path: Path):
    (tmp_path / "ttyUSB3" / "device").mkdir(parents=True)
    (tmp_path / "ttyUSB3" / "device" / "latency_timer").write_text("16\n")
    assert latency_timer("/dev/ttyUSB3", sysfs=tmp_path) == pytest.approx(0.016)
    assert latency_timer("/dev/ttyACM0", sysfs=tmp_path) is None
