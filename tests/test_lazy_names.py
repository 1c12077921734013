"""Importing whiptool costs nothing, and makes its environment known to Gymnasium."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import pytest


def test_import_is_light():
    heavy = "{'numpy', 'casadi', 'mujoco', 'torch', 'cv2', 'matplotlib', 'pinocchio'}"
    program = f"import sys, whiptool; found = {heavy} & set(sys.modules); assert not found, found"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_readers_are_light():
    """Each file of some formats is parsed in a process that imports them: SciPy would take it longer than the rest."""
    heavy = "{'scipy', 'casadi', 'matplotlib', 'h5py', 'pandas'}"
    program = f"import sys, whiptool.recording.readers; found = {heavy} & set(sys.modules); assert not found, found"
    subprocess.run([sys.executable, "-c", program], check=True)


ID = "whiptool/WhipTarget-v0"
FOUND = f"assert gymnasium.spec('{ID}').entry_point == 'whiptool.rl.environment:WhipEnv'"


@pytest.mark.skipif(find_spec("gymnasium") is None, reason="Gymnasium is not installed")
@pytest.mark.parametrize(
    "program",
    [
        f"import gymnasium, whiptool; {FOUND}",
        f"import whiptool, gymnasium; {FOUND}",
        f"import whiptool, importlib.util as u; u.find_spec('gymnasium'); u.find_spec('gymnasium'); import gymnasium; "
        f"{FOUND}",  # as `whiptool.extras` looks for it
    ],
)
def test_the_id_is_known_once_whiptool_is_imported(program):
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(find_spec("gymnasium") is None, reason="Gymnasium is not installed")
def test_whiptool_is_imported_without_gymnasium():
    """It imports none, nor needs one that is installed."""
    program = (
        "import sys, whiptool; assert 'gymnasium' not in sys.modules; assert sys.meta_path[0].find_spec('json', None) "
        "is None; sys.path.clear(); import importlib.util as u; assert u.find_spec('gymnasium') is None"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
