"""
Methods of search
=================

The nearest miss so far of four methods at one target. The gradient method has the exact derivatives of the
miss distance; the others see its value alone.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

rollout, target = wt.CompiledRollout(wt.preset("lemon2024")), wt.Target((1.25, 0.2), hit_radius=1e-3)
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for method in ("random", "directl", "cmaes", "gradient"):
    objective = wt.Objective(rollout, target, max_trials=400, stop_at_hit=True)
    wt.search(objective, method, seed=2)
    misses = [trial.outcome.miss_distance for trial in objective.trials]
    axes.loglog(
        np.arange(1, len(misses) + 1), 1e3 * np.minimum.accumulate(misses), label=method, drawstyle="steps-post"
    )
axes.axhline(1e3 * target.hit_radius, color="0.5", ls=":")
axes.set(xlabel="trials", ylabel="nearest miss so far [mm]")
axes.legend()
