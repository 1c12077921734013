"""Verdicts on Table 4 follow the data."""

from __future__ import annotations

from claims import verdicts

from papers.lemon2024 import table4
from papers.lemon2024.tracking_errors import TABLE4_CONSTANT, TABLE4_OIAC, TrackingErrors
from whiptool.viz import report


def test_table4s_own_numbers_are_reproduced():
    constant = TrackingErrors(TABLE4_CONSTANT, TABLE4_CONSTANT, 0)
    adaptive, worse = TrackingErrors(TABLE4_OIAC, TABLE4_OIAC, 0), TrackingErrors(2 * TABLE4_CONSTANT, TABLE4_OIAC, 0)
    good = table4.claims({"constant": constant, "OIAC printed": adaptive, "OIAC table4": adaptive})
    assert verdicts(good) == [report.REPRODUCED] * 5
    assert "22.36 %" in good[1].paper
    partly = table4.claims({"constant": constant, "OIAC printed": worse, "OIAC table4": adaptive})
    assert all(v.startswith("reproduced only with OIAC printed, mean errors or") for v in verdicts(partly))


def test_table4s_numbers_are_missed_to_either_side():
    """A ratio a fifth above or below the paper's is reproduced; one a third above or below is not."""
    constant = TrackingErrors(TABLE4_CONSTANT, TABLE4_CONSTANT, 0)
    for factor, held in ((1.2, True), (1 / 1.2, True), (1.3, False), (1 / 1.3, False)):
        adaptive = TrackingErrors(factor * TABLE4_OIAC, factor * TABLE4_OIAC, 0)
        better, *ratios = table4.claims({"constant": constant, "OIAC printed": adaptive, "OIAC table4": adaptive})
        assert better.verdict == report.REPRODUCED
        assert verdicts(ratios) == [report.REPRODUCED if held else report.NOT_REPRODUCED] * 4
