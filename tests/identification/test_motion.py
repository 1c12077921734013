"""The prescribed motion of a whip's base: splines against SciPy's, arms against differences, noise against its draw."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline
from space_films import ROBOT, STRIKES

from whiptool.errors import InputError
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.joint_motion import JointMotion
from whiptool.identification.motion import (
    HANDLE_JERK,
    JOINT_JERK,
    REST,
    SHORTEST,
    HandleMotion,
    LaggedReference,
    SmoothSpline,
    StillMotion,
    check_covers,
    cross_validated,
)
from whiptool.identification.plant import Plant
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller
from whiptool.models.parameters import ArmLink, ArmParameters
from whiptool.models.presets import preset
from whiptool.recording.strike_recording import StrikeRecording

T = np.arange(-0.1, 1.2, 0.008)
Q = np.stack([np.clip(T, 0, 0.6) * 1.5, -np.clip(T, 0, 0.6)], axis=1)


def log(which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return T[which], Q[which]


@pytest.mark.parametrize(
    ("which", "said"),
    [
        ((T < 0.3) | (T > 0.5), r"a hole of 0\.20\d s from 0\.\d+ s, in which a joint moved by 0\.3"),
        (T > 0.2, r"a start at 0\.20\d s, with the arm moving; readings from 0\.000 s"),
        (T < 0.4, r"an end at 0\.39\d s; readings to 1\.000 s"),
        (T < 0.85, r"an end at 0\.84\d s; readings to 1\.000 s"),
    ],
)
def test_what_would_have_to_be_guessed_is_refused(which, said):
    with pytest.raises(InputError, match=f"^s.csv: joints: got .*{said}"):
        check_covers("s.csv: joints", *log(which), 0.0, 1.0)


@pytest.mark.parametrize(
    "which",
    [T < 2, T > -0.05, T < 1.0, (T < 0.7) | (T > 0.95), np.arange(len(T)) % 4 == 0, np.arange(len(T)) % 30 != 5],
)
def test_a_log_that_tells_the_motion_passes(which):
    """Also with a hole while the arm stands, a sample lost here and there, or samples that are rare."""
    check_covers("s.csv: joints", *log(which), 0.0, 1.0)


ARM = ArmParameters(tuple(ArmLink(mass=0.3, length=x) for x in (0.4, 0.3, 0.2)))
I = np.linspace(0.0, 1.0, 201)


def test_a_spline_passes_through_what_it_can_and_derives_as_it_should():
    """A quintic is its own regression spline; the jerk that is expected is large enough to say nothing."""
    p = np.polynomial.Polynomial([0.1, 1.0, -2.0, 0.5, 1.0, -0.7])
    spline = SmoothSpline(start=0.0, end=1.0, knots=0.1, jerk=1e9, d=1)
    t = np.linspace(0, 1, 60)
    c = spline.fit(t, p(t)[:, None], np.full(60, 1e-3))
    assert c.shape == (spline.size,) == (10 + 5,)
    for derivative in range(4):
        np.testing.assert_allclose(spline.basis(I, derivative) @ c, p.deriv(derivative)(I), atol=2e-6)


def test_a_base_that_stays_has_a_place_and_nothing_unknown():
    motion = StillMotion(np.array([0.3, -0.1]), 7, joints=2)
    moved = motion.at(np.zeros(0))
    assert motion.start.shape == motion.mean.shape == (0,)
    assert motion.rows.shape == (0, 0)
    np.testing.assert_array_equal(moved.place, np.tile([0.3, -0.1], (7, 1)))
    assert moved.d_place.shape == (0, 7, 2)
    assert not moved.inputs.any()
    assert not moved.q_i.any()


def test_a_spline_is_weighted_least_squares():
    rng = np.random.default_rng(0)
    t, sigma = np.sort(rng.uniform(0, 1, 80)), rng.uniform(0.5, 2.0, 80)
    values = rng.normal(size=(80, 2))
    spline = SmoothSpline(start=0.0, end=1.0, knots=0.2, jerk=1e9, d=2)
    gaps = values.copy()
    gaps[[3, 40], [0, 1]] = np.nan
    seen = np.delete(np.arange(80), [3, 40])
    c = spline.fit(t, gaps, sigma).reshape(-1, 2)
    knots = 0.2 * np.arange(-5, 11)
    theirs = make_lsq_spline(t[seen], values[seen], knots, k=5, w=1 / sigma[seen])
    np.testing.assert_allclose(c, theirs.c, rtol=1e-4, atol=1e-4)


def test_what_begins_at_rest_has_no_first_rate():
    """Noise leaves the first rate of a spline at random; known to be at rest it is a thousandth. No other changes."""
    rng, t = np.random.default_rng(1), np.linspace(0, 1, 200)
    values = np.stack([t**3, -(t**2)], axis=1) + 1e-3 * rng.normal(size=(200, 2))
    loose, still = (SmoothSpline(start=0.0, end=1.0, knots=0.1, jerk=1e3, d=2, at_rest=x) for x in (False, True))
    rates = [
        s.basis(np.array([0.0, 0.5]), 1) @ s.fit(t, values, np.full(200, 1e-3)).reshape(-1, 2) for s in (loose, still)
    ]
    assert np.abs(rates[0][0]).max() > 0.02
    assert np.abs(rates[1][0]).max() < REST
    np.testing.assert_allclose(rates[1][1], rates[0][1], atol=0.01)
    extra = still.penalty[len(loose.penalty) :]
    np.testing.assert_allclose(extra @ np.ones(2 * still.size), 0, atol=1e-6)  # a constant is at rest
    line = make_lsq_spline(t, t, 0.1 * np.arange(-5, 16), k=5).c
    np.testing.assert_allclose(extra @ np.kron(line, [1, -2]), np.array([1, -2]) / REST, rtol=1e-6)


def test_the_jerk_of_usual_size_bridges_gaps():
    """One row per piece: third derivative in its middle over the usual size, for each quantity alike."""
    spline = SmoothSpline(start=0.0, end=1.0, knots=0.25, jerk=50.0, d=2)
    assert spline.penalty.shape == (2 * 4, 2 * spline.size)
    p = np.polynomial.Polynomial([0.0, 0.0, 0.0, 2.0, 1.0])
    fit = SmoothSpline(start=0.0, end=1.0, knots=0.25, jerk=1e9, d=2)
    t = np.linspace(0, 1, 50)
    c = fit.fit(t, np.stack([p(t), -3 * p(t)], axis=1), np.full(50, 1e-3))
    middles = np.array([0.125, 0.375, 0.625, 0.875])
    expected = np.outer(p.deriv(3)(middles), [1, -3]).ravel() / 50
    np.testing.assert_allclose(spline.penalty @ c, expected, atol=1e-4)
    hole = np.r_[0:15, 35:50]
    lost = np.full((50, 2), np.nan)
    lost[hole] = np.stack([t, t**2], axis=1)[hole]
    bridged = spline.fit(t, lost, np.full(50, 1e-3))
    np.testing.assert_allclose((spline.basis(t) @ bridged.reshape(-1, 2)), np.stack([t, t**2], axis=1), atol=1e-5)


def derivative(function, x: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """By central differences, one row per entry of x."""
    steps = h * np.eye(len(x))
    return np.array([(function(x + s) - function(x - s)) / (2 * h) for s in steps])


def test_a_handles_path_moves_the_base_and_does_not_turn_it():
    t = np.linspace(0, 1, 51)
    path = np.stack([0.3 * np.sin(4 * t), 0.2 * t**2], axis=1)
    motion = HandleMotion(t, path, np.full(51, 1e-4), I, joints=2)
    moved = motion.at(motion.start)
    np.testing.assert_allclose(moved.place, np.stack([0.3 * np.sin(4 * I), 0.2 * I**2], axis=1), atol=2e-4)
    inside = slice(10, -10)
    np.testing.assert_allclose(moved.inputs[inside, 3], 1.2 * np.cos(4 * I)[inside], atol=0.01)
    np.testing.assert_allclose(moved.inputs[inside, 4], 0.4 * I[inside], atol=0.01)
    np.testing.assert_allclose(moved.inputs[inside, 5], -4.8 * np.sin(4 * I)[inside], atol=0.3)
    np.testing.assert_allclose(moved.inputs[inside, 6], 0.4, atol=0.3)
    assert not moved.inputs[:, :3].any()
    assert not moved.q_i.any()
    assert not moved.d_q_i.any()
    assert moved.q_i.shape == (2,)
    assert moved.d_q_i.shape == (len(motion.start), 2)
    np.testing.assert_allclose(derivative(lambda c: motion.at(c).inputs, motion.start), moved.d_inputs, atol=1e-3)
    np.testing.assert_allclose(derivative(lambda c: motion.at(c).place, motion.start), moved.d_place, atol=1e-8)
    np.testing.assert_array_equal(motion.mean, np.zeros(len(motion.rows)))
    usual = SmoothSpline(start=0.0, end=1.0, knots=0.03, jerk=HANDLE_JERK, d=2)  # 1.5 frames
    assert len(motion.start) == 2 * (34 + 5)
    np.testing.assert_allclose(motion.rows, usual.penalty)
    fast = np.linspace(0, 1, 1001)
    finest = HandleMotion(fast, np.zeros((1001, 2)), np.full(1001, 1e-4), I, joints=2)
    assert len(finest.start) == 2 * (round(1 / SHORTEST) + 5)
    assert (SHORTEST, HANDLE_JERK, JOINT_JERK) == (0.02, 3e3, 1e4)
    coarse = HandleMotion(t, path, np.full(51, 1e-4), I, joints=2, knots=0.25)
    assert len(coarse.start) == 2 * (4 + 5)


def angles(t: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(3 * t), 0.5 * t**2, -np.cos(2 * t)], axis=1)


@pytest.fixture(scope="module")
def joints() -> JointMotion:
    t = np.arange(-0.1, 1.1, 0.02)
    return JointMotion(t, angles(t), ARM, I)


def test_an_arms_joints_move_the_base(joints):
    """The hand's place from the angles; velocity, acceleration and turning from its own differences."""
    moved = joints.at(joints.start)
    theta = np.cumsum(angles(I), axis=1)
    l = np.array([0.4, 0.3, 0.2])
    hand = np.stack([(l * np.sin(theta)).sum(axis=1), -(l * np.cos(theta)).sum(axis=1)], axis=1)
    np.testing.assert_allclose(moved.place, hand, atol=1e-4)
    np.testing.assert_allclose(moved.inputs[:, 0], theta[:, -1], atol=2e-4)
    h, inside = I[1] - I[0], slice(2, -2)
    for x, rate in ((moved.place, moved.inputs[:, 3:5]), (moved.inputs[:, 3:5], moved.inputs[:, 5:7])):
        np.testing.assert_allclose(np.gradient(x, h, axis=0)[inside], rate[inside], atol=2e-2)
    np.testing.assert_allclose(np.gradient(moved.inputs[:, 0], h)[inside], moved.inputs[inside, 1], atol=2e-2)
    np.testing.assert_allclose(np.gradient(moved.inputs[:, 1], h)[inside], moved.inputs[inside, 2], atol=2e-2)
    np.testing.assert_allclose(moved.q_i, angles(np.zeros(1))[0], atol=2e-4)


