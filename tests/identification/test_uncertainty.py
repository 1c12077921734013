"""Degrees of freedom of a fit whose recordings have more unknowns of their own than readings."""

from __future__ import annotations

import numpy as np
import pytest
from pendulum_swing import angles_of, pendulum

from whiptool.identification.plant import Plant
from whiptool.identification.problem import FitOptions, Problem
from whiptool.identification.results import is_explained
from whiptool.identification.solver import Block, Ending, Solution
from whiptool.identification.summary import flat_directions
from whiptool.identification.uncertainty import Uncertainty, assess, classify
from whiptool.identification.variables import room, variable, variables_of
from whiptool.models.parameters import ArmLink


@pytest.mark.parametrize("readings", [40, 400])
def test_readings_that_unknowns_take_up_are_those_of_the_hat_matrix(readings):
    """A hand's motion has hundreds of coefficients, which a log knows; a camera has some hundred readings of them."""
    rng, unknowns = np.random.default_rng(0), 120
    A, B, log = (rng.standard_normal(shape) for shape in ((readings, 1), (readings, unknowns), (unknowns, unknowns)))
    rows = np.vstack([B, 30 * log])
    taken_up = np.trace(np.linalg.pinv(rows)[:, :readings] @ B)  # of the smoother from readings to fitted readings
    r = rng.standard_normal(readings + unknowns)
    block = Block(r, np.vstack([A, np.zeros((unknowns, 1))]), rows)
    at = [np.zeros(readings, int)], [np.arange(readings) / 60]
    found = assess([variable("whip.k", 1.0)], np.zeros(1), [block], *at, None)
    freedom = readings - 1 - taken_up
    assert freedom < readings - 1
    assert found.residual_variance == pytest.approx(r[:readings] @ r[:readings] / freedom)


SIGMA = 1e-3  # [rad]
TRUE = pendulum((ArmLink(0.2, 0.2, 0.09, 8e-4), ArmLink(0.1, 0.2, 0.1, 4e-4)))
SPREAD = [f"link.{name}[{i}]" for i in range(2) for name in ("com", "inertia")]


def spread_otherwise(inertia: float) -> Plant:
    """The true pendulum but for how its links' masses are spread, which no swing shows; the last link's inertia given.

    What is seen of two links: m2 c2, I2 + m2 c2^2, m1 c1 + m2 l1, and I1 + m1 c1^2 + m2 l1^2.
    """
    upper, lower = TRUE.model.arm.links
    first, second = lower.mass * lower.com, lower.inertia + lower.mass * lower.com**2
    mass = first**2 / (second - inertia)
    carried = mass - lower.mass
    com = upper.com - carried * upper.length / upper.mass
    about = upper.inertia + upper.mass * upper.com**2 - carried * upper.length**2 - upper.mass * com**2
    return pendulum((ArmLink(upper.mass, upper.length, com, about), ArmLink(mass, lower.length, first / mass, inertia)))


def assessed(plant: Plant, free: list[str], truth: Plant) -> Uncertainty:
    """Uncertainty at a plant of two noisy recordings of the true one."""
    rng, t = np.random.default_rng(0), np.linspace(0, 1.5, 151)
    options, angles = FitOptions(drive="free", loss=None), np.zeros((len(t), 2))
    empty = [angles_of(t, angles, np.array([q, [0.0, 0.0]]), SIGMA) for q in ([1.0, 1.5], [-0.8, 0.6])]
    variables = variables_of(plant.values(), free, {}, {})
    simulated = Problem(empty, truth, free, variables, options)
    seen = simulated.predictor(truth, {}, simulated.predictor.start, derivatives=False)
    noisy = [x.value.reshape(-1, 2) + SIGMA * rng.standard_normal((len(t), 2)) for x in seen]
    recordings = [angles_of(t, q, r.first_state, SIGMA) for q, r in zip(noisy, empty, strict=True)]
    problem = Problem(recordings, plant, free, variables, options)
    z = np.array([v.z(plant.values()[v.name]) for v in variables])
    return problem.assess(Solution(z, problem.predictor.start, 1.0, Ending.CONVERGED))


def kinds(uncertainty: Uncertainty) -> dict[str, str]:
    return {p.name: p.kind for p in classify(uncertainty, [1.0] * len(uncertainty.z))}


@pytest.mark.parametrize(("errors", "kind"), [(2.9, "well determined"), (3.1, "withdrawn")])
def test_a_class_is_withdrawn_where_the_model_does_not_explain_the_readings(errors, kind):
    """Readings that are off by so many times what they state, evenly: the linear fit of one number, by hand."""
    r = errors * np.resize([1.0, -1.0], 400)
    uncertainty = assess(
        [variable("whip.k", 1.0)],
        np.zeros(1),
        [Block(r, np.full((400, 1), 100.0), np.zeros((400, 0)))],
        [np.arange(400)],
        [np.linspace(0, 1, 400)],
        None,
    )
    (found,) = classify(uncertainty, [1.0], withdrawn=not is_explained(uncertainty, [], None))
    assert found.kind == kind
    assert (found.interval is None) is (kind == "withdrawn")


