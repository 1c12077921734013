"""Trajectories, and closest approaches against a search along every segment and curves with closed forms."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from rich_model import COMPUTED, CONTROLLERS, LEMON
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.optimize import minimize_scalar

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.models import Model, preset
from whiptool.models.presets import rope
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
from whiptool.models.strike import Strike, default_bounds
from whiptool.models.trajectory import Trajectory, closest_on_curve, closest_on_segments, target_points
from whiptool.rollout import CompiledRollout


def test_it_is_the_least_distance_of_the_segments():
    rng = np.random.default_rng(0)
    paths, place = rng.normal(size=(20, 4, 2)), rng.normal(size=2)
    found = closest_on_segments(paths, place)
    for path, distance, segment, share in zip(paths, *found):
        searched = [
            minimize_scalar(
                lambda s, a=a, b=b: np.linalg.norm(a + s * (b - a) - place), bounds=(0, 1), method="bounded",
                options={"xatol": 1e-10},
            )
            for a, b in itertools.pairwise(path)
        ]  # fmt: skip
        least = int(np.argmin([result.fun for result in searched]))
        assert distance == pytest.approx(searched[least].fun, rel=1e-6)
        assert segment == least
        assert share == pytest.approx(searched[least].x, abs=1e-5)


def test_each_path_has_its_own_place_and_a_line_its_cross_product():
    rng = np.random.default_rng(1)
    angles, places = rng.uniform(0, np.pi, 20), 0.2 * rng.standard_normal((20, 2))
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    paths = along[:, None] * np.linspace(-1, 1, 7)[:, None]
    found = closest_on_segments(paths, places)
    expected = np.abs(along[:, 0] * places[:, 1] - along[:, 1] * places[:, 0])
    np.testing.assert_allclose(found.distance, expected, atol=1e-12)
    at = -1 + (found.segment + found.share) / 3
    np.testing.assert_allclose(at, (along * places).sum(axis=1), atol=1e-12)


def test_the_closest_approach_is_between_points():
    paths = np.array([[[-1.0, 0.0], [1.0, 0.5], [3.0, 0.5]], [[2.0, 2.0], [2.0, 3.0], [2.0, 4.0]]])
    distance, when, share = closest_on_segments(paths, np.array([0.0, 1.0]))
    np.testing.assert_allclose(distance, [0.75 * 2 / np.hypot(2, 0.5), np.hypot(2, 1)])  # of a line and a point
    assert when.tolist() == [0, 0]
    # the foot of the perpendicular: (1, 1) . (2, 0.5) / |(2, 0.5)|^2 of the way; and an end
    np.testing.assert_allclose(share, [(1 * 2 + 1 * 0.5) / (4 + 0.25), 0.0])


def test_what_changes_along_a_path_is_read_at_its_closest_approach():
    t = np.array([0.0, 1.0, 2.0])
    path = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, 5.0]])
    found = closest_on_segments(path, np.array([0.5, 0.0]))
    assert found.between(t) == pytest.approx(0.75)
    np.testing.assert_allclose(found.between(path), [0.5, 1.0])


def test_points_that_do_not_move_or_are_not_known():
    still = closest_on_segments(np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros(2))
    assert (still.distance, still.segment, still.share) == (1.0, 0, 0.0)
    unknown = closest_on_segments(np.full((2, 3, 2), np.nan), np.zeros(2))
    assert unknown.distance.tolist() == [np.inf, np.inf]
    partly = np.array([[np.nan, np.nan], [3.0, 1.0], [-3.0, 1.0], [np.nan, np.nan]])
    assert closest_on_segments(partly, np.zeros(2))[:2] == (1.0, 1)
    assert closest_on_segments(np.zeros((1, 2)), np.zeros(2)).distance == np.inf


@pytest.mark.parametrize("kind", [CubicSpline, PchipInterpolator])
def test_a_curve_is_nearest_where_its_distance_has_no_slope(kind):
    t = np.linspace(0, 1, 9)
    curve = kind(t, np.stack([np.cos(3 * t), np.sin(5 * t)], axis=1))
    place = np.array([0.3, 0.2])
    when = closest_on_curve(curve, place, samples=200)
    fine = np.linspace(0, 1, 200_001)
    assert when == pytest.approx(fine[np.linalg.norm(curve(fine) - place, axis=1).argmin()], abs=1e-5)
    assert abs((curve(when) - place) @ curve(when, 1)) < 1e-12


def test_a_parabola_and_a_point_before_its_start():
    t = np.linspace(0, 2, 5)
    curve = CubicSpline(t, np.stack([t, t**2], axis=1))  # exactly the parabola
    # the foot of (0, 1 / 2 + s^2) on y = x^2 is (s, s^2)
    assert closest_on_curve(curve, np.array([0.0, 0.5 + 0.81]), samples=50) == pytest.approx(0.9, abs=1e-12)
    assert closest_on_curve(curve, np.array([-1.0, -1.0]), samples=50) == 0.0
    assert closest_on_curve(curve, np.array([3.0, 9.0]), samples=50) == 2.0


@pytest.mark.parametrize("place", [(1.1, 0.2), (1.1, 0.2, -0.3)])
def test_one_place_is_that_of_all(place: tuple[float, ...]):
    d = len(place)
    for target in (Target(place), place, list(place), np.array(place)):
        assert target_points(target, 3, d).tolist() == [list(place)] * 3


def test_each_has_its_own():
    places = np.random.default_rng(0).normal(size=(4, 3))
    np.testing.assert_array_equal(target_points(places, 4, 3), places)
    np.testing.assert_array_equal(target_points(places.tolist(), 4, 3), places)
    assert target_points(np.array([[1, 2]]), 1).dtype == float


def test_as_many_as_coordinates_are_one_each():
    """Two strikes in the plane: rows are strikes."""
    assert target_points(np.array([[1.0, 2.0], [3.0, 4.0]]), 2).tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("target", "count", "dimension", "message"),
    [
        (np.zeros((3, 2)), 2, 2, r"shape \(3, 2\).*in the plane, shape \(2,\), or one each, \(2, 2\)"),
        (np.zeros(3), 2, 2, r"shape \(3,\).*in the plane"),
        (Target((1.0, 2.0)), 5, 3, r"shape \(2,\).*in space, shape \(3,\), or one each, \(5, 3\)"),
        (np.array(1.0), 2, 2, r"shape \(\)"),
    ],
)
def test_other_shapes_are_refused(target, count: int, dimension: int, message: str):
    with pytest.raises(InputError, match=f"target: got .*{message}"):
        target_points(target, count, dimension)


TARGET = np.array([1.3, 0.0])
_BODY = {"mass": 1.0, "com": (0, 0, 0), "inertia": (0.1, 0.1, 0.1, 0, 0, 0), "axis": (0, 1, 0)}
_RAIL = SpatialLink(**_BODY, position=(0, 0, 0), kind="prismatic", limits=JointLimits((-1, 1)))
_LINKS = _RAIL, SpatialLink(**_BODY, position=(0, 0, -0.3))
SLIDING = Model(rope(3), SpatialArm(_LINKS, joints=("rail", "wrist"), hand_position=(0, 0, -0.2)))
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)


@pytest.mark.parametrize(
    "controller",
    [pytest.param(x, marks=[pytest.mark.slow] * (name in ("all options", "held"))) for name, x in CONTROLLERS.items()],
    ids=CONTROLLERS,
)
def test_trajectory_and_outcome_tell_the_same(controller):
    rollout = CompiledRollout(LEMON, controller, timestep=2.5e-4)
    near = rollout.approach(STRIKES[:5], TARGET, t_stay=0.3)
    for i, (vector, path) in enumerate(zip(STRIKES, rollout.trajectories(STRIKES[:5], t_stay=0.3), strict=False)):
        single = rollout.trajectory(Strike.from_vector(vector), t_stay=0.3)
        np.testing.assert_array_equal(path.q, single.q)
        again = path.approach(TARGET)
        assert path.t[-1] == pytest.approx(vector[-1] + 0.3)
        for name in COMPUTED:
            np.testing.assert_allclose(getattr(again, name)[0], getattr(near, name)[i], atol=1e-9)
        np.testing.assert_allclose(np.gradient(path.tip, path.t, axis=0)[1:-1], path.tip_velocity[1:-1], atol=0.5)


def test_trajectories_are_saved_without_pickle(tmp_path):
    path = CompiledRollout(LEMON, CONTROLLERS["oiac"]).trajectory(Strike.from_vector(STRIKES[0]), t_stay=0.1)
    path.save(tmp_path / "strike.npz")
    again = Trajectory.load(tmp_path / "strike.npz")
    for field in dataclasses.fields(path):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(path, field.name))


@pytest.mark.parametrize(
    ("model", "some"),
    [
        (
            LEMON,
            ["q.shoulder [rad]", "v.whip[11] [rad/s]", "tau.elbow [N m]", "K.shoulder.elbow [N m/rad]"],
        ),
        (preset("nah2023"), ["q.whip[24][1] [rad]", "B.elbow.elbow [N m s/rad]", "tip_velocity.z [m/s]"]),
        (preset("ur5e"), ["q.wrist_3 [rad]", "q.whip[0].x [1]", "v.whip[19].z [1/s]", "q_d.shoulder_pan [rad]"]),
        (SLIDING, ["q.rail [m]", "v_d.rail [m/s]", "tau.rail [N]", "K.rail.rail [N/m]", "B.rail.wrist [N s/rad]"]),
    ],
)
def test_columns_have_the_joints_names_and_their_units(model, some):
    T, n, a, d = 2, model.coordinates, model.arm.n, model.dimension
    chain, arm, gains, tip = np.ones((T, n)), np.ones((T, a)), np.ones((T, a, a)), np.ones((T, d))
    path = Trajectory(np.arange(2.0), chain, chain, arm, arm, arm, gains, gains, tip, tip, names=model.coordinate_names)
    header = path.to_csv().splitlines()[0].split(",")
    assert header[0] == "t [s]"
    assert len(set(header)) == len(header) == 1 + 2 * n + 3 * a + 2 * a * a + 2 * d
    assert set(some) <= set(header)
    assert list(path.columns()) == [name.split(" [")[0] for name in header]
    assert "q[0]" in dataclasses.replace(path, names=()).columns()
