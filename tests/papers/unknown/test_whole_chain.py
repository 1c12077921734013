"""Unknown whips through servos, images and tracker."""

from __future__ import annotations

import dataclasses

import pytest
from whip_study import study_of

from papers.unknown import whole_chain
from papers.unknown.whole_chain import ReachUnit, RigTransferUnit
from whiptool.adaptation import options as options_of_adaptation


@pytest.mark.slow
def test_a_whips_target_is_one_that_the_motors_reach(monkeypatch):
    study = study_of()
    own = study.within(study.twin("kin", 5))
    unit = ReachUnit(study=study, family="kin", seed=5)
    assert unit.run(None, 1) == {"target": own[0], "passed": 0}
    prepared = options_of_adaptation.prepare

    def weaker(options):
        found = prepared(options)
        (motor,) = found.options.limits
        weak = dataclasses.replace(motor, stall_torque=0.5)
        found.options = dataclasses.replace(found.options, limits=(weak,))
        return found

    monkeypatch.setattr(options_of_adaptation, "prepare", weaker)
    assert unit.run(None, 1) == {"target": None, "passed": 5}


@pytest.mark.slow
def test_a_whip_learned_in_the_whole_chain_is_struck_at_other_targets(monkeypatch):
    """Once each, and those only that the motors reach; without rendering, which takes long."""
    prepare, study = whole_chain.prepared, study_of(strikes=1)
    prepared = []

    def seen_as_points(*args, **changes):
        prepared.append(prepare(*args, **changes, camera="points"))
        return prepared[-1]

    monkeypatch.setattr(whole_chain, "prepared", seen_as_points)
    monkeypatch.setattr(whole_chain, "motors_reach", lambda study, family, seed, number: number != own[2])
    own = study.within(study.twin("kin", 5)).tolist()
    unit = RigTransferUnit(study=study, family="kin", seed=5, target=own[0], further=(own[1], own[2]))
    found = unit.run(None, 1)
    assert found["passed"] == 1
    [struck] = found["transferred"]
    assert struck["target"] == own[1]
    assert struck["miss"] < 0.06
    learning, again = prepared
    assert not learning.options.still
    assert learning.known is None
    assert again.known.errors()["profile.length"] < 0.01 < again.prior.errors()["profile.length"]
