"""Several limits at once: which of them convicts, what is left of a box, and whole strikes of candidates alone."""

from __future__ import annotations

import dataclasses
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from repository import ROOT

import whiptool as wt
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.limits.all_limits import AllLimits, limits_given
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import CommandLimits
from whiptool.models import JointLimits, StrikeBounds, default_bounds, preset
from whiptool.models.scene import Scene
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rollout import CompiledRollout
from whiptool.strike_map.striker import Striker

TARGET = Target((1.2, 0.2, 0.1), 0.05)
GOOD = [-1.27, 0.83, -2.04, -3.1, -0.51, 1.67, 0.25, -0.78, -0.07, -1.06, 1.48, 1.74, 1.35]


@pytest.fixture(scope="module")
def rollout() -> CompiledRollout:
    """The UR5e with its rope of rods, its joints exactly on the reference."""
    return CompiledRollout(preset("ur5e"), timestep=1.5e-3)


def lowest(rollout: CompiledRollout, strike: list[float]) -> float:
    """Height of the lowest point of arm and whip over a strike [m]."""
    q, found = rollout.trajectory(np.array(strike)).q, []
    for of in ("apart", "whip"):
        scene = Scene(rollout.model, 0.0, of)
        floor = len(scene.bodies)
        over = [i for i, j in scene.pairs if j == floor]
        radius = np.array([scene.bodies[i].capsule.radius for i in over])
        found += [(ends[:, over, 2] - radius).min() for ends in scene.segments(q)]
    return float(min(found))


def test_a_strike_that_goes_through_the_floor_or_is_commanded_too_fast_is_refused_and_told_why(rollout):
    model = rollout.model
    arm = ArmLimits.of(model.arm, prescribed=True)
    floor = lowest(rollout, GOOD)
    path, strike = rollout.trajectory(np.array(GOOD)), wt.Strike.from_vector(GOOD)
    above, below = (Clearance(model, floor=floor + dz) for dz in (0.1, -0.01))
    kept, left = Objective(rollout, TARGET, limits=[arm, below]), Objective(rollout, TARGET, limits=[arm, above])
    free = Objective(rollout, TARGET, limits=None)
    assert free(GOOD).refused is None
    assert kept(GOOD) == free(GOOD)
    assert left(GOOD).refused == "clearance"
    assert left.n_refused == 1
    assert left.judge(path, strike).refused == "clearance"
    said = left.limits.explain(path, model.arm.joints, strike)
    assert said is not None
    assert said.endswith("100 mm below the floor")
    assert kept.limits.explain(path, model.arm.joints, strike) is None
    slow = tuple(dataclasses.replace(joint, acceleration=1.0) for joint in arm.joints)
    gentle = Objective(rollout, TARGET, limits=[ArmLimits(slow), below])
    assert gentle(GOOD).refused == "joint"
    said = gentle.limits.explain(path, model.arm.joints, strike)
    assert said is not None
    assert "is commanded up to" in said
    assert gentle.judge(path).refused is None  # what was commanded is not known


def test_only_what_would_be_a_hit_or_the_best_is_looked_at_whole(rollout):
    """Beyond distances a strike that is neither counts as it is."""
    limits, arm = Clearance(rollout.model), ArmLimits.of(rollout.model.arm)
    some = arm.command.shortened(default_bounds(rollout.model.arm).sample(np.random.default_rng(0), 16))
    judged, free = (Objective(rollout, TARGET, limits=x) for x in (limits, None))
    outcomes, plain = judged.batch(some), free.batch(some)
    beyond = [limits.violation(path) > 0 for path in rollout.trajectories(some)]
    best = min(x.cost for x, is_beyond in zip(plain, beyond, strict=True) if not is_beyond)
    for ours, theirs, is_beyond in zip(outcomes, plain, beyond, strict=True):
        assert (ours.refused == "clearance") == (is_beyond and theirs.cost < best)
        assert ours.refused is not None or ours == theirs
    assert 0 < judged.n_refused < sum(beyond)
    assert judged.best is not None
    assert judged.best.outcome.cost == best


def test_the_gradient_search_keeps_what_it_can_beforehand(rollout):
    model = rollout.model
    limits = [ArmLimits.of(model.arm, keep_free=0.1, prescribed=True), Clearance(model, floor=-0.9, least=0.01)]
    objective = Objective(rollout, TARGET, limits=limits, max_trials=400, stop_at_hit=True)
    found = search(objective, "gradient", seed=0)
    assert found.outcome is not None
    assert found.strike is not None
    assert found.outcome.hit
    assert objective.limits.violation(rollout.trajectory(found.strike), found.strike) <= 0
    assert all((smooth.constraints(found.strike.vector)[0] <= 1e-6).all() for smooth in objective.smooth)


