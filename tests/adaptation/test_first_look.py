"""What a first look tells: the information against a determinant of differences of another engine's paths."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq

from whiptool.adaptation import first_look
from whiptool.adaptation.first_look import choose_wiggle, expected_sag, hanging, information
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.plan_search import PlanningEffort
from whiptool.adaptation.planner import plan
from whiptool.adaptation.posterior import update
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.identification.plant import Plant
from whiptool.impedance import OIAC, ConstantImpedance, Controller, PositionControl, oiac_preset
from whiptool.limits.clearance import Clearance
from whiptool.models import preset
from whiptool.models.strike import Strike, StrikeBounds
from whiptool.recording.strike_recording import AT_REST, StrikeRecording
from whiptool.rollout import CompiledRollout

MODEL, CONTROLLER = preset("lemon2024"), Controller(OIAC())
NAMES = ("whip.k", "whip.m", "whip.l", "delay")
ROOT = np.array([[0.2, 0, 0, 0], [0.05, 0.1, 0, 0], [0, 0.02, 0.15, 0], [0, 0, 0.1, 0.5]])
PLANT = Plant(MODEL, CONTROLLER)
STRIKES = np.array([[-0.3, 0.2, 0.2, 0.5, 0.6], [-0.5, 0.3, 0.3, 0.2, 0.8]])


def belief(delay: float = 0.0) -> Belief:
    at = PLANT.values()
    z = np.log([at["whip.k"], at["whip.m"], at["whip.l"], 1.0])
    z[3] = delay / 0.01  # the delay counts in hundredths of a second
    return Belief(PLANT, NAMES, z, ROOT @ ROOT.T)


def tips(b: Belief, z: np.ndarray, strike: np.ndarray) -> np.ndarray:
    """Positions of the tip at the camera's frames, flat; before a strike begins it hangs."""
    rollout = CompiledRollout(b.at(z).model, CONTROLLER, timestep=2.5e-4)
    t, path, _ = rollout.tip_path(strike[None], t_stay=0.3, rate=2000.0)
    frames = np.arange(int((strike[-1] + 0.3) * 60) + 1) / 60 - 0.01 * z[3]
    path = path[0][np.isfinite(path[0, :, 0])]
    return np.stack([np.interp(frames, t[: len(path)], x) for x in path.T], axis=1)


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_information_is_half_the_logarithm_of_the_determinant(delay):
    b = belief(delay)
    told, fastest, widest = information(b, STRIKES)
    for strike, nats, speed, width in zip(STRIKES, told, fastest, widest, strict=True):
        h = np.array([1e-3, 1e-3, 1e-3, 0.05])
        columns = [(tips(b, b.z + s, strike) - tips(b, b.z - s, strike)).ravel() for s in np.diag(h)]
        J = np.array(columns).T / (2 * h) / 0.005
        posterior = np.linalg.inv(np.linalg.inv(b.covariance) + J.T @ J)
        expected = 0.5 * np.log(np.linalg.det(b.covariance) / np.linalg.det(posterior))
        assert nats == pytest.approx(expected, rel=0.01)
        path, spread = tips(b, b.z, strike), 0.005 * J
        variance = np.diag(spread @ b.covariance @ spread.T).reshape(-1, 2).sum(axis=1)
        assert width == pytest.approx(np.sqrt(variance.max()), rel=0.02)
        assert speed == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).max() * 60, rel=0.01)


def test_what_is_known_already_tells_nothing():
    b = belief()
    sure = Belief(PLANT, NAMES, b.z, 1e-16 * np.eye(4))
    np.testing.assert_allclose(information(sure, STRIKES[:1])[0], 0, atol=1e-6)


