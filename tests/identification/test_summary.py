"""What a fit says in numbers and words: units, tip paths, errors, what is unseen, the table for JSON."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from pendulum_swing import angles_of, pendulum
from scipy.stats import t as student

from whiptool.identification import summary
from whiptool.identification.correlation import Autoregression
from whiptool.identification.results import Fit, FittedStart, RecordingFit, root_mean_square
from whiptool.identification.similarity import similarity
from whiptool.identification.solver import Ending, Solution
from whiptool.identification.uncertainty import Parameter, Uncertainty
from whiptool.identification.variables import Variable, unit_of, variable
from whiptool.models.parameters import ArmLink
from whiptool.recording.camera import Camera
from whiptool.recording.strike_recording import StrikeRecording

K, M, B = (variable(f"whip.{name}", 1.0) for name in "kmb")
DELAY, TURN, DRAG = variable("delay", 0.0), variable("rotation", 0.0), variable("whip.drag", 0.0)
INDEPENDENT = Autoregression(np.zeros(0), np.ones(1), 1.0)


def seen(variables: list[Variable], z: list[float], rows: list[list[float]], units: list[float]) -> Uncertainty:
    """What is known where readings change with z by `rows`: a direction is unseen whose singular value is below 1."""
    rows_in_units = np.array(rows) * units
    _, s, directions = np.linalg.svd(np.vstack([rows_in_units, np.zeros((len(z), len(z)))]))
    flat = s < 1
    kept = directions[~flat] / s[~flat][:, None] * units
    covariance = kept.T @ kept
    sd = np.sqrt(np.diag(covariance)) + (np.diag(covariance) == 0)
    return Uncertainty(
        variables=tuple(variables),
        z=np.array(z),
        covariance=covariance,
        correlation=covariance / np.outer(sd, sd),
        singular_values=s,
        directions=directions,
        units=np.array(units, float),
        flat=flat,
        condition_number=math.inf,
        residual_variance=1.21,
        freedom=12.0,
        stated=covariance,
        whiteness=math.nan,
        errors=INDEPENDENT,
    )


def parameter(name: str, value: float, kind: str = "well determined", **told) -> Parameter:
    usual = {"start": 1.0, "error": 0.05, "interval": None, "alone": 0.01, "partner": None, "correlation": 0.0}
    return Parameter(name, value, kind=kind, unit=unit_of(name), **{**usual, **told})


def fitted(uncertainty: Uncertainty, parameters: list[Parameter], **told) -> Fit:
    end = Solution(np.zeros(1), [], 2.0, Ending.STEPS, [(3.0, 1.0, 0.0), (2.0, 1.0, 0.1)], 5)
    usual = {
        "plant": pendulum((ArmLink(1.0, 1.0),)), "drive": "command", "nuisance": {"delay": 0.01}, "recordings": (),
        "held_out": (), "runs": (FittedStart({"whip.k": 1.0}, {"whip.k": 2.0}, end),), "wall_time": 1.5,
    }  # fmt: skip
    return Fit(parameters=tuple(parameters), uncertainty=uncertainty, **{**usual, **told})


def test_parameters_in_lines():
    U = seen([K, M], [math.log(6.0), math.log(2.0)], [[100.0, -100.0]], [1, 1])
    parameters = [
        parameter("whip.k", 0.123456789, interval=(0.1, 0.2)),
        parameter("scale", 1.0, "traded", partner="whip.k", correlation=-0.98765),
        parameter("delay", 0.0, "weak", partner="scale", correlation=0.5),
        parameter("whip.m", 2.0, "flat", partner="scale", correlation=0.5),
        parameter("whip.b", 2.0, "weak"),
    ]
    lines = summary.parameter_lines(fitted(U, parameters))
    assert [" ".join(line.split()) for line in lines[:5]] == [
        "whip.k 0.12346 N m/rad 0.1 to 0.2 well determined",
        "scale 1 none traded with whip.k (-0.988)",
        "delay 0 s none weak with scale (+0.500)",
        "whip.m 2 kg none flat",
        "whip.b 2 N m s/rad none weak",
    ]
    assert {line.index("none") for line in lines[1:5]} == {2 + len("whip.k") + 2 + 24 + 1}
    assert lines[5].startswith("  not seen: whip.k and whip.m all multiplied")
    assert lines[6].startswith("  whip.k / whip.m: 3, ")
    assert len(lines) == 7


def test_errors_are_those_of_all_readings_together():
    """A recording with more readings counts for more."""
    some = [residuals_of(np.array(x)) for x in ([3.0, -4.0], [0.0] * 6)]
    assert root_mean_square(some) == pytest.approx(math.sqrt(25 / 8))
    assert root_mean_square([]) is None


def residuals_of(r: np.ndarray, **told) -> RecordingFit:
    K = len(r)
    usual = {
        "source": "film", "residuals": r, "measured": np.zeros(K), "sigma": np.full(K, 2.0), "weight": np.ones(K),
        "channels": np.stack([np.arange(K), np.zeros(K, int), np.zeros(K, int)], axis=1), "markers": ("tip",),
        "own": {}, "t": np.zeros(0), "path": {},
    }  # fmt: skip
    return RecordingFit(**{**usual, **told})


T = np.linspace(0, 1, 12)
TIP = np.stack([np.cos(3 * T), np.sin(2 * T) + 2], axis=1)
OFF = np.stack([0.01 * T, 0.02 * np.cos(9 * T)], axis=1)


def filmed(markers: tuple[str, ...]) -> tuple[StrikeRecording, RecordingFit]:
    """Two markers, the tip among them or not, whose readings come in any order; frame 4 is missing."""
    points = np.stack([TIP, TIP + 5.0], axis=1)
    late = T[:, None] + np.array([0.0, 0.004])
    recording = StrikeRecording(T, points, markers, t_points=late, target=(0.0, 2.5), source="folder/film.csv")
    rows = [(i, j, axis) for i in range(12) if i != 4 for j in range(2) for axis in range(2)]
    channels = np.array(rows)[np.random.default_rng(0).permutation(len(rows))]
    measured = points[tuple(channels.T)]
    found = residuals_of(OFF[channels[:, 0], channels[:, 2]], measured=measured, channels=channels, markers=markers)
    return recording, found


@pytest.mark.parametrize(
    ("markers", "which"), [(("tip", "handle"), 0), (("handle", "tip"), 1), (("node1", "node2"), 1)]
)
def test_the_tips_paths_or_the_last_markers(markers, which):
    recording, found = filmed(markers)
    t, measured, predicted, name = summary.tip_paths(recording, found)
    kept = np.arange(12) != 4
    assert name == markers[which]
    np.testing.assert_allclose(t, T[kept] + 0.004 * which)
    np.testing.assert_allclose(measured, (TIP + 5.0 * which)[kept])
    np.testing.assert_allclose(predicted, (TIP + 5.0 * which + OFF)[kept])


def test_depth_is_told_in_metres_beside_pixels():
    """It is read as its inverse [1/m], whose size is the squared depth; a frame without it has none in its path."""
    view = Camera("left", 640, 480, np.diag([400.0, 400.0, 1.0]), np.eye(3), np.zeros(3))
    seen, depth = np.full((12, 1, 2), 100.0), np.full((12, 1), 2.0)
    depth[3] = np.nan
    recording = StrikeRecording(T, seen, ("tip",), view=view, depth=depth)
    channels = np.array([(i, 0, axis) for i in range(12) for axis in range(3) if (i, axis) != (3, 2)])
    deep = channels[:, 2] == 2
    measured = np.where(deep, 0.5, 100.0)
    modelled = np.where(deep, 1 / 2.02, 100.3)
    told = {"measured": measured, "channels": channels, "view": view, "size": np.where(deep, 2.02**2, 5e-3)}
    found = residuals_of(modelled - measured, **told)
    assert found.pixels == pytest.approx(0.3)
    assert found.rmse == pytest.approx(1.5e-3)
    assert found.depth == pytest.approx(0.02, rel=0.02)
    assert root_mean_square([found]) == pytest.approx(1.5e-3)
    assert root_mean_square([found], "pixels") == pytest.approx(0.3)
    assert root_mean_square([found, residuals_of(np.ones(2))], "depth") == found.depth
    assert root_mean_square([residuals_of(np.ones(2))], "depth") is None
    assert summary.error_words([found]) == "1.5 mm (0.3 pixels, depth 20.2 mm)"
    _, was, expected, _ = summary.tip_paths(recording, found)
    np.testing.assert_allclose(was[:, 2], depth[:, 0])
    np.testing.assert_allclose(expected[:, 2], np.where(np.isnan(depth[:, 0]), np.nan, 2.02))


def test_similarity_is_that_of_the_tips_paths():
    recording, found = filmed(("tip", "handle"))
    kept = np.arange(12) != 4
    expected = similarity(T[kept], TIP[kept], (TIP + OFF)[kept], target=(0.0, 2.5))
    assert summary.similarity_of(recording, found) == expected
    few = found.channels[:, 0] < 4
    parts = {name: getattr(found, name)[few] for name in ("residuals", "measured", "channels", "sigma", "weight")}
    assert summary.similarity_of(recording, dataclasses.replace(found, **parts)) is None


def test_facts_of_recordings():
    a, b = (StrikeRecording(T, TIP[:, None], ("tip",), source=f"{x}/film.csv", sha256="ab") for x in "12")
    facts = summary.recording_facts([a, b])
    assert list(facts) == ["film.csv", "2/film.csv"]  # one name, two files
    assert facts["film.csv"] == "1/film.csv; camera not named; 12 frames; seen: tip 12; sha256 ab"


# what is unseen


def test_a_common_factor():
    """Readings of k / m alone."""
    U = seen([K, M, B], [0, 0, 0], [[50, -50, 0], [0, 50, -50]], [1, 1, 1])
    assert summary.flat_directions(U) == [
        "whip.k, whip.m and whip.b all multiplied by the same factor: only their ratios are determined"
    ]


@pytest.mark.parametrize(
    ("power", "words"), [(2, "whip.m by -0.5 %"), (3, "whip.m by -0.33 %"), (-2, "whip.m by +0.5 %")]
)
def test_a_product_of_powers(power, words):
    """Readings of k m^p: k goes with m^-p, told by a hundredth of the number that changes most."""
    (said,) = summary.flat_directions(seen([K, M], [0, 0], [[40, 40 * power]], [1, 1]))
    assert said == f"changed together, whip.k by +1 %, {words}: the predictions do not change"


def test_numbers_that_may_be_zero_change_by_their_own_unit():
    """Readings of ln k + 20 delay, and of delay + 3 rotation: counted in units of 0.01 s and 0.01 rad."""
    (said,) = summary.flat_directions(seen([K, DELAY], [0.0, 0.1], [[40, 40 * 20 * 0.01]], [1, 10]))
    assert said == "changed together, whip.k by +1 %, delay by -0.0005 s: the predictions do not change"
    (said,) = summary.flat_directions(seen([DELAY, TURN], [0.0, 0.0], [[40, 120]], [10, 10]))
    assert said == "changed together, delay by +0.01 s, rotation by -0.0033 rad: the predictions do not change"


def test_an_inertia_that_may_vanish_changes_by_its_unit():
    """Its room is wider than a factor of e: of m^4 I a hundredth of m takes 4 hundredths of I = 0.03 kg m^2."""
    mass, inertia = (variable(f"link.{name}[0]", 1.0) for name in ("mass", "inertia"))
    (said,) = summary.flat_directions(seen([mass, inertia], [0.0, math.log(0.03)], [[40, 10]], [1, 5]))
    assert said == (
        "changed together, link.mass[0] by +1 %, link.inertia[0] by -0.0012 kg m^2: the predictions do not change"
    )


@pytest.mark.parametrize(
    ("of", "z", "row", "unit", "said"),
    [
        (K, 0.0, 0.5, 1, "whip.k alone: known to no better than a factor of 7.4"),  # e^2
        (K, 0.0, 0.1, 1, "whip.k alone: all values fit equally well"),
        (K, 0.0, 0.0, 1, "whip.k alone: all values fit equally well"),
        (DRAG, 2.0, 0.02, 20, "whip.drag alone: its standard error is 0.05 N s^2/m^2"),  # 1 / 0.02, of 1e-3
        (DELAY, 0.0, 0.09, 10, "delay alone: its standard error is 0.11 s"),  # 1 / 0.09, of 0.01 s
        (DELAY, 0.0, 0.0005, 10, "delay alone: all values fit equally well"),
    ],
)
def test_a_number_alone(of, z, row, unit, said):
    """Standard error: what moves the readings by one standard error of theirs."""
    U = seen([of, B], [z, 0.0], [[row, 0], [0, 99]], [unit, 1])
    assert summary.flat_directions(U) == [said]


def test_bounds_of_what_is_just_seen():
    step, edge = 1.0, 1e-9
    assert "factor" in summary._bound(K, step, 0.2 + edge)
    assert "all values" in summary._bound(K, step, 0.2)
    assert "standard error" in summary._bound(DELAY, step, 0.01 + edge)
    assert "all values" in summary._bound(DELAY, step, 0.01)
    assert summary._bound(variable("whip.drag_ratio", 1.0), 1.0, 0.5) == "its standard error is 2"


def test_numbers_with_a_small_part_are_left_out():
    """A twentieth of a direction and less is not worth a word."""
    for part, named in ((0.04, "whip.k alone"), (0.08, "changed together")):
        (said,) = summary.flat_directions(seen([K, M], [0, 0], [[-99 * part, 99]], [1, 1]))
        assert said.startswith(named)


def test_everything_seen_needs_no_words():
    U = seen([K, M], [0, 0], [[99, 0], [0, 99]], [1, 1])
    assert summary.flat_directions(U) == []
    assert summary.seen_ratios(U) == {}


def test_ratios_that_are_seen():
    """k / m by its own measured slope, 100 per unit of its logarithm; b / m by 50."""
    z = [math.log(x) for x in (6.0, 2.0, 5.0)]
    U = seen([K, M, B], z, [[100, -100, 0], [0, -50, 50]], [1, 1, 1])
    ratios, spread = summary.seen_ratios(U), student.ppf(0.975, 12)
    assert list(ratios) == ["whip.k / whip.m", "whip.b / whip.m"]
    for (value, (low, high)), true, slope in zip(ratios.values(), (3.0, 2.5), (100, 50), strict=True):
        assert value == pytest.approx(true)
        assert math.log(high / true) == pytest.approx(spread / slope)
        assert math.log(true / low) == pytest.approx(spread / slope)
    without_m = seen([K, B], z[:2], [[100, -100]], [1, 1])
    assert list(summary.seen_ratios(without_m)) == ["whip.k / whip.b"]  # over the last
    (said,) = summary.flat_directions(seen([K, M], [0, 0], [[40, 80]], [1, 1]))
    assert summary.seen_ratios(seen([K, M], [0, 0], [[40, 80]], [1, 1])) == {}, said  # k m^2 is seen, k / m is not
    assert summary.seen_ratios(seen([K, DELAY], [0, 0], [[40, 80]], [1, 10])) == {}  # no ratio to a delay


# the table


@pytest.mark.parametrize(
    ("x", "finite"), [(None, None), (math.nan, None), (-math.inf, None), (3, 3), (np.float64(0.5), 0.5), (0.0, 0.0)]
)
def test_numbers_that_json_has(x, finite):
    assert summary.finite(x) == finite
    assert type(summary.finite(x)) is type(finite)


def test_a_robots_lag_has_names_and_units():
    own = {"lag": 0.0987, "lag_shape": 1 / 3, "lag_delay": 0.0046}
    lagging, still = (residuals_of(np.zeros(3), own=x) for x in (own, {"start[0]": 1.0}))
    found = fitted(seen([K], [0.0], [[100]], [1]), [], recordings=(still, lagging))
    (line,) = summary.lag_lines(found)
    assert line.endswith(": the robot lags by 98.7 ms after a delay of 4.6 ms (shape 0.33)")


def test_what_each_recording_has_of_its_own_is_said_with_interval_and_unit():
    own, intervals = {"start[0]": 1.0, "smoothing": 0.25, "scale": 1.01}, {"smoothing": (0.24, 0.26)}
    found = fitted(
        seen([K], [0.0], [[100]], [1]), [], recordings=(residuals_of(np.zeros(3), own=own, intervals=intervals),)
    )
    first, second = summary.own_lines(found)
    assert first.startswith("smoothing of ")
    assert first.endswith(": 0.25 s (a filter of 4 Hz), 0.24 to 0.26")
    assert second.endswith(": 1.01, none")


@pytest.mark.parametrize("assumed", [None, 2e-3])
def test_errors_far_above_the_residuals_are_said_whoever_stated_them(assumed):
    t = np.arange(9) / 60
    one = StrikeRecording(t, np.zeros((9, 1, 2)), ("tip",), **({} if assumed is None else {"sigma": assumed}))
    found = fitted(seen([K], [0.0], [[100]], [1]), [], recordings=(residuals_of(np.full(9, 0.3), sigma=np.ones(9)),))
    assert found.misfit == pytest.approx(0.3)
    (said,) = summary.assumed_errors(found, [one])
    assert "3.3 times" in said
    assert "intervals go by the scatter" in said
    assert ("sigma = 0.0003" in said) == (assumed is None)


def test_a_fit_as_plain_data():
    z = [math.log(6.0), math.log(2.0)]
    U = seen([K, M], z, [[100, -100]], [1, 1])
    recording, found = filmed(("tip", "handle"))
    angles = angles_of(T, TIP, np.zeros((2, 2)), source="swing")
    swing = residuals_of(
        np.array([0.3, -0.4, 0.0]), weight=np.array([1.0, 0.5, 0.99]), predicted_from=0.5,
        own={"motion[0]": 1.0, "start[1]": 2.0},
    )  # fmt: skip
    parameters = [
        parameter("whip.k", 6.0, interval=(5.0, math.inf), partner="whip.m", correlation=0.9, start=4.0),
        parameter("whip.m", 2.0, "flat", error=math.nan, alone=math.inf),
    ]
    table = summary.fit_table(fitted(U, parameters, recordings=(found,), held_out=(swing,)), [recording], [angles])
    assert json.loads(json.dumps(table, allow_nan=False)) == table
    assert table["parameters"] == [
        {
            "name": "whip.k", "value": 6.0, "unit": "N m/rad", "start": 4.0, "class": "well determined",
            "standard_error": 0.05, "interval": [5.0, None], "standard_error_if_all_others_were_known": 0.01,
            "partner": "whip.m", "correlation": 0.9,
        },
        {
            "name": "whip.m", "value": 2.0, "unit": "kg", "start": 1.0, "class": "flat", "standard_error": None,
            "interval": None, "standard_error_if_all_others_were_known": None, "partner": None, "correlation": 0.0,
        },
    ]  # fmt: skip
    assert table["starts"] == [
        {
            "start": {"whip.k": 1.0}, "values": {"whip.k": 2.0}, "cost": 2.0, "cost_over_best": 1.0, "failed": False,
            "status": "steps", "steps": 1, "evaluations": 5,
        }
    ]  # fmt: skip
    said = {
        "status": "steps", "converged": False, "message": Ending.STEPS.value, "drive": "command",
        "intervals_from": "covariance",
        "condition_number": None, "residual_variance": 1.21, "residual_correlation": None, "nuisance": {"delay": 0.01},
        "rmse": pytest.approx(np.sqrt(np.mean(OFF[np.arange(12) != 4] ** 2))), "fit_time": 1.5,
        "held_out_rmse": pytest.approx(0.5 / math.sqrt(3)), "flat_directions": summary.flat_directions(U),
        "singular_values": pytest.approx([100 * math.sqrt(2), 0]), "correlation": U.correlation.tolist(),
    }  # fmt: skip
    assert {name: table[name] for name in said} == said
    ((low, high),) = [ratio["interval"] for ratio in table["ratios"]]
    assert table["ratios"] == [{"name": "whip.k / whip.m", "value": pytest.approx(3.0), "interval": [low, high]}]
    one, two = table["recordings"]
    assert (one["held_out"], two["held_out"]) == (False, True)
    assert (one["source"], two["source"]) == ("folder/film.csv", "swing")
    assert one["similarity"]["hit_point"] == summary.similarity_of(recording, found).hit_point
    assert len(one["similarity"]["rho"]) == 2
    assert (one["predicted_from"], one["down_weighted"], one["n_residuals"]) == (None, 0, 44)
    told = {
        "similarity": None, "predicted_from": 0.5, "down_weighted": 2, "own": {"start[1]": 2.0}, "own_intervals": {},
        "n_residuals": 3,
        "rmse": pytest.approx(0.5 / math.sqrt(3)), "rms_over_stated_error": pytest.approx(0.25 / math.sqrt(3)),
    }  # fmt: skip
    assert {name: two[name] for name in told} == told


def test_a_start_that_never_began():
    end = Solution(np.zeros(1), [], math.inf, Ending.DIVERGED)
    U = seen([K], [0.0], [[9.0]], [1])
    runs = (FittedStart({}, {}, end, over_best=math.inf, failed=True),)
    table = summary.fit_table(fitted(U, [parameter("whip.k", 1.0)], runs=runs), [], [])
    (start,) = table["starts"]
    assert (start["steps"], start["cost"], start["cost_over_best"], start["failed"]) == (0, None, None, True)
    assert (table["rmse"], table["held_out_rmse"]) == (None, None)


def test_intervals_of_correlated_errors_say_so():
    U = seen([K], [0.0], [[9.0]], [1])
    errors = Autoregression(np.array([0.5]), np.array([1.0, 0.5]), 0.75)
    correlated = Uncertainty(**{**vars(U), "errors": errors})
    assert summary.fit_table(fitted(correlated, []), [], [])["intervals_from"] == "correlated errors"


def ended(values: list[float], chi: float = 1.0) -> Fit:
    """A fit of stiffness, mass and drag that started at 1, 1 and 0; its one recording is off by so much."""
    variables = [K, M, DRAG]
    z = [v.z(x) if not v.log or x else v.lower for v, x in zip(variables, values, strict=True)]
    U = seen(variables, z, np.eye(3).tolist(), [1, 1, 1])
    parameters = [parameter(v.name, v.value(x), start=1.0) for v, x in zip(variables, z, strict=True)]
    recordings = (residuals_of(2.0 * chi * np.ones(4)),)
    return fitted(U, parameters, recordings=recordings)


def test_a_fit_names_what_ended_at_a_bound_and_a_misfit_that_is_too_large():
    good, bad = ended([0.25, 2.0, 0.003]), ended([1e-3, 1e3, 0.0], chi=3.1)
    end = f"NOT CONVERGED: {Ending.STEPS.value}"
    assert repr(good) == f"Fit(whip.k = 0.25 N m/rad, whip.m = 2 kg, whip.drag = 0.003 N s^2/m^2; {end}; 1 recording)"
    assert repr(bad) == (
        "Fit(whip.k = 0.001 N m/rad (its lower bound), whip.m = 1000 kg (its upper bound), "
        f"whip.drag = 0 N s^2/m^2 (its lower bound); {end}; 1 recording, model does not fit: misfit 3.1)"
    )
    assert good.misfit == pytest.approx(1.0)
    assert (good.explains, bad.explains) == (True, False)
    assert bad.at_bounds == {"whip.k": "lower", "whip.m": "upper", "whip.drag": "lower"}
    assert summary.bound_lines(good) == []
    assert summary.bound_lines(bad) == [
        "whip.k ended at its lower bound, 0.001 N m/rad (it started at 1 N m/rad), and is not an estimate",
        "whip.m ended at its upper bound, 1000 kg (it started at 1 kg), and is not an estimate",
        "whip.drag ended at 0, its smallest possible value",
    ]
    assert summary.misfit_line(good) == "1.00 (RMS residual in standard errors; about 1 if the model fits)"
    assert summary.misfit_line(bad).endswith("if the model fits): above 3, the model does not explain the recordings")


def test_a_misfit_is_doubted_where_more_than_half_of_the_squared_residuals_is_not_stated():
    doubted = summary.misfit_line(ended([0.25, 2.0, 0.003], chi=2.0))
    assert "75% of the squared residuals are more than the stated errors leave; intervals hold only if" in doubted
    assert summary.misfit_line(ended([0.25, 2.0, 0.003], chi=1.4)).endswith("about 1 if the model fits)")


def test_smoothed_tracks_withdraw_a_fit_and_say_where():
    found = dataclasses.replace(ended([0.25, 2.0, 0.003]), smoothed=(4.02,))
    assert not found.explains
    assert "withdrawn: the tracks were smoothed before export" in repr(found)
    assert "smoothed before export" in summary.misfit_line(found)
    assert "at 4 Hz. Classes and intervals are withdrawn" in summary.warning(found)


def test_directions_of_the_base_that_were_fitted_are_counted():
    own = {"motion[0]": 0.1, "motion[1]": 0.2}
    found = fitted(seen([K], [0.0], [[100]], [1]), [], recordings=(residuals_of(np.zeros(3), own=own),), drive="joints")
    assert summary.freed_line(found) == "2 directions of its motion that the logs leave open were fitted, too"
    assert summary.freed_line(dataclasses.replace(found, drive="handle")) == ""  # a handle's motion is always fitted


def test_a_fit_looks_short_names_up_as_what_is_freed_does():
    """Of a pendulum's links, `com[1]` and, where one alone was free, `com` stand for `link.com[1]`."""
    names = ["link.com[0]", "link.com[1]", "link.mass[0]", "whip.k"]
    U = seen([variable(name, 1.0) for name in names], [0.0] * 4, np.eye(4).tolist(), [1] * 4)
    found = fitted(U, [parameter(name, 1.0) for name in names])
    for short, full in [("k", "whip.k"), ("com[1]", "link.com[1]"), ("mass", "link.mass[0]"), ("mass[0]", names[2])]:
        assert found[short] is found[full]
    with pytest.raises(KeyError, match=r"com; free were link\.com\[0\], link\.com\[1\]'"):
        found["com"]
    with pytest.raises(KeyError, match=r"link; free were .*whip\.k"):
        found["link"]
