"""Import of MuJoCo such that a wrong OpenGL setting disables only pictures, not physics, and that its warnings are
logged once, not written to stderr and to a file in the working folder.
"""

from __future__ import annotations

import logging
import os
from functools import cache

log = logging.getLogger("whiptool")

try:
    import mujoco
except Exception as error:  # MuJoCo does not load at all where MUJOCO_GL names something that does not work
    given = os.environ.get("MUJOCO_GL")
    if given is None:
        raise
    log.warning("MUJOCO_GL=%s does not work (%s); MuJoCo draws nothing", given, error)
    os.environ["MUJOCO_GL"] = "disabled"
    import mujoco


@cache
def _warn_once(said: str) -> None:
    log.warning("MuJoCo warns: %s", said)


if mujoco.get_mju_user_warning() is None:  # a user's own handler stays
    mujoco.set_mju_user_warning(lambda text: _warn_once(text.partition(" Time = ")[0]))

__all__ = ["mujoco"]
