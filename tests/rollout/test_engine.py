"""Engines agree: CasADi's interpreter, scalar and SIMD code."""

from __future__ import annotations

import dataclasses
import logging
import tracemalloc

import numpy as np
import pytest
from rich_model import COMPUTED, CONTROLLERS, EVERY_RUNG, LEMON, everything
from slopes import compare

from whiptool.dynamics.structure import Structure
from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout
from whiptool.rollout import compiler as compiler_module
from whiptool.rollout import engine as engine_module

TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)


@pytest.mark.parametrize("controller", CONTROLLERS.values(), ids=CONTROLLERS)
@pytest.mark.parametrize("model", [LEMON, everything()], ids=["lemon2024", "everything"])
def test_interpreter_and_compiled_code_agree(model, controller):
    native, slow = (
        CompiledRollout(model, controller, timestep=2.5e-4, engine=name) for name in ("scalar", "interpreter")
    )
    assert (native.engine, slow.engine) == ("scalar", "interpreter")
    a, b = (r.approach(STRIKES[:4], TARGET, t_stay=0.3) for r in (native, slow))
    for name in COMPUTED:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-8, atol=1e-9)


RNG = np.random.default_rng(21)
STRIKES_ENGINE = default_bounds(LEMON.arm).sample(RNG, 200)
TARGETS = TARGET + RNG.uniform(-0.3, 0.3, (200, 2))


def mixed() -> tuple[list, list]:
    """A model and a controller per strike, all of one structure, most of them different."""
    rng = np.random.default_rng(4)
    rich = everything()
    models = [
        rich.with_parameters({
            "gravity": rng.uniform(8, 11), "arm.mass[0]": rng.uniform(0.2, 0.4), "whip.k[4]": rng.uniform(0.1, 0.4),
            "whip.b[7]": rng.uniform(0.05, 0.15), "whip.m[11]": rng.uniform(0.008, 0.02),
        })
        for _ in range(50)
    ]  # fmt: skip
    controllers = [Controller(OIAC(a=a)) for a in np.geomspace(5e-4, 0.2, 10)]
    return [models[i % 50] for i in range(200)], [controllers[i % 7] for i in range(200)]


@pytest.mark.slow
def test_all_engines_agree_on_mixed_batches():
    """Random strikes, models, targets and controllers."""
    models, controllers = mixed()
    results = {}
    for name in engine_module.RUNGS:
        rollout = CompiledRollout(models[0], controllers[0], timestep=1e-3, engine=name)
        assert rollout.engine == name
        results[name] = rollout.approach(STRIKES_ENGINE, TARGETS, t_stay=0.3, models=models, controllers=controllers)
    assert not results["simd"].diverged.any()
    for name, near in results.items():
        assert np.abs(near.distance - results["simd"].distance).max() < 1e-7, name
        np.testing.assert_allclose(near.tip, results["simd"].tip, atol=1e-6)
        np.testing.assert_allclose(near.max_joint_speed, results["simd"].max_joint_speed, rtol=1e-6)
    one = CompiledRollout(models[3], controllers[3], timestep=1e-3).approach(
        STRIKES_ENGINE[3:4], TARGETS[3], t_stay=0.3
    )
    assert one.distance[0] == pytest.approx(results["simd"].distance[3], abs=1e-12)


@pytest.mark.parametrize("name", ["simd", "scalar"])
def test_a_diverging_lane_leaves_the_others_bit_identical(name):
    calm = Controller(ConstantImpedance())
    wild = Controller(ConstantImpedance(K=((1e7, 0), (0, 1e7)), B=((0, 0), (0, 0))))
    rollout = CompiledRollout(LEMON, calm, timestep=1e-3, engine=name)
    strikes = STRIKES_ENGINE[:24].copy()
    strikes[:, -1] = 0.8  # one order, whatever the controllers
    alone = rollout.approach(strikes, TARGETS[:24], t_stay=0.3)
    controllers = [wild if i in (2, 11, 17) else calm for i in range(24)]
    together = rollout.approach(strikes, TARGETS[:24], t_stay=0.3, controllers=controllers)
    assert np.flatnonzero(together.diverged).tolist() == [2, 11, 17]
    others = ~together.diverged
    for name in COMPUTED:
        np.testing.assert_array_equal(getattr(together, name)[others], getattr(alone, name)[others])


