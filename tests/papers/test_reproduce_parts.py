"""Parts of the paper's command that have a model of their own."""

from __future__ import annotations

import pytest

from papers.reproduce import OTHERS, ReproduceOptions, _other, _part


@pytest.mark.parametrize("what", OTHERS)
def test_a_part_with_a_model_of_its_own_has_targets_that_fit_it(what):
    scene, part = _other(ReproduceOptions(what=what)).scene, _part(what)
    assert (scene.model, scene.controller) == (part.MODEL, part.CONTROLLER)
    assert scene.points().shape[1] == part.MODEL.dimension
