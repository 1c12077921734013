"""What cameras in space saw, in pixels: readings beside OpenCV's and MuJoCo's, derivatives, whips that come back."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from space_films import LEFT, ROBOT, STRIKES, WHIP, film_in_space, filmed_by_two

from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.joint_motion import ResolvedMotion
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.identification.results import root_mean_square
from whiptool.identification.summary import error_words
from whiptool.impedance import Controller, PositionControl
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout

TRUE = {"whip.k": 0.05, "whip.b": 0.004, "whip.l": 0.2}


@pytest.fixture(scope="module")
def seen():
    """Both strikes by MuJoCo's servos, filmed by two cameras whose clocks differ: a pair of recordings for each."""
    return [filmed_by_two(ROBOT, strike, seed) for seed, strike in enumerate(STRIKES)]


@pytest.fixture(scope="module")
def rolled():
    """A strike of the compiled model under its command."""
    return CompiledRollout(ROBOT, Controller(PositionControl()), timestep=5e-4).trajectory(STRIKES[0], t_stay=0.1)


def test_a_view_reads_what_opencv_projects_of_the_same_path(rolled):
    """With a lens, rows read one after the other and a late clock; to what a mean over the exposure leaves."""
    film = film_in_space(LEFT, rolled.t, rolled.tip[:, None], late=0.02, strike=STRIKES[0])
    plant = Plant(ROBOT, Controller(PositionControl()))
    predictor = Predictor([film], plant, drive="command", shared=["whip.k", "delay"], timestep=5e-4)
    (found,) = predictor(plant, {"delay": 0.02}, predictor.start, derivatives=False)
    off = found.value.reshape(-1, 2) - film.points[film.seen]
    assert np.abs(off).max() < 0.05
    assert np.sqrt(np.mean(off**2)) < 0.01
    (late,) = predictor(plant, {"delay": 0.0}, predictor.start, derivatives=False)
    assert np.abs(late.value.reshape(-1, 2) - film.points[film.seen]).max() > 3
    seconds, path = predictor.path(0, plant, {"delay": 0.02}, predictor.start[0])
    moment = int(np.argmin(np.abs(seconds - 0.02 - 0.3)))
    at = LEFT.project(CubicSpline(rolled.t, rolled.tip)(seconds[moment] - 0.02))
    np.testing.assert_allclose(path["tip"][moment], at, atol=0.01)


def test_derivatives_of_views_are_those_of_differences(seen):
    """By numbers of the whip, a clock, the pose of what was measured, and some directions of the hand's motion."""
    recordings, shared = seen[0], ["whip.k", "whip.b", "delay"]
    plant, given = Plant(ROBOT, Controller()), {"delay": 0.003}
    own = ("rotation_z", "shift_x", "scale")
    predictor = Predictor(recordings, plant, drive="joints", shared=shared, own=own)
    log = predictor.drives[0].motion.log
    predictor.set_motion(0, ResolvedMotion(log, np.eye(len(log.start))[:, [3, 40]]))
    start = [x.copy() for x in predictor.start]
    assert [len(x) for x in start] == [2 + 3, 3]  # of the other motion nothing is unknown
    found = predictor(plant, given, start, derivatives=True)

    def moved(name: str, by: float) -> list[np.ndarray]:
        changes = {name: plant.values()[name] * (1 + by)} if name in plant.values() else {}
        nuisance = given if changes else {"delay": given["delay"] + by}
        return [p.value for p in predictor(plant.changed(changes), nuisance, start, derivatives=False)]

    for j, name in enumerate(shared):
        unit = plant.values().get(name, 1.0)
        for i, (up, down) in enumerate(zip(moved(name, 1e-4), moved(name, -1e-4), strict=True)):
            slope = (up - down) / 2e-4 / unit
            np.testing.assert_allclose(found[i].by_shared[:, j], slope, atol=2e-4 * np.abs(slope).max())
    for entry, step in ((0, 1.0), (1, 1.0), (2, 1e-4), (3, 1e-4), (4, 1e-4)):
        values = []
        for by in (step, -step):
            x = [start[0].copy(), start[1]]
            x[0][entry] += by
            values.append(predictor(plant, given, x, derivatives=False)[0].value)
        slope = (values[0] - values[1]) / (2 * step)
        np.testing.assert_allclose(found[0].by_own[:, entry], slope, atol=2e-4 * np.abs(slope).max())


@pytest.mark.slow
def test_two_cameras_tell_a_whip_and_their_clocks(seen):
    """MuJoCo's whip on MuJoCo's robot, 0.3 pixels, nothing triangulated; the other strike is foreseen."""
    guess = Plant(dataclasses.replace(ROBOT, whip=dataclasses.replace(WHIP, k=0.07, b=0.006, l=0.19)), Controller())
    how = FitOptions(drive="joints", per_recording=("delay",))
    found = fit(seen[0], guess, ["k", "b", "l"], held_out=seen[1][:1], options=how)
    for name, true in TRUE.items():
        low, high = found[name].interval
        assert low <= true <= high, (name, found[name])
        assert high - low < 0.4 * true
    clocks = [r.own["delay"] for r in found.recordings]
    np.testing.assert_allclose(clocks, [0.004, -0.003], atol=2e-3)
    assert root_mean_square(found.recordings, "pixels") == pytest.approx(0.3, rel=0.15)
    assert root_mean_square(found.held_out, "pixels") < 0.4
    for film in found.held_out:  # two to three metres away, a pixel is some 5 to 7 mm
        assert 4e-3 < film.rmse / film.pixels < 9e-3
    assert "pixels" in error_words(found.held_out)


