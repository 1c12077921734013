"""Models in files: they read back the same, and mistakes are named."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from random_models import models

from whiptool.errors import InputError
from whiptool.models import (
    load_model,
    preset,
    read_model,
    write_model,
)
from whiptool.models.files import model_from_table, model_to_table

ROUND = {"length": 1.0, "youngs_modulus": 2e5, "diameter": 0.0127, "density": 700.0, "bending_damping": 2.6e-5}


@given(models())
@settings(max_examples=50, deadline=None, derandomize=True)
def test_files_read_back_the_same(tmp_path_factory, model):
    path = tmp_path_factory.mktemp("model") / "model.toml"
    write_model(model, path)
    again = read_model(path)
    assert again == model
    assert again.name == model.name
    assert load_model(str(path)) == model


def test_mistakes_in_files_are_named(tmp_path):
    good = model_to_table(preset("lemon2024"))
    for change, name in (
        ({"whip": {**good["whip"], "N": 0}}, r"whip\.N: got 0"),
        ({"whip": {**good["whip"], "mass": 1}}, r"whip\.mass: got 1; allowed: one of the keys N, l, m"),
        ({"whip": {"N": 3}}, r"whip\.l: got None.*missing"),
        ({"gravitee": 1}, "gravitee"),
        ({"arm": {"links": []}}, r"arm\.links"),
        ({"arm": {"links": [{"mass": -1, "length": 1}]}}, r"arm\.links\[0\]\.mass: got -1"),
        ({"arm": 3}, "arm: got 3; allowed: a table"),
        ({"whip": {"N": 4, "profile": {"length": -1}}}, r"whip\.profile\."),
        ({"whip": {"N": 4, "l": 1, "profile": {}}}, r"whip\.l"),
        ({"whip": {"N": 4, "profile": {"length": 1, "density": 700}}}, r"whip\.profile\.youngs_modulus: got None"),
        ({"whip": {"N": 4, "profile": ROUND | {"density": -1}}}, r"whip\.profile\.density"),
        (
            {"whip": {"N": 4, "profile": ROUND | {"linear_density": 1}}},
            r"whip\.profile\.linear_density",
        ),
        ({"whip": {"N": 4, "clamp": 1.5, "profile": ROUND}}, r"whip\.clamp: got 1\.5; allowed: true or false"),
    ):
        with pytest.raises(InputError, match=name):
            model_from_table({**good, **change})
    (tmp_path / "broken.toml").write_text("whip = [")
    with pytest.raises(InputError, match="valid TOML"):
        read_model(tmp_path / "broken.toml")
    with pytest.raises(InputError, match="readable"):
        read_model(tmp_path / "absent.toml")


def test_a_profile_in_a_file_is_lumped(tmp_path):
    path = tmp_path / "tapered.toml"
    path.write_text("""
        [whip]
        N = 6
        [whip.profile]
        length = 0.9
        linear_density = 0.2
        bending_stiffness = 0.02
        bending_damping = 0.005
        density_taper = 0.3
        [arm]
        links = [{mass = 0.25, length = 0.31}, {mass = 0.274, length = 0.34}]
    """)
    whip = read_model(path).whip
    assert (whip.N, whip.length) == (6, pytest.approx(0.9))
    density = 0.2 * (0.3 - 1) / np.log(0.3) * 0.9  # integral of the geometric taper
    assert whip.mass == pytest.approx(density)


def test_a_rope_by_its_material_is_that_of_the_presets():
    """Whose stiffness is written with the radius, E pi r^4 / 4; clamped it bends at the hand by half a link's share."""
    EI = 2e5 * np.pi * 0.00635**4 / 4
    arm = model_to_table(preset("ur5e"))["arm"]
    whip = {"N": 20, "joints": "rod", "profile": {**ROUND, "bending_damping": 0.1 * EI}}
    rope = model_from_table({"whip": whip, "arm": arm}).whip
    for name in ("l", "m", "k", "b"):
        np.testing.assert_allclose(rope.per_node(name), preset("ur5e").whip.per_node(name), rtol=1e-12)
    clamped = model_from_table({"whip": {**whip, "clamp": True}, "arm": arm}).whip
    np.testing.assert_allclose(clamped.per_node("k"), EI * 20 * np.r_[2, np.ones(19)], rtol=1e-12)
    assert model_from_table({"whip": {**whip, "clamp": False}, "arm": arm}).whip == rope
