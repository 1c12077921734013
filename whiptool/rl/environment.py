"""Gymnasium environments of the task; one step is one strike.

    gymnasium.make("whiptool:whiptool/WhipTarget-v0", observation="goal")
    gymnasium.make_vec("whiptool:whiptool/WhipTarget-v0", num_envs=100)

If whiptool is imported, the id without `whiptool:` is sufficient. The vector environment simulates the strikes of all
lanes (sub-environments) as one batch, on all cores.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from whiptool.errors import InputError, refuse_call
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target
from whiptool.impedance import CONSTANT_PRESETS, Controller, constant_preset, oiac_preset
from whiptool.models import Model, load_model
from whiptool.models.numbers import ASK_UNIT, LONGEST, whole
from whiptool.rl.task import StrikeTask, TaskStep
from whiptool.rollout import CompiledRollout
from whiptool.words import as_named

_CHOSEN = ("target", "angle", "targets", "angles")  # options of `reset`, for one lane and for many


def make_task(
    *, model: Model | str | Path = "lemon2024", controller: Controller | str | None = None, **options: Any
) -> StrikeTask:
    """Return the task of an environment, from the environment's options.

    Args:
        model: A model, the name of a preset, or a TOML file.
        controller: A controller, or the name of a preset of OIAC or of constant impedance; default:
            `default_controller`.
        options: Options of `StrikeTask`, by name, such as `observation`, `strikes`, `limits` and
            `zone=GoalRegion(Disc(), ArrivalRule(angle=(0.5, 1.5)), hit_radius=0.05)`.

    Raises:
        InputError: An option is out of range.
    """
    if not isinstance(model, Model):
        model = load_model(str(model))
    if isinstance(controller, str):
        of_arm = as_named(controller, CONSTANT_PRESETS) in CONSTANT_PRESETS
        controller = Controller(constant_preset(controller) if of_arm else oiac_preset(controller))
    rollout = CompiledRollout(model, controller)
    refuse_call("an environment", StrikeTask, rollout, **options)
    return StrikeTask(rollout, **options)


def spaces(task: StrikeTask) -> tuple[Box, Box]:
    """Return the space of observations in SI units, (n_obs,), and that of actions, (n_act,); the actions -1 and 1 are
    the lower and upper bounds of strikes.
    """
    lower, upper = task.zone.box
    d = task.zone.dimension
    reach = np.full(d, task.rollout.model.reach)
    low, high = (-reach - upper, reach - lower) if task.observation == "relative" else (-reach, reach)
    unit = np.ones(d if task.arrival.directed else 0)
    least, most = ([lower, -unit], [upper, unit]) if task.observation == "goal" else ([], [])
    return (
        Box(
            np.concatenate([low, np.full(d, -np.inf), *least]).astype(np.float32),
            np.concatenate([high, np.full(d, np.inf), *most]).astype(np.float32),
        ),
        Box(-1, 1, (task.n_act,), np.float32),
    )


class WhipEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Gymnasium environment: strike at a target until it is hit.

    An episode has one goal; it is terminated by a hit and truncated after `strikes` misses. `reset` draws a target, or
    uses that of `options={"target": (x, y)}` [m], in space `(x, y, z)`; if arrival angles are drawn, also `"angle"`
    [rad]. `info` contains the `target` [m] and after a strike `is_success` (a hit), `miss_distance` [m], `tip_speed` at
    the closest approach [m/s], `diverged`, `refused` (the exceeded limit, such as `joint` or `clearance`; empty: none)
    and, after a hit, `hit_time` [s]. If a strike diverged or was refused, the distance is a penalty and the speed zero.
    If the goal has a direction or speed, `info` also contains the `direction`, if any, and after a strike
    `arrival_angle` from it [rad], `arrival_speed` along it [m/s] and `cost` [m] (`Goals`); if a strike diverged or was
    refused, these are pi, zero and the penalty.

    Args:
        render_mode: None, or `rgb_array` for a picture of the last strike.
        options: See `make_task`.

    Raises:
        InputError: An option is out of range.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(self, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError("render mode", render_mode, "None or rgb_array")
        self.render_mode, self.task = render_mode, make_task(**options)
        self.observation_space, self.action_space = spaces(self.task)
        self._strike: np.ndarray | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw a target and return the observation before the first strike, (n_obs,), and the information.

        Raises:
            InputError: The target of the options is not a point, or its angle not a number.
        """
        super().reset(seed=seed)
        self._strike = None
        _check_names(options)
        place, angle = _chosen(options, "target", (self.task.zone.dimension,)), _chosen(options, "angle", ())
        goals = _goals(self.task, 1, self.np_random, place, angle)
        seen = _float32(self.task.reset(goals))[0]
        return seen, {name: value[0] for name, value in _asked(self.task).items()}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Make one strike by an action (n_act,), which is clipped to [-1, 1].

        Returns:
            Observation (n_obs,), reward, whether the goal was hit, whether the episode was truncated, and `info`.

        Raises:
            InputError: The action is not `n_act` finite numbers.
        """
        actions = _checked(action, (self.task.n_act,))[None]
        self._strike = self.task.to_strikes(actions)
        step = self.task.step(actions)
        info = {name: v[0] if v.ndim > 1 else v[0].item() for name, v in _info(self.task, step).items()}
        if not step.hit[0]:
            del info["hit_time"]
        return _float32(step.obs)[0], float(step.reward[0]), bool(step.hit[0]), bool(step.truncated[0]), info

    def render(self) -> np.ndarray | None:
        """Return a picture of the last strike, or of the whip at rest before the first, (480, 640, 3) uint8."""
        if self.render_mode is None:
            return None
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.patches import Circle

        from whiptool.viz.plots_strike import plot_strike

        task, target = self.task, self.task.targets[0]
        figure = Figure(figsize=(6.4, 4.8), dpi=100, layout="constrained")
        canvas, ax = FigureCanvasAgg(figure), figure.add_subplot()
        if self._strike is None:
            across, up = task.resting[:, 0], task.resting[:, -1]  # in space from the side
            ax.plot(across, up)
            ax.add_patch(Circle((target[0], target[-1]), task.hit_radius, fill=False))
            ax.set(xlabel="x [m]", ylabel="y [m]" if len(target) == 2 else "z [m]", aspect="equal")
        else:
            path = next(task.rollout.trajectories(self._strike, t_stay=task.t_stay))
            plot_strike(path, task.rollout.model, Target.of(task.goals, 0), ax=ax)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


class WhipEnvs(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Vector environment: lanes (sub-environments) with separate targets, whose strikes are simulated as one batch.

    A lane whose episode ended gets its next target in the same step (`AutoresetMode.SAME_STEP`): `obs` is then the
    observation before the first strike at that target, and `info["final_obs"]` and `info["final_info"]` contain the
    result of the last strike, as in `gymnasium.vector.SyncVectorEnv`. A mask `_name` states for which lanes
    `info[name]` is valid. `reset(options={"targets": ...})` takes targets (num_envs, d) [m], d = 3 in space, and, if
    arrival angles are drawn, also `"angles"` (num_envs,) [rad].

    Args:
        num_envs: Number of lanes.
        options: See `make_task`.

    Raises:
        InputError: An option is out of range.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, **options: Any) -> None:
        self.num_envs, self.task = whole("num_envs", num_envs), make_task(**options)
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw a target for every lane; return the observations before the first strikes, (num_envs, n_obs), and the
        information.

        Raises:
            InputError: The options do not give one point, or one angle, per lane.
        """
        super().reset(seed=seed)
        _check_names(options)
        places = _chosen(options, "targets", (self.num_envs, self.task.zone.dimension))
        angles = _chosen(options, "angles", (self.num_envs,))
        obs = self.task.reset(_goals(self.task, self.num_envs, self.np_random, places, angles))
        return _float32(obs), _masked(_asked(self.task), np.ones(self.num_envs, bool))

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Make one strike in every lane by actions (num_envs, n_act), which are clipped to [-1, 1].

        Returns:
            Observations (num_envs, n_obs), rewards, terminations, truncations, (num_envs,) each, and `info`.

        Raises:
            InputError: The actions are not (num_envs, n_act) finite numbers.
        """
        step = self.task.step(_checked(actions, (self.num_envs, self.task.n_act)))
        over, struck, obs = step.hit | step.truncated, _info(self.task, step), step.obs
        info = _masked(struck, ~over, hit=step.hit)
        if over.any():
            last = np.full(self.num_envs, None, object)
            for lane in np.flatnonzero(over):
                last[lane] = _float32(obs[lane])
            obs = self.task.renew(obs, over, _goals(self.task, int(over.sum()), self.np_random))
            info |= {"final_obs": last, "_final_obs": over, "final_info": _masked(struck, over, hit=step.hit)}
            info |= {"_final_info": over, **_masked(_asked(self.task), np.ones_like(over))}
        return _float32(obs), step.reward, step.hit, step.truncated, info


def _info(task: StrikeTask, step: TaskStep) -> dict[str, np.ndarray]:
    """The entries of `info` after a strike in every lane, (B, ...) each."""
    judged, goals = step.judged, task.goals
    near, velocity = judged.approach, np.where(judged.lost[:, None], 0.0, judged.approach.velocity)
    info = {
        **_asked(task),
        "is_success": judged.hit,  # as Stable-Baselines3 counts successes
        "miss_distance": judged.distance,
        "tip_speed": np.where(judged.lost, 0.0, near.speed),
        "diverged": judged.diverged,
        "refused": judged.refused,
        "hit_time": near.time,
    }
    if goals.directions is not None:
        info["arrival_angle"] = goals.angle(velocity)
    if not goals.only_points:
        info |= {"arrival_speed": goals.arrival_speed(velocity), "cost": judged.cost}
    return info


def _asked(task: StrikeTask) -> dict[str, np.ndarray]:
    """The entries of `info` that say what is struck at, (B, d) each."""
    asked = {"target": task.targets.copy()}
    return asked if task.goals.directions is None else {**asked, "direction": task.goals.directions.copy()}


def _goals(
    task: StrikeTask,
    count: int,
    rng: np.random.Generator,
    places: np.ndarray | None = None,
    angles: np.ndarray | None = None,
) -> Goals:
    """Return goals for lanes: what of places (count, d) and angles (count,) is not given is drawn.

    Raises:
        InputError: There are angles, and the task draws none.
    """
    rule = task.arrival
    if places is None:
        goals = task.region.draw(count, rng)
    else:
        goals = rule.goals(places.reshape(count, -1), task.hit_radius, rng.random((count, rule.drawn)))
    return goals if angles is None else rule.goals_at(goals.positions, task.hit_radius, angles.reshape(count))


def _masked(values: Mapping[str, np.ndarray], lanes: np.ndarray, *, hit: np.ndarray | None = None) -> dict[str, Any]:
    """Gymnasium's form of information about some lanes: zero elsewhere (of words None), and a mask for each entry."""
    info: dict[str, Any] = {}
    for name, value in values.items():
        mask = lanes & hit if name == "hit_time" and hit is not None else lanes
        if mask.any():
            elsewhere = np.full(value.shape, None) if value.dtype.kind == "U" else np.zeros_like(value)
            info[name] = np.where(mask.reshape(-1, *[1] * (value.ndim - 1)), value, elsewhere)
            info["_" + name] = mask.copy()
    return info


def _float32(obs: np.ndarray) -> np.ndarray:
    return obs.astype(np.float32)


def _checked(values: Any, shape: tuple[int, ...], name: str = "action") -> np.ndarray:
    array = np.asarray(values, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(name, values, f"finite numbers in the shape {shape}")
    return array


def _check_names(options: dict[str, Any] | None) -> None:
    """Refuse an option of `reset` that neither one environment nor one of many lanes has."""
    for name in options or {}:
        if name not in _CHOSEN:
            raise InputError("options of reset", name, ", ".join(_CHOSEN))


def _chosen(options: dict[str, Any] | None, name: str, shape: tuple[int, ...]) -> np.ndarray | None:
    """The targets or angles given in the options of `reset`; None: none were given."""
    wanted = (options or {}).get(name)
    if wanted is None:
        return None
    found = _checked(wanted, shape, name)
    if name.startswith("target") and np.abs(found).max() > LONGEST:
        raise InputError(name, wanted, f"within {LONGEST:g} m", ASK_UNIT)
    return found
