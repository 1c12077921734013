"""What is said of a throw: where the thing lands, what is counted, and throws that never land."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.commands.options.throw_options import ThrowOptions
from whiptool.commands.strike_lines import outcome_lines, outcome_table
from whiptool.commands.throw_lines import NEVER_DOWN, never_landed, replay_doubt, replay_table, throw_lines, throw_table
from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.models.strike import T_STAY
from whiptool.objective import Objective
from whiptool.throws.box import Box
from whiptool.throws.flight import Thing
from whiptool.throws.mujoco_throw import ThrowReplay, replay_throw
from whiptool.throws.rollout import ThrowRollout

LEMON, BALL = preset("lemon2024"), Thing.of_ball(0.02, 0.04)
STRIKE = np.array([-0.94248, 1.41371, 1.72787, 1.41371, 0.95])
LANDING = ("landing_time", "landing_distance", "landing_velocity", "entry_angle")


def thrown(release_time: float, **how) -> tuple[ThrowRollout, dict, dict, list[str]]:
    """Return a rollout, what is said of the strike's throw as tables of throw and outcome, and the lines."""
    box = Box((1.8, -0.5), 0.08, **how)
    throws = ThrowRollout(LEMON, box, thing=BALL, release_time=release_time)
    outcome = Objective(throws, box)(STRIKE)
    table = throw_table(throws, throws.space.strike(STRIKE), outcome, T_STAY)
    lines = throw_lines(table, outcome, throws, outcome_lines(outcome, box, LEMON.arm))
    return throws, table, outcome_table(outcome, box), lines


def test_the_landing_is_said_as_it_is_and_what_counts_next_to_it():
    """A ball lands within the opening at such a slant that not all of it enters."""
    throws, table, outcome, lines = thrown(0.675)
    landed = throws.landings(STRIKE, [0.675])
    assert landed.place is not None
    assert table["landing_distance"] == pytest.approx(np.linalg.norm(landed.place[0]), abs=1e-12)
    assert table["landing_distance"] == pytest.approx(0.078, abs=5e-4)
    path = throws.trajectory(STRIKE)  # where the thing is at last
    assert table["landing_distance"] == pytest.approx(math.dist(path.tip[-1], throws.box.position), abs=1e-9)
    counted = throws.approach(STRIKE, throws.box).distance[0]
    assert counted == pytest.approx(0.138, abs=5e-4)
    angle = math.degrees(table["entry_angle"])
    said = f"missed: the thing lands {table['landing_distance']:.4f} m from the centre at {angle:.0f} degrees from the"
    assert said in lines[0]
    assert f"counted as {counted:.4f} m, at most 0.080 m for all of it to enter" in lines[0]
    assert never_landed(table, outcome) == {}


def test_a_thing_that_never_comes_down_through_the_opening_has_no_landing():
    _, table, outcome, lines = thrown(0.0, direction=(0.0, -1.0))
    assert table["release_time"] == 0
    assert [table[name] for name in LANDING] == [None] * 4
    assert f"missed: {NEVER_DOWN}; counted as" in lines[0]
    assert len(lines) == 2 + LEMON.arm.n  # box, release, joints
    assert "lands" not in " ".join(lines)
    found = never_landed(table, outcome)
    assert found["tip_speed"] is None
    assert found["arrival"]["angle"] is found["arrival"]["speed"] is None
    assert found["missed_by"]["direction"] is None
    assert found["missed_by"]["point"] > 1


def test_a_thing_that_is_not_released_has_neither_release_nor_landing():
    _, table, _, lines = thrown(1.7)
    assert [table[name] for name in ("release_time", *LANDING)] == [None] * 5
    assert "not released, because the strike ends before" in lines[0]
    assert len(lines) == 1 + LEMON.arm.n


def test_mujoco_confirms_that_a_thing_never_comes_down():
    throws, *_ = thrown(0.0)
    seen = replay_throw(throws, STRIKE, t_stay=0.0)
    assert seen.confirmed
    assert replay_doubt(seen, 1e-3) is None
    assert set(replay_table(seen, throws).values()) == {None}


def test_doubts_of_a_replay_are_whole_sentences_and_only_distances_ask_for_a_smaller_tolerance():
    place = np.zeros(2)
    far = ThrowReplay(place, place, 0.002, 1e-4, False, 0.1)
    never, lost = (ThrowReplay(None, None, None, 1e-4, False, diverged=x) for x in (False, True))
    only = ThrowReplay(place, place, None, 1e-4, False, 0.1)
    end = "in MuJoCo at 0.1 ms"
    assert replay_doubt(far, 1e-3) == f"the thing lands 2.0 mm away {end}, more than 1 mm; try a smaller --tolerance"
    assert replay_doubt(never, 1e-3) == f"{NEVER_DOWN} {end}"
    assert replay_doubt(lost, 1e-3) == f"the simulation diverges {end}"
    assert replay_doubt(only, 1e-3) == f"the thing comes down through the opening's plane only {end}"


@pytest.mark.parametrize(("name", "box"), [("lemon2024", (1.8, -0.5, 0.2, 0.1)), ("fr3", (1.8, 0.0, 0.2))])
def test_a_box_of_another_dimension_is_refused_by_its_own_name(name, box):
    with pytest.raises(InputError, match=r"--box: got \(1.8, .*; allowed: X Y (Z )?SIZE in m, for the model"):
        ThrowOptions(throw=True, box=box).build_target(preset(name))
