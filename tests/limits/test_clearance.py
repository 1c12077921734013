"""Clearance: whips that hang above a floor, arms on their path, and whole strikes."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from processes import HANG

from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.limits.clearance import FRACTIONS, SPARE, UNIT, Clearance, HangingWhip, PathClearance
from whiptool.models import Model, StrikeBounds, default_bounds, in_space, preset
from whiptool.models.kinematics import joint_points
from whiptool.models.mount import RADIUS, mounted
from whiptool.models.presets import rope
from whiptool.models.scene import Scene
from whiptool.models.trajectory import Trajectory
from whiptool.objective import Objective
from whiptool.rl.task import StrikeTask
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.striker import Striker

STIFF = Model(replace(preset("nah2023").whip, k=300.0, b=1.0), in_space(preset("lemon2024").arm))


@pytest.mark.parametrize("name", ["ur5e", "panda", "nah2023"])
def test_no_whip_hangs_less_low_than_is_reckoned_with(name):
    """Whatever the hand's direction: what is left out would have the whip in the floor."""
    model, floor = preset(name), -0.3
    strikes = default_bounds(model.arm).sample(np.random.default_rng(0), 20)
    points = joint_points(model, start_posture(model, strikes[:, : model.arm.n]))
    lowest = points[:, model.arm.n :, 2].min(axis=1)
    hand = points[:, model.arm.n, 2]
    left_out = ~HangingWhip(model, floor).kept(strikes)
    assert left_out.any()
    assert (lowest[left_out] < floor).all()
    assert (hand - lowest >= 0.4 * model.whip.length).all()


def test_a_stiff_whip_may_be_held_out():
    """As stiff as a rod it does not hang, and only the hand has to be above the floor."""
    arm = STIFF.arm
    up = np.r_[np.zeros(arm.n), np.zeros(arm.n), 0.5]  # the hand hangs 0.65 m below the shoulder
    assert HangingWhip(STIFF, -0.66).kept(up[None])[0]
    assert not HangingWhip(STIFF, -0.64).kept(up[None])[0]
    weightless = replace(preset("ur5e"), gravity=0.0)
    assert HangingWhip(weightless, 0.0, 0.1).constraints(np.r_[np.zeros(12), 0.5])[0] == pytest.approx(
        0.1 - joint_points(weightless, np.zeros(66))[6, 2]
    )


@pytest.mark.parametrize(("name", "floor"), [("ur5e", -1.2), ("nah2023", -1.8)])
def test_slopes_are_differences_and_kept_is_their_sign(name, floor):
    model = preset(name)
    hanging = HangingWhip(model, floor, 0.01)
    strikes = default_bounds(model.arm).sample(np.random.default_rng(1), 30)
    values = np.array([hanging.constraints(strike)[0][0] for strike in strikes])
    np.testing.assert_array_equal(hanging.kept(strikes), values <= 0)
    assert 0 < (values <= 0).sum() < 30
    steps = 1e-6 * np.eye(strikes.shape[1])
    ups, downs = ([hanging.constraints(strikes[0] + side * e)[0] for e in steps] for side in (1, -1))
    differences = (np.array(ups) - np.array(downs)) / 2e-6
    np.testing.assert_allclose(hanging.constraints(strikes[0])[1], differences.T, atol=1e-8)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_values_are_the_scene_s_and_slopes_their_differences(name):
    model = preset(name)
    path = PathClearance(model, floor=-0.5, least=0.01)
    close, apart = Scene(model, -0.5, "close"), Scene(model, -0.5, "apart")
    a = model.arm.n
    for vector in default_bounds(model.arm).sample(np.random.default_rng(3), 2):
        values, slopes = path.constraints(vector)
        q = vector[:a] + FRACTIONS[:, None] * (vector[a : 2 * a] - vector[:a])
        of_close, of_apart = close.distances(q)[0].min(), apart.distances(q)[0].min()
        assert values.max() == pytest.approx(max(-of_close, 0.01 + SPARE - of_apart), abs=1e-12)
        steps = 1e-6 * np.eye(len(vector))
        differences = [(path.constraints(vector + e)[0] - path.constraints(vector - e)[0]) / 2e-6 for e in steps]
        np.testing.assert_allclose(slopes, np.transpose(differences), atol=1e-6)
        assert not slopes[:, -1].any()


