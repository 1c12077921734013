"""Calls as a new user types them before looking anything up: each works, and gives the right value.

A snippet is evaluated with `wt`, `np`, `model`, `rollout`, `strike`, `path`, `target`, `objective` and `folder` in
reach; beside it stands what holds of its value, `it`.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.optimize import minimize

import whiptool as wt
from whiptool.errors import InputError
from whiptool.rl.settings import TrainingPlan

pytestmark = pytest.mark.filterwarnings("ignore:Animation was deleted")
MODEL = wt.load_model("lemon2024")
STRIKE = wt.Strike((-1.36, 0.47), (1.73, 1.41), 0.95)
TARGET = wt.Target((1.25, 0.2))


def weights(path: wt.Trajectory) -> np.ndarray:
    """Torques that hold arm and whip up, the whip's mass at the hand (Eq. 3), from the arms of the weights, (T, 2)."""
    (one, two), m = MODEL.arm.links, MODEL.whip.mass
    upper = np.sin(path.q[:, 0])
    fore = np.sin(path.q[:, 0] + path.q[:, 1])
    elbow = 9.81 * (two.mass * two.com + m * two.length) * fore
    shoulder = elbow + 9.81 * (one.mass * one.com + (two.mass + m) * one.length) * upper
    return np.stack([shoulder, elbow], axis=1)


class Here(dict):
    """What is in reach of a snippet: made when it is first asked for."""

    made: dict[str, object] = {}  # noqa: RUF012

    def __init__(self, folder: Path) -> None:
        super().__init__(
            wt=wt, np=np, near=pytest.approx, weights=weights, model=MODEL, strike=STRIKE, target=TARGET, folder=folder
        )

        self["minimize"] = minimize

    def __missing__(self, name: str) -> object:
        if name == "objective":  # counts its trials: another one for each snippet
            self[name] = wt.Objective(self["rollout"], TARGET, max_trials=12)
            return self[name]
        if name not in self.made:
            self.made[name] = {
                "rollout": lambda: wt.CompiledRollout(MODEL, wt.Controller(), timestep=1e-3),
                "path": lambda: self["rollout"].trajectory(STRIKE),
                "reference": lambda: self["rollout"].approach(STRIKE, TARGET),
            }[name]()
        return self.made[name]


