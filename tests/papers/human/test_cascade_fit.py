"""The fit finds a whip again, and people's cascade; the rhythmic style is predicted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from human_data import DATA, needs_people, write_made_up

from papers.human.cascade_fit import fit_cascade, measured, predicted, start
from papers.human.reading import STYLES, read_people


def test_a_throw_of_the_model_is_found_again(tmp_path):
    """What is measured is what a known whip does; the fit begins beside it."""
    seen = measured(read_people(write_made_up(tmp_path)), "discrete")
    truth = start()
    truth[-3:] += [0.3, -0.2, 0.1]
    cascade = predicted(truth, seen.hand)
    made = dataclasses.replace(
        seen, peaks=cascade.peaks, times=cascade.times, first=cascade.speeds[0], last=cascade.speeds[-1],
        shape=cascade.shape, way=cascade.way, handle=float(truth[10]),
    )  # fmt: skip
    found = fit_cascade(made)
    again = predicted(found.x, seen.hand)
    np.testing.assert_allclose(again.peaks, cascade.peaks, rtol=0.03)
    np.testing.assert_allclose(again.times, cascade.times, atol=0.02)


@needs_people
@pytest.mark.slow
def test_the_discrete_cascade_is_explained_and_the_rhythmic_one_predicted():
    people = read_people(DATA)
    seen = {style: measured(people, style) for style in STYLES}
    found = fit_cascade(seen["discrete"])
    discrete, rhythmic = (predicted(found.x, seen[style].hand) for style in STYLES)
    np.testing.assert_allclose(discrete.peaks, seen["discrete"].peaks, rtol=0.1)
    np.testing.assert_allclose(discrete.times, seen["discrete"].times, atol=0.05)
    np.testing.assert_allclose(rhythmic.times, seen["rhythmic"].times, atol=0.05)
    within = np.abs(rhythmic.peaks / seen["rhythmic"].peaks - 1) < 0.1
    assert within.sum() >= 7  # of ten: three markers of the middle miss by up to 16 %
    assert 0.05 < found.whip.taper < 0.5