def test_a_standard_error_is_in_the_unit_of_the_value_whatever_the_solver_counts():
    """400 readings of +-1, each changing by 100 a unit of z: by hand z is known to 1 / (20 * 100) = 5e-4."""
    of_z, r = 5e-4, np.resize([1.0, -1.0], 400)
    named = {"whip.k": (4.0, 4.0 * of_z), "whip.drag": (2e-3, 1e-3 * of_z), "delay": (0.05, 0.01 * of_z)}
    for name, (value, error) in named.items():
        v = variable(name, value)
        block = Block(r, np.full((400, 1), 100.0), np.zeros((400, 0)))
        U = assess([v], np.array([v.z(value)]), [block], [np.zeros(400, int)], [np.arange(400.0)], None)
        (found,) = classify(U, [value])
        assert found.value == pytest.approx(value)
        assert found.error == pytest.approx(error, rel=0.01), name
        assert found.alone == pytest.approx(error, rel=0.01), name
        assert found.interval is not None
        assert np.ptp(found.interval) / (2 * 1.96) == pytest.approx(found.error, rel=0.02)


def test_classes_are_the_same_along_an_unseen_direction():
    """A last link's inertia may be all of what is seen of it, or next to nothing: an end is as good as the other."""
    free = ["link.mass[1]", "link.length[0]", *SPREAD]
    found = []
    for inertia in (4e-4, 1e-6, 1e-10):
        U = assessed(spread_otherwise(inertia), free, TRUE)
        assert U.residual_variance == pytest.approx(1, abs=0.2)
        found.append(kinds(U))
        assert [words.split(", ")[0] for words in flat_directions(U)] == ["changed together"] * int(U.flat.sum())
    assert found[0] == found[1] == found[2]
    assert {name for name, kind in found[0].items() if kind == "flat"} == {"link.mass[1]", *SPREAD}
    assert found[0]["link.length[0]"] == "well determined"


def test_a_mass_beside_the_inertia_is_needed_to_see_the_centre_of_mass():
    """With the masses known (from a balance), the same swings pin both centres of mass."""
    for inertia in (4e-4, 1e-6):
        found = kinds(assessed(spread_otherwise(inertia), ["link.length[0]", "link.com[1]", "link.com[0]"], TRUE))
        assert set(found.values()) == {"well determined"}


def test_a_friction_that_may_be_none_is_not_well_determined():
    """Five micro-newton metres with an interval across zero, though usual ones are a thousand times as large."""
    rubbing = TRUE.changed({"link.dry_friction[0]": 2e-3, "link.dry_friction[1]": 5e-6})
    free = ["link.dry_friction[0]", "link.dry_friction[1]", "link.com[1]"]
    U = assessed(rubbing, free, rubbing)
    first, second, com = classify(U, [1.0] * 3)
    assert second.interval is not None
    assert second.interval[0] < 0 < second.interval[1]
    assert second.error < 1e-4
    assert [first.kind, second.kind, com.kind] == ["well determined", "weak", "well determined"]


def test_what_has_an_arbitrary_zero_is_well_determined_by_its_usual_size():
    for name, kind in (("delay", "well determined"), ("whip.drag", "weak")):
        v = variable(name, 0.0)
        error = 0.05  # of its usual size, five times the number itself
        block = Block(np.array([1.0, -1.0, 1.0, -1.0]), np.full((4, 1), 0.5 / error), np.zeros((4, 0)))
        at = [np.zeros(4, int)], [np.arange(4.0)]
        U = assess([v], np.array([0.01]), [block], *at, None)
        assert classify(U, [0.0])[0].kind == kind


def test_the_room_of_an_inertia_is_that_of_a_rod():
    values = {"link.mass[0]": 0.3, "link.length[0]": 0.2, "link.inertia[0]": 1e-6, "link.drag[0]": 0.0}
    chosen = [variable(name, values[name]) for name in ("link.mass[0]", "link.inertia[0]", "link.drag[0]")]
    z = np.array([v.z(values[v.name]) for v in chosen])
    np.testing.assert_allclose(room(chosen, z, values), [1.0, 1e-3 / 1e-6, 10.0])
    z[1], z[2] = np.log(0.1), 2.0  # an inertia above the rod's, a drag of twice its usual size
    np.testing.assert_allclose(room(chosen, z, values), [1.0, 1.0, 20.0])
