"""Learners on problems whose answer is known, and the promises of their code: seeds, checkpoints, formulas."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
import pytest
import torch
from one_joint import one_joint, one_joint_task

from whiptool.errors import InputError
from whiptool.goals.zone import Disc, sample
from whiptool.rl import hindsight
from whiptool.rl.actor_critic import LEARNERS, PPO, make_learner
from whiptool.rl.learner import Diverged, OffPolicyLearner, Transitions
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.settings import TrainingPlan, settings_for
from whiptool.rl.task import OBSERVATIONS, reward
from whiptool.rl.training import Training, load_checkpoint

OFF_POLICY = ("sac", "td3", "ddpg")
SMALL: dict[str, dict[str, Any]] = {name: {"hidden": (16, 16), "batch_size": 32} for name in OFF_POLICY}
SMALL["ppo"] = {"hidden": (16, 16)}


def training(method, *, seed=0, plan=None, task=None, **changes) -> Training:
    task = task or one_joint_task()
    learner = make_learner(method, settings_for(method, **changes), task, torch.Generator().manual_seed(seed))
    return Training(learner, task, plan or TrainingPlan(episodes=6, trials=20, random_episodes=2))


def same(a, b) -> bool:
    """Whether two states are the same to the bit."""
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


@pytest.fixture(autouse=True, scope="module")
def _one_thread():
    """Two threads that wait for a core that others use are slower than one."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


# what is learned


@pytest.mark.parametrize("method", LEARNERS)
def test_learners_find_the_best_action_of_a_bandit(method):
    """Reward -10 |a - a*(x)|^2 with a* = (0.8 x, -0.4)."""
    generator = torch.Generator().manual_seed(0)
    ppo = method == "ppo"
    changes = {"learning_rate": 1e-2, "minibatch": 100} if ppo else {"learning_rate": 3e-3, "batch_size": 64}
    settings = settings_for(method, hidden=(32, 32), **changes)
    learner = LEARNERS[method](settings, n_obs=1, n_act=2, discount=0.0, generator=generator)

    def best(x):
        return torch.cat([0.8 * x, torch.full_like(x, -0.4)], dim=1)

    for i in range(40 if ppo else 10):
        x = 2 * torch.rand(200 if ppo else 50, 1, generator=generator) - 1
        explore = not ppo and i < 2
        action = 2 * torch.rand(len(x), 2, generator=generator) - 1 if explore else learner.act(x)
        gained = -10 * ((action.clamp(-1, 1) - best(x)) ** 2).sum(dim=1)
        learner.learn(Transitions(x, action, gained, x, torch.ones(len(x))), update=not explore)
    x = torch.linspace(-1, 1, 101)[:, None]
    assert (learner.act(x, deterministic=True) - best(x)).abs().mean() < 0.12


@pytest.mark.slow
@pytest.mark.parametrize("method", LEARNERS)
def test_learners_hit_with_one_joint(method):
    """The bandit shows that actions follow the observation; this, that strikes are learned from the task's reward."""
    off_policy = {"learning_rate": 1e-3, "batch_size": 128}
    changes, plan = {
        "sac": (off_policy, TrainingPlan(episodes=12, trials=100, random_episodes=5)),
        "td3": ({**off_policy, "noise": 0.3}, TrainingPlan(episodes=18, trials=50, random_episodes=4)),
        "ddpg": ({**off_policy, "noise": 0.3}, TrainingPlan(episodes=18, trials=50, random_episodes=4)),
        "ppo": ({"learning_rate": 3e-3, "kl_target": 0.03}, TrainingPlan(episodes=30, trials=200, random_episodes=0)),
    }[method]
    run = training(method, plan=plan, task=one_joint_task(hit_radius=0.1), hidden=(64, 64), **changes)
    targets = sample(run.task.zone, 200, np.random.default_rng(1))
    judge = one_joint_task(hit_radius=0.1)
    judge.reset(targets)
    chance = judge.step(np.random.default_rng(2).uniform(-1, 1, (200, 3))).hit.mean()
    run.run()
    _, hit = trials_to_hit(run.learner, judge, targets, cap=1, convention="mean")
    assert chance < 0.35
    assert hit.mean() > chance + 0.25


# seeds and checkpoints


@pytest.mark.parametrize("method", LEARNERS)
def test_seeds_decide_everything(method):
    numpy_state, torch_state = repr(np.random.get_state()), torch.get_rng_state()  # noqa: NPY002
    states, seen = [], []
    for seed in (0, 0, 1):
        run = training(method, seed=seed, **SMALL[method])
        seen.append(run.run())
        states.append(run.learner.state_dict())
    assert same(states[0], states[1])
    assert seen[0] == seen[1] != seen[2]
    assert not same(states[0]["actor"], states[2]["actor"])
    assert repr(np.random.get_state()) == numpy_state  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), torch_state)