def test_derivatives_by_an_arms_coefficients():
    t = np.arange(-0.1, 1.1, 0.02)
    joints = JointMotion(t, angles(t), ARM, I[::10], knots=0.2)
    c = joints.start + np.random.default_rng(0).normal(0, 0.05, len(joints.start))
    moved = joints.at(c)
    for name in ("inputs", "place", "q_i"):
        found = derivative(lambda x, name=name: getattr(joints.at(x), name), c)
        expected = getattr(moved, f"d_{name}")
        np.testing.assert_allclose(found, expected, atol=1e-7 * max(1.0, float(np.abs(expected).max())))


def test_derivatives_by_the_coefficients_of_a_robots_joints():
    arm = preset("ur5e").arm
    t = np.arange(-0.1, 1.1, 0.02)
    q = np.sin(np.outer(t, 1 + np.arange(6)) + np.arange(6)) * 0.3
    joints = JointMotion(t, q, arm, I[::10], knots=0.2)
    c = joints.start + np.random.default_rng(0).normal(0, 0.05, len(joints.start))
    moved = joints.at(c)
    for name in ("inputs", "place", "q_i"):
        found = derivative(lambda x, name=name: getattr(joints.at(x), name), c)
        expected = getattr(moved, f"d_{name}")
        np.testing.assert_allclose(found, expected, atol=1e-6 * max(1.0, float(np.abs(expected).max())))


