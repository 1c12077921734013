"""What a fit leaves of a belief: covariances against Bayes' rule, the model's error, frames that are used."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from papers.aim.published import CONTROLLER as PRESCRIBED
from papers.aim.published import MODEL as ROBOT
from whiptool.adaptation import posterior
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.model_error import ModelError
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.posterior import AFTER, ELSEWHERE, UNMODELLED, driven_by, tip_mislabelled, update, usable
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.adaptation.twins import draw_twin
from whiptool.identification.problem import FitOptions
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike
from whiptool.recording.strike_recording import StrikeRecording

NOISE, COARSE = 0.005, 0.05  # [m]
STRIKE, REST = Strike((-1.0, 0.5), (2.0, 0.8), 0.8), Strike((-0.9, 1.4), (-0.9, 1.4), 0.5)


@pytest.fixture(scope="module")
def prior() -> Belief:
    belief = default_prior(preset("lemon2024"), Controller(oiac_preset("table4")), whip="uniform")
    return dataclasses.replace(belief, model_error=ModelError(0.01, 1.5))


def recorded(strike: Strike = STRIKE, *, frames: int = 61, target=None, sigma: float = NOISE) -> StrikeRecording:
    """A tip that flies along x = t, y = 0."""
    t = np.arange(frames) / 60
    points = np.stack([t, 0 * t], axis=1)[:, None]
    return StrikeRecording(t, points, ("tip",), sigma=np.array(sigma), strike=strike, target=target, source="one")


def fitted(prior: Belief, J: np.ndarray, residuals: np.ndarray, *, variance: float = 1.0, whiteness: float = 0.0):
    """The end of a fit with derivatives J (K, m) of readings whitened by their stated errors, at the prior's mean."""
    W = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    units = np.linspace(1, 3, len(prior.z))
    _, values, directions = np.linalg.svd(np.vstack([J / np.sqrt(variance), W]) * units, full_matrices=False)
    U = SimpleNamespace(
        z=prior.z, directions=directions, singular_values=values, units=units,
        residual_variance=variance, whiteness=whiteness,
    )  # fmt: skip
    sigma = np.full(len(residuals), np.hypot(NOISE, UNMODELLED))
    return SimpleNamespace(uncertainty=U, recordings=[SimpleNamespace(residuals=residuals, sigma=sigma)])


@pytest.mark.parametrize(("variance", "whiteness"), [(1.0, 0.0), (4.0, 0.0), (4.0, 0.5), (0.5, 0.5), (1.0, -0.4)])
def test_covariance_is_that_of_bayes_rule_with_fewer_readings(prior, variance, whiteness):
    """Readings count as many as are independent, with the variance that they show, never a smaller one than stated."""
    J = 3 * np.random.default_rng(0).standard_normal((40, len(prior.z)))
    found = fitted(prior, J, np.zeros(40), variance=variance, whiteness=whiteness)
    belief = posterior._belief(prior, found, [recorded()], posterior._redundancy(found))
    correlation = max(whiteness, 0)
    worth = (1 - correlation) / (1 + correlation) / max(variance, 1)
    expected = np.linalg.inv(worth * J.T @ J + np.linalg.inv(prior.covariance))
    np.testing.assert_allclose(belief.covariance, expected, rtol=1e-6, atol=1e-12)


def test_model_error_grows_with_what_cameras_do_not_explain(prior):
    """By hand: the prior's sum of squares and that of the residuals without the camera's noise, over both counts."""
    for size in (0.0, 0.02):
        residuals = np.hypot(NOISE, size) * np.resize([1.0, -1.0], 50)
        found = fitted(prior, np.zeros((50, len(prior.z))), residuals)
        error = posterior._learned_error(prior.model_error, found, [recorded()], 2.0)
        squares = 1.5 * 0.01**2 + 25 * (ELSEWHERE * size) ** 2
        assert error.scale == pytest.approx(np.sqrt(squares / 26.5))
        assert error.freedom == 2.5


def test_residuals_below_the_noise_are_no_negative_error(prior):
    found = fitted(prior, np.zeros((50, len(prior.z))), np.zeros(50))
    error = posterior._learned_error(prior.model_error, found, [recorded()], 1.0)
    assert error.scale == pytest.approx(np.sqrt(1.5 * 0.01**2 / 51.5))


