"""A bus with emulated servos that the tests of a file share."""

from __future__ import annotations

import pytest

from whiptool.rig.emulator import Emulator, TwinOptions


@pytest.fixture(scope="module")
def twin():
    with Emulator(TwinOptions(timestep=5e-4, integrator="implicitfast")) as emulator:
        yield emulator


@pytest.fixture
def bus(twin):
    twin.reset((0.3, 0.5))
    with twin.bus(timeout=0.02) as bus:
        bus.prepare_block()
        yield bus