def test_what_is_known_of_the_coefficients_is_log_and_jerk():
    """`rows c - mean` has the squares of the log's residuals and of the jerk's, less those at the best fit."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 1.0005, 0.001)
    noisy = angles(t)[:, :2] + rng.normal(0, 1e-3, (len(t), 2))
    arm = ArmParameters(ARM.links[:2])
    motion = JointMotion(t, noisy, arm, I, knots=0.1)
    spline = SmoothSpline(start=0.0, end=1.0, knots=0.1, jerk=JOINT_JERK, d=2)
    np.testing.assert_allclose(motion.rows @ motion.start, motion.mean)

    def badness(c: np.ndarray, sigma: float) -> float:
        log = (spline.basis(t) @ c.reshape(-1, 2) - noisy) / sigma
        return (log**2).sum() + ((spline.penalty @ c) ** 2).sum()

    c = motion.start + rng.normal(0, 1e-3, len(motion.start))
    rise = ((motion.rows @ c - motion.mean) ** 2).sum()
    assert rise == pytest.approx(badness(c, 1e-3) - badness(motion.start, 1e-3), rel=0.15)  # the noise is estimated
    assert JointMotion(t, angles(t)[:, :2], arm, I).start.shape == (2 * (50 + 5),)  # knots: two samples, 20 ms at least
    smooth = JointMotion(t, 0 * noisy, arm, I, knots=0.1)  # a log without noise is taken to err by 10 nanoradians
    assert np.linalg.norm(smooth.rows @ c) == pytest.approx(np.linalg.norm(spline.basis(t) @ c.reshape(-1, 2)) / 1e-8)


def test_samples_outside_the_instants_do_not_count():
    t = np.arange(-1.0, 2.0, 0.01)
    q = angles(t)
    wild = np.where((t < -0.03)[:, None] | (t > 1.03)[:, None], 99.0, q)
    np.testing.assert_allclose(JointMotion(t, wild, ARM, I).start, JointMotion(t, q, ARM, I).start, atol=1e-9)


def test_logs_that_do_not_fit_are_refused():
    t = np.linspace(0, 1, 8)
    JointMotion(t, angles(t), ARM, I)
    with pytest.raises(InputError, match="8 or more samples of 3 joints"):
        JointMotion(t[:7], angles(t[:7]), ARM, I)
    with pytest.raises(InputError, match="joints_q"):
        JointMotion(t, angles(t)[:, :2], ARM, I)


def test_a_motion_too_long_for_memory_is_refused_before_it_is_made():
    """Ten minutes of a robot's log at 500 Hz would take terabytes."""
    t = np.arange(0, 600, 0.002)
    with pytest.raises(InputError, match=r"600 s, a knot every 0.02 s: .*keep only the part with the strike"):
        JointMotion(t, np.stack([np.sin(t)] * ARM.n, 1), ARM, np.arange(0, 600, 1e-3))