def test_models_outside_the_structure_are_refused():
    rollout = CompiledRollout(LEMON, Controller())
    with pytest.raises(InputError, match=r"got .optional .*; allowed: as this rollout has: optional .*all these terms"):
        rollout.approach(STRIKES_ENGINE[:2], TARGET, t_stay=0.3, models=[LEMON, everything()])
    held = [Controller(), Controller(control_period=0.002)]
    with pytest.raises(
        InputError, match=r"got 'control_period 0.002'; allowed: as this rollout has: control_period None"
    ):
        rollout.approach(STRIKES_ENGINE[:2], TARGET, t_stay=0.3, controllers=held)
    with pytest.raises(InputError, match="shape"):
        rollout.approach(STRIKES_ENGINE[:2, :4], TARGET, t_stay=0.3)
    with pytest.raises(InputError, match="simd, scalar, interpreter"):
        CompiledRollout(LEMON, Controller(), engine="gpu")


def test_the_environment_forces_an_engine(monkeypatch):
    for name in engine_module.RUNGS:
        monkeypatch.setenv("WHIPTOOL_ENGINE", name)
        assert CompiledRollout(LEMON, Controller()).engine == name
    monkeypatch.setenv("WHIPTOOL_ENGINE", "abacus")
    with pytest.raises(InputError, match="WHIPTOOL_ENGINE: got 'abacus'"):
        CompiledRollout(LEMON, Controller())


def test_a_compiler_without_simd_falls_to_scalar(monkeypatch, caplog, tmp_path):
    """A wrapper that refuses vectors stands for another compiler."""
    real = compiler_module.find_compiler()
    wrapper = tmp_path / "plain-c++"
    wrapper.write_text(
        '#!/bin/sh\nfor word in "$@"; do [ "$word" = -DSIMD=1 ] && echo "no vectors" >&2 && exit 1; done\n'
        f'exec {real} "$@"\n',
        encoding="utf-8",
    )
    wrapper.chmod(0o755)
    monkeypatch.setenv("CXX", str(wrapper))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # else the real compiler's library is found
    caches = (compiler_module.find_compiler, engine_module.find_engine)
    for function in caches:
        function.cache_clear()
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        rollout = CompiledRollout(LEMON, Controller())
        engine = rollout.engine
    monkeypatch.delenv("CXX")
    for function in caches:
        function.cache_clear()
    assert engine == "scalar"
    assert [record.message for record in caplog.records] == [f"{wrapper} failed (no vectors); trying something simpler"]


STRIKE_NAMES = ("q_si", "q_ei", "q_sf", "q_ef", "D")
LAWS = {
    "constant": Controller(ConstantImpedance(), torque_limit=12.0),
    "oiac": Controller(OIAC(a=5e-3), feedforward=True),
    "held": Controller(ConstantImpedance(), control_period=0.001),
}


def central(rollout, strikes, targets, name, size) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of the miss distance, and an estimate of their own error, each (B,)."""
    values = {}
    for k in (-2, -1, 1, 2):
        if name in STRIKE_NAMES:
            shifted = strikes.copy()
            shifted[:, STRIKE_NAMES.index(name)] += k * size
            near = rollout.approach(shifted, targets, t_stay=0.3)
        else:
            model, controller = shifted_parameter(rollout, name, k * size)
            other = CompiledRollout(model, controller, timestep=rollout.timestep, free=rollout.free)
            near = other.approach(strikes, targets, t_stay=0.3)
        values[k] = near.distance
    narrow, wide = (values[1] - values[-1]) / (2 * size), (values[2] - values[-2]) / (4 * size)
    return (4 * narrow - wide) / 3, np.abs(narrow - wide) / 3


def differs(slope, difference, own_error, size):
    """Whether by more than the rounding of the rollout over the step, and the difference's truncation."""
    return np.abs(slope - difference) > 1e-5 * np.abs(difference) + 1e-12 / size + 3 * own_error


def shifted_parameter(rollout, name, by):
    model, controller = rollout.model, rollout.controller
    if name in model.parameters():
        return model.with_parameters({name: model.parameters()[name] + by}), controller
    if name == "torque_limit":
        return model, dataclasses.replace(controller, torque_limit=controller.torque_limit + by)
    block, _, index = name.removeprefix("law.").partition("[")
    law = controller.law
    if not index:
        return model, dataclasses.replace(controller, law=dataclasses.replace(law, **{block: getattr(law, block) + by}))
    matrix = np.array(getattr(law, block))
    matrix.flat[int(index[:-1])] += by
    return model, dataclasses.replace(controller, law=dataclasses.replace(law, **{block: matrix}))


