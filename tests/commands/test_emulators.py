import socket
import subprocess
import sys

import numpy as np
import pytest
from ports import sdk
from processes import HANG
from servos import OK
from ur_robot import own_host

from whiptool.commands import emulators


def test_the_command_serves_until_it_is_stopped():
    receive = pytest.importorskip("rtde_receive", reason="ur-rtde is not installed, or has no wheel here")
    host, posture = own_host(), (0.1, -1.2, 0.3, 0.0, 0.0, 0.5)
    words = ["--host", host, "--posture", *map(str, posture), "--protective-stop", "0.5", "--lockstep"]
    with subprocess.Popen(
        [sys.executable, "-m", "whiptool.rig.ur_emulator", *words], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"an emulated UR5e serves on {host}: ur://{host}; Ctrl-C ends it\n"
        client = receive.RTDEReceiveInterface(host, 500.0, ["actual_q"])
        assert np.allclose(client.getActualQ(), posture)
        client.disconnect()
        with socket.create_connection((host, 30001), timeout=HANG) as stranger:
            stranger.sendall(b"def mine():\n movej([0, 0, 0, 0, 0, 0])\nend\n")
            said = process.stdout.readline()  # at once
        assert said == "a program other than ur_rtde's control program is not emulated\n"
        process.terminate()
        process.wait(HANG)


def test_an_address_of_another_machine_is_refused(capsys):
    assert emulators.ur(["--host", "192.0.2.1"]) == 2
    assert "an address on which port 29999 is free" in capsys.readouterr().err


def test_command_line_serves_a_linked_device(tmp_path):
    link = tmp_path / "tty"
    faults = ("--faults", "sag:volts=11", "same_id:at=3600:servo=1", "--reboot-time", "3600")
    command = [sys.executable, "-m", "whiptool.rig.emulator", "--link", str(link), *faults]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert "emulated servos [1, 2] at 1000000 baud" in process.stdout.readline()
        assert "and on" in process.stdout.readline()
        port, handler = sdk.PortHandler(str(link)), sdk.Protocol2PacketHandler()
        assert port.setBaudRate(1_000_000)
        while handler.ping(port, 2) != (1020, *OK):  # the SDK gives up after 34 ms, a busy machine does not
            assert process.poll() is None
        while handler.read2ByteTxRx(port, 2, 144) != (110, *OK):  # [0.1 V]
            assert process.poll() is None
        handler.reboot(port, 2)
        while handler.ping(port, 1) != (1020, *OK):  # so that the reboot was heard
            assert process.poll() is None
        assert handler.ping(port, 2)[1] == sdk.COMM_RX_TIMEOUT  # for an hour
        port.closePort()
    finally:
        process.terminate()
        process.wait(HANG)
