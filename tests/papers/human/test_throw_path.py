"""The handle's motion is consistent, and the hand has the mean speed that was measured."""

from __future__ import annotations

import numpy as np
import pytest
from human_data import PEOPLE, write_made_up

from papers.human.cascade_fit import start, unpacked
from papers.human.reading import read_people
from papers.human.throw_path import CYCLES, mean_hand, thrown

H = 5e-4


@pytest.fixture(scope="module")
def people(tmp_path_factory):
    return read_people(write_made_up(tmp_path_factory.mktemp("people")))


@pytest.fixture(params=["discrete", "rhythmic"])
def hand(people, request):
    return mean_hand(people.of_style(request.param), cyclic=request.param == "rhythmic")


def test_instants_and_largest_speed_are_means_of_people(people, hand):
    ones = people.of_style("rhythmic" if hand.cyclic else "discrete")
    np.testing.assert_allclose(hand.instants, [0.8, 1.1, 1.4], atol=0.01)
    assert hand.speed.max() == pytest.approx(np.mean([one.markers[-1].max() for one in ones]))
    assert len(ones) == PEOPLE


def test_motion_is_its_own_derivative(hand):
    path, _ = unpacked(start())
    handle = thrown(hand, path, H)
    theta, omega, alpha = handle.inputs[:, :3].T
    velocity, acceleration = handle.inputs[:, 3:5], handle.inputs[:, 5:7]
    moving = slice(2, -4)
    for values, rates, size in (
        (theta, omega, 0.02), (omega, alpha, 1.0), (handle.place, velocity, 0.01), (velocity, acceleration, 1.5),
    ):  # fmt: skip
        np.testing.assert_allclose(np.gradient(values, H, axis=0)[moving], rates[moving], atol=size)


def test_the_hand_has_the_measured_speed(hand):
    path, _ = unpacked(start())
    handle = thrown(hand, path, H)
    out = np.stack([np.sin(handle.inputs[:, 0]), -np.cos(handle.inputs[:, 0])], axis=1)
    speed = np.linalg.norm(np.gradient(handle.place - path.grip * out, H, axis=0), axis=1)
    late = slice(600, -4)  # it has got going from rest
    np.testing.assert_allclose(speed[late], handle.hand_speed[late], atol=0.02)
    assert handle.hand_speed[handle.peak] == pytest.approx(hand.speed.max(), rel=5e-3)


def test_rhythmic_throws_repeat(people):
    hand = mean_hand(people.of_style("rhythmic"), cyclic=True)
    handle = thrown(hand, unpacked(start())[0], H)
    period = round(hand.instants[-1] / H)
    assert len(handle.inputs) == pytest.approx(CYCLES * period + 2, abs=2)
    one, other = handle.inputs[-period - 2 : -2], handle.inputs[-2 * period - 2 : -period - 2]
    np.testing.assert_allclose(one[:, 1:], other[:, 1:], atol=0.02 * np.abs(one).max())
    turned = (one[:, 0] - other[:, 0]) / (2 * np.pi)
    np.testing.assert_allclose(turned, np.round(turned), atol=1e-2)
