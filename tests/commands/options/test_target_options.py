"""What is struck at, and with what: targets, zones of targets, models and their arms."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from robot_files import URDF

from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.target_options import (
    LONGEST_STAY,
    GoalOptions,
    TargetOptions,
    ZoneGoalOptions,
    ZoneOptions,
)
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.target import Target
from whiptool.goals.zone import sample
from whiptool.models import PRESETS, preset, write_model


@dataclass(frozen=True, kw_only=True)
class SpaceOptions(ModelOptions):
    """Of a command that takes models in space."""

    in_space: ClassVar[bool] = True


def test_targets_are_as_given():
    assert TargetOptions().build_target() == Target()
    assert TargetOptions(target=(1.0, 0.5), hit_radius=0.02).build_target() == Target((1.0, 0.5), 0.02)
    assert TargetOptions(target=(1, 0, 0.5)).build_target().position == (1.0, 0.0, 0.5)


@pytest.mark.parametrize("given", [{}, {"t_stay": 0.0}, {"t_stay": LONGEST_STAY}, {"target": (0.1, 0.2, 0.3)}])
def test_what_can_be_struck_at_passes(given):
    ZoneOptions(**given).check()


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"target": (1.0,)}, "target"), ({"target": (1.0, float("nan"))}, "target"), ({"target": ()}, "target"),
        ({"hit_radius": 0.0}, "hit radius"), ({"hit_radius": float("inf")}, "hit radius"),
        ({"t_stay": -0.1}, "--t-stay"), ({"t_stay": 60.1}, "--t-stay"), ({"t_stay": float("nan")}, "--t-stay"),
        ({"zone_radius": 0.0}, "--zone-radius"), ({"zone_radius": -1.0}, "--zone-radius"),
    ],
)  # fmt: skip
def test_what_cannot_is_named(given, name):
    with pytest.raises(InputError) as caught:
        ZoneOptions(**given).check()
    assert caught.value.name == name


@pytest.mark.parametrize(("model", "centre"), [("lemon2024", (1.45, 0.0)), ("nah2023", (2.3, 0.0, 0.0))])
def test_targets_are_drawn_within_the_zone_and_within_reach(model, centre):
    """Of a zone at the edge of what is within reach, of which not all is."""
    model = preset(model)
    zone = ZoneOptions(target=centre, zone_radius=0.2).build_zone(model)
    drawn = sample(zone, 2000, np.random.default_rng(0))
    assert np.linalg.norm(drawn - centre, axis=1).max() <= 0.2
    assert np.linalg.norm(drawn, axis=1).max() <= model.reach
    assert np.linalg.norm(drawn - centre, axis=1).max() > 0.19  # all of the zone's near side
    assert np.linalg.norm(drawn, axis=1).max() > model.reach - 0.01  # up to what is within reach


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"target": (9.0, 0.0)}, "^target: .*within the model's reach"),
        ({"target": (1.0, 0.0, 0.0)}, "^target: .*two coordinates x y"),
        ({"zone_radius": 50.0}, "^radius of the zone: got 50"),
    ],
)
def test_zones_without_a_target_that_could_be_missed_or_hit_are_refused(given, said):
    with pytest.raises(InputError, match=said):
        ZoneOptions(**given).build_zone(preset("lemon2024"))


@pytest.mark.parametrize("name", PRESETS)
def test_every_published_model_can_be_named(name):
    assert SpaceOptions(model=name).build_model() == preset(name)


def test_a_model_may_stand_in_a_file(tmp_path):
    model = preset("lemon2024").with_parameters({"whip.l": 0.08})
    write_model(model, tmp_path / "mine.toml")
    assert ModelOptions(model=str(tmp_path / "mine.toml")).build_model() == model


def test_an_arm_in_the_plane_holds_the_whip_of_the_model():
    model = ModelOptions(model="lemon2024", arm="nah2020-n10").build_model()
    assert (model.whip, model.arm) == (preset("lemon2024").whip, preset("nah2020-n10").arm)


def test_an_arm_in_space_holds_the_whip_of_a_model_in_space_or_its_own():
    assert SpaceOptions(model="nah2023", arm="panda").build_model() == replace(
        preset("panda"), whip=preset("nah2023").whip
    )
    assert SpaceOptions(model="lemon2024", arm="panda").build_model() == preset("panda")


def test_a_robots_file_is_an_arm_with_the_rope_of_the_ur5e(tmp_path):
    start, end = URDF.index('  <joint name="finger_joint"'), URDF.index("</robot>")
    path = tmp_path / "arm.urdf"
    path.write_text(URDF[:start] + URDF[end:])
    as_model = SpaceOptions(model=str(path)).build_model()
    assert as_model.whip == preset("ur5e").whip
    assert SpaceOptions(arm=str(path)).build_model() == as_model
    with_whip = SpaceOptions(model="nah2023", arm=str(path)).build_model()
    assert (with_whip.arm, with_whip.whip) == (as_model.arm, preset("nah2023").whip)


@pytest.mark.parametrize(
    ("given", "option", "value"),
    [
        ({"model": "ur5e"}, "--model", "ur5e"),
        ({"arm": "panda"}, "--arm", "panda"),
        ({"model": "nah2023", "arm": "panda"}, "--arm", "panda"),
    ],
)
def test_a_command_in_the_plane_refuses_models_in_space(given, option, value):
    with pytest.raises(InputError) as caught:
        ModelOptions(**given).build_model()
    assert (caught.value.name, caught.value.given) == (option, value)
    assert caught.value.allowed == "a model in the plane, for this command"


@pytest.mark.parametrize(("given", "name"), [({"model": "ur10"}, "--model"), ({"arm": "ur10"}, "--arm")])
def test_models_that_there_are_none_of_are_named(given, name):
    with pytest.raises(InputError) as caught:
        SpaceOptions(**given).build_model()
    assert (caught.value.name, caught.value.given) == (name, "ur10")
    assert "lemon2024" in caught.value.allowed


@pytest.mark.parametrize(
    ("name", "place"), [("nah2023", (1.3, 0, 0)), ("ur5e", (1.2, 0.3, 0.5)), ("panda", (1.2, 0.3, 0.5))]
)
def test_options_without_a_target_have_the_usual_one_of_their_model(name, place):
    model = preset(name)
    assert ZoneOptions().build_target(model).position == GoalOptions().build_target(model).position == place
    assert ZoneOptions().build_zone(model).box[0] == pytest.approx(np.array(place) - 0.1)
    assert ZoneOptions(target=(1.3, 0.0)).build_target(model).position == (1.3, 0.0)  # that of the plane was said
    assert ZoneOptions(target=(1.2, 0.0)).build_target(model).position == (
        1.2,
        0.0,
    )  # which is refused where it is used
    assert ZoneOptions().build_target(preset("lemon2024")).position == (1.3, 0.0)


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({}, ArrivalRule()),
        ({"direction": (0.0, 2.0), "cone": 30.0}, ArrivalRule(direction=(0.0, 1.0), cone=math.radians(30))),
        ({"arrival_angle": (30.0,)}, ArrivalRule(angle=math.radians(30))),
        ({"arrival_angle": (-180.0, 180.0)}, ArrivalRule(angle=(-math.pi, math.pi))),
        ({"least_speed": 3.0}, ArrivalRule(speed=3.0)),
    ],
)
def test_the_rule_that_options_ask_for(options, rule):
    given = ZoneGoalOptions(**options)
    given.check()
    assert given.build_arrival() == rule


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"cone": 20.0}, "--cone: got 20.0; allowed: only with --direction or --arrival-angle"),
        (
            {"direction": (1.0, 0.0), "arrival_angle": (1.0,)},
            "only without --direction",
        ),
        ({"arrival_angle": (90.0, 30.0)}, "--arrival-angle"),
        ({"arrival_angle": (0.0, 361.0)}, "at most one turn apart"),
        ({"arrival_angle": ()}, "--arrival-angle"),
    ],
)
def test_what_contradicts_itself_is_refused(options, said):
    with pytest.raises(InputError, match=said):
        ZoneGoalOptions(**options).check()


def test_a_direction_fits_the_model_and_the_middle_of_the_zone():
    """Where arm and whip are stretched no tip moves outward."""
    lemon = preset("lemon2024")
    assert ZoneGoalOptions(direction=(0.0, 1.0)).build_zone(lemon) == ZoneGoalOptions().build_zone(lemon)
    with pytest.raises(InputError, match="2 coordinates"):
        ZoneGoalOptions(direction=(0.0, 1.0, 0.0)).build_zone(lemon)
    at_reach = {"target": (lemon.reach, 0.0), "zone_radius": 0.01}
    with pytest.raises(InputError, match="stretched to their reach"):
        ZoneGoalOptions(direction=(1.0, 0.0), **at_reach).build_zone(lemon)
    ZoneGoalOptions(direction=(0.0, 1.0), **at_reach).build_zone(lemon)
