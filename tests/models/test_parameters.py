"""Models and planar arms: links as uniform rods by default, numbers by name, checks where they enter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from random_models import models

from whiptool.errors import InputError
from whiptool.models import ArmLink, ArmParameters

LINKS = (ArmLink(1.0, 0.4, com=0.1, inertia=0.01, friction=0.3), ArmLink(0.5, 0.3))


def test_a_link_is_a_uniform_rod_unless_it_says_otherwise():
    """By the sums over slices of a rod of 0.3 kg and 0.4 m."""
    link = ArmLink(mass=0.3, length=0.4)
    slices = (np.arange(1000) + 0.5) / 1000 * 0.4
    assert link.com == pytest.approx(slices.mean())
    assert link.inertia == pytest.approx(0.3 * ((slices - slices.mean()) ** 2).mean(), rel=1e-5)
    assert link.friction == 0
    own = ArmLink(mass=0.3, length=0.4, com=0.05, inertia=0.2)
    assert (own.com, own.inertia) == (0.05, 0.2)
    assert ArmLink(0.3, 0.4, com=0.5).com == 0.5  # a counterweight may be anywhere


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mass": 0}, "mass: got 0; allowed: a finite number > 0"),
        ({"length": -1}, "length: got -1; allowed: a finite number > 0"),
        ({"length": float("nan")}, "length: got nan"),
        ({"com": -0.1}, "com: got -0.1; allowed: a finite number >= 0"),
        ({"inertia": -1e-9}, "inertia"),
        ({"friction": -1}, "friction: got -1; allowed: a finite number >= 0"),
        ({"com": 0, "inertia": 0}, "inertia: got 0; allowed: a number > 0 if com is 0"),
    ],
)
def test_bad_links_are_named(wrong, message):
    with pytest.raises(InputError, match=f"^{message}"):
        ArmLink(**{"mass": 1.0, "length": 1.0, **wrong})


@pytest.mark.parametrize(
    ("links", "joints", "message"),
    [
        ((), (), r"links: got \(\); allowed: one or more ArmLink"),
        (((1.0, 0.4),), (), "links: .*one or more ArmLink"),
        (LINKS, ("a",), "joints: .*2 different names"),
        (LINKS[:1], ("a", "b"), "joints: .*1 different names"),
    ],
)
def test_bad_arms_are_named(links, joints, message):
    with pytest.raises(InputError, match=f"^{message}"):
        ArmParameters(links, joints)


def test_an_arm_is_its_links_in_order():
    arm = ArmParameters(list(LINKS))
    assert (arm.n, arm.dimension, arm.joints, arm.subscripts) == (2, 2, ("shoulder", "elbow"), ("s", "e"))
    assert arm.length == pytest.approx(0.7)
    np.testing.assert_array_equal(arm.per_link("mass"), [1.0, 0.5])
    np.testing.assert_array_equal(arm.per_link("com"), [0.1, 0.15])
    assert arm == ArmParameters(LINKS)
    assert hash(arm) == hash(ArmParameters(LINKS))


def test_every_number_can_be_changed_by_name():
    arm = ArmParameters(LINKS, ("hip", "knee"))
    known = arm.parameters()
    assert set(known) == {f"{name}[{i}]" for name in ("mass", "length", "com", "inertia", "friction") for i in (0, 1)}
    assert (known["friction[0]"], known["com[1]"]) == (0.3, 0.15)
    for name, value in known.items():
        changed = arm.with_parameters({name: value + 0.5})
        assert changed.parameters() == {**known, name: value + 0.5}  # nor does a longer link move its centre of mass
        assert changed.joints == ("hip", "knee")
    with pytest.raises(InputError, match=r"^mass: got -1"):
        arm.with_parameters({"mass[1]": -1})


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
