"""Logs of joints that leave the motion of the arm to be guessed."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.identification.log_gaps import check_covers

T = np.arange(-0.1, 1.2, 0.008)
Q = np.stack([np.clip(T, 0, 0.6) * 1.5, -np.clip(T, 0, 0.6)], axis=1)


def log(which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return T[which], Q[which]


@pytest.mark.parametrize(
    ("which", "said"),
    [
        ((T < 0.3) | (T > 0.5), r"a hole of 0\.20\d s from 0\.\d+ s, in which a joint moved by 0\.3"),
        (T > 0.2, r"a start at 0\.20\d s, with the arm moving; readings from 0\.000 s"),
        (T < 0.4, r"an end at 0\.39\d s; readings to 1\.000 s"),
        (T < 0.85, r"an end at 0\.84\d s; readings to 1\.000 s"),
    ],
)
def test_what_would_have_to_be_guessed_is_refused(which, said):
    with pytest.raises(InputError, match=f"^s.csv: joints: got .*{said}"):
        check_covers("s.csv: joints", *log(which), 0.0, 1.0)


@pytest.mark.parametrize(
    "which",
    [T < 2, T > -0.05, T < 1.0, (T < 0.7) | (T > 0.95), np.arange(len(T)) % 4 == 0, np.arange(len(T)) % 30 != 5],
)
def test_a_log_that_tells_the_motion_passes(which):
    """Also with a hole while the arm stands, a sample lost here and there, or samples that are rare."""
    check_covers("s.csv: joints", *log(which), 0.0, 1.0)