def test_a_whip_at_rest_leaves_the_model_error(prior):
    found = fitted(prior, np.zeros((4, len(prior.z))), np.ones(4))
    assert posterior._learned_error(prior.model_error, found, [recorded(REST)], 1.0) == prior.model_error


def test_frames_are_kept_until_shortly_after_the_planned_contact():
    """The tip passes (0.5, 0) at 0.5 s."""
    recording = recorded(target=(0.5, 0.0))
    for contact, end in ((None, 0.5), (0.3, 0.5), (0.7, 0.7)):
        cut, reason = usable(recording, contact)
        assert cut is not None
        assert not reason
        last = cut.t[np.flatnonzero(cut.seen[:, 0])[-1]]
        assert last == pytest.approx(end + AFTER, abs=1 / 60)
        assert last <= end + AFTER + 1e-9
        np.testing.assert_allclose(cut.sigma, np.hypot(NOISE, UNMODELLED))


def test_a_tip_that_is_lost_in_half_of_the_frames_is_not_used():
    recording = recorded(frames=60)
    for share, used in ((0.45, True), (0.55, False)):
        points = np.array(recording.points)
        points[: round(share * 60)] = np.nan
        cut, reason = usable(dataclasses.replace(recording, points=points))
        assert (cut is not None) is used
        assert ("lost" in reason) is not used


def test_frames_at_rest_are_their_median_with_the_error_of_one():
    rng = np.random.default_rng(2)
    t = np.arange(31) / 60
    points = 0.4 + COARSE * rng.standard_normal((31, 1, 2))
    recording = StrikeRecording(t, points, ("tip",), sigma=np.array(COARSE), strike=REST, source="rest")
    cut, _ = usable(recording)
    assert cut is not None
    assert cut.seen.sum() == 1
    (frame,) = np.flatnonzero(cut.seen[:, 0])
    np.testing.assert_allclose(cut.points[frame, 0], np.median(points[:, 0], axis=0))
    spread = np.std([np.median(COARSE * rng.standard_normal(31)) for _ in range(4000)])
    assert cut.sigma[frame, 0] == pytest.approx(np.hypot(spread, UNMODELLED), rel=0.05)


def test_the_first_frames_are_a_share_of_those_seen_and_never_too_few():
    points = np.array(recorded().points)
    points[:20] = np.nan  # 41 of 61 frames are left
    half = posterior._until(dataclasses.replace(recorded(), points=points), 0.5)
    assert np.flatnonzero(half.seen[:, 0]).tolist() == list(range(20, 41))
    few = posterior._until(dataclasses.replace(recorded(), points=points), 0.05)
    assert np.flatnonzero(few.seen[:, 0]).tolist() == list(range(20, 26))


def test_which_recording_does_not_go_with_the_others(prior):
    """The worst one, from 6 cm; from 3 cm where it is three times the others' median."""
    plausible = SimpleNamespace(z=prior.z)
    for rmse, worst in (
        ([0.01, 0.05], 1), ([0.02, 0.05], None), ([0.009, 0.029], None), ([0.059], None), ([0.061], 0),
        ([0.05, 0.065], 1),
    ):  # fmt: skip
        found = SimpleNamespace(uncertainty=plausible, recordings=[SimpleNamespace(rmse=x) for x in rmse])
        moving = [recorded()] * len(rmse)
        assert posterior._inconsistent(prior, found, moving) == worst


def test_joints_drive_a_robot_in_space_that_logged_them_in_every_recording(prior):
    robot = default_prior(ROBOT, PRESCRIBED, stock=stock_of_material("cotton")).plant
    logged, silent = (SimpleNamespace(joints_q=q) for q in (np.zeros((3, 6)), None))
    assert driven_by(robot, [logged, logged]) == "joints"
    assert driven_by(robot, [logged, silent]) == "command"
    assert driven_by(prior.plant, [logged]) == "command"  # a torque-controlled arm in the plane


