"""What readings resolve of a measured motion, against fits that vary all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from films import film

from whiptool.identification import resolution
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.joint_motion import ResolvedMotion
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import default_bounds

LEMON = preset("lemon2024")
STRIKE = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 8)[0]
AWAY = Plant(LEMON.with_parameters({"whip.k": 0.3, "whip.b": 0.07}), Controller())
FREE = ["k", "b"]


def seen(joint_noise: float):
    return film(LEMON, STRIKE, np.random.default_rng(5), joint_noise=joint_noise, rate=200.0, sigma=1e-3)


@pytest.fixture(scope="module")
def noisy():
    return seen(3e-3)


def test_a_fit_of_what_readings_resolve_is_the_fit_of_all(noisy, monkeypatch):
    """A log whose noise the tip magnifies: a few directions in place of all coefficients, the same numbers."""
    some = fit([noisy], AWAY, FREE, options=FitOptions(drive="joints"))
    monkeypatch.setattr(resolution, "RESOLVED", 1e-9)
    every = fit([noisy], AWAY, FREE, options=FitOptions(drive="joints"))
    counts = [sum(name.startswith("motion") for name in x.recordings[0].own) for x in (some, every)]
    assert 3 < counts[0] < 0.6 * counts[1]
    for one, other in zip(some.parameters, every.parameters, strict=True):
        assert one.value == pytest.approx(other.value, abs=0.05 * other.error)
        assert one.error == pytest.approx(other.error, rel=0.02)


def test_what_is_left_out_moves_no_reading(noisy):
    """The singular values of all directions, by the predictor's own derivatives: those above the limit are kept."""
    predictor = Predictor([noisy], AWAY, drive="joints", shared=["whip.k"])
    log = predictor.drives[0].motion.log
    assert len(predictor.start[0]) == 0
    (own,) = resolution.resolve(predictor, AWAY, {}, predictor.start)
    kept = predictor.drives[0].motion.directions
    assert own.shape == predictor.start[0].shape == (kept.shape[1],)
    np.testing.assert_allclose(kept.T @ kept, np.eye(len(own)), atol=1e-12)
    predictor.set_motion(0, ResolvedMotion(log, np.eye(len(log.start))))
    (all_of_them,) = predictor(AWAY, {}, predictor.start, derivatives=True)
    effects = all_of_them.by_own / predictor.sigma[0][:, None]
    assert np.linalg.norm(effects - effects @ kept @ kept.T, 2) <= resolution.RESOLVED * (1 + 1e-9)
    assert np.linalg.svd(effects @ kept, compute_uv=False).min() > resolution.RESOLVED


def test_an_exact_log_leaves_nothing_unknown():
    exact = seen(0.0)
    smooth = np.outer((1 - np.cos(5 * exact.joints_t)) ** 2, [0.3, -0.2])
    predictor = Predictor([replace(exact, joints_q=smooth)], AWAY, drive="joints", shared=["whip.k"])
    assert resolution.resolve(predictor, AWAY, {}, predictor.start) is None
    assert len(predictor.start[0]) == 0


def test_the_log_of_a_standing_arm_leaves_next_to_nothing_unknown_however_slow_it_is():
    """Zeros ten times a second left a base free to shake between them: as many directions as samples were fitted."""
    still, counts = seen(0.0), []
    for rate in (10.0, 100.0):
        t = np.arange(-0.2, still.t[-1] + 0.3, 1 / rate)
        log = replace(still, joints_t=t, joints_q=np.zeros((len(t), 2)))
        predictor = Predictor([log], AWAY, drive="joints", shared=["whip.k"])
        resolution.resolve(predictor, AWAY, {}, predictor.start)
        counts.append(len(predictor.start[0]))
    assert counts[0] <= 2
    assert counts[1] == 0


def test_a_solution_where_readings_resolve_more_goes_on_from_there(noisy):
    """Directions found in the wrong place are replaced, and the path stays as near as the new ones allow."""
    predictor = Predictor([noisy], AWAY, drive="joints", shared=["whip.k"])
    resolution.resolve(predictor, AWAY, {}, predictor.start)
    motion = predictor.drives[0].motion
    wrong = ResolvedMotion(motion.log, motion.directions[:, -2:])
    predictor.set_motion(0, wrong)
    (own,) = resolution.resolve(predictor, AWAY, {}, [np.array([1.0, -2.0])])
    np.testing.assert_allclose(
        predictor.drives[0].motion.whole(own), wrong.whole(np.array([1.0, -2.0])), atol=0.1
    )  # derivatives are those of another path
    assert resolution.resolve(predictor, AWAY, {}, [own]) is None


def test_two_cameras_of_one_log_resolve_as_much_as_their_wider_priors_let_them(noisy):
    predictor = Predictor([noisy, noisy], AWAY, drive="joints", shared=["whip.k"])
    alone = Predictor([noisy], AWAY, drive="joints", shared=["whip.k"])
    for x in (predictor, alone):
        resolution.resolve(x, AWAY, {}, x.start)
    assert len(predictor.start[0]) == len(predictor.start[1]) >= len(alone.start[0])