@pytest.mark.parametrize(
    ("method", "observation", "copies"),
    [
        ("sac", "goal", 0),
        ("sac", "goal", 2),
        ("sac", "tip", 0),
        ("td3", "goal", 1),
        ("td3", "relative", 0),
        ("ddpg", "tip", 0),
        ("ppo", "goal", 0),
        ("ppo", "relative", 0),
    ],
)
def test_a_run_goes_on_as_if_nothing_had_happened(method, observation, copies, tmp_path):
    plan = TrainingPlan(episodes=6, trials=20, random_episodes=2, hindsight=copies)

    def fresh(seed):
        task = one_joint_task(observation=observation, strikes=2)
        return training(method, seed=seed, plan=plan, task=task, **SMALL[method])

    straight = fresh(0)
    whole = straight.run()
    first = fresh(0)
    before = first.run(episodes=3)
    first.save(tmp_path / "checkpoint.pt")
    second = fresh(999)
    second.load(tmp_path / "checkpoint.pt")
    assert before + second.run() == whole
    assert same(second.learner.state_dict(), straight.learner.state_dict())
    assert np.array_equal(second.obs, straight.obs)
    assert np.array_equal(second.task.targets, straight.task.targets)
    assert np.array_equal(second.task.counts, straight.task.counts)
    assert (second.done, second.task.n_strikes) == (straight.done, straight.task.n_strikes) == (6, 120)
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.pt"]


def test_checkpoints_that_are_none_are_refused(tmp_path):
    path = tmp_path / "checkpoint.pt"
    run = training("sac", **SMALL["sac"])
    with pytest.raises(InputError, match="checkpoint"):
        run.load(path)
    run.save(path)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", b"not a checkpoint", whole[:-400]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="checkpoint"):
            run.load(path)
    torch.save({"plan": TrainingPlan}, path)  # code, which is not executed
    with pytest.raises(InputError, match="checkpoint"):
        load_checkpoint(path)
    for foreign in ([1, 2], 3, {}, {**torch.load(io.BytesIO(whole), weights_only=True), "obs": [1]}):
        torch.save(foreign, path)
        with pytest.raises(InputError, match=path.name):
            run.load(path)
    path.write_bytes(whole)
    other = training("sac", plan=TrainingPlan(episodes=7, trials=20, random_episodes=1), **SMALL["sac"])
    with pytest.raises(InputError, match=r"random.episodes"):
        other.load(path)


# the future of a trial


@pytest.mark.parametrize("method", OFF_POLICY)
def test_truncation_is_bootstrapped_and_termination_is_not(method):
    changes = {"target_noise": 0.0} if method == "td3" else {}
    generator = torch.Generator().manual_seed(4)
    learner = LEARNERS[method](
        settings_for(method, **SMALL[method], **changes), n_obs=4, n_act=3, discount=0.9, generator=generator
    )
    assert isinstance(learner, OffPolicyLearner)
    rewards, terminated = torch.tensor([1.0, 2.0]), torch.tensor([0.0, 1.0])
    batch = Transitions(torch.rand(2, 4), torch.rand(2, 3), rewards, torch.rand(2, 4), terminated)
    asked = []

    def next_action(obs):
        asked.append(obs)
        return torch.full((2, 3), 0.25), torch.tensor([0.5, 0.5])

    q = learner.target_critic(batch.next_obs, torch.full((2, 3), 0.25)).min(dim=0).values
    learner.next_action = next_action
    y = learner.target_value(batch)
    assert y.tolist() == pytest.approx([1 + 0.9 * (float(q[0]) + 0.5), 2])
    assert torch.equal(asked[0], batch.next_obs)
    learner.discount = 0.0
    assert learner.target_value(batch) is batch.reward
    assert len(asked) == 1


def test_the_target_policies_act_as_cited():
    obs = torch.rand(500, 4)
    for method in ("ddpg", "td3"):
        learner = training(method, task=one_joint_task(observation="tip"), **SMALL[method]).learner
        action, bonus = learner.next_action(obs)
        offset = action - learner.target_actor(obs)
        assert float(bonus) == 0
        if method == "ddpg":
            assert not offset.any()
        else:  # Eq. 15
            assert 0.15 < float(offset.std()) < 0.22
            assert float(offset.abs().max()) <= 0.5 + 1e-6
            assert float(action.abs().max()) <= 1


def test_ppo_bootstraps_as_well():
    settings = settings_for("ppo", hidden=(16,), epochs=1, minibatch=2)
    learner = PPO(settings, n_obs=4, n_act=3, discount=0.9, generator=torch.Generator().manual_seed(0))
    obs, next_obs = torch.rand(2, 4), torch.rand(2, 4)
    batch = Transitions(obs, learner.act(obs), torch.tensor([1.0, 2.0]), next_obs, torch.tensor([0.0, 1.0]))
    with torch.no_grad():
        v, after = learner.value(obs)[0, :, 0], learner.value(next_obs)[0, :, 0]
    expected = ((torch.stack([1 + 0.9 * after[0], torch.tensor(2.0)]) - v) ** 2).mean()
    assert learner.learn(batch)["value"] == pytest.approx(float(expected), rel=1e-5)


