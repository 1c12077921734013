"""Flights against SciPy's integration, closed forms, and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from whiptool.errors import InputError
from whiptool.throws.flight import Opening, Thing, fly, land

G = 9.81


def scipy_landing(state: np.ndarray, opening: Opening, drag: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Offset, velocity and time where a thing last falls through a plane."""
    d = len(state) // 2
    down = np.r_[np.zeros(d - 1), -G]

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        return np.r_[x[d:], down - drag * np.linalg.norm(x[d:]) * x[d:]]

    def height(t: float, x: np.ndarray) -> float:
        return float((x[:d] - opening.centres[0] - opening.drift * t) @ opening.normal)

    height.direction = -1  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0, 20), state, events=height, method="DOP853", rtol=1e-12, atol=1e-12)
    t, x = found.t_events[0][-1], found.y_events[0][-1]
    return x[:d] - opening.centres[0] - opening.drift * t, x[d:], float(t)


CASES = {
    "plane": ([0.3, 0.2, 4.0, 3.0], [1.8, -0.5], [0.0, 1.0], [0.0, 0.0]),
    "from below": ([0.3, -0.9, 2.0, 7.0], [1.8, -0.5], [0.0, 1.0], [0.0, 0.0]),
    "downward": ([0.3, 0.9, 3.0, -2.0], [1.8, -0.5], [0.0, 1.0], [0.0, 0.0]),
    "space": ([0.4, 0.1, 1.0, 5.0, -1.0, 4.0], [2.0, 0.3, 0.2], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]),
    "tilted and moving": ([0.4, 0.1, 1.0, 5.0, -1.0, 4.0], [2.0, 0.3, 0.2], [-0.6, 0.0, 0.8], [0.5, -0.2, 0.1]),
}


def case(name: str) -> tuple[np.ndarray, Opening]:
    state, centre, normal, drift = (np.array(x) for x in CASES[name])
    return state, Opening(centre[None], normal, drift)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("drag", [0.0, 0.0177, 0.12])  # none, a ball of 20 g and 40 mm, a table-tennis ball
def test_landings_are_those_of_scipy(name, drag):
    state, opening = case(name)
    found = land(state[None], opening, gravity=G, drag=drag)
    offset, velocity, time = scipy_landing(state, opening, drag)
    assert np.abs(found.offset[0] - offset).max() < 1e-4
    assert np.abs(found.velocity[0] - velocity).max() < 1e-3
    assert abs(found.time[0] - time) < 1e-4
    assert abs(found.offset[0] @ opening.normal) < 1e-7  # it is in the plane


def test_a_shuttlecock_at_20_m_s_lands_within_a_millimetre():
    state, opening = (
        np.array([0.0, 0.0, 14.0, 14.0]),
        Opening(np.array([[4.0, -0.3]]), np.array([0.0, 1.0]), np.zeros(2)),
    )
    found = land(state[None], opening, gravity=G, drag=0.22)
    assert np.abs(found.offset[0] - scipy_landing(state, opening, 0.22)[0]).max() < 1e-3


@pytest.mark.parametrize("drag", [1.0, 4.0, 35.0, 100.0])
def test_balloons_and_feathers_land_within_a_tenth_of_a_millimetre(drag):
    rng, down = np.random.default_rng(3), np.array([0.0, 0.0, -G])
    for _ in range(2):
        state = np.r_[rng.uniform(-0.5, 0.5, 3), rng.uniform(-10, 10, 2), rng.uniform(-3, 15)]
        opening = Opening(state[None, :3] - [0.1, 0.2, 1.0], np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.0, 0.0]))
        found = land(state[None], opening, gravity=G, drag=drag)
        coarse = land(state[None], opening, gravity=G, drag=drag, tolerance=1e-5)  # of the search for the release
        offset, velocity, time = scipy_landing(state, opening, drag)
        assert found.offset[0] == pytest.approx(offset, abs=1e-6)
        assert coarse.offset[0] == pytest.approx(offset, abs=1e-3)
        assert found.velocity[0] == pytest.approx(velocity, abs=1e-5)
        place = fly(state[None], np.array([time / 3, time]), down, drag)[0][1]
        assert place - opening.centres[0] - opening.drift * time == pytest.approx(offset, abs=1e-5)


