"""Whether what is shared by threads gives each of them what it gives one alone."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np


def check_shared(function: Callable[[Any], tuple], items: Sequence[Any]) -> None:
    """Have three threads that take turns often call a function; every number is the same to the bit."""
    alone = [function(item) for item in items]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(3) as threads:
            together = list(threads.map(function, items))
    finally:
        sys.setswitchinterval(interval)
    for mine, shared in zip(alone, together, strict=True):
        for x, y in zip(mine, shared, strict=True):
            np.testing.assert_array_equal(x, y)