def test_depth_is_read_where_the_camera_has_it(rolled):
    """As the mean along the optical axis, also of a frame without depth; the delay shifts it like the pixels."""
    film = film_in_space(LEFT, rolled.t, rolled.tip[:, None], late=0.02, strike=STRIKES[0], deep=True)
    film = dataclasses.replace(film, depth=np.where(np.arange(len(film.t))[:, None] == 5, 0.0, film.depth))
    plant = Plant(ROBOT, Controller(PositionControl()))
    predictor = Predictor([film], plant, drive="command", shared=["delay"], timestep=5e-4)
    (found,) = predictor(plant, {"delay": 0.02}, predictor.start, derivatives=False)
    deep = predictor.channels[0][:, 2] == 2
    assert (deep.sum(), (~deep).sum()) == (film.seen.sum() - 1, 2 * film.seen.sum())
    assert 5 not in predictor.channels[0][deep, 0]
    assert np.abs(1 / found.value[deep] - film.depth[np.isfinite(film.depth)]).max() < 2e-4
    np.testing.assert_allclose(predictor.sigma[0][deep], 0.08 / (430.0 * 0.05))  # of its inverse: the same everywhere
    seconds, path = predictor.path(0, plant, {"delay": 0.02}, predictor.start[0])
    moment = int(np.argmin(np.abs(seconds - 0.32)))
    place = CubicSpline(rolled.t, rolled.tip)(seconds[moment] - 0.02)
    assert path["tip"][moment, 2] == pytest.approx(LEFT.rotation[2] @ (place - LEFT.position), abs=1e-4)


def test_derivatives_of_depth_are_those_of_differences(rolled):
    film = film_in_space(
        LEFT, rolled.t, rolled.tip[:, None], rng=np.random.default_rng(0), deep=True, strike=STRIKES[0]
    )
    plant, shared = Plant(ROBOT, Controller(PositionControl())), ["whip.k", *UNSEEN, "delay"]
    predictor = Predictor([film], plant, drive="command", shared=shared, timestep=5e-4)
    given = {"delay": 0.003, "scale": 1.02, "shift_x": 0.01, "shift_y": -0.02, "shift_z": 0.03}
    (found,) = predictor(plant, given, predictor.start, derivatives=True)
    deep = predictor.channels[0][:, 2] == 2
    for j, name in enumerate(shared):
        values = []
        for step in (1e-4, -1e-4):
            if name == "whip.k":
                moved = plant.changed({name: TRUE[name] * (1 + step)}), given
            else:
                moved = plant, given | {name: given[name] + step}
            values.append(predictor(*moved, predictor.start, derivatives=False)[0].value)
        slope = (values[0] - values[1]) / 2e-4 / (TRUE[name] if name == "whip.k" else 1.0)
        for part in (deep, ~deep):
            np.testing.assert_allclose(found.by_shared[part, j], slope[part], atol=2e-4 * np.abs(slope[part]).max())
    assert np.abs(1 / found.size[deep] - found.value[deep] ** 2).max() < 1e-12


UNSEEN = ("scale", "shift_x", "shift_y", "shift_z")


def test_one_camera_with_depth_tells_how_far_away_the_whip_is(rolled):
    """Without, a base that is farther away and a larger strike look the same; the intervals hold the truth."""
    plant = Plant(ROBOT, Controller(PositionControl()))
    guess, how = plant.changed({"whip.k": 0.06}), FitOptions(drive="command", timestep=5e-4)
    true = {"whip.k": 0.05, "scale": 1.0, "shift_x": 0.0, "shift_y": 0.0, "shift_z": 0.0}
    held = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        film = film_in_space(LEFT, rolled.t, rolled.tip[:, None], rng=rng, deep=True, strike=STRIKES[0])
        found = fit(film, guess, ["k", *UNSEEN], options=how)
        assert {p.kind for p in found.parameters} <= {"well determined", "traded"}
        intervals = {p.name: p.interval for p in found.parameters}
        assert intervals["shift_y"][1] - intervals["shift_y"][0] < 0.03  # the axis is mostly along y
        held += [low <= true[name] <= high for name, (low, high) in intervals.items()]
        (deep,) = found.recordings
        assert deep.depth == pytest.approx(np.sqrt(np.nanmean(film.depth_sigma**2)), rel=0.25)
        assert deep.pixels == pytest.approx(0.3, rel=0.2)
        assert deep.chi == pytest.approx(1.0, abs=0.15)
        assert f"depth {1e3 * deep.depth:.3g} mm" in error_words([deep])
    assert sum(held) >= 18  # of 20
    alone = fit(dataclasses.replace(film, depth=None, depth_sigma=None), guess, ["k", *UNSEEN], options=how)
    assert {alone[name].kind for name in UNSEEN[1:]} == {"flat"}
    assert alone.recordings[0].depth is None


def test_one_log_for_two_cameras_is_counted_once(seen):
    """Where the joints err most, a camera's twin beside it must not make the whip better known."""
    pair = seen[0][0], dataclasses.replace(seen[0][0])
    plant = Plant(ROBOT, Controller())
    one, two = (Predictor(list(x), plant, drive="joints", shared=["whip.k"]) for x in (pair[:1], pair))
    assert (one.sharing, two.sharing) == ([1], [2, 2])


def test_pixels_are_not_places(seen):
    film = dataclasses.replace(seen[0][0], strike=Strike((0.1, 0.2), (0.3, 0.4), 0.5))
    with pytest.raises(InputError, match="positions, for a model in the plane"):
        Predictor([film], Plant(preset("lemon2024"), Controller()), drive="command", shared=["whip.k"])