def stepped(t):
    """Joints that start and end abruptly, at 2.5 and 1.5 rad/s."""
    return np.clip(t, 0, 0.5)[:, None] * [2.5, 1.5]


def test_knots_are_as_dense_as_the_log_asks_for():
    """A joint that starts abruptly, logged at 30 Hz, has a knot a sample, and leaves a quarter of the error."""
    t = np.arange(-0.29, 1.0, 1 / 30)
    q = stepped(t) + 1e-5 * np.random.default_rng(0).standard_normal((len(t), 2))
    told = {"jerk": JOINT_JERK, "at_rest": True}
    chosen = cross_validated(t, q, np.full(2, 2e-5), **told)
    assert chosen == pytest.approx(1 / 30)
    fine, off = np.arange(-0.25, 0.95, 1e-3), {}
    for knots in (chosen, 2 / 30):
        spline = SmoothSpline(start=t[0], end=t[-1], knots=knots, d=2, **told)
        off[knots] = np.abs(spline.basis(fine) @ spline.fit(t, q, np.full(len(t), 2e-5)).reshape(-1, 2) - stepped(fine))
    assert off[chosen].mean() < off[2 / 30].mean() / 2


def test_noisy_logs_of_smooth_motions_have_fewer_knots_than_samples():
    t = np.arange(-0.2, 1.0, 1 / 60)
    s = np.clip(t / 0.5, 0, 1)
    q = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * [1.0, 0.7]
    noisy = q + 2e-3 * np.random.default_rng(1).standard_normal(q.shape)
    assert cross_validated(t, noisy, np.full(2, 2e-3), jerk=JOINT_JERK, at_rest=True) == pytest.approx(3 / 60)
    assert cross_validated(t, q, np.full(2, 1e-6), jerk=JOINT_JERK, at_rest=True) < 2 / 60