DATA = [
    ("wt.Target(1.25, 0.2)", "it == wt.Target((1.25, 0.2)) and it.hit_radius == 0.06"),
    ("wt.Target(1.2, 0.3, 0.5)", "it == wt.Target((1.2, 0.3, 0.5))"),
    ("wt.Target(1.25, 0.2, hit_radius=0.03)", "it == wt.Target((1.25, 0.2), 0.03)"),
    ("wt.Target([1.25, 0.2])", "it == target"),
    ("wt.Target(np.array([1.25, 0.2]))", "it == target"),
    ("wt.Strike(-1.36, .47, 1.73, 1.41, .95)", "it == strike and it.q_f == (1.73, 1.41) and it.D == 0.95"),
    ("wt.Strike([-1.36, .47, 1.73, 1.41, .95])", "it == strike"),
    ("wt.Strike(-1, 1, 0.5)", "it == wt.Strike((-1,), (1,), 0.5)"),
    ("list(strike)", "it == [-1.36, 0.47, 1.73, 1.41, 0.95]"),
    ("np.asarray(strike)", "it.tolist() == list(strike)"),
    ("wt.presets()", "'lemon2024' in it and all(wt.load_model(name).name == name for name in it)"),
    ("wt.load_model('lemon2024')", "it == wt.preset('lemon2024')"),
    (
        "wt.default_bounds(model).sample(100, seed=1)",
        "it.shape == (100, 5) and (it >= wt.default_bounds(model).box[0]).all()",
    ),
]
MODELS = [
    (
        "model.with_whip(length=1.0)",
        "it.whip.length == near(1) and it.whip.mass == near(0.012 / 0.072)",
    ),
    ("model.with_whip(nodes=24)", "it.whip.k == near(2 * 0.242) and it.whip.mass == near(0.144)"),
    (
        "model.with_whip(length=1.2, nodes=20, taper=0.5)",
        "it.whip.N == 20 and it.whip.mass == near(0.2 * 0.75 / np.log(4))"  # the integral of 4^-s
        " and it.whip.k[2] / it.whip.k[1] == near(0.5 ** (4 / 20))",
    ),
    (
        "model.with_whip(taper=0.5).with_whip(nodes=20)",
        "np.allclose(it.whip.m, model.with_whip(nodes=20, taper=0.5).whip.m)",
    ),
    (
        "wt.load_model('ur5e').with_whip(length=0.8, nodes=10)",
        "it.whip.joints == 'rod' and it.whip.length == near(0.8)",
    ),
    ("model.arm.lengths", "it.tolist() == [0.31, 0.34]"),
    (
        "model.with_arm(lengths=[0.3, 0.4])",
        "it.arm.lengths == near([0.3, 0.4]) and it.arm.links[1].com == near(0.2)",
    ),
    (
        "wt.load_model('nah2023').with_arm(lengths=[0, 0, 0.588, 0.291])",
        "it.arm.lengths == near([0, 0, 0.588, 0.291]) and it.arm.links[2].com[2] == near(-0.258)"
        " and it.arm.links[3].com == wt.load_model('nah2023').arm.links[3].com",
    ),
]
SEARCHES = [
    ("wt.search(rollout, target)", "it.hit and it.method == 'directl' and it.outcome.miss_distance < 0.06"),
    ("wt.search(rollout, (1.25, 0.2), 'random', seed=1, max_trials=5)", "it.n_trials <= 5 and it.method == 'random'"),
    ("wt.search(objective)", "it.method == 'directl' and it.n_trials == 12"),
    ("wt.search(objective, 'direct-l')", "it.trace == wt.search(wt.Objective(rollout, target, max_trials=12)).trace"),
    ("wt.search(objective, 'DIRECT_L')", "it.method == 'directl'"),
    ("wt.search(objective, 'cma-es')", "it.method == 'cmaes'"),
    ("wt.search(objective, 'CMAES')", "it.method == 'cmaes'"),
    ("wt.search(objective, method='Random', seed=3)", "it.method == 'random'"),
    ("wt.search(objective, 'nlopt:gn-crs2-lm')", "it.method == 'nlopt:GN_CRS2_LM'"),
]
PATHS = [
    ("path.tip_speed", "np.allclose(it**2, (path.tip_velocity**2).sum(axis=1)) and it.shape == path.t.shape"),
    ("path.tracking_error", "np.array_equal(it, path.q_d - path.q[:, :2])"),
    ("rollout.simulate([-1.36, .47, 1.73, 1.41, .95])", "np.array_equal(it.q, path.q)"),
    ("path.times", "it is path.t and path.torques is path.tau and path.positions is path.q"),
    ("path.duration", "it == near(0.95 + 0.3)"),
    ("path.miss(target)", "it == path.distance(target).min() or 0 <= path.distance(target).min() - it < 1e-3"),
    (
        "path.to_dataframe()",
        "np.array_equal(it['q.whip[1]'], path.q[:, 3]) and np.array_equal(it['tip.y'], path.tip[:, 1])",
    ),
    ("path.to_dataframe()", "np.array_equal(it['K.shoulder.elbow'], path.K[:, 0, 1]) and len(it) == len(path.t)"),
    ("path.to_csv()", "np.array_equal(np.loadtxt(it.splitlines(), delimiter=',', skiprows=1)[:, 1:15], path.q)"),
    ("path.to_csv(f'{folder}/a.csv')", "(folder / 'a.csv').read_text() == path.to_csv()"),
    ("path.save(f'{folder}/a.npz')", "np.array_equal(wt.Trajectory.load(f'{folder}/a.npz').tip, path.tip)"),
]
FIGURES = [
    (
        "wt.plot_tracking(path)",
        "it.shape == (2,) and 'joint1: RMS' in it[0].get_legend().get_texts()[0].get_text()",
    ),
    ("wt.plot_tracking(path, model)", "'shoulder: RMS' in it[0].get_legend().get_texts()[0].get_text()"),
    ("wt.plot_torque(path, model)", "np.array_equal(it.lines[1].get_ydata(), path.tau[:, 1])"),
    ("wt.plot_torque(path)", "it.get_ylabel() == 'torque [N m]'"),
    ("wt.plot_tip_speed(path)", "it.lines[1].get_ydata()[0] == path.tip_speed.max()"),
    ("wt.animate(path, model, target)", "it.count == 1 + np.ceil(path.t[-1] / (0.25 / 25))"),
    (
        "wt.similarity(path.t, path.tip, path.tip + [0.003, 0.004])",
        "abs(it.rmse - 0.005) + abs(it.delay) < 1e-12",
    ),
]
OUTCOMES = [
    ("objective(strike)", "float(it) == it.miss_distance == objective.trials[0].outcome.cost"),
    (
        "minimize(wt.Objective(rollout, target), strike, method='Nelder-Mead', options={'maxfev': 8})",
        "it.fun <= float(objective(strike)) and it.x.shape == (5,)",
    ),
]
LAWS = [
    ("wt.ConstantImpedance(100, 10)", "it.gains(np.zeros(3), np.zeros(3))[0].tolist() == (100 * np.eye(3)).tolist()"),
    ("wt.ConstantImpedance([100, 50], [10, 5])", "it.K == ((100, 0), (0, 50)) and it.B == ((10, 0), (0, 5))"),
    (
        "wt.CompiledRollout(model, wt.Controller(wt.ConstantImpedance(30, 3)), timestep=1e-3).trajectory(strike)",
        "np.allclose(it.tau - 30 * it.tracking_error - 3 * (it.v_d - it.v[:, :2]), weights(it), atol=1e-9)",
    ),
]
LEARNING = [
    (
        "wt.compare(rollout, ['direct-l'], targets=2, max_trials=5)",
        "[one.method for one in it] == ['directl', 'random'] and it[0].trials.shape == (1, 2)",
    ),
]


