"""Options that change the model's whip, wherever there is a `--model`."""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module

import numpy as np
import pytest

from whiptool.commands.adapt import prepare
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.option_group import OptionGroup
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.commands.options.strike_options import StepOptions
from whiptool.errors import InputError
from whiptool.models import preset


class Space(ModelOptions):
    in_space = True


def test_a_whip_is_as_long_and_has_as_many_nodes_as_asked():
    model = ModelOptions(whip_length=0.8, nodes=16).build_model()
    assert model.whip.length == pytest.approx(0.8)
    assert model.whip.N == 16
    assert model == preset("lemon2024").with_whip(length=0.8, nodes=16)
    # mass per length stays, but for the half link that the paper's whip lacks at the hand
    usual = preset("lemon2024").whip
    assert model.whip.mass / 0.8 == pytest.approx(usual.mass / usual.length, rel=1e-9)
    thin = Space(model="ur5e", taper=0.5).build_model().whip
    assert thin.mass == pytest.approx(preset("ur5e").whip.mass * (0.5**2 - 1) / (2 * np.log(0.5)))  # integral of 0.25^s


def test_a_rope_by_its_material():
    """Of the UR5e's own material it is the UR5e's rope; twice as thick it is four times as heavy, 16 times as stiff."""
    same = Space(model="ur5e", youngs_modulus=2e5, diameter=0.0127, density=700.0).build_model().whip
    thick = Space(model="ur5e", youngs_modulus=2e5, diameter=0.0254, density=700.0, whip_length=2.0).build_model().whip
    usual = preset("ur5e").whip
    for name in ("l", "m", "k", "b"):
        np.testing.assert_allclose(same.per_node(name), usual.per_node(name), rtol=1e-9)
    assert thick.mass == pytest.approx(2 * 4 * usual.mass)
    np.testing.assert_allclose(thick.per_node("k"), 16 / 2 * usual.per_node("k"), rtol=1e-9)
    np.testing.assert_allclose(thick.per_node("b"), 16 / 2 * usual.per_node("b"), rtol=1e-9)


@pytest.mark.parametrize(
    ("given", "name", "said"),
    [
        ({"whip_length": -1.0}, "--whip-length", "> 0"),
        ({"nodes": 0}, "--nodes", "whole number"),
        ({"taper": 100.0}, "--taper", ""),
        ({"diameter": 0.01}, "--youngs-modulus", "--youngs-modulus, --diameter, --density go together"),
        ({"youngs_modulus": 1e6, "diameter": 0.01, "density": -1.0}, "--density", "> 0"),
    ],
)
def test_mistakes_name_the_option(given, name, said):
    with pytest.raises(InputError) as caught:
        ModelOptions(**given).build_model()
    assert caught.value.name == name
    assert said in str(caught.value)


COMMANDS = ("optimize", "simulate", "train", "compare", "map", "identify", "adapt", "rig", "emulators")


@pytest.mark.parametrize("command", [*COMMANDS, "papers.reproduce"])
def test_every_command_with_a_model_has_them(command):
    module = import_module(command if "." in command else f"whiptool.commands.{command}")
    groups = [x for x in vars(module).values() if isinstance(x, type) and issubclass(x, OptionGroup)]
    of_commands = [x for x in groups if "model" in {f.name for f in fields(x)} and x is not StepOptions]
    assert of_commands
    for options in of_commands:
        assert {"whip_length", "nodes", "taper", "youngs_modulus"} <= {f.name for f in fields(options)}


def test_a_diameter_belongs_to_the_material_that_is_given():
    """With `--material` it changes the prior, and needs no Young's modulus; without, it is one of three numbers."""
    leather = AdaptOptions(camera="tip", material="leather", diameter=0.012, length=0.9)
    assert leather.build_model() == preset("lemon2024")
    rubber = AdaptOptions(camera="tip", youngs_modulus=2e7, diameter=0.012, density=900.0)
    assert rubber.build_model() == ModelOptions(youngs_modulus=2e7, diameter=0.012, density=900.0).build_model()
    prepare(rubber)  # not refused
    with pytest.raises(InputError, match="go together"):
        AdaptOptions(camera="tip", diameter=0.012).build_model()
