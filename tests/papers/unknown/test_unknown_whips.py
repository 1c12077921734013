"""Unknown whips are tried with every method."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from whip_study import study_of

from papers.unknown.unknown_whips import OpeningUnit, WhipUnit
from whiptool.goals.zone import Disc


@pytest.mark.slow
def test_an_unknown_whip_is_tried_with_every_method():
    """What is learned after one strike is better than the first; what nothing is learned from is the same again."""
    study = study_of()
    target = int(study.within(study.twin("kin", 5))[0])
    opening = OpeningUnit(study=study, kind="robust", material=study.material(5), target=target).run(None, 1)
    found = {}
    for method in ("robust", "correction", "uniform", "adapt"):
        unit = WhipUnit(
            study=study,
            family="kin",
            seed=5,
            method=method,
            targets=(target,),
            openings={target: opening},
            transfer=(1,),
        )
        found[method] = unit.run(None, 1)
        if method not in ("uniform", "adapt"):  # their seconds differ
            assert found[method] == unit.run(None, 1)
    first, second = found["robust"]["trials"][0]["miss"]
    assert first == second
    for method in ("correction", "adapt"):
        assert found[method]["trials"][0]["miss"][0] == first
    for method in ("uniform", "adapt"):
        assert found[method]["trials"][0]["miss"][1] < 0.02
    assert [row["target"] for row in found["adapt"]["transferred"]] == [1]
    assert found["adapt"]["transferred"][0]["miss"] < 0.06


def test_targets_are_within_the_whips_reach():
    study = study_of()
    far = study_of(scene=dataclasses.replace(study.scene, zone=Disc((3.0, 0.0))))
    twin = study.twin("stranger", 2)
    assert len(far.within(twin)) == 0
    own = study.scene.points()[study.within(twin)]
    assert (np.hypot(*own.T) < twin.model.reach).all()
