"""How near the tip comes within reach and at exactly full reach, and the report's section on it.

Many independent trials descend to where no neighbour is nearer; CMA-ES searches the same.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from papers.nah2023 import pictures, published
from papers.nah2023.claims import LEVEL, share_nearer
from papers.nah2023.solutions import descend
from papers.nah2023.units import BOUNDS, COARSE, CONTROLLER, STAY, by_merit, simulator
from whiptool import CompiledRollout, Strike, StrikeBounds, Target, Trajectory
from whiptool.comparison.units import Unit
from whiptool.models.kinematics import joint_points
from whiptool.models.presets import NAH2023
from whiptool.viz.report import Picture, Section, Table, Text

CLOSE = published.HIT_RADIUS  # [m]: descents that end farther away are not followed on
BESIDE = (0.2, 0.04)  # widths of the boxes around a strike, of the whole box
_GAIN, _LAST_GAIN = 1e-3, 1e-6  # of a step, of the descents with the finer step, and of the nearest


@dataclass(frozen=True, kw_only=True)
class TrialsUnit(Unit):
    """Independent trials, all alike: of some random strikes the nearest, from there down to where none is nearer.

    Args:
        target: Which, from 0.
        seed: Seed of the random strikes.
        trials: Number of trials.
        random: Random strikes of each.
    """

    target: int
    seed: int
    trials: int = 16
    random: int = 32

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return where the trials ended and how far from the target [m], the nearest first."""
        start, target = time.monotonic(), np.array(published.TARGETS[self.target])
        rollout, coarse = simulator(threads), simulator(threads, timestep=COARSE)
        drawn = BOUNDS.sample(np.random.default_rng([self.target, self.seed]), self.trials * self.random)
        misses = coarse.approach(drawn, target, t_stay=STAY).distance.reshape(self.trials, self.random)
        starts = drawn.reshape(self.trials, self.random, -1)[np.arange(self.trials), misses.argmin(axis=1)]
        strikes, ends = descend(coarse, BOUNDS, starts, target, t_stay=STAY)
        near = ends <= CLOSE
        strikes[near], ends[near] = descend(rollout, BOUNDS, strikes[near], target, t_stay=STAY, gain=_GAIN)
        strikes, ends = by_merit(strikes, ends)
        strikes[:1], ends[:1] = descend(rollout, BOUNDS, strikes[:1], target, t_stay=STAY, gain=_LAST_GAIN)
        return {
            "random": self.random,
            "ends": ends.tolist(),
            "strikes": strikes.tolist(),
            "wall_time": time.monotonic() - start,
        }


@dataclass(frozen=True, kw_only=True)
class EvolutionUnit(Unit):
    """CMA-ES with restarts over the whole box, and a descent from the nearest that it finds.

    Args:
        target: Which, from 0.
        seed: Seed of the search.
        cap: Rollouts.
    """

    target: int
    seed: int
    cap: int = 10_000

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return where the search ended and how far from the target [m]."""
        start, target = time.monotonic(), np.array(published.TARGETS[self.target])
        rollout, coarse = simulator(threads), simulator(threads, timestep=COARSE)
        first, _ = cmaes(coarse, self.target, BOUNDS, self.cap, self.seed)
        strikes, ends = descend(rollout, BOUNDS, first[None], target, t_stay=STAY, gain=_LAST_GAIN)
        return {
            "rollouts": self.cap,
            "ends": ends.tolist(),
            "strikes": strikes.tolist(),
            "wall_time": time.monotonic() - start,
        }


def cmaes(rollout: CompiledRollout, target: int, bounds: StrikeBounds, cap: int, seed: int) -> tuple[np.ndarray, float]:
    """Return the nearest strike that CMA-ES finds within bounds, and its miss [m]."""
    from whiptool import Objective, search

    sought = Target(published.TARGETS[target], published.HIT_RADIUS)
    objective = Objective(rollout, sought, t_stay=STAY, bounds=bounds, max_trials=cap)
    found = search(objective, "cmaes", seed=seed).uninterrupted()
    nearest = min(found.trace, key=lambda trial: trial.outcome.miss_distance)
    return np.array(nearest.strike), nearest.outcome.miss_distance


@dataclass(frozen=True, kw_only=True)
class BesideUnit(Unit):
    """CMA-ES in smaller and smaller boxes around a strike, each around the nearest so far: is there a nearer one?

    Args:
        target: Which, from 0.
        strike: Strike vector.
        cap: Rollouts in each box.
    """

    target: int
    strike: tuple[float, ...]
    cap: int = 1000

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return the nearest strike, and the least miss before and after each box [m]."""
        start, rollout, strike = time.monotonic(), simulator(threads), np.array(self.strike)
        target, (lower, upper) = np.array(published.TARGETS[self.target]), BOUNDS.box
        misses = [float(rollout.approach(strike[None], target, t_stay=STAY).distance[0])]
        for seed, share in enumerate(BESIDE):
            half = share / 2 * (upper - lower)
            box = StrikeBounds(tuple(np.maximum(lower, strike - half)), tuple(np.minimum(upper, strike + half)))
            other, miss = cmaes(rollout, self.target, box, self.cap, seed)
            strike = other if miss < misses[-1] else strike
            misses.append(min(miss, misses[-1]))
        wall_time = time.monotonic() - start
        return {"strike": strike.tolist(), "misses": misses, "rollouts": self.cap, "wall_time": wall_time}