def test_a_trial_given_up_is_not_stored_as_ended():
    run = training("sac", task=one_joint_task(observation="tip", strikes=1), **SMALL["sac"])
    run.run(episodes=4)
    held = run.learner.state_dict()["replay"]
    assert torch.equal(held["terminated"], (held["reward"] == 50).float())
    assert 0 < held["terminated"].mean() < 1
    first = torch.as_tensor(run.task.normalise(run.task.first_look(np.zeros((1, 2)))), dtype=torch.float32)
    assert torch.equal(held["obs"], first.expand_as(held["obs"]))  # every strike was a lane's first
    assert (held["next_obs"] != first).any(dim=1).all()  # and what it led to is seen, not the next trial's start


@pytest.mark.parametrize("method", LEARNERS)
def test_a_reward_that_is_no_number_stops_the_learner(method):
    run = training(method, **SMALL[method])
    run.run(episodes=3)
    obs = torch.rand(40, 6)
    bad = Transitions(obs, run.learner.act(obs), torch.full((40,), math.nan), obs, torch.zeros(40))
    with pytest.raises(Diverged, match=r"has become nan: try a smaller learning rate"):
        run.learner.learn(bad)


# the task


def test_what_each_observation_shows():
    targets = sample(Disc((0.75, 0.0), 0.15), 30, np.random.default_rng(0))
    actions = np.random.default_rng(1).uniform(-1, 1, (30, 3))
    task = one_joint_task()
    task.reset(targets)
    step, seen = task.step(actions), {}
    for observation in OBSERVATIONS:
        task = one_joint_task(observation=observation)
        assert task.reset(targets).shape == (30, task.n_obs)
        seen[observation] = task.step(actions).obs
        assert np.abs(task.normalise(seen[observation])).max() < 5
    tip, velocity = step.approach.tip, step.approach.velocity
    assert np.array_equal(seen["tip"], np.hstack([tip, velocity]))
    assert np.array_equal(seen["relative"], np.hstack([tip - targets, velocity]))
    assert np.array_equal(seen["goal"], np.hstack([tip, velocity, targets]))
    assert np.hypot(*(seen["relative"][:, :2]).T) == pytest.approx(step.approach.distance)


def test_trials_are_counted_to_the_first_hit():
    class Fixed:
        """The mean strikes once and for all; samples are random."""

        rng = np.random.default_rng(0)

        def act(self, obs, *, deterministic=False):
            action = np.zeros((len(obs), 3)) if deterministic else self.rng.uniform(-1, 1, (len(obs), 3))
            return torch.as_tensor(action)

    task = one_joint_task(hit_radius=0.1)
    targets = sample(task.zone, 100, np.random.default_rng(3))
    task.reset(targets)
    at_once = task.step(np.zeros((100, 3))).hit
    trials, hit = trials_to_hit(Fixed(), task, targets, cap=40)
    assert np.array_equal(trials == 1, at_once)
    assert (trials[~hit] == 40).all()
    assert hit.mean() > at_once.mean()
    assert not trials_to_hit(Fixed(), task, targets, cap=9, convention="mean")[1][~at_once].any()
    with pytest.raises(InputError, match="convention"):
        trials_to_hit(Fixed(), task, targets, cap=1, convention="best")


# hindsight


def test_relabelled_rewards_are_those_of_the_physics():
    run = training("sac", plan=TrainingPlan(episodes=2, trials=50, random_episodes=1, hindsight=3), **SMALL["sac"])
    run.run(episodes=1)
    task, held = run.task, run.learner.state_dict()["replay"]
    assert held["size"] == 50 * 4
    centre, half = np.array(task.zone.centre), task.zone.radius
    targets = centre + half * held["obs"][:, 4:].double().numpy()
    strikes = task.to_strikes(held["action"].double().numpy())
    near = one_joint().approach(strikes, targets, t_stay=task.t_stay)
    gained = held["reward"].numpy()
    sampled = np.floor((strikes[:, -1] + task.t_stay) * hindsight.RATE) / hindsight.RATE
    # [m]: straight lines between samples, and a path that ends up to one sample before its strike
    slack = np.where(near.time <= sampled, 1e-3, 1e-3 + near.speed / hindsight.RATE)
    low, high = near.distance - slack, near.distance + slack
    assert (gained <= reward(low, low <= task.hit_radius) + 1e-6).all()
    assert (gained >= reward(high, high <= task.hit_radius) - 1e-6).all()
    assert np.array_equal(held["terminated"].numpy(), gained == 50)
    tips = centre + max(1, 2 * half) * held["next_obs"][:, :2].double().numpy()
    assert (np.abs(np.hypot(*(tips - targets).T) - near.distance) <= slack).all()
    assert torch.equal(held["next_obs"][:, 4:], held["obs"][:, 4:])
    relabelled = gained[:150]  # before the strikes themselves are stored
    assert (relabelled == 50).mean() > 1.5 * (gained[150:] == 50).mean()
    for wrong in (("ppo", "goal"), ("sac", "tip")):
        with pytest.raises(InputError, match="hindsight"):
            training(wrong[0], task=one_joint_task(observation=wrong[1]), plan=TrainingPlan(hindsight=1))