def test_a_hanging_whip_is_filmed_in_the_middle_of_where_strikes_begin():
    bounds = StrikeBounds((-1.0, 0.2, 0.0, 0.0, 0.4), (-0.4, 0.6, 3.0, 2.0, 1.5))
    still = hanging(belief(), bounds, rng=np.random.default_rng(0))
    np.testing.assert_allclose(still.vector, [-0.7, 0.4, -0.7, 0.4, 0.5])
    default = hanging(belief(), rng=np.random.default_rng(0)).vector
    np.testing.assert_allclose(default[:2], default[2:4])
    told, fastest, _ = information(belief(), still.vector[None])
    assert fastest[0] < 0.02
    assert told[0] > 1  # the length is seen


@pytest.fixture
def asked(monkeypatch):
    """`information` replaced by one that tells more, the longer the movement, and is fast beyond D = 0.7."""
    seen: dict = {}

    def stated(belief, strikes, *, t_stay):
        seen["strikes"], seen["t_stay"] = strikes, t_stay
        wide = np.where(strikes[:, -1] > seen.get("foreseen", 1.0), 0.36, 0.34)
        return strikes[:, -1].copy(), np.where(strikes[:, -1] > seen.get("limit", 0.7), 8.01, 8.0), wide

    monkeypatch.setattr(first_look, "information", stated)
    return seen


def test_the_wiggle_tells_most_among_the_slow_ones(asked):
    bounds = StrikeBounds((-1.0, 0.2, 0.0, 0.0, 0.4), (-0.4, 0.6, 3.0, 2.0, 1.5))
    strike, told = choose_wiggle(belief(), rng=np.random.default_rng(0), bounds=bounds, t_stay=0.2, candidates=300)
    tried = asked["strikes"]
    assert tried.shape == (300, 5)
    assert asked["t_stay"] == 0.2
    slow = tried[tried[:, -1] <= 0.7]
    assert told == slow[:, -1].max()
    np.testing.assert_array_equal(strike.vector, slow[slow[:, -1].argmax()])
    assert tried[:, -1].min() == pytest.approx(0.4, abs=0.01)
    assert tried[:, -1].max() == pytest.approx(0.8, abs=0.01)
    for joint, (low, high, end) in enumerate([(-1.0, -0.4, 3.0), (0.2, 0.6, 2.0)]):
        q_i, q_f = tried[:, joint], tried[:, 2 + joint]
        np.testing.assert_allclose([q_i.min(), q_i.max()], [low, high], atol=0.02)
        swing = q_f - q_i
        assert np.abs(swing).max() <= 0.7
        assert swing.max() > 0.65
        assert min(low, 0.0) <= q_f.min()
        assert q_f.max() <= end
        np.testing.assert_allclose(q_f.min(), max(min(low, 0.0), low - 0.7), atol=0.05)


def test_where_all_are_fast_there_is_no_wiggle(asked):
    asked["limit"] = 0.1
    with pytest.raises(InputError, match=r"tip reaches 8.0 m/s or more'; allowed: at most 8 m/s"):
        choose_wiggle(belief(), rng=np.random.default_rng(0))
    assert asked["strikes"].shape == (32, 5)
    assert asked["t_stay"] == 0.3


def test_movements_are_drawn_until_one_is_slow(asked):
    """Of 32 durations between 0.4 and 0.8 s none is below 0.402 s, of the further ones some are."""
    asked["limit"] = 0.402
    strike, _ = choose_wiggle(belief(), rng=np.random.default_rng(0))
    assert strike.vector[-1] <= 0.402


@pytest.mark.parametrize("foreseen", [0.6, 0.0])
def test_in_space_the_wiggle_is_one_that_the_prior_foresees_if_there_is_one(asked, foreseen):
    """The longest is told most of; among those whose tip is known to 0.35 m, or where there are none, among all."""
    asked["foreseen"] = foreseen
    prior = default_prior(preset("ur5e"), Controller(PositionControl()), stock=stock_of_material("nylon"))
    _, told = choose_wiggle(prior, rng=np.random.default_rng(0), candidates=300)
    durations = asked["strikes"][:, -1]
    assert told == durations[durations <= (foreseen or 0.7)].max()


def test_in_the_plane_the_wiggle_may_be_one_that_is_hardly_foreseen(asked):
    asked["foreseen"] = 0.5
    _, told = choose_wiggle(belief(), rng=np.random.default_rng(0), candidates=300)
    assert told > 0.6