def test_what_is_kept_is_where_no_value_is_above_zero():
    model = preset("ur5e")
    path = PathClearance(model, floor=0.0)
    strikes = default_bounds(model.arm).sample(np.random.default_rng(4), 40)
    expected = [(path.constraints(strike)[0] <= 0).all() for strike in strikes]
    assert 0 < sum(expected) < 40
    np.testing.assert_array_equal(path.kept(strikes), expected)
    assert path.kept(strikes[:0]).shape == (0,)


UR5E = preset("ur5e")
AHEAD = (0.0, -1.0, 1.5, -3.6, -1.5707963, 0.0)  # the stick level and forward
FOLDED = (0.0, -1.0, 3.1, -3.6, -1.5707963, 0.0)  # elbow shut


def held(*postures, model=UR5E, along=(0.0, 0.0, -1.0), diverged: bool = False) -> Trajectory:
    """A trajectory from posture to posture, 100 ms each, the whip straight along a direction."""
    a, N = model.arm.n, model.whip.N
    t = np.arange(0, 0.1 * (len(postures) - 1) + 1e-9, 2.5e-4)
    q = np.stack([np.interp(t, 0.1 * np.arange(len(postures)), x) for x in np.transpose(postures)], axis=1)
    q = np.hstack([q, np.tile(along, (len(t), N))])
    zeros, gains, tip = np.zeros((len(t), a)), np.zeros((len(t), a, a)), np.zeros((len(t), 3))
    return Trajectory(t, q, 0 * q, q[:, :a], zeros, zeros, gains, gains, tip, tip, diverged)


def test_a_tip_that_dips_into_the_floor_by_hand():
    strike = held(AHEAD, AHEAD)
    lowest = joint_points(UR5E, strike.q)[0, -1, 2]
    assert Clearance(UR5E, floor=lowest + 0.05).violation(strike) == pytest.approx(0.05 / UNIT, abs=1e-9)
    above = Clearance(UR5E, floor=lowest - 0.001)
    assert above.violation(strike) <= 0
    nearest, _ = above.nearest(strike)
    assert nearest is not None
    assert nearest.clearance == pytest.approx(0.001, abs=1e-9)
    assert Clearance(UR5E, floor=lowest - 0.05, least=0.08).violation(strike) == pytest.approx(0.3, abs=1e-9)
    said = str(Clearance(UR5E, floor=lowest + 0.05).explain(strike, UR5E.arm.joints))
    assert said == "at 0.000 s the whip's node 20 is 50 mm below the floor"
    said = str(Clearance(UR5E, floor=lowest - 0.05, least=0.08).explain(strike, UR5E.arm.joints))
    assert said == "at 0.000 s the whip's node 20 is 50 mm from the floor; it has to keep 80 mm"


def test_an_arm_that_folds_into_itself_and_a_whip_that_lies_on_it():
    limits = Clearance(UR5E)
    assert limits.violation(held(AHEAD, AHEAD)) <= 0
    folding = held(AHEAD, FOLDED)
    assert limits.violation(folding) > 0
    said = str(limits.explain(folding, UR5E.arm.joints))
    assert said.startswith("at 0.")
    assert "the link of shoulder_lift is" in said
    assert "mm inside the link of" in said
    assert limits.explain(folding, UR5E.arm.joints).overlap
    back = held(AHEAD, AHEAD, along=(-1.0, 0.0, 0.0))  # along the stick
    assert limits.violation(back) > 0
    assert "is 40 mm inside the whip's node" in str(limits.explain(back, UR5E.arm.joints))
    assert limits.violation(held(AHEAD, AHEAD, diverged=True)) == np.inf


def test_the_way_of_a_robot_without_its_whip():
    limits = Clearance(UR5E)
    t = np.linspace(0, 2, 201)
    q = np.array(AHEAD) + t[:, None] / 2 * (np.array(FOLDED) - AHEAD)
    assert limits.beyond_on_way(t[:2], q[:2]) is None
    said = limits.beyond_on_way(t, q)
    assert said is not None
    assert "inside" in said.words


