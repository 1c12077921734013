"""Parameters: validation at the door, presets as published, files that read back the same."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whiptool.errors import InputError
from whiptool.models import (
    ArmLink,
    ArmParameters,
    Model,
    WhipParameters,
    find_model,
    preset,
    read_model,
    write_model,
)
from whiptool.models.files import model_from_table, model_to_table


def test_published_presets():
    lemon = preset("lemon2024")
    w = lemon.whip
    assert (w.N, w.l, w.m, w.k, w.b) == (12, 0.072, 0.012, 0.242, 0.092)  # Table 2
    assert [(link.mass, link.length) for link in lemon.arm.links] == [(0.25, 0.31), (0.274, 0.34)]  # Table 3
    assert lemon.whip.length == pytest.approx(0.864)
    assert lemon.whip.mass == pytest.approx(0.144)
    fitted = preset("nah2020-fitted")
    assert (fitted.whip.length, fitted.whip.mass) == (pytest.approx(1.8), pytest.approx(0.3))
    assert {preset(f"nah2020-n{n}").whip.N for n in (10, 15, 20)} == {10, 15, 20}


def test_the_hinge_is_free_and_links_are_rods():
    whip = preset("lemon2024").whip
    assert whip.per_node("k")[0] == whip.per_node("b")[0] == 0
    assert (whip.per_node("k")[1:] == 0.242).all()
    link = ArmLink(mass=0.3, length=0.4)
    assert (link.com, link.inertia) == (0.2, pytest.approx(0.3 * 0.4**2 / 12))
    sprung = dataclasses.replace(whip, k=tuple(np.full(12, 0.3)))
    assert sprung.per_node("k")[0] == 0.3  # a value per node speaks of the hinge, too


def _whip(**changes):
    return WhipParameters(**{"N": 3, "l": 0.1, "m": 0.01, "k": 0.2, "b": 0.1, **changes})


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"N": 0}, "N"), ({"N": 2.5}, "N"), ({"N": True}, "N"), ({"l": 0.0}, "l"), ({"m": -0.1}, "m"),
        ({"k": -1.0}, "k"), ({"b": float("nan")}, "b"), ({"l": [0.1, 0.1]}, "l"), ({"m": [0.1, 0.1, -0.1]}, r"m\[2\]"),
        ({"k": "stiff"}, "k"), ({"drag": -1.0}, "drag"), ({"friction_velocity": 0.0}, "friction_velocity"),
        ({"rest_angle": float("inf")}, "rest_angle"), ({"hinge_mass": -1e-9}, "hinge_mass"),
    ],
)  # fmt: skip
def test_bad_whips_are_named(changes, name):
    with pytest.raises(InputError, match=f"^{name}: got .*allowed: ") as caught:
        _whip(**changes)
    assert "\n" not in str(caught.value)


def test_bad_arms_are_named():
    for wrong, name in (({"mass": 0}, "mass"), ({"length": -1}, "length"), ({"friction": -1}, "friction")):
        with pytest.raises(InputError, match=f"^{name}"):
            ArmLink(**{"mass": 1.0, "length": 1.0, **wrong})
    with pytest.raises(InputError, match="joints"):
        ArmParameters((ArmLink(1.0, 1.0),), joints=("a", "b"))
    with pytest.raises(InputError, match="lemon2024, nah2020-n10"):
        preset("lemon2023")


finite = st.floats(1e-4, 10)


@st.composite
def models(draw):
    N = draw(st.integers(1, 5))
    per_node = st.one_of(finite, st.lists(finite, min_size=N, max_size=N).map(tuple))
    whip = WhipParameters(
        N=N, l=draw(per_node), m=draw(per_node), k=draw(per_node), b=draw(per_node), drag=draw(per_node),
        rest_angle=draw(per_node), dry_friction=draw(per_node), hinge_mass=draw(st.floats(0, 1)),
        friction_velocity=draw(finite), cubic_stiffness=draw(per_node), drag_ratio=draw(st.floats(0, 2)),
    )  # fmt: skip
    links = draw(st.lists(st.builds(ArmLink, finite, finite, finite, finite, finite), min_size=1, max_size=4))
    return Model(whip=whip, arm=ArmParameters(tuple(links)), gravity=draw(st.floats(0, 20)), name="drawn")


@given(models())
@settings(max_examples=50, deadline=None, derandomize=True)
def test_files_read_back_the_same(tmp_path_factory, model):
    path = tmp_path_factory.mktemp("model") / "model.toml"
    write_model(model, path)
    again = read_model(path)
    assert again == model
    assert again.name == model.name
    assert find_model(str(path)) == model


@given(models())
@settings(max_examples=50, deadline=None, derandomize=True)
def test_every_parameter_can_be_changed_by_name(model):
    for name, value in model.parameters().items():
        changed = model.with_parameters({name: value + 0.5})
        assert changed != model
        assert changed.parameters()[name] == pytest.approx(value + 0.5)
        assert changed.with_parameters({name: value}) == model
    with pytest.raises(InputError, match=r"whip\.l"):
        model.with_parameters({"whip.q": 1.0})


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
