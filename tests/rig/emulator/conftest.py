"""An emulator that the tests of a file share."""

from __future__ import annotations

import pytest
from ports import PatientPort, sdk

from whiptool.rig.emulator import Emulator, TwinOptions


@pytest.fixture(scope="module")
def twin():
    with Emulator(TwinOptions()) as emulator:
        yield emulator


@pytest.fixture
def line(twin):
    """The SDK's own port and handler on a fresh emulator."""
    twin.reset()
    port = PatientPort(twin)
    yield port, sdk.Protocol2PacketHandler()
    port.closePort()