@pytest.mark.parametrize(
    ("moved", "said"),
    [
        ({}, "alone it would fit: a whip other than"),
        ({"shift_x": 0.004, "rotation": 0.004}, "alone it would fit: a whip other than"),
        ({"rotation": 0.1}, "turned by +5.7 deg and moved by (+0.000, +0.000) m"),
        ({"shift_y": -0.2}, "turned by +0.0 deg and moved by (+0.000, -0.200) m"),
        ({"rotation": 1.0}, "is the marker that was tracked the tip?"),
    ],
)
def test_a_recording_that_is_refused_says_what_would_explain_it(prior, monkeypatch, moved, said):
    """A whip other than the others' where the camera's pose stayed; else the pose, up to an eighth of a turn."""
    own = {"rotation": 0.0, "shift_x": 0.0, "shift_y": 0.0} | moved
    posed = SimpleNamespace(recordings=[SimpleNamespace(own=own, rmse=0.01)], uncertainty=SimpleNamespace(z=prior.z))
    monkeypatch.setattr(posterior, "_fit", lambda *given: posed)
    assert said in posterior._why(prior, recorded(), 0.1, FitOptions())


def test_no_whip_four_standard_errors_from_the_prior_is_plausible(prior):
    """Root mean square over all numbers."""
    root = np.linalg.cholesky(prior.covariance)
    for size, allowed in ((3.9, True), (4.1, False)):
        z = prior.z + size * root @ np.ones(len(prior.z))
        found = SimpleNamespace(uncertainty=SimpleNamespace(z=z))
        assert posterior._plausible(prior, found) is allowed


def test_two_starts_that_agree_end_the_search_unless_both_are_far_off():
    def end(cost: float, rmse: float = 0.005):
        solution = SimpleNamespace(cost=cost)
        return SimpleNamespace(runs=[SimpleNamespace(solution=solution)], recordings=[SimpleNamespace(rmse=rmse)])

    assert posterior._again([end(10.0), end(10.4)])
    assert not posterior._again([end(10.0), end(10.6)])
    assert not posterior._again([end(10.6), end(10.0)])
    assert not posterior._again([end(10.0, 0.021), end(10.0, 0.021)])
    assert not posterior._again([end(10.0)])
    assert not posterior._again([end(10.0), None])
    assert posterior._again([None, end(50.0), end(10.0), end(10.1)])


def captured(
    *, exchanged: tuple[int, ...] = (), markers: tuple[str, ...] = ("tip", "middle", "hand")
) -> StrikeRecording:
    """Motion capture of markers that swing on circles, their labels exchanged from a frame on."""
    t = np.arange(80) / 100
    radii = np.array([1.2, 0.7, 0.2])[: len(markers)]
    angle = np.stack([2 * np.sin(3 * t + 0.3 * r) for r in radii], axis=1)
    points = np.stack([radii * np.cos(angle), 0 * angle, radii * np.sin(angle)], axis=2)
    points += 0.002 * np.random.default_rng(0).standard_normal(points.shape)
    if exchanged:
        points[40:, exchanged] = points[40:, exchanged[::-1]]
    strike = Strike((0.0,) * 6, (0.1,) * 6, 0.5)
    return StrikeRecording(t, points, markers, sigma=np.array(0.002), strike=strike, source="captured")


def test_motion_capture_whose_tip_changed_its_label_is_not_used():
    """Exchanges of others do no harm: the tip alone is used. Films are not asked, nor is a marker that is alone."""
    assert usable(captured())[0] is not None
    cut, reason = usable(captured(exchanged=(0, 1)))
    assert cut is None
    assert reason.startswith("the label of the tip left its marker: ")
    assert "at 0.400 s" in reason
    assert not tip_mislabelled(captured(exchanged=(1, 2)))
    assert not tip_mislabelled(captured(markers=("tip",)))
    assert not tip_mislabelled(recorded())


def test_a_strike_of_other_gains_than_are_believed_in_is_learned_from():
    """A strange twin's controller deviates like its whip does, and its rig's recordings say so."""
    model, controller = preset("lemon2024"), Controller()
    twin = draw_twin("strange", 3, model, controller)
    seen = TipPort(twin, (1.2, 0.1)).strike(Strike((-1.36, 0.47), (1.73, 1.41), 0.95), 1, None).recording
    assert seen is not None
    told = dataclasses.replace(seen, controller=twin.controller)
    found = update(default_prior(model, controller, whip="uniform"), [told], starts=1)
    assert found.refused == {}
    assert found.rmse[told.source] < 0.03