def test_a_floor_in_the_plane():
    """Of the planar arm and whip that hang straight down, the tip is as low as all lengths together."""
    model = preset("lemon2024")
    straight = np.zeros((2, model.n))
    low = joint_points(model, straight)[0, -1, 1]
    zeros, gains, tip = np.zeros((2, 2)), np.zeros((2, 2, 2)), np.zeros((2, 2))
    strike = Trajectory(np.array([0, 1e-3]), straight, straight, zeros, zeros, zeros, gains, gains, tip, tip)
    assert Clearance(model, floor=low - 0.02).violation(strike) == pytest.approx(-0.2, abs=1e-9)
    limits = Clearance(model, floor=low + 0.02)
    assert limits.violation(strike) == pytest.approx(0.2, abs=1e-9)
    assert limits.explain(strike, model.arm.joints).words.endswith(
        f"the whip's node {model.whip.N} is 20 mm below the floor"
    )
    assert limits.smooth == ()
    assert limits.beyond_on_way(strike.t, strike.q[:, :2]) is None


def test_nothing_to_touch_is_named():
    with pytest.raises(
        InputError,
        match="clearance: got 'an arm without capsules, and no floor'; allowed: an arm with",
    ):
        Clearance(preset("lemon2024"))
    with pytest.raises(InputError, match="least: got -1"):
        Clearance(UR5E, least=-1)
    with pytest.raises(InputError, match="floor: got nan"):
        Clearance(UR5E, floor=float("nan"))
    assert Clearance(UR5E).words == "the distance from arm and whip to the arm"


MEMORY = """
import dataclasses, types
import numpy as np
from whiptool.models import preset
from whiptool.limits.clearance import Clearance
from whiptool.models.presets import rope
model = dataclasses.replace(preset("ur5e"), whip=rope(100))
wave = np.sin(np.linspace(0, 9, 1500))[:, None]
strike = types.SimpleNamespace(t=np.arange(1500) * 1e-3, q=0.3 * wave * np.ones(model.coordinates), diverged=False)
assert np.isfinite(Clearance(model, floor=-1.0).violation(strike))
print(*(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def test_a_whip_of_a_hundred_nodes_needs_little_memory():
    """The whole process, of which most are libraries; kinematics of free bodies in Pinocchio took 18 GB."""
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True, timeout=HANG)
    assert int(done.stdout) < 300e3  # kB


@pytest.mark.parametrize("wrong", [{"least": 20.0}, {"floor": 800.0}])
def test_distances_in_millimetres_are_asked_about(wrong):
    with pytest.raises(InputError, match=rf"^{next(iter(wrong))}: .*are these millimetres\?$"):
        Clearance(preset("ur5e"), **wrong)


def test_a_whip_must_not_drag_over_the_floor_on_the_way():
    """Where it lies at the beginning it may, until it is lifted; the whip that counts is the one that is given."""
    model, t = preset("ur5e"), np.linspace(0, 2, 21)
    hand = lambda q: joint_points(model, start_posture(model, q))[:, 6, 2]  # noqa: E731
    high, low = np.array([-1.5, -1.2, -0.2, -0.5, 2.0, 0.4]), np.array([-1.5, -0.3, -0.2, -0.5, 2.0, 0.4])
    down = high + np.linspace(0, 1, 21)[:, None] * (low - high)
    length, heights = model.whip.length, hand(down)
    assert (np.diff(heights) < 0).all()
    floor = float(heights[[8, 9]].mean()) - length  # reached between the two
    kept = Clearance(model, floor)
    assert kept.whip_on_way(t[:9], down[:9], model) is None
    said = kept.whip_on_way(t, down, model)
    assert said is not None
    assert str(said).startswith(
        f"at 2.000 s the hanging whip is {1e3 * (floor + length - heights[-1]):.0f} mm below the floor"
    )
    assert kept.whip_on_way(t, down[::-1], model) is None
    again = np.vstack([down[::-2], down[2::2]])
    assert kept.whip_on_way(t[: len(again)], again, model) is not None
    short = replace(model, whip=replace(model.whip, l=model.whip.per_node("l") / 4))
    assert kept.whip_on_way(t, down, short) is None
    assert Clearance(model, None).whip_on_way(t, down, model) is None


@pytest.mark.parametrize("least", [0.0, 0.05])
def test_a_whip_that_no_posture_holds_above_the_floor_is_refused(least):
    """The hand is highest straight up, 0.65 m above the shoulder: to 0.1 mm as high as the hanging whip needs it."""
    arm = in_space(preset("lemon2024").arm)
    model = Model(rope(5), arm)
    hangs = HangingWhip(model, 0.0)._lowest
    lower, upper = (np.array(x) for x in StrikeBounds((-3.1,) * 4 + (0.5,), (3.1,) * 4 + (1.0,)).box)
    upright = np.array([np.pi, 0.0, 0.0, 0.0, 0.5])
    upper[:2] = 3.2
    for over, refused in ((-1e-4, False), (1e-4, True)):
        hanging = HangingWhip(model, 0.65 - hangs - least + over, least)
        assert bool(hanging.kept(upright[None])[0]) != refused
        if refused:
            with pytest.raises(InputError, match=r"whip and mount: got 'a whip of 1 m on an arm whose hand rises to"):
                hanging.check_box(lower, upper)
        else:
            hanging.check_box(lower, upper)
    lower[0], upper[0] = -1.5, 1.5  # where the upper arm is below the shoulder
    with pytest.raises(InputError, match="hand rises to"):
        HangingWhip(model, 0.64 - hangs).check_box(lower, upper)


def test_a_floor_above_every_posture_is_refused_in_whole_sentences():
    model = preset("ur5e")
    lower, upper = (np.array(x) for x in StrikeBounds((-3.1,) * 12 + (0.5,), (3.1,) * 12 + (1.0,)).box)
    with pytest.raises(InputError) as caught:
        HangingWhip(model, 50.0).check_box(lower, upper)
    given, allowed = str(caught.value).split("; allowed: ")
    stays = r"a whip of 1 m on an arm whose hand stays at least 4\d\.?\d* m below the floor"
    assert re.fullmatch(f"whip and mount: got '{stays}'", given)
    higher = "a base higher above the floor, such as 1 m, or a lower floor"
    assert allowed == f"a whip that hangs above the floor in some posture; give {higher}"


@pytest.mark.parametrize(
    ("height", "said"),
    [
        (0.5, r"a whip of 1 m on an arm whose hand rises to 0.5 m above the floor at most'.* such as 1.3 m$"),
        (
            1.0,
            r"too close to something in all of 1025 postures tried'.* at best .* 4 mm (inside the|below the) \w+; give",
        ),
    ],
)
def test_a_rope_that_hangs_free_in_no_posture_under_a_ceiling_is_refused(height, said):
    """At 1 m the stick's radius, 8 mm, is lacking: that is shared between ceiling and floor."""
    ur5e = preset("ur5e")
    model = Model(ur5e.whip, mounted(ur5e.arm, "ceiling", height))
    with pytest.raises(InputError, match=said):
        Objective(CompiledRollout(model))
    Objective(CompiledRollout(Model(ur5e.whip, mounted(ur5e.arm, "ceiling", 1.3))))


