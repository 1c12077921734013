import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lsim

from whiptool.errors import InputError
from whiptool.identification.servo_lag import PERIOD, ServoLag, fit_servo_lag

T = np.arange(0, 1.2, PERIOD)
QUINTIC, SHARE = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6]), np.clip(T / 0.6, 0, 1)
WAY, *RATES = (QUINTIC.deriv(k)(SHARE)[:, None] * np.array([0.8, -1.2]) / 0.6**k for k in range(3))
LAG = ServoLag(0.1, 300.0, 0.0046)


def test_following_is_the_response_of_the_linear_system_to_held_commands():
    fine = np.arange(0, T[-1], PERIOD / 20)  # the delay is 46 of these steps
    late = np.rint(fine / (PERIOD / 20)).astype(int) - 46
    held = np.where(late < 0, WAY[0, 0], WAY[np.maximum(late, 0) // 20, 0])
    system = ([LAG.stiffness], [1, LAG.stiffness * LAG.lag, LAG.stiffness])
    _, other, _ = lsim(system, held, fine, interp=False)
    found = LAG.following(WAY)
    np.testing.assert_allclose(found[:-1, 0], other[::20][: len(found) - 1], atol=1e-12)
    assert np.abs(found).max() > 0.7


def test_a_joint_at_a_steady_speed_is_behind_by_the_total_lag_and_half_a_period():
    ramp = np.arange(2000)[:, None] * PERIOD
    behind = ramp[-1] - LAG.following(ramp)[-1]
    assert behind == pytest.approx(LAG.total + PERIOD / 2, abs=2e-5)


def test_commands_that_lead_are_followed_exactly_and_later():
    found = LAG.following(LAG.leading(WAY, *RATES))
    late = np.stack([np.interp(T - LAG.delay - PERIOD / 2, T, way) for way in WAY.T], axis=1)
    assert np.abs(found - late).max() < 1e-4
    assert np.abs(LAG.following(WAY) - late).max() > 0.1  # without the lead


def response(lag: ServoLag, t: np.ndarray, D: float) -> np.ndarray:
    """Position, rate and acceleration (3, T) behind a minimum-jerk path, by matrix exponentials: the path's five
    derivatives are states, too, so that nothing drives the system. Times are in units of D."""
    A = np.eye(8, k=1)
    A[1] = lag.stiffness * D**2 * np.array([-1, -lag.lag / D, 1, 0, 0, 0, 0, 0])
    path = np.array([QUINTIC.deriv(k)(0.0) for k in range(6)])
    state = np.concatenate([[0.0, 0.0], path])
    end = expm(A) @ state
    end[2:] = [1, 0, 0, 0, 0, 0]
    s = np.maximum(t - lag.delay, 0) / D
    found = np.array([expm(A * x) @ state if x <= 1 else expm(A * (x - 1)) @ end for x in s])
    return np.stack([found[:, 0], found[:, 1] / D, found @ A[1] / D**2])


@pytest.mark.parametrize("numbers", [(0.1, 300.0, 0.005), (0.02, 1e4, 0.0), (0.02, 1e8, 0.003), (0.3, 2e3, 0.0)])
def test_behind_a_minimum_jerk_path_is_the_response_of_the_linear_system(numbers):
    """Of oscillating, critically damped, stiff (of first order) and slow joints, with both rates."""
    lag, D, t = ServoLag(*numbers), 0.6, np.r_[np.linspace(0, 0.02, 9), np.linspace(0.03, 1.2, 60), 30.0]
    expected = response(lag, t, D)
    largest = np.abs(expected).max(axis=1)
    off = np.abs(lag.behind(t, D) - expected).max(axis=1) / largest
    rounding = 1e-13 * np.array([1.0, lag.stiffness * lag.lag / largest[1], lag.stiffness / largest[2]])
    of_exponentials = 1e-15 * lag.stiffness * D**2  # which are squares of squares
    assert np.all(off <= 1e-11 + of_exponentials + rounding)  # rates are differences of terms as large as stiffness is


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_finds_the_numbers_within_their_standard_errors(seed):
    rng = np.random.default_rng(seed)
    q = LAG.following(WAY) + 1e-4 * rng.standard_normal(WAY.shape)
    found = fit_servo_lag(T, WAY, q)
    off = [found.lag - LAG.lag, found.stiffness - LAG.stiffness, found.delay - LAG.delay]
    assert np.all(np.abs(off) < 4 * np.array(found.errors))
    assert np.all(np.array(found.errors) < [5e-4, 5.0, 5e-4])
    assert found.rms == pytest.approx(1e-4, rel=0.1)


def test_standard_errors_are_as_large_as_the_scatter_of_fits():
    fits = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        fits.append(fit_servo_lag(T, WAY, LAG.following(WAY) + 1e-3 * rng.standard_normal(WAY.shape)))
    scatter = np.std([(x.lag, x.stiffness, x.delay) for x in fits], axis=0)
    stated = np.mean([x.errors for x in fits], axis=0)
    assert np.all((stated / scatter > 0.4) & (stated / scatter < 2.5))


def test_missing_samples_and_an_offset_do_not_matter():
    kept = np.sort(np.random.default_rng(0).choice(np.arange(1, len(T)), 400, replace=False))
    kept = np.r_[0, kept]
    held = np.searchsorted(kept, np.arange(len(T)), side="right") - 1
    sent = WAY[kept][held]  # a command stays until the next one that was sent
    q = LAG.following(sent) + np.array([0.02, -0.01])
    found = fit_servo_lag(T[kept], WAY[kept], q[kept])
    assert found.lag == pytest.approx(LAG.lag, abs=1e-5)
    assert found.delay == pytest.approx(LAG.delay, abs=1e-5)


@pytest.mark.parametrize(
    ("commands", "allowed"), [(np.zeros((50, 2)), "move"), (np.zeros((5, 2)), "20 samples"), (WAY[:30], "20 samples")]
)
def test_a_recording_that_tells_nothing_is_refused(commands, allowed):
    with pytest.raises(InputError, match=allowed):
        fit_servo_lag(T[: len(commands)], commands, commands[:, :1] if len(commands) == 30 else commands)


def test_the_lag_is_said_with_its_standard_errors():
    assert str(ServoLag(0.1, 300, 0.004, (0.0005, 2, 0.0003), 1e-4)) == (
        "the joints lag 100.00 +- 0.50 ms behind their commands, which have an effect after 4.00 +- 0.30 ms; "
        "stiffness 300 +- 2 1/s^2; residual RMS 0.100 mrad"
    )
