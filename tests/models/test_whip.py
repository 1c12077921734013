"""Parameters of a whip: one number or one per node, the free hinge, and checks at the door."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models import WhipParameters, preset


def _whip(**changes):
    return WhipParameters(**{"N": 3, "l": 0.1, "m": 0.01, "k": 0.2, "b": 0.1, **changes})


def test_the_hinge_is_free():
    whip = preset("lemon2024").whip
    assert whip.per_node("k")[0] == whip.per_node("b")[0] == 0
    assert (whip.per_node("k")[1:] == 0.242).all()
    sprung = dataclasses.replace(whip, k=tuple(np.full(12, 0.3)))
    assert sprung.per_node("k")[0] == 0.3  # a value per node is also the hinge's


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("l", [0.1, 0.1, 0.1]), ("m", [0.01, 0.01, 0.01]), ("drag", [0.3, 0.3, 0.3]),  # of every node
        ("k", [0, 0.2, 0.2]), ("b", [0, 0.1, 0.1]), ("rest_angle", [0, 0.4, 0.4]),  # of joints 2..N
        ("dry_friction", [0, 0.5, 0.5]), ("cubic_stiffness", [0, 0.6, 0.6]),
    ],
)  # fmt: skip
def test_one_number_speaks_of_all_nodes_or_of_all_joints_but_the_first(name, expected):
    whip = _whip(drag=0.3, rest_angle=0.4, dry_friction=0.5, cubic_stiffness=0.6)
    np.testing.assert_array_equal(whip.per_node(name), expected)


@pytest.mark.parametrize("kind", [tuple, list, np.array])
def test_rows_of_any_kind_become_tuples(kind):
    whip = _whip(k=kind([0.1, 0.2, 0.3]), l=kind([1, 2, 3]))
    assert (whip.k, whip.l) == ((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))
    assert hash(whip) == hash(_whip(k=(0.1, 0.2, 0.3), l=(1.0, 2.0, 3.0)))
    np.testing.assert_array_equal(whip.per_node("k"), [0.1, 0.2, 0.3])


@pytest.mark.parametrize(("joints", "per_node"), [("hinge", 1), ("universal", 2), ("rod", 2)])
def test_a_node_bends_about_one_axis_in_the_plane_and_two_in_space(joints, per_node):
    whip = _whip(k=(0.1, 0.2, 0.3), joints=joints)
    assert whip.kind.joints == per_node
    expected = [0.1, 0.2, 0.3] if per_node == 1 else [0.1, 0.1, 0.2, 0.2, 0.3, 0.3]
    np.testing.assert_array_equal(whip.per_joint("k"), expected)


def test_length_and_mass_are_sums():
    assert _whip(l=(0.1, 0.2, 0.4)).length == pytest.approx(0.7)
    assert _whip().length == pytest.approx(0.3)
    assert _whip(m=(0.01, 0.02, 0.03), hinge_mass=0.5).mass == pytest.approx(0.56)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"N": 0}, "N"), ({"N": 2.5}, "N"), ({"N": True}, "N"), ({"l": 0.0}, "l"), ({"m": -0.1}, "m"),
        ({"k": -1.0}, "k"), ({"b": float("nan")}, "b"), ({"l": [0.1, 0.1]}, "l"), ({"m": [0.1, 0.1, -0.1]}, r"m\[2\]"),
        ({"k": "stiff"}, "k"), ({"drag": -1.0}, "drag"), ({"friction_velocity": 0.0}, "friction_velocity"),
        ({"rest_angle": float("inf")}, "rest_angle"), ({"hinge_mass": -1e-9}, "hinge_mass"),
        ({"N": 201}, "N"), ({"drag_ratio": -0.1}, "drag_ratio"),
        ({"node_inertia": -1.0, "joints": "universal"}, "node_inertia"),
        ({"l": [[0.1], [0.1], [0.1]]}, "l"),
    ],
)  # fmt: skip
def test_bad_whips_are_named(changes, name):
    with pytest.raises(InputError, match=f"^{name}: got .*allowed: ") as caught:
        _whip(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"joints": "ball"}, "joints: got 'ball'; allowed: hinge, universal, rod"),
        ({"joints": "rod", "node_inertia": 1e-6}, "node_inertia: .*0 for joints of the kind rod"),
        ({"rest_angle_x": 0.1}, "rest_angle_x: .*0 for joints of the kind hinge"),
        ({"joints": "rod", "rest_angle": (0, 0, 0.1)}, "rest_angle: .*0 for rods, which do not twist"),
        ({"joints": "rod", "rest_angle_x": 0.1}, "rest_angle_x: .*0 for joints of the kind rod"),
    ],
)
def test_quantities_that_such_joints_do_not_have_are_refused(wrong, message):
    with pytest.raises(InputError, match=f"^{message}"):
        _whip(**wrong)


def test_hinges_of_universal_joints_have_rest_angles_of_their_own():
    whip = WhipParameters(N=3, l=0.1, m=0.01, k=0.1, b=0, joints="universal", rest_angle=0.3, rest_angle_x=(1, 0.5, -1))
    np.testing.assert_array_equal(whip.rest_angles, [1, 0, 0.5, 0.3, -1, 0.3])  # x, then -y; the free hinge
    np.testing.assert_array_equal(_whip(N=3, rest_angle=0.3).rest_angles, [0, 0.3, 0.3])


def test_a_single_number_says_nothing_of_the_free_hinge_and_a_row_does():
    """A whip of one node has no rest angle by a single number."""
    assert not _whip(N=1, rest_angle=0.3).per_node("rest_angle").any()
    assert WhipParameters(N=1, l=0.1, m=0.01, k=0, b=0, rest_angle=0.3, joints="rod").rest_angle == 0.3
    with pytest.raises(InputError, match=r"^rest_angle"):
        _whip(N=1, rest_angle=(0.3,), joints="rod")


@pytest.mark.parametrize("name", ["rest_angle", "rest_angle_x"])
def test_rest_angles_in_degrees_are_asked_about(name):
    whip = {"N": 3, "l": 0.1, "m": 0.01, "k": 0.1, "b": 0.01, "joints": "universal"}
    for right in (np.pi / 2, -np.pi / 2, (0.0, 1.5, -1.5)):
        WhipParameters(**whip, **{name: right})
    for wrong in (5.0, -90, (0.0, 1.0, 30.0)):
        with pytest.raises(InputError, match=rf"^{name}: got [0-9.]+; .*in radians; are these degrees\?$"):
            WhipParameters(**whip, **{name: wrong})
