"""The Gymnasium environments: the interface kept, one strike a step, lanes that equal single environments."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import whiptool.rl.environment as environment
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.target import Target
from whiptool.goals.zone import Disc
from whiptool.lazy_names import ID
from whiptool.objective import Objective
from whiptool.rl.task import OBSERVATIONS


@pytest.fixture(autouse=True)
def _one_thread():
    """Two threads that wait for a core that others use are slower than one."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.filterwarnings("ignore:.*minimum value is -infinity", "ignore:.*maximum value is infinity")
@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_gymnasiums_checker_finds_nothing_but_unbounded_velocities(observation, recwarn):
    env = gymnasium.make(ID, observation=observation)
    check_env(env.unwrapped)
    assert not [str(w.message) for w in recwarn if "infinity" not in str(w.message)]


@pytest.mark.parametrize("imports", ["gymnasium", "whiptool, gymnasium"])
@pytest.mark.parametrize("module", ["whiptool", "whiptool.rl.environment"])
def test_the_id_is_known_by_its_module_alone(module, imports):
    code = (
        f"import {imports}; env = gymnasium.make('{module}:{ID}'); env.reset(seed=0); "
        f"gymnasium.make_vec('{ID}', num_envs=2).reset(seed=0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_step_is_a_strike():
    env = gymnasium.make(ID).unwrapped
    obs, info = env.reset(seed=3, options={"target": (1.25, 0.05)})
    assert obs == pytest.approx([0, -env.task.rollout.model.reach, 0, 0, 1.25, 0.05])
    assert info["target"].tolist() == [1.25, 0.05]
    rng, hits = np.random.default_rng(0), 0
    objective = Objective(env.task.rollout, Target((1.25, 0.05)))
    for action in rng.uniform(-1, 1, (40, 5)):
        lower, upper = env.task.bounds.box
        outcome = objective(lower + (action + 1) / 2 * (upper - lower))
        obs, reward, terminated, truncated, info = env.step(action)
        assert obs == pytest.approx([*outcome.tip, *outcome.tip_velocity, 1.25, 0.05], rel=1e-6)
        assert (info["miss_distance"], info["tip_speed"]) == pytest.approx((outcome.miss_distance, outcome.tip_speed))
        assert terminated == outcome.hit == (reward == 50) == info["is_success"]
        assert isinstance(info["is_success"], bool)
        assert info.get("hit_time") == outcome.hit_time
        assert not truncated
        assert not info["diverged"]
        hits += terminated
    assert 0 < hits < 40


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_the_vector_environment_equals_single_ones(observation):
    options = {"observation": observation, "zone": GoalRegion(Disc(), hit_radius=0.1), "strikes": 3}
    many, count = gymnasium.make_vec(ID, num_envs=8, **options), 8
    ones = [gymnasium.make(ID, **options) for _ in range(count)]
    obs, info = many.reset(seed=5)
    for lane, env in enumerate(ones):
        alone, _ = env.reset(options={"target": info["target"][lane]})
        assert obs[lane].tolist() == alone.tolist()
    rng, ended = np.random.default_rng(1), {"hit": 0, "truncated": 0}
    for _ in range(6):
        actions = rng.uniform(-1, 1, (count, 5))
        obs, reward, terminated, truncated, info = many.step(actions)
        assert many.observation_space.contains(obs)
        ended["hit"] += terminated.sum()
        ended["truncated"] += truncated.sum()
        for lane, env in enumerate(ones):
            seen, r, hit, cut, told = env.step(actions[lane])
            assert (r, hit, cut) == (reward[lane], terminated[lane], truncated[lane])
            over = hit or cut
            of_strike = info["final_info"] if over else info
            for name, value in told.items():
                assert of_strike["_" + name][lane]
                assert np.array_equal(of_strike[name][lane], value)
            if not hit and "hit_time" in of_strike:
                assert not of_strike["_hit_time"][lane]
            assert ("final_obs" in info and info["_final_obs"][lane]) == over
            if over:
                assert seen.tolist() == info["final_obs"][lane].tolist()
                seen, _ = env.reset(options={"target": info["target"][lane]})
            assert seen.tolist() == obs[lane].tolist()
    assert min(ended.values()) > 0


def test_the_vector_environment_tells_in_the_form_of_gymnasiums_own():
    def play(**how):
        envs = gymnasium.make_vec(ID, zone=GoalRegion(Disc(), hit_radius=0.3), num_envs=4, strikes=2, **how)
        targets = {"targets": np.full((4, 2), (1.3, 0.0)), "target": (1.3, 0.0)}
        envs.reset(options=targets)
        actions = np.random.default_rng(2).uniform(-1, 1, (2, 4, 5))
        return envs, [envs.step(a) for a in actions]

    same = {"autoreset_mode": AutoresetMode.SAME_STEP}
    (native, ours), (loop, theirs) = play(), play(vectorization_mode="sync", vector_kwargs=same)
    assert native.metadata["autoreset_mode"] is loop.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert native.observation_space == loop.observation_space
    assert native.action_space == loop.action_space
    for mine, other in zip(ours[0][1:4], theirs[0][1:4], strict=True):
        assert np.array_equal(mine, other)
    mine, other = ours[0][4], theirs[0][4]
    assert mine.keys() == other.keys()
    assert mine["final_info"].keys() == other["final_info"].keys()
    for name in ("_miss_distance", "miss_distance", "_target", "_final_obs", "_final_info"):
        assert np.array_equal(mine[name], other[name])
    for name, value in other["final_info"].items():
        assert np.array_equal(mine["final_info"][name], value)


UPWARD = ArrivalRule(angle=(np.radians(60), np.radians(120)), cone=np.radians(20), speed=2.0)
NEARER = Disc((1.0, 0.3), 0.15)


@pytest.mark.filterwarnings("ignore:.*minimum value is -infinity", "ignore:.*maximum value is infinity")
@pytest.mark.parametrize("rule", [UPWARD, ArrivalRule(direction=(0.0, 1.0)), ArrivalRule(speed=2.0)])
def test_gymnasiums_checker_finds_nothing_at_goals_with_arrivals(rule, recwarn):
    env = gymnasium.make(ID, zone=GoalRegion(NEARER, rule))
    check_env(env.unwrapped)
    assert not [str(w.message) for w in recwarn if "infinity" not in str(w.message)]
    assert env.observation_space.shape == ((8,) if rule.directed else (6,))


def test_a_step_at_a_direction_is_a_trial_of_the_objective():
    env = gymnasium.make(ID, zone=GoalRegion(NEARER, UPWARD, hit_radius=0.1)).unwrapped
    obs, info = env.reset(seed=3, options={"target": (1.0, 0.35), "angle": 1.4})
    target = Target.arriving((1.0, 0.35), 1.4, hit_radius=0.1, cone=np.radians(20), speed=2.0)
    assert target.direction is not None
    assert obs[4:] == pytest.approx([1.0, 0.35, *target.direction])
    assert info["direction"] == pytest.approx(target.direction)
    assert set(info) == {"target", "direction"}
    objective, lower, upper = Objective(env.task.rollout, target), *env.task.bounds.box
    hits, rng = 0, np.random.default_rng(0)
    for action in rng.uniform(-1, 1, (50, 5)):
        outcome = objective(lower + (action + 1) / 2 * (upper - lower))
        obs, reward, terminated, _, info = env.step(action)
        assert terminated == outcome.hit
        assert outcome.arrival is not None
        told = [info[name] for name in ("arrival_angle", "arrival_speed", "cost")]
        assert told == pytest.approx([outcome.arrival.angle, outcome.arrival.speed, outcome.arrival.cost])
        cost = outcome.arrival.cost
        assert reward == pytest.approx(50 if outcome.hit else -5 * cost if cost <= 0.1 else -10 * cost)
        hits += terminated
    assert 0 < hits < 20
    env.render_mode = "rgb_array"
    assert env.render().shape == (480, 640, 3)


def test_lanes_with_directions_equal_single_environments():
    """Each strike is its lane's last: the next goals stand in the same answer."""
    options: dict[str, Any] = {"zone": GoalRegion(NEARER, UPWARD, 0.12), "strikes": 1}
    many, one = gymnasium.make_vec(ID, num_envs=6, **options), gymnasium.make(ID, **options)
    obs, asked = many.reset(seed=4)
    rng, hits = np.random.default_rng(1), 0
    for _ in range(3):
        angles = np.arctan2(asked["direction"][:, 1], asked["direction"][:, 0])
        assert ((angles > np.radians(60)) & (angles < np.radians(120))).all()
        assert np.ptp(angles) > 0.2
        actions, shown, last = rng.uniform(-1, 1, (6, 5)), obs, asked
        obs, reward, hit, cut, asked = many.step(actions)
        assert many.observation_space.contains(obs)
        assert (hit | cut).all()
        hits += hit.sum()
        for lane in range(6):
            seen, _ = one.reset(options={"target": last["target"][lane], "angle": angles[lane]})
            np.testing.assert_allclose(seen, shown[lane], rtol=1e-6)
            seen, r, h, _, told = one.step(actions[lane])
            assert (h, r) == (hit[lane], pytest.approx(reward[lane]))
            np.testing.assert_allclose(seen, asked["final_obs"][lane], rtol=1e-6)
            for name in ("direction", "arrival_angle", "arrival_speed", "cost", "miss_distance"):
                np.testing.assert_allclose(asked["final_info"][name][lane], told[name])
    assert hits > 0
    again, _ = many.reset(options={"targets": last["target"], "angles": angles})
    np.testing.assert_allclose(again, shown, rtol=1e-6)
    with pytest.raises(InputError, match="angles"):
        many.reset(options={"angles": [1.0]})


def test_angles_are_refused_where_none_is_drawn():
    env = environment.WhipEnv(zone=GoalRegion(Disc(), ArrivalRule(direction=(0.0, 1.0))))
    with pytest.raises(InputError, match=r"arrival angles: got .* None, because the rule draws no angles"):
        env.reset(options={"angle": 1.0})
    with pytest.raises(InputError, match="angle: got nan"):
        environment.WhipEnv(zone=GoalRegion(Disc(), UPWARD)).reset(options={"angle": np.nan})


def test_seeds_decide_the_targets():
    envs, zone = gymnasium.make_vec(ID, num_envs=50), Disc()
    first, again, other = (envs.reset(seed=seed)[1]["target"] for seed in (0, 0, 1))
    assert first.tolist() == again.tolist()
    assert (first != other).all()
    assert zone.contains(first).all()
    assert (envs.reset()[1]["target"] != other).all()  # goes on drawing
    env = gymnasium.make(ID)
    assert env.reset(seed=7)[0].tolist() == env.reset(seed=7)[0].tolist() != env.reset()[0].tolist()


def test_a_picture_before_and_after_a_strike():
    env = gymnasium.make(ID, render_mode="rgb_array")
    env.reset(seed=0)
    still = np.asarray(env.render())
    env.step(np.zeros(5, np.float32))
    struck = np.asarray(env.render())
    assert still.shape == struck.shape == (480, 640, 3)
    assert still.dtype == struck.dtype == np.uint8
    assert still.std() > 5
    assert (still != struck).any()


def test_bad_input_is_refused():
    wrong: tuple[dict[str, Any], ...] = (
        {"observation": "all"},
        {"hit_radius": 0.1},
        {"strikes": 0},
        {"model": "lemon"},
        {"controller": "mine"},
    )
    for options in wrong:
        with pytest.raises(InputError):
            environment.WhipEnv(**options)
        with pytest.raises(InputError):
            environment.WhipEnvs(2, **options)
    with pytest.raises(InputError, match="render mode"):
        environment.WhipEnv(render_mode="human")
    with pytest.raises(InputError, match="num_envs"):
        environment.WhipEnvs(0)
    env, envs = environment.WhipEnv(), environment.WhipEnvs(2)
    env.reset()
    envs.reset()
    for action in ([0.0] * 4, [np.nan] * 5):
        with pytest.raises(InputError, match="action"):
            env.step(np.array(action))
        with pytest.raises(InputError, match="action"):
            envs.step(np.array([action, action]))
    with pytest.raises(InputError, match="target"):
        env.reset(options={"target": (1.0,)})
    with pytest.raises(InputError, match="targets"):
        envs.reset(options={"targets": [(1.0, 0.0)]})
    with pytest.raises(InputError, match=r"target: .*are these millimetres"):
        env.reset(options={"target": (1200, 100)})
    for one in (env, envs):
        with pytest.raises(InputError, match="got 'taget'; allowed: target, angle, targets, angles; did you mean"):
            one.reset(options={"taget": (1.2, 0.1)})


@pytest.mark.slow
def test_stable_baselines_learns_on_it_unchanged():
    sb3 = pytest.importorskip("stable_baselines3")
    env = gymnasium.make(ID, observation="goal")
    sizes = {"learning_starts": 200, "batch_size": 128, "policy_kwargs": {"net_arch": [64, 64]}}
    learner = sb3.SAC("MlpPolicy", env, gamma=0.0, ent_coef=0.2, learning_rate=1e-3, seed=0, **sizes)
    targets = Disc().place(np.random.default_rng(9).random((100, 3)))
    envs = gymnasium.make_vec(ID, num_envs=100)

    def share_hit(actions):
        envs.reset(options={"targets": targets})
        return envs.step(actions)[2].mean()

    chance = share_hit(np.random.default_rng(0).uniform(-1, 1, (100, 5)))
    learner.learn(700)
    seen, _ = envs.reset(options={"targets": targets})
    assert share_hit(learner.predict(seen, deterministic=True)[0]) > chance + 0.25


def test_environments_in_space():
    """Lanes equal single environments, a step equals the objective's trial, and both show three coordinates."""
    region = GoalRegion(Disc((1.7, 0.3, 0.2), 0.3), hit_radius=0.1)
    options = {"model": "nah2023", "controller": "nah2023", "zone": region}
    many, one = gymnasium.make_vec(ID, num_envs=3, **options), gymnasium.make(ID, **options).unwrapped
    assert many.single_observation_space.shape == many.single_action_space.shape == (9,)
    targets = np.array([[1.7, 0.3, 0.2], [1.8, 0.2, 0.1], [1.6, 0.4, 0.3]])
    obs, _ = many.reset(seed=0, options={"targets": targets})
    np.testing.assert_allclose(obs[:, 6:], targets, rtol=1e-6)
    np.testing.assert_allclose(obs[:, 3:6], 0)
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 9))
    obs, rewards, _, _, info = many.step(actions)
    objective = Objective(one.task.rollout, Target((1.7, 0.3, 0.2), 0.1))
    for lane in range(3):
        one.reset(options={"target": targets[lane]})
        assert one.render() is None
        seen, reward, *_, told = one.step(actions[lane])
        np.testing.assert_allclose(obs[lane], seen, rtol=1e-6)
        assert (rewards[lane], info["miss_distance"][lane]) == (reward, told["miss_distance"])
    outcome = objective(one.task.to_strikes(actions[:1])[0])
    np.testing.assert_allclose(obs[0], [*outcome.tip, *outcome.tip_velocity, *targets[0]], rtol=1e-6)
    with pytest.raises(InputError, match=r"target: got .* finite numbers in the shape \(3,\)"):
        one.reset(options={"target": (1.0, 0.2)})
    shown = gymnasium.make(ID, render_mode="rgb_array", **options).unwrapped
    shown.reset(seed=0)
    pictures = [shown.render()]
    shown.step(actions[0])
    pictures.append(shown.render())
    assert [picture.shape for picture in pictures] == [(480, 640, 3)] * 2
    assert (pictures[0] != pictures[1]).any()
