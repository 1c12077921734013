"""What notebooks import from `whiptool.human` is there, and costs nothing until it is used."""

from __future__ import annotations

import pkgutil
import subprocess
import sys
from importlib import import_module
from types import ModuleType

import pytest
from processes import HANG

import papers.human
from whiptool import human


@pytest.mark.parametrize("name", dir(human))
def test_the_name_is_there(name):
    """Also when the modules of the folder have been imported, of which none has its name."""
    for module in pkgutil.iter_modules(papers.human.__path__):
        import_module(f"papers.human.{module.name}")
    assert not isinstance(getattr(human, name), ModuleType)


def test_the_door_is_light():
    code = (
        "import sys; from whiptool import human; sys.exit(bool({'pandas', 'h5py', 'statsmodels'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=HANG, check=False).returncode == 0