MODEL_SAG, CONTROLLER_SAG = preset("lemon2024"), Controller(oiac_preset("table4"))
RESTING = Strike((-0.9, 1.4), (-0.9, 1.4), 0.5)
STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
RESTING_SOURCE = "at rest"
SAG = np.array([-0.015, 0.012])


def measured(strike: Strike, sag, points=None, **more) -> StrikeRecording:
    """A recording whose encoders show where the arm stood."""
    t = np.arange(0, 0.1, 0.002)
    points = np.zeros((len(t), 1, 2)) if points is None else points
    joints = np.tile(np.add(strike.q_i, sag), (len(t), 1))
    joints[t > AT_REST] += 1.0  # by then it moves
    given = {"t": t, "joints_t": t, "joints_q": joints} | more
    return StrikeRecording(points=points, markers=("tip",), strike=strike, **given)


def test_what_a_recording_says_of_the_sag():
    np.testing.assert_allclose(measured(STRIKE, SAG).sag, SAG)
    np.testing.assert_allclose(measured(STRIKE, (0.001, 0.02)).sag, [0.0, 0.02])  # less than encoders can tell
    bare = measured(STRIKE, SAG, joints_t=None, joints_q=None)
    assert bare.sag is None
    assert bare.stood is None
    late = measured(STRIKE, SAG, joints_t=np.arange(0.05, 0.15, 0.002))
    assert late.sag is None
    assert measured(STRIKE, SAG[:1].repeat(2)).stood is not None


def heavier(law, q_i: np.ndarray, extra: tuple[float, float]) -> np.ndarray:
    """Where the law holds weights that compensation does not know, by bisection on the error's size: the reference."""
    e = np.zeros(2)
    for _ in range(30):
        first, second = np.sin((q_i - e)[0]), np.sin((q_i - e).sum())
        torque = np.array([extra[0] * first + extra[1] * second, extra[1] * second])
        if isinstance(law, ConstantImpedance):
            e = np.linalg.solve(law.parameters()["K"].reshape(2, 2), torque)
            continue
        size = float(np.linalg.norm(torque))
        error = brentq(lambda x, size: x**3 * (1 + law.C * x**2) / law.a - size, 0, 1, args=(size,))  # Eqs. 2, 8-10
        e = error * torque / size
    return -e


@pytest.mark.parametrize("law", [oiac_preset("table4"), OIAC(a=1e-3), ConstantImpedance()])
def test_sag_in_one_posture_tells_that_in_others(law):
    extra, look = (0.5, -1.2) if isinstance(law, ConstantImpedance) else (0.05, -0.12), np.array([-0.9, 1.4])
    seen = measured(RESTING, heavier(law, look, extra))
    assert np.abs(seen.sag).min() > 0
    others = np.array([[-1.4, 0.6], [-0.5, 2.5], [-1.0, 0.2]])
    told = expected_sag(law, [None, measured(RESTING, SAG, joints_t=None, joints_q=None), seen])
    assert told is not None
    expected = np.array([heavier(law, q, extra) for q in others])
    np.testing.assert_allclose(told(others), expected, atol=2e-3)
    assert np.abs(expected).max() > 5e-3


def test_no_sag_is_expected_where_none_was_measured():
    assert expected_sag(CONTROLLER_SAG.law, []) is None
    assert expected_sag(CONTROLLER_SAG.law, [measured(STRIKE, (0.0, 0.0))]) is None


