"""OpenCV, imported where it is used."""

from __future__ import annotations

import importlib
from typing import Any

from whiptool.errors import WhiptoolError


def opencv() -> Any:
    """The module cv2.

    Raises:
        WhiptoolError: It is not installed, or does not load.
    """
    try:
        return importlib.import_module("cv2")
    except ImportError as error:
        raise WhiptoolError(f"OpenCV does not load ({error}): pip install whiptool[vision]") from error
