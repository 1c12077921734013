"""The compiled rollout: its parameters, its batches, what diverges."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rich_model import CONTROLLERS, LEMON, everything

from whiptool.dynamics.structure import Structure
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout

TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)


@pytest.mark.slow
def test_every_free_parameter_changes_the_compiled_model():
    """Models and controllers, one number at a time; a change that leaves all strikes as they were is a lost one."""
    model = everything()
    controller = Controller(ConstantImpedance(), torque_limit=2.0, feedforward=True)
    strikes = STRIKES[:3]

    def outcome(model: Model, controller: Controller, strikes: np.ndarray = strikes) -> np.ndarray:
        assert Structure.of(model, controller) == structure  # the same code, other numbers
        near = CompiledRollout(model, controller, timestep=1e-3).approach(strikes, TARGET, t_stay=0.3)
        return np.concatenate([near.tip.ravel(), near.max_torque.ravel()])

    structure = Structure.of(model, controller)
    base = outcome(model, controller)
    parameters = model.parameters()
    no_effect = {"whip.rest_angle[0]"}  # the hinge has no spring ...
    model_with_hinge = model.with_parameters({"whip.k[0]": 0.2})
    base_with_hinge = outcome(model_with_hinge, controller)
    for name, value in parameters.items():
        origin, before = (model_with_hinge, base_with_hinge) if name in no_effect else (model, base)  # ... unless given
        more = 1.0 if "cubic" in name else 1e-3  # joints bend little, those near the tip by some thousandths
        changed = outcome(origin.with_parameters({name: value * 1.05 + more}), controller)
        assert np.abs(changed - before).max() > 1e-9, name
    law = controller.law
    for name in ("K", "B"):
        for i in range(2):
            for j in range(2):
                matrix = np.array(getattr(law, name))
                matrix[i, j] *= 1.05
                other = dataclasses.replace(controller, law=dataclasses.replace(law, **{name: matrix}))
                assert np.abs(outcome(model, other) - base).max() > 1e-9, (name, i, j)
    assert np.abs(outcome(model, dataclasses.replace(controller, torque_limit=2.1)) - base).max() > 1e-9
    for i in range(5):
        shifted = strikes + 0.01 * np.eye(5)[i]
        assert np.abs(outcome(model, controller, shifted) - base).max() > 1e-9, i
    adaptive = Controller(OIAC(a=1e-3))
    structure = Structure.of(model, adaptive)
    base = outcome(model, adaptive)
    for name in ("a", "beta", "C"):
        other = Controller(dataclasses.replace(adaptive.law, **{name: getattr(adaptive.law, name) * 1.05}))
        assert np.abs(outcome(model, other) - base).max() > 1e-9, name


def test_batches_do_not_depend_on_their_size():
    rollout = CompiledRollout(LEMON, CONTROLLERS["oiac"], timestep=1e-3)
    strikes = default_bounds(LEMON.arm).sample(np.random.default_rng(1), 200)  # several chunks, several threads
    together = rollout.approach(strikes, TARGET, t_stay=0.3)
    alone = [rollout.approach(s[None], TARGET, t_stay=0.3).distance[0] for s in strikes[::20]]
    np.testing.assert_array_equal(together.distance[::20], alone)
    targets = np.random.default_rng(2).normal(size=(200, 2))
    each = rollout.approach(strikes, targets, t_stay=0.3)
    one = rollout.approach(strikes[7:8], targets[7], t_stay=0.3)
    assert each.distance[7] == one.distance[0]


def test_divergence_is_reported_and_alone():
    """A spring far too stiff for the step; test_engine.py has the lanes beside a diverging one."""
    wild = Controller(ConstantImpedance(K=((1e7, 0), (0, 1e7)), B=((0, 0), (0, 0))))
    near = CompiledRollout(LEMON, wild, timestep=2.5e-4).approach(STRIKES[:3], TARGET, t_stay=0.3)
    assert near.diverged.all()
    path = CompiledRollout(LEMON, wild, timestep=2.5e-4).trajectory(Strike.from_vector(STRIKES[0]), t_stay=0.3)
    assert path.diverged
    assert len(path.t) < 2000
    assert np.isfinite(path.q).all()
    assert not CompiledRollout(LEMON, CONTROLLERS["oiac"]).approach(STRIKES, TARGET, t_stay=0.3).diverged.any()