def test_a_base_that_just_leaves_the_rope_room_is_not_refused():
    """What is lacking at 1 m is the stick's radius."""
    ur5e = preset("ur5e")
    for over, refused in ((-1e-3, True), (1e-3, False)):
        model = Model(ur5e.whip, mounted(ur5e.arm, "ceiling", 1.0 + RADIUS + over))
        limits, box = Clearance(model, -1.0 - RADIUS - over), default_bounds(model.arm).box
        if refused:
            with pytest.raises(InputError, match="postures tried"):
                limits.check_box(*box)
        else:
            limits.check_box(*box)


def test_every_search_refuses_it_before_it_begins():
    """Optimisation, strike map with interception, and training, with what would do."""
    ur5e = preset("ur5e")
    low = Model(replace(ur5e.whip, l=0.15), ur5e.arm)
    said = r"whip and mount: got 'a whip of 3 m on an arm whose hand rises to 1\.\d+ m above the floor at most'; "
    said += r"allowed: .* a shorter whip, such as 0\.\d+ m, or a base higher above the floor, such as 3 m$"
    rollout = CompiledRollout(low)
    for search in (lambda: Objective(rollout), lambda: Striker(rollout), lambda: StrikeTask(rollout)):
        with pytest.raises(InputError, match=said):
            search()
    Objective(rollout, limits=None)
    high = Model(low.whip, mounted(ur5e.arm, "pedestal", 3.0))
    Objective(CompiledRollout(high))