@pytest.mark.slow
@pytest.mark.parametrize("case", LAWS)
def test_derivatives_against_central_differences(case):
    """Every named parameter of strike, model and controller, on random strikes.

    A strike is left out for a parameter where the difference itself does not hold still: at a kink (two approaches
    equally near, a torque at its limit, a step more) its two widths disagree, or a narrower one. They are few.
    """
    controller = LAWS[case]
    model = everything().with_parameters({"arm.friction[0]": 0.05, "arm.friction[1]": 0.03})
    strikes, targets = STRIKES_ENGINE[:40], TARGETS[:40]
    rollout = CompiledRollout(model, controller, timestep=1e-3)
    names = [*STRIKE_NAMES, *model.parameters(), *controller.parameters()]
    if case != "constant":  # every parameter once; elsewhere a third of them
        names = names[:5] + names[5::3]
    near, slopes = rollout.gradient(strikes, targets, t_stay=0.3, names=names)
    np.testing.assert_allclose(near.distance, rollout.approach(strikes, targets, t_stay=0.3).distance, atol=1e-9)
    kinks = compared = 0
    for slope, name in zip(slopes.T, names, strict=True):
        value = 1.0 if name in STRIKE_NAMES else {**model.parameters(), **controller.parameters()}[name]
        size = 1e-5 * max(abs(value), 1e-3)
        difference, own_error = central(rollout, strikes, targets, name, size)
        smooth = own_error <= 1e-3 * np.abs(difference) + 1e-6 / size * 1e-4
        if name == "D":  # the number of steps is whole: where it changes, the discrete path jumps by its own error
            ends = strikes[:, -1, None] + 0.3 + 2 * size * np.array([-1, 1])
            smooth &= np.ptp(np.ceil(ends / rollout.timestep - 1e-9), axis=1) == 0
        wrong = smooth & differs(slope, difference, own_error, size)
        for i in np.flatnonzero(wrong):  # a kink inside both widths makes them agree: there a narrower one holds
            narrow = central(rollout, strikes[i : i + 1], targets[i : i + 1], name, size / 30)
            wrong[i], smooth[i] = differs(slope[i], *narrow, size / 30).item(), False
        assert not wrong.any(), (name, slope[wrong], difference[wrong])
        kinks += int((~smooth).sum())
        compared += len(smooth)
    assert kinks < 0.03 * compared, (kinks, compared)


def test_derivatives_of_the_tip_at_its_closest_approach_against_differences():
    """Of its place and its velocity, by the strike; where the closest approach jumps to another step, none holds."""
    strikes, targets = STRIKES_ENGINE[:24], TARGETS[:24]
    rollout = CompiledRollout(everything(), LAWS["constant"], timestep=1e-3)
    near, dtip, dvelocity = rollout.arrival_gradient(strikes, targets, t_stay=0.3)
    away = (near.tip - targets) / near.distance[:, None]
    of_distance = rollout.gradient(strikes, targets, t_stay=0.3)[1]
    np.testing.assert_allclose(np.einsum("bd,bdm->bm", away, dtip), of_distance, atol=1e-9)
    moving = 0
    for j in range(4):  # the steps of a strike move with D: see the test above
        for slopes, what in ((dtip, "tip"), (dvelocity, "velocity")):
            for coordinate in range(2):

                def seen(by: float, j: int = j, what: str = what, coordinate: int = coordinate) -> np.ndarray:
                    shifted = strikes.copy()
                    shifted[:, j] += by
                    return getattr(rollout.approach(shifted, targets, t_stay=0.3), what)[:, coordinate]

                wrong, still = compare(slopes[:, coordinate, j], seen, 3e-6)
                assert not wrong.any(), (j, what, coordinate)
                moving += int(still.sum())
    assert moving > 0.8 * 4 * 2 * 2 * len(strikes)


