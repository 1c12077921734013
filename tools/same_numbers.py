"""Do the numbers stay as they were, to the bit? For whoever moves code that must not change a result.

Records 200 random strikes of each preset (closest approach, torques), ten searches (all
trials) and five fits of simulated recordings, all through public calls with fixed seeds; compares them with a record of
the same machine. Records of different machines differ in the last bits.

    python -m tools.same_numbers record FILE.npz
    python -m tools.same_numbers compare FILE.npz
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

import whiptool as wt
from whiptool.goals.target import usual_target
from whiptool.models.presets import PRESETS

SEARCHES = [
    ("lemon2024", "directl"),
    ("lemon2024", "ga"),
    ("lemon2024", "cmaes"),
    ("lemon2024", "gradient"),
    ("lemon2024", "random"),
    ("nah2020-fitted", "directl"),
    ("nah2023", "gradient"),
    ("ur5e", "gradient"),
    ("ur5e", "cmaes"),
    ("panda", "gradient"),
]
FITS = [("whip.k", "whip.b"), ("whip.m",), ("whip.l",), ("whip.k", "whip.b", "whip.m"), ("whip.b", "whip.l")]


def rolled(name: str) -> wt.CompiledRollout:
    """A preset's rollout as users have it."""
    model = wt.preset(name)
    return wt.CompiledRollout(model, wt.default_controller(model))


def strikes(name: str) -> np.ndarray:
    """Closest approaches of 200 random strikes to a point that the model reaches, a row each."""
    rollout = rolled(name)
    drawn = wt.default_bounds(rollout.model.arm).sample(np.random.default_rng(3), 200)
    near = rollout.approach(drawn, usual_target(rollout.model))
    return np.column_stack([near.distance, near.time, near.tip, near.velocity, near.max_torque])


def search(name: str, method: str) -> np.ndarray:
    """Strike and miss of every trial, a row each."""
    found = wt.search(rolled(name), method=method, seed=1, max_trials=150)
    return np.array([[*trial.strike, trial.outcome.miss_distance] for trial in found.trace])


def fit(free: tuple[str, ...], seed: int) -> np.ndarray:
    """Fitted values and their intervals, a row each, of two simulated recordings."""
    model = wt.preset("lemon2024")
    rng = np.random.default_rng(seed)
    films = [filmed(vector, rng) for vector in wt.default_bounds(model.arm).sample(rng, 2)]
    found = wt.fit(films, wt.Plant(model, wt.default_controller(model)), free)
    return np.array([[found[name].value, *(found[name].interval or (np.nan, np.nan))] for name in free])


def filmed(vector: np.ndarray, rng: np.random.Generator) -> wt.StrikeRecording:
    """What a camera of 60 frames a second sees of the tip, with errors of 5 mm."""
    path = rolled("lemon2024").trajectory(vector)
    frames = np.arange(0.004, path.t[-1], 1 / 60)
    tip = np.column_stack([np.interp(frames, path.t, x) for x in path.tip.T])[:, None]
    seen = tip + 5e-3 * rng.standard_normal(tip.shape)
    strike = wt.Strike.from_vector(vector)
    return wt.StrikeRecording(
        t=frames, points=seen, markers=("tip",), sigma=np.full((len(frames), 1), 5e-3), strike=strike
    )


def main(words: list[str]) -> int:
    """Record, or compare and name what differs."""
    if len(words) != 2 or words[0] not in ("record", "compare"):
        print(__doc__)
        return 2
    numbers = {f"strikes {name}": strikes(name) for name in tqdm(PRESETS, desc="strikes")}
    numbers |= {f"search {name} {method}": search(name, method) for name, method in tqdm(SEARCHES, desc="searches")}
    numbers |= {f"fit {' '.join(free)}": fit(free, seed) for seed, free in enumerate(tqdm(FITS, desc="fits"))}
    file = Path(words[1])
    if words[0] == "record":
        np.savez(file, allow_pickle=False, **numbers)
        return 0
    before = np.load(file)
    differing = [name for name in numbers if not np.array_equal(numbers[name], before[name], equal_nan=True)]
    print("\n".join(f"differs: {name}" for name in differing) or f"all {len(numbers)} are equal to the bit")
    return bool(differing)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