def test_flights_do_not_depend_on_those_beside_them():
    rng = np.random.default_rng(4)
    states = np.hstack([rng.uniform(-1, 1, (8, 3)), rng.uniform(-20, 20, (8, 3))])
    opening = Opening(np.tile([0.5, 0.2, -1.2], (8, 1)), np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.1, 0.02)
    together = land(states, opening, gravity=G, drag=2.0).offset
    for i in range(8):
        one = Opening(opening.centres[i : i + 1], opening.normal, opening.drift, 0.1, 0.02)
        assert land(states[i : i + 1], one, gravity=G, drag=2.0).offset[0] == pytest.approx(together[i], abs=1e-12)


def test_without_drag_the_flight_is_a_parabola():
    state = np.array([[0.2, 1.0, 3.0, 2.0]])
    found = land(state, Opening(np.array([[1.0, 0.0]]), np.array([0.0, 1.0]), np.zeros(2)), gravity=G, drag=0.0)
    time = (2.0 + np.sqrt(4.0 + 2 * G)) / G
    assert found.time[0] == pytest.approx(time, abs=1e-12)
    assert found.offset[0] == pytest.approx([0.2 + 3 * time - 1.0, 0.0], abs=1e-12)
    places, velocities = fly(state, np.array([0.1, 0.4]), np.array([0.0, -G]), 0.0)
    assert places[1] == pytest.approx([0.2 + 1.2, 1.0 + 0.8 - G * 0.08], abs=1e-12)
    assert velocities[0] == pytest.approx([3.0, 2.0 - 0.1 * G], abs=1e-12)


@pytest.mark.parametrize("name", [*CASES, "stays below"])
@pytest.mark.parametrize("drag", [0.0, 0.05])
def test_slopes_are_those_of_differences(name, drag):
    low = name == "stays below"  # 0.9 m below the opening at 2 m/s: it counts with its highest point
    state, opening = case("plane" if low else name)
    if low:
        state = np.array([0.3, -1.4, 4.0, 2.0])
    d, found = len(state) // 2, land(state[None], opening, gravity=G, drag=drag, slopes=True)
    assert found.slopes is not None
    for k in range(2 * d + bool(drag)):
        by = 1e-6 * np.eye(2 * d + 1)[k]
        ahead, behind = (land((state + x[:-1])[None], opening, gravity=G, drag=drag + x[-1]) for x in (by, -by))
        seen = [(getattr(ahead, y) - getattr(behind, y))[0] / 2e-6 for y in ("offset", "velocity")]
        assert found.slopes[0, :, k] == pytest.approx(np.concatenate(seen), rel=1e-5, abs=1e-5)


def test_a_thing_that_stays_below_the_plane_is_not_in_the_box_however_near_it_comes():
    opening = Opening(np.array([[1.0, 0.0]]), np.array([0.0, 1.0]), np.zeros(2), radius=0.1)
    found = land(np.array([[1.0, -0.05 - 0.2, 0.0, np.sqrt(2 * G * 0.2)]]), opening, gravity=G, drag=0.0)
    assert found.velocity[0] == pytest.approx([0.0, 0.0], abs=1e-12)  # its highest point, 5 cm below the centre
    assert np.linalg.norm(found.offset[0]) == pytest.approx(0.05 + 0.1)


def test_without_a_radius_the_miss_is_continuous_where_things_begin_to_reach_the_plane():
    opening = Opening(np.tile([1.8, -0.5], (2, 1)), np.array([0.0, 1.0]), np.zeros(2))
    reaching = np.sqrt(2 * G * 0.4)  # from 0.4 m below
    states = np.array([[0.3, -0.9, 4.0, reaching + by] for by in (-1e-7, 1e-7)])
    offsets = land(states, opening, gravity=G, drag=0.0).offset
    assert offsets[0] == pytest.approx(offsets[1], abs=2e-3)


def test_things_that_cannot_be():
    with pytest.raises(InputError, match="mass of the thing"):
        Thing(0.0)
    with pytest.raises(InputError, match="drag of the thing"):
        Thing(0.02, -1.0)
    with pytest.raises(InputError, match="drag per mass of the thing"):
        Thing(0.001, 0.2)
    assert Thing.of_ball(0.02, 0.04).drag == pytest.approx(0.5 * 1.2 * 0.47 * np.pi * 0.02**2)
