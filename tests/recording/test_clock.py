"""Time stamps: one bad stamp costs one sample, a stretch of them is refused, and so is what no recording lasts."""

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.recording.clock import check_pace, gaps, good_stamps

EVEN = np.arange(40) / 60


def changed(at, value, base=EVEN) -> np.ndarray:
    stamps = base.copy()
    stamps[at] = value
    return stamps


@pytest.mark.parametrize(
    ("stamps", "bad"),
    [
        (changed(10, EVEN[9]), 10),  # the second of a pair repeats the first
        (changed(9, EVEN[10]), 9),  # the first of a pair has what the second should have
        (changed(10, EVEN[3]), 10),
        (changed(10, np.nan), 10),
        (changed(0, np.nan), 0),
        (changed(10, 0.0, EVEN + 5), 10),
        (changed(0, 0.0, EVEN + 1.7e9), 0),
        (changed(10, 99.0), 10),
        (changed(-1, 0.0), 39),
        (changed(-1, 99.0), 39),
    ],
)
def test_a_bad_stamp_costs_its_own_sample(stamps, bad):
    keep, said = good_stamps(stamps, "stamps")
    np.testing.assert_array_equal(np.flatnonzero(~keep), [bad])
    assert f"left out 1 of 40 samples, whose stamps cannot be right: {bad + 1} (" in said[0]


def test_good_stamps_are_kept_without_a_word():
    for stamps in (EVEN, np.delete(EVEN, [7, 8]), EVEN + 1.7e9):
        keep, said = good_stamps(stamps, "stamps")
        assert keep.all()
        assert not said


def test_a_stretch_of_doubled_stamps_is_refused():
    held, pairs = EVEN.copy(), EVEN.copy()
    held[10:16] = EVEN[10]
    pairs[11:20:2] = pairs[10:19:2]
    for stamps in (held, pairs, np.zeros(40), np.full(40, np.nan)):
        with pytest.raises(InputError, match="each later than the one before"):
            good_stamps(stamps, "stamps")
    with pytest.raises(InputError, match="samples 11 to 16"):
        good_stamps(held, "stamps")


@pytest.mark.parametrize(
    ("t", "said"),
    [
        (1e3 * EVEN + 4e5, "steps of 16.6667.*milliseconds"),
        (1e6 * EVEN, "microseconds"),
        (1e9 * EVEN + 1.7e18, "nanoseconds"),
        (np.arange(8000) * 0.2, "span of 1599.8 s in 8000 rows.*milliseconds"),
        (np.arange(3000) * 0.5, "steps of 0.5.*milliseconds"),
        (1e-9 * EVEN, "steps from 1e-06 s"),
    ],
)
def test_times_that_no_strike_lasts_are_refused_with_the_likely_cause(t, said):
    with pytest.raises(InputError, match=said):
        check_pace("t", t)


def test_holes_are_told():
    assert gaps("joints", EVEN, least=0.05) == []
    (said,) = gaps("joints", np.r_[EVEN, EVEN + EVEN[-1] + 0.2], least=0.05, steps=3)
    assert said == "joints: a hole where about 11 samples are missing, the longest of 0.2 s from 0.650 to 0.850 s"
    assert "2 holes where about 3 samples" in gaps("frames", np.delete(EVEN, [7, 20, 21]))[0]