def test_the_box_is_narrowed_to_positions():
    box = StrikeBounds((-3.0, -3.0, -3.0, -3.0, 0.4), (3.0, 3.0, 3.0, 3.0, 1.0))
    limits = AllLimits(ArmLimits((JointLimits((-1.0, 9.0)), JointLimits((-9.0, 2.0)))))
    assert limits.narrowed(box) == StrikeBounds((-1.0, -3.0, -1.0, -3.0, 0.4), (3.0, 2.0, 3.0, 2.0, 1.0))
    with pytest.raises(InputError, match=r"^bounds\[0\]: got \(-3.0, 3.0\); .*position limits, 4 to 9$"):
        AllLimits(ArmLimits((JointLimits((4.0, 9.0)), JointLimits()))).narrowed(box)
    assert AllLimits(None).narrowed(box) == box
    assert not AllLimits(None)


def test_random_strikes_keep_what_can_be_kept_beforehand():
    """A joint that moves slowly is commanded to move too fast in most random strikes; where none can, any are taken."""
    box, rng = StrikeBounds((-3.0, -3.0, -3.0, -3.0, 0.4), (3.0, 3.0, 3.0, 3.0, 1.0)), np.random.default_rng(0)
    slow = CommandLimits((JointLimits(), JointLimits(velocity=0.1)), share=1.0)
    member: Any = SimpleNamespace(violation=None, command=None, smooth=(slow,))
    strikes = AllLimits(member).random_strikes(box, rng, 64)
    assert strikes.shape == (64, 5)
    assert slow.kept(strikes).all()
    assert not slow.kept(box.sample(rng, 64)).all()
    member.smooth = (SimpleNamespace(kept=lambda strikes: np.zeros(len(strikes), bool)),)
    assert AllLimits(member).random_strikes(box, rng, 4).shape == (4, 5)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_robot_keeps_its_limits_itself_and_its_floor_clear_unless_it_is_told_not_to(name):
    rollout = CompiledRollout(preset(name), engine="interpreter")
    joints, clear = Objective(rollout).limits.members
    assert joints == ArmLimits.of(rollout.model.arm, prescribed=True)
    assert clear == Clearance(rollout.model, floor=0.0)
    assert clear.words == "the distance from arm and whip to the arm and the floor at 0 m"
    assert [type(x) for x in Striker(rollout).limits.members] == [ArmLimits, Clearance]
    assert not Objective(rollout, limits=None).limits
    assert Objective(rollout, limits=clear).limits.members == (clear,)
    with pytest.raises(InputError, match="limits: got 'arm'; allowed: 'default', None, or"):
        Objective(rollout, limits="arm")


def test_an_arm_without_limits_has_none():
    for name in ("lemon2024", "nah2023"):
        assert not Objective(CompiledRollout(preset(name), engine="interpreter")).limits


def test_a_strike_that_begins_below_its_own_base_is_refused():
    """A UR5e's stick straight down beside its base, 1.65 m long with the rope: its shoulder is 0.1625 m high."""
    rollout = CompiledRollout(preset("ur5e"), engine="interpreter", timestep=2e-3)
    below = [0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.1, 0.9, 0.0, 0.0, 0.0, 0.0, 0.4]
    judged, free = Objective(rollout, TARGET, t_stay=0.0), Objective(rollout, TARGET, t_stay=0.0, limits=None)
    assert judged(below).refused == "clearance"
    assert free(below).refused is None


def test_a_motor_by_its_name_is_refused_with_what_gives_it():
    model = preset("lemon2024")
    with pytest.raises(InputError, match=r"^limits: got 'XM430'; .*; give limits_preset\('xm430'\)$"):
        limits_given("XM430", model, prescribed=False)


ASKED = re.compile(r"\.(violation_of_peaks|of_candidates)\b")
OF_SEARCHES = {"adaptation/planner.py", "commands/options/search_options.py"}  # rank strikes; refuse postures


def test_no_one_outside_asks_a_part_of_the_limits():
    """Peak values show no distances; whether a strike may be made is asked of all limits, along the whole strike."""
    asking = {
        str(file.relative_to(ROOT / "whiptool"))
        for file in (ROOT / "whiptool").rglob("*.py")
        if file.parent.name != "limits" and ASKED.search(file.read_text())
    }
    whole = {"objective.py", "strike_map/striker.py", "comparison/learner_unit.py"}  # go on to whole trajectories
    assert asking == OF_SEARCHES | whole


def test_candidates_are_judged_along_their_whole_trajectories():
    """Of three strikes whose peak values say nothing, the first and the last are too low; the first is no candidate."""
    low: Any = SimpleNamespace(
        violation=lambda path: path,
        command=None,
        judges="height",
        by_peaks=True,
        of_candidates=True,
        violation_of_peaks=lambda near: np.array([-1.0, -1.0, -1.0]),
    )
    strikes, heights = np.arange(3.0)[:, None], [0.5, -0.5, 0.25]
    found = AllLimits(low).judged(strikes, low, lambda strike: heights[int(strike[0])], candidates=[1, 2])
    assert found[0].tolist() == [0.0, 0.0, 0.25]
    assert found[1][2] == "height"
