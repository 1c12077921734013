"""Passive swings: a whip that is held still, clamped or behind a free hinge, and released by hand."""

from __future__ import annotations

import dataclasses
import json
import tomllib

import numpy as np
import pytest
from swings import Whip

from whiptool.commands import identify
from whiptool.dynamics.structure import lumping
from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, predict
from whiptool.identification.plant import Plant, slopes
from whiptool.identification.predict import Predictor
from whiptool.models import preset, write_model
from whiptool.models.kinematics import joint_points
from whiptool.models.profile import WhipProfile
from whiptool.models.trajectory import Trajectory
from whiptool.recording.camera import camera_preset, pinhole
from whiptool.recording.readers.tracks import write_csv
from whiptool.recording.strike_recording import StrikeRecording

WHIP = Plant(preset("lemon2024")).with_nodes(4).model  # as long and heavy as lemon's, of four links
TRUE = {"whip.k": WHIP.whip.k, "whip.b": WHIP.whip.b}
PULLS = ((2.0, 0.5), (-1.5, 0.9), (1.2, 0.6))  # [N] at the tip, before it is released
SIGMA, RATE, LASTS = 5e-4, 60.0, 1.6  # [m], [1/s], [s]
HELD = {"free hinge": None, "clamp": 0.1}  # where the clamp points [rad]


def swing(held: str, pull: tuple[float, float], t: np.ndarray) -> tuple[Whip, np.ndarray]:
    """The whip and its absolute angles (T, 4) after the release."""
    clamp = HELD[held]
    whip = Whip(WHIP, clamped=clamp is not None, direction=clamp or 0.0)
    return whip, whip.released(whip.held_aside(pull), t)


@pytest.fixture(scope="module", params=list(HELD))
def tracks(request):
    """How it is held, and three swings from a tip that is tracked with errors; the third begins in full swing."""
    t, recordings = np.arange(0, LASTS + 0.3, 1 / RATE), []
    for i, pull in enumerate(PULLS):
        whip, theta = swing(request.param, pull, t)
        late = slice(12 if i == 2 else 0, None)
        points = whip.tip(theta)[late, None]
        points = points + SIGMA * np.random.default_rng(i).standard_normal(points.shape)
        recordings.append(StrikeRecording(t[late], points, ("tip",), sigma=np.array(SIGMA), source=f"swing{i}"))
    return request.param, recordings


def film_of(t: np.ndarray, q: np.ndarray) -> Trajectory:
    """A path of joints that nothing drives, as the virtual camera takes it."""
    arm, none = np.zeros((len(t), WHIP.arm.n)), np.zeros((len(t), WHIP.arm.n, WHIP.arm.n))
    tip = joint_points(WHIP, q)[:, -1]
    return Trajectory(t, q, np.gradient(q, t, axis=0), arm, arm, arm, none, none, tip, np.gradient(tip, t, axis=0))


def off_model(folder):
    whip = dataclasses.replace(WHIP.whip, k=1.3 * TRUE["whip.k"], b=0.7 * TRUE["whip.b"])
    path = folder / "start.toml"
    write_model(dataclasses.replace(WHIP, whip=whip), path)
    return path


def identified(capsys, folder, names, held: str, *more: str) -> dict:
    """What the command line finds of stiffness and damping, the last swing held out."""
    clamp = [] if HELD[held] is None else ["--clamp", 0.0]
    free = ["k", "b", *([] if HELD[held] is None else ["clamp"]), *more]
    words = [*names, "--drive", "passive", "--free", *free, *clamp, "--model", off_model(folder), "--starts", 1]
    status = identify.main([*map(str, words), "--json", "--out", str(folder / "run")])
    said = capsys.readouterr()
    assert status == 0, said.err
    return json.loads(said.out)


def assert_found(result: dict, held: str) -> None:
    found = {p["name"]: p for p in result["parameters"]}
    print({name: (p["value"], p["interval"]) for name, p in found.items()}, result["rmse"], result["held_out_rmse"])
    for name, true in TRUE.items():
        low, high = found[name]["interval"]
        assert low - 0.5 * (high - low) < true < high + 0.5 * (high - low), found[name]
        assert found[name]["value"] == pytest.approx(true, rel=0.1)
    if HELD[held] is not None:
        assert found["clamp"]["value"] == pytest.approx(HELD[held], abs=5e-3)
    (unseen,) = (r for r in result["recordings"] if r["held_out"])
    assert unseen["rms_over_stated_error"] < 1.3
    middle = (unseen["span"][0] + unseen["span"][1]) / 2
    assert unseen["predicted_from"] == pytest.approx(middle, abs=0.05)


@pytest.mark.slow
@pytest.mark.figures
def test_stiffness_and_damping_from_the_command_line(tracks, capsys, tmp_path):
    held, recordings = tracks
    names = [tmp_path / f"swing{i}.csv" for i in range(3)]
    for recording, name in zip(recordings, names, strict=True):
        write_csv(recording, name)
    result = identified(capsys, tmp_path, names, held)
    assert_found(result, held)
    assert result["misfit"] == pytest.approx(1, abs=0.15)
    assert result["converged"]
    page = (tmp_path / "run" / "report.html").read_text()
    assert "have their own unknowns" in page
    assert ("in a clamp" if HELD[held] is not None else "behind a free hinge") in page


@pytest.mark.slow
def test_the_known_whip_and_state_give_the_swing_back(tracks):
    """Against Lagrange's equations: with the true numbers, only the readings' errors are left."""
    held, recordings = tracks
    found = predict(recordings, Plant(WHIP, clamp=HELD[held]), {}, FitOptions(drive="passive"))
    assert np.mean([x.chi for x in found]) == pytest.approx(1, abs=0.2)


