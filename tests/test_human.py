"""What notebooks import from `whiptool.human` is there, and costs nothing until it is used."""

from __future__ import annotations

import subprocess
import sys

import pytest
from processes import HANG

from whiptool import human


@pytest.mark.parametrize("name", dir(human))
def test_the_name_is_there(name):
    assert getattr(human, name) is not None


def test_the_door_is_light():
    code = (
        "import sys; from whiptool import human; sys.exit(bool({'pandas', 'h5py', 'statsmodels'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=HANG, check=False).returncode == 0
