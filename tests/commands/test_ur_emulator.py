import subprocess
import sys

import numpy as np
import pytest
from processes import HANG
from ur_robot import own_host

from whiptool.commands.ur_emulator import emulator


def test_the_command_serves_until_it_is_stopped():
    receive = pytest.importorskip("rtde_receive", reason="ur-rtde is not installed, or has no wheel here")
    host, posture = own_host(), (0.1, -1.2, 0.3, 0.0, 0.0, 0.5)
    words = ["--host", host, "--posture", *map(str, posture), "--protective-stop", "0.5"]
    with subprocess.Popen(
        [sys.executable, "-m", "whiptool.rig.ur_emulator", *words], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"an emulated UR5e serves on {host}: ur://{host}; Ctrl-C ends it\n"
        client = receive.RTDEReceiveInterface(host)
        assert np.allclose(client.getActualQ(), posture)
        client.disconnect()
        process.terminate()
        process.wait(HANG)


def test_an_address_of_another_machine_is_refused(capsys):
    assert emulator(["--host", "192.0.2.1"]) == 2
    assert "an address on which port 29999 is free" in capsys.readouterr().err
