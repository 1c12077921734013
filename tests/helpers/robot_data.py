"""Robots of the package example-robot-data, where it is installed."""

from __future__ import annotations

import sysconfig
from importlib.util import find_spec
from pathlib import Path

import pytest


def example_robots() -> Path:
    """Return the folder of its robots; the test is skipped where there is none.

    With its Python module it says so itself; newer wheels have none, and lay the files where cmeel's packages do.
    """
    if find_spec("example_robot_data") is not None:
        from example_robot_data.path import EXAMPLE_ROBOT_DATA_MODEL_DIR

        return Path(EXAMPLE_ROBOT_DATA_MODEL_DIR)
    folder = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
    if not folder.is_dir():
        pytest.skip("example-robot-data is not installed")
    return folder