@dataclass(frozen=True, kw_only=True)
class ReferenceUnit(Unit):
    """A strike in MuJoCo, at the step that it needs there.

    Args:
        target: Which, from 0.
        strike: Strike vector.
    """

    target: int
    strike: tuple[float, ...]

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return the miss here and in MuJoCo [m], None where it diverges there, the step there [s], whether both agree,
        and how far the shoulder's second joint turned until the closest approach [rad]."""
        from whiptool.rollout.reference import replay

        start, target, strike = time.monotonic(), np.array(published.TARGETS[self.target]), np.array(self.strike)
        path = simulator(threads).trajectory(strike, t_stay=STAY)
        here = path.approach(target)
        expected, until = float(here.distance[0]), path.t <= here.time[0]
        found = replay(NAH2023, CONTROLLER, Strike.from_vector(strike), target, t_stay=STAY, expected=expected)
        return {
            "expected": expected,
            **asdict(found),
            "abduction": float(np.abs(path.q[until, 1]).max()),
            "wall_time": time.monotonic() - start,
        }


REACH = NAH2023.reach
FAR = range(published.WITHIN_REACH, len(published.TARGETS))
Results = list[dict[str, Any]]

_WITHIN = (
    "Of many random strikes the nearest are followed down together, by Levenberg and Marquardt's method with exact "
    "derivatives of every link's path."
)
_FULL = (
    "Targets 4 to 6 lie at exactly full reach. With L the length of arm and whip, and theta the angle of a link of "
    "length l to the direction of the target, a miss is at least the sum of l (1 - cos theta), less the target's "
    "distance from full reach (0.02 mm at most): 0 only if all 27 links point at the target at once, which a movement "
    "of nine numbers meets but approximately. No bound above 0 is known for what it can meet; what follows is a "
    "search, in two ways. Trials, all alike and independent: of {random} random strikes the nearest, followed down "
    "until the descent ends (those still farther than 5 cm at twice the step are left there). CMA-ES with restarts, "
    "over the whole box ({cap:,} rollouts, {seeds}), and a descent from its nearest. The next trial comes "
    "nearer than all {trials} with a probability of 1 in {next}; the share of such trials is below {share:.0f} % "
    "({level:.0f} % confidence). Around the nearest of all that is known, the descents above included, CMA-ES "
    "searches once more, in boxes of {boxes} of the whole one's width, {beside:,} rollouts each, the next box around "
    "the nearest so far."
)
_REPLAY = (
    "The nearest strikes in MuJoCo (RK4), whose step is halved until both simulators agree within 0.3 mm. Where the "
    "shoulder's abduction passes near 90 degrees, its first and third axes nearly meet: a turn of the one against the "
    "other hardly moves anything, so that the controller's damping acts on next to no inertia, and an explicit "
    "integrator needs a step that falls with the square of the angle that is left. Ours is implicit in that damping."
)


def how_near(
    found: Results,
    tried: Sequence[Results],
    evolved: Sequence[Results],
    refined: Results,
    nearest: list[np.ndarray],
    replays: Results,
) -> Section:
    """How near the tip comes to each target.

    Args:
        found: Solutions by target.
        tried, evolved: Trials, and ends of CMA-ES, by target from the fourth.
        refined: What lies near the nearest, likewise.
        nearest: The nearest strike at each target.
        replays: Each of these in MuJoCo; none: left out.
    """
    rollout = simulator(None)
    paths = [rollout.trajectory(strike, t_stay=STAY) for strike in nearest]
    at = [path.approach(np.array(place)) for path, place in zip(paths, published.TARGETS, strict=True)]
    times = [float(near.time[0]) for near in at]
    ends = [np.sort(np.concatenate([r["ends"] for r in some])) for some in tried]
    by_cmaes = [np.sort([r["ends"][0] for r in some]) for some in evolved]
    parts: list[Text | Table | Picture] = [
        Text(_WITHIN),
        Table(_descents(found), "Descents from the nearest of random strikes: how near they end."),
        Text(_full(tried, evolved, refined)),
        Table(_full_reach(ends, by_cmaes, refined), "At exactly full reach, by two searches."),
        Picture(pictures.ends_of_trials(ends, by_cmaes), "Where the trials end, in order; diamonds: CMA-ES."),
        Table(
            [["target", "miss [mm]", "by the links' angles [mm]", "links' angle, rms [deg]", "largest [deg]"]]
            + [_straightness(i, paths[i], times[i], float(at[i].distance[0])) for i in FAR],
            "The nearest strikes at the closest approach: how straight the chain is, and what that alone misses by.",
        ),
    ]
    if replays:
        parts += [Text(_REPLAY), Table(_replayed(replays), "The nearest strike at each target in both simulators.")]
    caption = "The nearest strike at each target, until the closest approach of the tip."
    return Section(
        "How near the tip comes", [*parts, Picture(pictures.strikes_in_space(paths, times), caption, vector=False)]
    )