@pytest.mark.slow
@pytest.mark.parametrize("rung", EVERY_RUNG[1:])
def test_engines_agree_on_the_derivatives_of_the_tip(rung):
    strikes, targets = STRIKES_ENGINE[:6], TARGETS[:6]
    best, other = (CompiledRollout(everything(), LAWS["constant"], timestep=1e-3, engine=x) for x in (None, rung))
    slopes = [x.arrival_gradient(strikes, targets, t_stay=0.3)[1:] for x in (best, other)]
    for expected, found in zip(*slopes, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
def test_a_parameter_whose_term_is_zero_can_be_freed():
    names = ["whip.drag", "whip.hinge_mass", "whip.rest_angle"]
    rollout = CompiledRollout(LEMON, Controller(ConstantImpedance()), free=names, tolerance=1e-6)
    _, slopes = rollout.gradient(STRIKES_ENGINE[:20], TARGET, t_stay=0.3, names=names)
    for slope, name in zip(slopes.T, names, strict=True):
        changed = LEMON.with_parameters({name: 1e-9})
        moved = CompiledRollout(changed, rollout.controller, free=names, tolerance=1e-6)
        difference = (
            moved.approach(STRIKES_ENGINE[:20], TARGET, t_stay=0.3).distance
            - rollout.approach(STRIKES_ENGINE[:20], TARGET, t_stay=0.3).distance
        ) / 1e-9
        np.testing.assert_allclose(slope, difference, rtol=1e-3, atol=1e-4 * np.abs(difference).max())
    with pytest.raises(InputError, match="free"):
        CompiledRollout(LEMON, Controller()).gradient(STRIKES_ENGINE[:1], TARGET, t_stay=0.3, names=["whip.drag"])
    with pytest.raises(InputError, match="one of q_si"):
        rollout.gradient(STRIKES_ENGINE[:1], TARGET, t_stay=0.3, names=["whip.colour"])


@pytest.mark.parametrize("name", EVERY_RUNG)
def test_tip_paths_and_their_derivatives(name):
    """Paths at a given rate against the trajectory's own steps; derivatives against differences at fixed times."""
    rollout = CompiledRollout(LEMON, Controller(OIAC(a=5e-3)), timestep=5e-4, engine=name)
    strikes = STRIKES_ENGINE[:3]
    names = ["q_si", "D", "whip.k", "law.a"]
    times, path, slopes = rollout.tip_path(strikes, t_stay=0.3, rate=60.0, names=names)
    assert path.shape == (3, len(times), 2)
    assert slopes.shape == (3, len(times), 2, 4)
    for vector, samples in zip(strikes, path, strict=True):
        fine = rollout.trajectory(Strike.from_vector(vector), t_stay=0.3)
        inside = times <= fine.t[-1]
        assert np.isnan(samples[~inside]).all()
        exact = np.stack([np.interp(times[inside], fine.t, fine.tip[:, c]) for c in range(2)], axis=1)
        np.testing.assert_allclose(samples[inside], exact, atol=2e-4)
    _, plain, _ = rollout.tip_path(strikes, t_stay=0.3, rate=60.0)
    np.testing.assert_allclose(plain, path, atol=1e-9)
    alone = rollout.approach(strikes, np.zeros(2), t_stay=0.3)
    near, again = rollout.peaks_and_path(strikes, t_stay=0.3, rate=60.0)
    np.testing.assert_array_equal(again, plain)
    for field in dataclasses.fields(alone):
        np.testing.assert_array_equal(getattr(near, field.name), getattr(alone, field.name))
    for k, (parameter, size) in enumerate(zip(names, (1e-6, 1e-6, 1e-6, 1e-8), strict=True)):
        sides = []
        for sign in (1, -1):
            if parameter in STRIKE_NAMES:
                moved = strikes + sign * size * np.eye(5)[STRIKE_NAMES.index(parameter)]
                sides.append(rollout.tip_path(moved, t_stay=0.3, rate=60.0)[1])
            else:
                model, controller = shifted_parameter(rollout, parameter, sign * size)
                other = CompiledRollout(model, controller, timestep=5e-4, engine=name)
                sides.append(other.tip_path(strikes, t_stay=0.3, rate=60.0)[1])
        difference = (sides[0] - sides[1]) / (2 * size)
        ok = np.isfinite(difference) & np.isfinite(slopes[..., k])
        scale = np.abs(difference[ok]).max()
        np.testing.assert_allclose(slopes[..., k][ok], difference[ok], rtol=1e-4, atol=2e-5 * scale)


@pytest.mark.slow
def test_many_strikes_run_in_bounded_memory():
    """What a strike leaves behind is its outcome; its parameters are packed for a few thousand at a time."""
    rollout = CompiledRollout(LEMON, Controller(ConstantImpedance()), timestep=4e-3)
    strikes = default_bounds(LEMON.arm).sample(np.random.default_rng(0), 40_000)
    tracemalloc.start()
    near = rollout.approach(strikes, TARGET, t_stay=0.3)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(near.distance) == 40_000
    assert peak < 30e6 + 300 * 40_000  # bytes; all parameters at once would be 23 MB more, trajectories gigabytes


def test_structures_share_their_parameters():
    free = Structure.of(LEMON, Controller(), free=["whip.dry_friction[3]", "whip.friction_velocity", "q_si"])
    assert free.optional == ("dry_friction",)
    assert free.columns("whip.m") == slice(5 + 10 + 12, 5 + 10 + 24)


def test_without_a_compiler_the_interpreter_runs_and_says_so_once(monkeypatch, caplog):
    monkeypatch.setenv("CXX", "no-such-compiler")
    compiler_module.find_compiler.cache_clear()
    engine_module.find_engine.cache_clear()
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        rollout = CompiledRollout(LEMON, CONTROLLERS["constant"], timestep=2e-3)
        CompiledRollout(LEMON, CONTROLLERS["constant"], timestep=1e-3)
    monkeypatch.delenv("CXX")
    compiler_module.find_compiler.cache_clear()
    engine_module.find_engine.cache_clear()
    assert rollout.engine == "interpreter"
    assert len(caplog.records) == 1