def test_derivatives_of_a_clamped_whips_readings(tracks):
    held, recordings = tracks
    plant = Plant(WHIP, clamp=HELD[held])
    names = ["whip.k", "whip.l", "gravity", *(["clamp"] if HELD[held] is not None else [])]
    read = Predictor(recordings[:1], plant, drive="passive", shared=names, own=("start", "shift_x"))
    own, values = [read.start[0] + 0.01], plant.values()
    exact = read(plant, {}, own, derivatives=True)[0]
    for i, name in enumerate(names):
        h = 1e-5 * max(abs(values[name]), 0.1)
        moved = [
            read(plant.changed({name: values[name] + s * h}), {}, own, derivatives=False)[0].value for s in (1, -1)
        ]
        by = exact.by_shared[:, i]
        np.testing.assert_allclose((moved[0] - moved[1]) / (2 * h), by, atol=1e-4 * np.abs(by).max())
    for j in range(len(own[0])):
        step = 1e-5 * np.eye(len(own[0]))[j]
        moved = [read(plant, {}, [own[0] + s * step], derivatives=False)[0].value for s in (1, -1)]
        by = exact.by_own[:, j]
        np.testing.assert_allclose((moved[0] - moved[1]) / 2e-5, by, atol=1e-4 * np.abs(by).max())


def test_a_clamped_profile_bends_at_the_clamp_by_half_a_link():
    """A uniform beam: the first joint is twice as stiff; a tapered one: its compliance is the integral over its hat."""
    uniform = WhipProfile(length=0.9, linear_density=0.2, bending_stiffness=0.02, bending_damping=0.005)
    held = Plant(WHIP, None, uniform, clamp=0.0).held.whip
    np.testing.assert_allclose(held.per_node("k")[0], 2 * held.per_node("k")[1], rtol=1e-9)
    np.testing.assert_allclose(held.per_node("b")[0], 2 * held.per_node("b")[1], rtol=1e-9)
    tapered = dataclasses.replace(uniform, stiffness_taper=0.1, rest_curvature=0.3)
    plant = Plant(WHIP, None, tapered, clamp=0.0)
    l, s = 0.9 / 4, np.linspace(0, 1, 20001)
    compliance = np.trapezoid((1 - s) / (0.02 * 0.1 ** (s / 4)), s * l)
    np.testing.assert_allclose(plant.held.whip.per_node("k")[0], 1 / compliance, rtol=1e-6)
    np.testing.assert_allclose(plant.held.whip.per_node("rest_angle")[0], 0.3 * l / 2, rtol=1e-9)
    np.testing.assert_allclose(plant.held.whip.per_node("k")[1:], plant.model.whip.per_node("k")[1:])
    free = lumping(4)[0](np.array([*tapered.numbers.values()]))
    assert float(free[2][0]) == 0
    by_stiffness = slopes(plant, ["profile.bending_stiffness"])[0]["whip.k"]
    np.testing.assert_allclose(by_stiffness, plant.held.whip.per_node("k") / 0.02, rtol=1e-9)


def test_what_a_passive_swing_cannot_have_is_refused(tracks, tmp_path, capsys):
    _, recordings = tracks
    for own in (("delay",), ("start", "delay")):
        with pytest.raises(InputError, match="names other than delay"):
            Predictor(recordings, Plant(WHIP), drive="passive", shared=["whip.k"], own=own)
    sprung = dataclasses.replace(WHIP, whip=dataclasses.replace(WHIP.whip, k=(0.2,) * 4))
    with pytest.raises(InputError, match="clamp"):
        Predictor(recordings, Plant(sprung), drive="passive", shared=["whip.l"])
    write_csv(recordings[0], tmp_path / "swing.csv")
    words = [str(tmp_path / "swing.csv"), "--clamp", "0", "--out", str(tmp_path / "run")]
    assert identify.main(words) == 2
    assert "--drive passive" in capsys.readouterr().err


@pytest.mark.hours
def test_a_filmed_swing_from_the_command_line_alone(capsys, tmp_path):
    """Films of the virtual camera, their calibration counted from the hand."""
    pytest.importorskip("cv2", reason="needs the extra `vision`")
    render = pytest.importorskip("whiptool.vision.render")
    from whiptool.vision.film_files import write_video
    from whiptool.vision.source import frames_of

    held = "clamp"
    camera = camera_preset("d435-infrared").replace(width=424, camera_matrix=pinhole(426, 426, 211.5, 239.5), fps=60)
    hand = np.array([0.0, -WHIP.arm.length])
    t, names = np.arange(0, LASTS, 2e-3), []
    for i, pull in enumerate(PULLS):
        _, theta = swing(held, pull, t)
        q = np.hstack([np.zeros((len(t), WHIP.arm.n)), np.diff(theta, axis=1, prepend=0.0)])
        trajectory = film_of(t, q)
        film = render.VirtualCamera(camera, WHIP, trajectory, np.random.default_rng(i))
        try:
            film.open()
        except Exception as error:  # a machine without OpenGL
            pytest.skip(f"no OpenGL: {error}")
        from_hand = np.array([[1, 0, -hand[0]], [0, 1, -hand[1]], [0, 0, 1.0]]) @ camera.homography
        names.append(tmp_path / f"swing{i}.mkv")
        write_video(names[-1], frames_of(film), synthetic=True, homography=from_hand)
        assert "strike" not in tomllib.loads(names[-1].with_suffix(".toml").read_text())
    # the whip's dark end draws the marker's centroid aside: a camera that is off by as much takes most of it up
    result = identified(capsys, tmp_path, names, held, "shift_x", "shift_y")
    assert result["synthetic"]
    assert_found(result, held)