def _descents(found: Results) -> list[list[str]]:
    rows = [["target", "nearest of random", "nearest followed down", "second", "within 1 mm of it", "within 5 cm"]]
    for i, r in enumerate(found):
        ends = np.sort(r["ends"])
        near = f"{(ends <= ends[0] + 1e-3).sum()} of {len(ends)}", str((ends <= published.HIT_RADIUS).sum())
        first = f"{1e3 * r['random_best']:.0f} mm", *(_millimetres(x) for x in ends[:2])
        rows.append([str(i + 1), *first, *near])
    return rows


def _millimetres(distance: float) -> str:
    return "< 0.01 mm" if distance < 1e-5 else f"{1e3 * distance:.2f} mm"


def _full(tried: Sequence[Results], evolved: Sequence[Results], refined: Results) -> str:
    trials = sum(len(r["ends"]) for r in tried[0])
    return _FULL.format(
        random=tried[0][0]["random"],
        cap=evolved[0][0]["rollouts"],
        seeds="one seed" if len(evolved[0]) == 1 else f"{len(evolved[0])} seeds",
        trials=trials,
        next=trials + 1,
        share=100 * share_nearer(trials),
        level=100 * LEVEL,
        boxes=" and ".join(f"{100 * share:g} %" for share in BESIDE),
        beside=refined[0]["rollouts"],
    )


def _full_reach(ends: Sequence[np.ndarray], by_cmaes: Sequence[np.ndarray], refined: Results) -> list[list[str]]:
    rows = [["target", "trials", "within 5 cm", "nearest three of them [mm]", "CMA-ES [mm]"]]
    rows[0] += ["nearest of all, and after each smaller box [mm]"]
    for i, trials, others, last in zip(FAR, ends, by_cmaes, refined, strict=True):
        row = [str(i + 1), str(len(trials)), str((trials <= published.HIT_RADIUS).sum())]
        rows.append(
            [*row, *(", ".join(f"{1e3 * x:.2f}" for x in some) for some in (trials[:3], others, last["misses"]))]
        )
    return rows


def _straightness(i: int, path: Trajectory, time: float, miss: float) -> list[str]:
    lengths, angles = link_angles(path, time, np.array(published.TARGETS[i]))
    short = (lengths * (1 - np.cos(angles))).sum() - (REACH - np.linalg.norm(published.TARGETS[i]))
    rms = np.sqrt((lengths * angles**2).sum() / lengths.sum())
    row = f"{1e3 * miss:.2f}", f"{1e3 * short:.2f}", f"{np.degrees(rms):.2f}", f"{np.degrees(angles.max()):.1f}"
    return [str(i + 1), *row]


def link_angles(path: Trajectory, time: float, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lengths of a chain's links [m], and their angles to a target's direction at an instant [rad]."""
    near = int(np.abs(path.t - time).argmin())
    links = np.diff(joint_points(NAH2023, path.q[near : near + 1])[0], axis=0)
    lengths = np.linalg.norm(links, axis=-1)
    links, lengths = links[lengths > 0], lengths[lengths > 0]
    along = links @ target / np.linalg.norm(target)
    across = np.linalg.norm(np.cross(links, target / np.linalg.norm(target)), axis=-1)
    return lengths, np.arctan2(across, along)


def _replayed(replays: Results) -> list[list[str]]:
    rows = [["target", "here [mm]", "MuJoCo [mm]", "MuJoCo's step [ms]", "agree", "abduction, at most [deg]"]]
    for i, r in enumerate(replays):
        there = "diverged" if r["miss_distance"] is None else f"{1e3 * r['miss_distance']:.3f}"
        said = f"{1e3 * r['timestep']:.4f}", "yes" if r["confirmed"] else "no", f"{np.degrees(r['abduction']):.1f}"
        rows.append([str(i + 1), f"{1e3 * r['expected']:.3f}", there, *said])
    return rows