@pytest.mark.parametrize(
    ("snippet", "holds"), [*DATA, *MODELS, *SEARCHES, *PATHS, *FIGURES, *OUTCOMES, *LAWS, *LEARNING]
)
def test_what_is_guessed_works(snippet, holds, tmp_path):
    here = Here(tmp_path)
    here["it"] = eval(snippet, here)
    assert eval(holds, here), here["it"]
    plt.close("all")


def test_a_policy_is_trained_and_asked_as_elsewhere():
    """`predict` is Stable-Baselines3's: an action for one observation or many, and no state."""
    here = Here(Path())
    policy = wt.train(here["rollout"], wt.Disc((1.2, 0.1), 0.2), "SAC", plan=TrainingPlan(2, 4, 0), progress=False)
    env = wt.WhipEnv(zone=wt.Disc((1.2, 0.1), 0.2))
    seen, info = env.reset(seed=0)
    action, state = policy.predict(seen, deterministic=True)
    assert state is None
    assert env.action_space.contains(action)
    expected = policy.task.to_strikes(action[None].astype(float))[0]
    np.testing.assert_allclose(policy.strike(info["target"]), expected, atol=1e-6)
    both, _ = policy.predict(np.stack([seen, seen]), deterministic=True)
    np.testing.assert_allclose(both, [action, action], atol=1e-6)
    with pytest.raises(InputError, match=r"observation: got \[1, 2\]; allowed: 6 finite numbers"):
        policy.predict([1, 2])


def test_a_function_stays_one_when_the_command_of_its_name_is_imported():

    for name in ("train", "compare"):
        door = import_module(f"whiptool.{name}")
        assert door.main is not getattr(wt, name)
        assert callable(getattr(wt, name))


@pytest.mark.parametrize(
    ("snippet", "said"),
    [
        (
            "wt.Strike(1, 2, 3, 4)",
            "strike: got [1.0, 2.0, 3.0, 4.0]; allowed: joint positions q_i, as many q_f, and D [s]: 5",
        ),
        ("wt.Target(1.0)", "target: got (1.0,); allowed: two finite coordinates x y in m, or three in space"),
        ("wt.search(objective, 'cma')", "method: got 'cma'; allowed: directl, gradient, map, cmaes"),
        ("wt.search(objective, max_trials=3)", "search: got 'max_trials'; allowed: only method, seed and first"),
        ("model.with_whip(nodes=0)", "nodes: got 0; allowed: a whole number from 1 to 200"),
        ("model.with_arm(lengths=[1])", "lengths: got [1]; allowed: 2 finite numbers"),
        ("wt.load_model('ur5e').with_arm(lengths=range(6))", "lengths: got "),
        ("wt.search(model, target)", "objective: got Model; allowed: Objective or Rollout"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(snippet, said, tmp_path):
    with pytest.raises(InputError) as refused:
        eval(snippet, Here(tmp_path))
    assert str(refused.value).startswith(said)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("snippet", "said"),
    [
        ("model.save('my.toml')", "Model has no attribute 'save'; whiptool.write_model(model, path) writes it"),
        ("wt.search(objective).miss", "Result has no attribute 'miss'; result.miss_distance is the best strike's"),
        ("path.plot()", "Trajectory has no attribute 'plot'; whiptool.plot_strike(path, model, target) draws it"),
        (
            "wt.search(rollout, target, budget=9)",
            "argument of search: got 'budget'; allowed: ... did you mean max_trials?",
        ),
        (
            "wt.search(rollout, target, max_trial=9)",
            "argument of search: got 'max_trial'; ... did you mean max_trials?",
        ),
        ("model.wings", "Model has no attribute 'wings'"),
    ],
)
def test_what_has_another_name_is_said_with_it(snippet, said, tmp_path):
    with pytest.raises((AttributeError, InputError)) as refused:
        eval(snippet, Here(tmp_path))
    assert all(part in str(refused.value) for part in said.split(" ... "))


def test_a_table_without_pandas_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setattr("whiptool.extras.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"a data frame: the package pandas is not installed; .*: pip install pandas"):
        Here(Path())["path"].to_dataframe()
