"""Import of MuJoCo such that a wrong OpenGL setting disables only pictures, not physics."""

from __future__ import annotations

import logging
import os

try:
    import mujoco
except Exception as error:  # MuJoCo does not load at all where MUJOCO_GL names something that does not work
    given = os.environ.get("MUJOCO_GL")
    if given is None:
        raise
    logging.getLogger("whiptool").warning("MUJOCO_GL=%s does not work (%s); MuJoCo draws nothing", given, error)
    os.environ["MUJOCO_GL"] = "disabled"
    import mujoco

__all__ = ["mujoco"]
