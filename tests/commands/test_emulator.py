"""The command that serves emulated servos."""

from __future__ import annotations

import subprocess
import sys

from ports import sdk
from processes import HANG
from servos import OK


def test_command_line_serves_a_linked_device(tmp_path):
    link = tmp_path / "tty"
    process = subprocess.Popen(
        [sys.executable, "-m", "whiptool.rig.emulator", "--link", str(link)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        assert "emulated servos [1, 2] at 1000000 baud" in process.stdout.readline()
        assert "and on" in process.stdout.readline()
        port, handler = sdk.PortHandler(str(link)), sdk.Protocol2PacketHandler()
        assert port.setBaudRate(1_000_000)
        while handler.ping(port, 2) != (1020, *OK):  # the SDK gives up after 34 ms, a busy machine does not
            assert process.poll() is None
        port.closePort()
    finally:
        process.terminate()
        process.wait(HANG)
