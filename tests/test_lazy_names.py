"""Names are imported when they are used."""

from __future__ import annotations

import subprocess
import sys


def test_import_is_light():
    heavy = "{'numpy', 'casadi', 'mujoco', 'torch', 'cv2', 'matplotlib', 'pinocchio'}"
    program = f"import sys, whiptool; found = {heavy} & set(sys.modules); assert not found, found"
    subprocess.run([sys.executable, "-c", program], check=True)
