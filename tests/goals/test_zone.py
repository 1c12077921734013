"""Zones: areas by counting, uniformity by moments, cells by the points that made them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fake_rollout import SPEED, StraightFlight, StraightFlightInSpace

from whiptool.errors import InputError
from whiptool.goals.zone import (
    Disc,
    ReachableDisc,
    Region,
    Sector,
    check_fits,
    disc_within_reach,
    random_paths,
    reachable_region,
    sample,
    usual_disc,
)
from whiptool.models import preset
from whiptool.models.strike import T_STAY, StrikeBounds

DISC = Disc((0.4, -0.2), 0.3)
CELLS = Region(np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.2], [0.6, -0.4]]), 0.2)
CUT = ReachableDisc(Disc((1.3, 0.0), 0.3), 1.514)
BALL = Disc((0.4, -0.2, 0.3), 0.3)
CUBES = Region(np.array([[0.0, 0.0, 0.2], [0.2, 0.0, 0.2], [0.0, 0.2, 0.0], [0.6, -0.4, 0.2]]), 0.2)
CAP = ReachableDisc(Disc((1.0, -0.6, 0.5), 0.3), 1.35)
MOSTLY_BEYOND_IN_SPACE = ReachableDisc(Disc((-0.6, 0.6, 0.6), 0.6), 0.8)
SECTOR = Sector(0.5, 0.9, -0.3, 0.7, 0.6)
WIDE_SECTOR = Sector(0.3, 0.8, 0.2, 0.6, 2.2)
MOSTLY_BEYOND = ReachableDisc(Disc((-0.9, 0.9), 0.6), 1.1)


@pytest.mark.parametrize("zone", [DISC, CELLS, CUT, BALL, CUBES, CAP, SECTOR, WIDE_SECTOR])
def test_area_and_containment_by_counting(zone):
    lower, upper = zone.box
    points = np.random.default_rng(0).uniform(lower - 0.1, upper + 0.1, (200_000, zone.dimension))
    share = zone.contains(points).mean()
    assert share * np.prod(upper - lower + 0.2) == pytest.approx(zone.size, rel=0.02)
    inside = points[zone.contains(points)]
    near = 0.01 if zone.dimension == 2 else 0.03  # few points are near the end of a ball
    if zone is CAP:  # it lies aslant in its box
        return
    np.testing.assert_allclose(inside.min(axis=0), lower, atol=near)
    np.testing.assert_allclose(inside.max(axis=0), upper, atol=near)


@pytest.mark.parametrize(
    "zone", [DISC, CELLS, CUT, MOSTLY_BEYOND, BALL, CUBES, CAP, MOSTLY_BEYOND_IN_SPACE, SECTOR, WIDE_SECTOR]
)
def test_places_are_uniform(zone):
    """As many in each part as its area says: parts are squares of a grid, areas by counting."""
    rng = np.random.default_rng(1)
    points = sample(zone, 40_000, rng)
    assert zone.contains(points).all()
    lower, upper = zone.box
    everywhere = rng.uniform(lower, upper, (400_000, zone.dimension))
    everywhere = everywhere[zone.contains(everywhere)]
    grid = [np.linspace(a, b, 6) for a, b in zip(lower, upper, strict=True)]
    got, wanted = (np.histogramdd(p, bins=grid)[0] / len(p) for p in (points, everywhere))
    assert np.abs(got - wanted).max() < 0.006


def test_a_disc_by_its_numbers():
    place = DISC.place(np.array([[0.0, 1.0, 0.0], [0.25, 0.25, 0.9], [0.5, 0.0, 0.0]]))
    np.testing.assert_allclose(place, [[0.7, -0.2], [0.4, -0.05], [0.4, -0.2]], atol=1e-15)
    assert DISC.size == pytest.approx(math.pi * 0.09)
    np.testing.assert_allclose(DISC.box, [[0.1, -0.5], [0.7, 0.1]])
    unit = Disc((0.0, 0.0), 1.0)
    assert unit.contains(np.array([[1.0, 0.0], [0.0, -1.0], [0.8, 0.601], [np.nan, 0.0]])).tolist() == [1, 1, 0, 0]
    assert unit.contains(np.zeros((2, 3, 2))).shape == (2, 3)


def test_of_a_disc_is_left_what_is_within_reach():
    """The area of two circles that cut each other is in tables; a disc around the shoulder is cut to a smaller one."""
    d, r, reach = 1.3, 0.3, 1.514
    beside, behind = (d**2 + r**2 - reach**2) / (2 * d * r), (d**2 + reach**2 - r**2) / (2 * d * reach)
    chord = math.sqrt((-d + r + reach) * (d + r - reach) * (d - r + reach) * (d + r + reach)) / 2
    assert CUT.size == pytest.approx(r**2 * math.acos(beside) + reach**2 * math.acos(behind) - chord, rel=1e-6)
    assert ReachableDisc(Disc((0.0, 0.0), 1.0), 0.5).size == pytest.approx(math.pi / 4, rel=1e-3)
    assert disc_within_reach(DISC, 2.0) is DISC
    assert disc_within_reach(CUT.disc, reach) == CUT
    edge = np.array([[1.513, 0.0], [1.515, 0.0], [1.3, 0.299], [1.3, 0.301], [np.nan, 0.0]])
    assert CUT.contains(edge).tolist() == [1, 0, 1, 0, 0]
    with pytest.raises(InputError, match=r"comes within 0\.500 m of the shoulder"):
        disc_within_reach(Disc((0.9, 0.0), 0.3), 0.5)


def test_of_a_ball_is_left_what_is_within_reach():
    """The volume of two balls that cut each other is in tables."""
    d, r, reach = math.hypot(1.0, -0.6, 0.5), 0.3, 1.35
    lens = math.pi * (r + reach - d) ** 2 * (d**2 + 2 * d * (r + reach) - 3 * (r - reach) ** 2) / (12 * d)
    assert CAP.size == pytest.approx(lens, rel=1e-6)
    assert disc_within_reach(BALL, 2.0) is BALL
    assert disc_within_reach(CAP.disc, reach) == CAP
    with pytest.raises(InputError, match=r"a ball of radius 0\.3 m"):
        disc_within_reach(BALL, 0.1)
    model = StraightFlight.model
    assert check_fits(DISC, model, 0.06) == 0.06
    for zone in (BALL, CUBES, CAP):
        with pytest.raises(InputError, match="coordinates of the zone: got 3; allowed: 2, as the model lemon2024 has"):
            check_fits(zone, model, 0.06)
    assert usual_disc(model) == Disc()
    assert usual_disc(preset("ur5e")) == Disc((1.2, 0.3, 0.5))


@pytest.mark.parametrize("away", [Disc((5.0, 0.0), 0.3), Region(np.array([[50.0, 50.0], [-40.0, 60.0]]), 0.1)])
def test_a_zone_that_is_out_of_reach_altogether_is_refused(away):
    """Policies were trained for targets at 70 m."""
    with pytest.raises(InputError, match=r"zone: got 'targets at least .* m away'; allowed: .* reach of 1\.514 m"):
        check_fits(away, StraightFlight.model, 0.06)
    assert check_fits(Disc((1.8, 0.0), 0.3), StraightFlight.model, 0.06) == 0.06  # some of it is within reach


def test_cells_by_their_numbers():
    place = CELLS.place(np.array([[0.0, 0.5, 0.25], [0.3, 0.0, 0.0], [0.999, 1.0, 0.5], [1.0, 0.5, 0.5]]))
    np.testing.assert_allclose(place, [[0.1, 0.05], [0.2, 0.0], [0.8, -0.3], [0.7, -0.3]])
    points = [[0.1, 0.1], [0.1, 0.3], [0.3, 0.3], [0.7, -0.3], [0.7, -0.1], [np.nan, 0.1], [9.0, 0.1], [0.1, -9.0]]
    assert CELLS.contains(np.array(points)).tolist() == [1, 1, 0, 1, 0, 0, 0, 0]
    assert CELLS.contains(np.array([[-0.01, 0.1], [0.81, -0.3], [0.7, -0.41], [0.1, 0.41]])).tolist() == [0] * 4
    assert CELLS.contains(np.array([points[:4], points[4:]])).shape == (2, 4)
    assert CELLS.size == pytest.approx(4 * 0.04)
    np.testing.assert_allclose(CELLS.box, [[0.0, -0.4], [0.8, 0.4]])


def test_cells_come_back_from_a_file(tmp_path):
    CELLS.save(tmp_path / "region.npz")
    back = Region.load(tmp_path / "region.npz")
    assert back.cell == CELLS.cell
    np.testing.assert_array_equal(back.corners, CELLS.corners)


BOUNDS = StrikeBounds((0.0, 0.0, 0.1, 0.2, 0.05), (math.pi / 2, 0.5, 0.3, 0.8, 0.1))


def test_random_paths_are_all_there():
    rng = np.random.default_rng(3)
    parts = list(random_paths(StraightFlight(), BOUNDS, 4100, rng, rate=10.0))
    assert [len(part) for part in parts] == [4096, 4]


@pytest.mark.parametrize(("rate", "cell"), [(200.0, 0.05), (10.0, 0.05)])
def test_the_reachable_region_of_straight_flights(rate, cell):
    """A quarter of a disc of 2 m/s times the shortest strike and rest, samples nearer or farther apart than cells."""
    region = reachable_region(StraightFlight(), BOUNDS, speed=1.9, count=3000, cell=cell, rate=rate, seed=1)
    low, high = SPEED * (0.05 + T_STAY), SPEED * (0.1 + T_STAY)
    centres = region.corners + cell / 2
    distance = np.hypot(*centres.T)
    grid = (np.stack(np.meshgrid(np.arange(-30, 40), np.arange(-30, 40)), axis=-1).reshape(-1, 2) + 0.5) * cell
    quarter = grid[(grid > 0).all(axis=1)]
    sure = quarter[np.hypot(*quarter.T) < low - 0.1 - (SPEED / rate if rate < 50 else 0)]
    assert region.contains(sure[np.hypot(*sure.T) > 0.1]).all()
    assert (distance < high + cell).all()
    assert (centres > 0).all()  # no flight begins behind the origin
    assert len(reachable_region(StraightFlight(), BOUNDS, speed=2.1, count=500, cell=cell, rate=rate).corners) == 0


IN_SPACE = StrikeBounds((0.0, 0.0, 0.0, *(0.1,) * 5, 0.05), (math.pi / 2, 0.5, math.pi / 2, *(0.3,) * 5, 0.1))


def test_the_reachable_region_of_straight_flights_in_space():
    """An eighth of a ball; heights are not drawn uniformly over it, so that its pole is full and its rim has holes."""
    region = reachable_region(StraightFlightInSpace(), IN_SPACE, speed=1.9, count=4000, cell=0.1, rate=100.0, seed=1)
    low, high = SPEED * (0.05 + T_STAY), SPEED * (0.1 + T_STAY)
    centres = region.corners + 0.05
    assert region.dimension == 3
    assert (centres > 0).all()
    assert (np.linalg.norm(centres, axis=1) < high + 0.1).all()
    grid = (np.stack(np.meshgrid(*[np.arange(10)] * 3), axis=-1).reshape(-1, 3) + 0.5) * 0.1
    distance = np.linalg.norm(grid, axis=1)
    assert region.contains(grid[(distance > 0.1) & (distance < low - 0.1)]).all()
    assert not region.contains(-grid).any()
    assert len(reachable_region(StraightFlightInSpace(), IN_SPACE, speed=2.1, count=100, cell=0.1).corners) == 0


def test_the_reachable_region_ends_at_reach():
    longest = StraightFlight.model.reach / SPEED - T_STAY
    far = StrikeBounds((0.0, 0.0, 0.1, 0.2, longest - 0.01), (math.pi / 2, 0.5, 0.3, 0.8, longest))
    region = reachable_region(StraightFlight(), far, speed=1.9, count=3000, cell=0.05, rate=100.0)
    corners = region.corners[:, None] + 0.05 * np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    farthest = np.hypot(*np.moveaxis(corners, -1, 0)).max(axis=1)
    reach = StraightFlight.model.reach
    assert farthest.max() <= reach
    assert farthest.max() > reach - 0.05


def test_a_radius_that_holds_all_within_reach_says_nothing():
    """The farthest point within reach lies on the far side of the shoulder."""
    disc_within_reach(Disc((1.3, 0.0), 2.79), 1.5)
    with pytest.raises(InputError, match=r"radius of the zone: got 2\.8; allowed: less than 2\.800 m"):
        disc_within_reach(Disc((1.3, 0.0), 2.8), 1.5)


def test_a_sector_has_the_volume_of_its_shell():
    whole = Sector(0.4, 1.0, -1.0, 1.0, math.pi)
    assert whole.size == pytest.approx(4 / 3 * math.pi * (1 - 0.4**3), rel=1e-6)
    assert Sector(0.4, 1.0, -1.0, 1.0, math.pi / 6).size == pytest.approx(whole.size / 6)
    slab = Sector(0.5, 1.0, -0.2, 0.3, math.pi)  # between heights that both spheres pass: rings of one area
    assert slab.size == pytest.approx(math.pi * (1 - 0.25) * 0.5)
    np.testing.assert_allclose(SECTOR.box[0][1], -0.9 * math.sin(0.6))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ((1.0, 0.5, 0, 0.2, 1), "farthest distance"),
        ((0.5, 1.0, -1.2, 0.2, 1), "lowest height"),
        ((0.5, 1.0, 0.3, 0.2, 1), "highest height"),
        ((0.5, 1.0, 0.0, 0.2, 4), "angle to either side"),
    ],
)
def test_a_sector_that_is_none_is_refused(numbers, said):
    with pytest.raises(InputError, match=said):
        Sector(*numbers)