def test_a_rollout_begins_where_the_arm_stands():
    """Its whip hangs from there; with derivatives as differences have them."""
    rollout = CompiledRollout(MODEL_SAG, CONTROLLER_SAG, sag=lambda q: np.broadcast_to(SAG, q.shape))
    path = rollout.trajectory(STRIKE, t_stay=0.1)
    np.testing.assert_allclose(path.q[0, :2], np.add(STRIKE.q_i, SAG), atol=1e-12)
    np.testing.assert_allclose(path.q[0].cumsum()[2:], 0, atol=1e-12)
    target, name = np.array((1.2, 0.1)), "q_si"
    _, slope = rollout.gradient(STRIKE.vector[None], target, t_stay=0.3, names=[name])
    moved = np.array([STRIKE.vector + s * 1e-5 * np.eye(5)[0] for s in (1, -1)])
    ahead, behind = rollout.approach(moved, target, t_stay=0.3).distance
    assert slope[0, 0] == pytest.approx((ahead - behind) / 2e-5, rel=1e-3)


@pytest.mark.slow
def test_a_hanging_whip_is_measured_from_where_the_arm_stands():
    """A sag of 45 mrad moves the tip by some centimetres; taken for the whip's, no whip hangs like that."""
    prior = default_prior(MODEL_SAG, CONTROLLER_SAG, whip="uniform")
    long = dataclasses.replace(MODEL_SAG, whip=dataclasses.replace(MODEL_SAG.whip, l=1.1 * MODEL_SAG.whip.l))
    sagged = CompiledRollout(long, CONTROLLER_SAG, sag=lambda q: np.broadcast_to(3 * np.abs(SAG), q.shape))
    tip = sagged.trajectory(RESTING, t_stay=0.01).tip[0]
    t = np.arange(40) / 60
    points = tip + 0.005 * np.random.default_rng(0).standard_normal((len(t), 1, 2))
    joints = {"t": t, "points": points, "sigma": np.array(0.005), "source": RESTING_SOURCE}
    with_joints = measured(RESTING, 3 * np.abs(SAG), **joints)
    without = measured(RESTING, SAG, **joints | {"joints_t": None, "joints_q": None})
    explained, not_explained = (update(prior, [r]).rmse[RESTING_SOURCE] for r in (with_joints, without))
    assert explained < 0.003
    assert not_explained > 0.02


@pytest.mark.slow
def test_a_plan_counts_with_the_sag():
    """Of an arm that sags by 50 mrad; a plan that does not count with it misses."""
    sure = default_prior(MODEL_SAG, CONTROLLER_SAG, whip="uniform")
    sure = dataclasses.replace(sure, covariance=1e-8 * sure.covariance)
    brief = PlanningEffort(pool=96, polished=4, steps=4, whips=4, population=4, rounds=1)
    stands = lambda q: np.broadcast_to(3 * SAG, q.shape)  # noqa: E731
    truth, target = CompiledRollout(MODEL_SAG, CONTROLLER_SAG, sag=stands), Target((1.2, 0.1))
    misses = []
    for sag in (stands, None):
        chosen = plan(sure, target, rng=np.random.default_rng(0), effort=brief, sag=sag)
        near = truth.approach(np.array([chosen.strike]), np.array(target.position), t_stay=0.3)
        misses.append(float(near.distance[0]))
    assert misses[0] < 0.01
    assert misses[1] > 2 * misses[0]


def test_a_posture_in_which_nothing_may_hang_is_refused_with_the_reason_of_the_nearest(monkeypatch) -> None:
    """What the check said of the first that it was asked about, which keeps the limits nearest to the middle."""
    monkeypatch.setattr(first_look, "CANDIDATES", 3)
    bounds = StrikeBounds((-0.8, 0.3, -0.8, 0.3, 0.4), (-0.6, 0.5, -0.6, 0.5, 1.0))
    asked: list[Strike] = []

    def check(strike: Strike) -> str:
        asked.append(strike)
        return f"on the way to the start, at {len(asked)}.000 s, the whip drags"

    with pytest.raises(InputError, match=r"at 1\.000 s, the whip drags") as found:
        hanging(belief(), bounds, rng=np.random.default_rng(0), check=check)
    np.testing.assert_allclose(asked[0].q_i, [-0.7, 0.4])
    assert "--" not in str(found.value)
    low = [Clearance(MODEL, floor=0.5)]
    with pytest.raises(InputError, match="below the floor"):
        hanging(belief(), bounds, rng=np.random.default_rng(0), keeps=low)
