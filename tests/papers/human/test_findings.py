"""What they print comes out to the last digit; correlations are those of other derivations."""

from __future__ import annotations

import numpy as np
import pytest
from human_data import DATA, needs_people, write_made_up
from scipy.stats import pearsonr

from papers.human.findings import PUBLISHED, agrees, correlations, in_order, summary
from papers.human.reading import STYLES, read_people

DISCRETE_PEAKS = (30.0, 27.6, 22.0, 18.5, 15.8, 13.8, 12.0, 10.7, 9.8, 9.0, 5.7)  # as the issue of the whip says


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    return read_people(write_made_up(tmp_path_factory.mktemp("people")))


@needs_people
@pytest.mark.parametrize("style", STYLES)
def test_published_figures(style):
    found = summary(read_people(DATA), style)
    for name in PUBLISHED[style]:
        assert agrees(style, name, found[name]), (name, found[name])


@needs_people
def test_peaks_along_the_whip():
    peaks = summary(read_people(DATA), "discrete")["peak_speeds"]
    np.testing.assert_allclose(peaks, DISCRETE_PEAKS, atol=0.06)


def test_another_figure_is_not_the_printed_one():
    assert agrees("discrete", "hit_share", 0.27805)
    assert not agrees("discrete", "hit_share", 0.2786)


def test_correlations_are_those_of_other_derivations(people):
    between, within = correlations(people, "rhythmic", "peak_hand_speed", "peak_tip_speed")
    throws = people.throws[people.throws["style"] == "rhythmic"]
    means = throws.groupby("person")[["peak_hand_speed", "peak_tip_speed"]].mean()
    reference = pearsonr(means["peak_hand_speed"], means["peak_tip_speed"])
    assert between.r == pytest.approx(reference.statistic)
    interval = reference.confidence_interval(0.95)
    assert (between.low, between.high) == pytest.approx(tuple(interval))
    # within people: analysis of covariance with a column per person
    columns = (throws["person"].to_numpy()[:, None] == np.unique(throws["person"])).astype(float)
    rest = [
        values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        for values in (throws["peak_hand_speed"].to_numpy(), throws["peak_tip_speed"].to_numpy())
    ]
    assert within.r == pytest.approx(rest[0] @ rest[1] / np.sqrt((rest[0] @ rest[0]) * (rest[1] @ rest[1])))
    assert within.low < within.r < within.high


def test_made_up_waves_are_cascades(people):
    assert in_order(people, "discrete") == (4, 4)
