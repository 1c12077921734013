"""OpenCV, imported where it is used."""

from __future__ import annotations

from typing import Any

from whiptool.extras import optional


def opencv() -> Any:
    """Return the module cv2.

    Raises:
        InputError: OpenCV is not installed, or does not load.
    """
    return optional("cv2", "cameras and images")