def test_the_error_that_is_minimised_is_that_of_samples_left_out():
    """Against leaving each sample out in turn: the same spacing, though the sums differ."""
    rng, t = np.random.default_rng(2), np.arange(0, 1.0, 1 / 30)
    q = np.sin(9 * t)[:, None] + 3e-2 * rng.standard_normal((len(t), 1))
    left_out = {}
    for knots in (1 / 30, 3 / 30):
        spline = SmoothSpline(start=t[0], end=t[-1], knots=knots, jerk=JOINT_JERK, d=1)
        errors = []
        for i in range(1, len(t) - 1):
            rest = np.arange(len(t)) != i
            c = spline.fit(t[rest], q[rest], np.full(rest.sum(), 3e-2))
            errors.append((spline.basis(t[i : i + 1]) @ c - q[i]).item())
        left_out[knots] = np.mean(np.square(errors))
    chosen = cross_validated(t, q, np.full(1, 3e-2), jerk=JOINT_JERK, at_rest=False)
    assert left_out[3 / 30] < left_out[1 / 30]
    assert chosen > 1.4 / 30


def test_the_hand_moves_with_the_lag_as_differences_say():
    motion = LaggedReference(STRIKES[0], ROBOT.arm, np.linspace(0, 0.9, 901))
    for c in ((0.03, 0.3, 0.004), (-0.03, 0.2, -0.01)):
        moved = motion.at(np.array(c))
        for i, step in enumerate(1e-6 * np.eye(3)):
            up, down = motion.at(c + step), motion.at(c - step)
            for name in ("inputs", "place"):
                slope = (getattr(up, name) - getattr(down, name)) / 2e-6
                found = getattr(moved, f"d_{name}")[i]
                np.testing.assert_allclose(found, slope, atol=1e-4 * np.abs(slope).max())
    same = [motion.at(np.array(c)).inputs for c in ((0.03, 0.3, 0.004), (-0.03, -0.3, -0.004))]
    np.testing.assert_allclose(*same)


def test_a_whip_and_its_robots_lag_come_back_from_the_command_alone():
    """No log of the joints: 1 mm at the tip, 120 frames a second, the lag of a UR; the command alone would not do."""
    plant, rng = Plant(ROBOT, Controller()), np.random.default_rng(0)
    t = np.arange(0, 1.1, 1 / 120)
    empty = [StrikeRecording(t, np.zeros((len(t), 1, 3)), ("tip",), strike=s) for s in STRIKES]
    simulated = Predictor(empty, plant, drive="robot", shared=["whip.k"])
    paths = simulated(plant, {}, [np.array([0.1, 1 / 3, 0.005])] * 2, derivatives=False)
    films = [
        StrikeRecording(t, p.value.reshape(-1, 1, 3) + 1e-3 * rng.standard_normal((len(t), 1, 3)), ("tip",), strike=s)
        for p, s in zip(paths, STRIKES, strict=True)
    ]
    found = fit(films, plant.changed({"whip.k": 0.06, "whip.b": 0.005}), ["k", "b"], options=FitOptions(drive="robot"))
    for name, true in {"whip.k": 0.05, "whip.b": 0.004}.items():
        low, high = found[name].interval
        assert low <= true <= high
        assert high - low < 0.3 * true
    for recording in found.recordings:
        assert recording.own["lag"] == pytest.approx(0.1, abs=3e-3)
        assert recording.own["lag_shape"] == pytest.approx(1 / 3, abs=0.05)
        assert recording.own["lag_delay"] == pytest.approx(0.005, abs=3e-3)
        assert recording.own["lag"] + recording.own["lag_delay"] == pytest.approx(0.105, abs=1e-3)
    assert found.misfit == pytest.approx(1, abs=0.1)


def test_a_robot_in_space_has_a_command():
    t = np.arange(0, 1, 0.02)
    nothing = StrikeRecording(t, np.zeros((len(t), 1, 3)), ("tip",))
    with pytest.raises(InputError, match="a recording that states its strike's command"):
        Predictor([nothing], Plant(ROBOT, Controller()), drive="robot", shared=["whip.k"])
    with pytest.raises(InputError, match="for a model in the plane"):
        Predictor([nothing], Plant(preset("lemon2024"), Controller()), drive="robot", shared=["whip.k"])
