"""
The same point from several directions
======================================

A target may ask for the direction in which the tip arrives, within a cone, and for a least speed. Not every
direction is possible at every place; where one is not, the search says by how much it misses.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

rollout, place = wt.CompiledRollout(wt.preset("lemon2024")), (1.0, 0.3)
figure, axes = plt.subplots(figsize=(6.4, 5), layout="constrained")
for degrees in (-60, 60, 90, 120):
    way = np.radians(degrees)
    target = wt.Target(place, 0.01, direction=(np.cos(way), np.sin(way)), cone=np.radians(10), speed=2.0)
    result = wt.search(rollout, target, "gradient", max_trials=100)
    swing = rollout.trajectory(result.strike)
    late = abs(swing.t - result.outcome.time) < 0.06  # [s]
    (line,) = axes.plot(*swing.tip[late].T, label=f"{degrees} degrees: {'hit' if result.hit else 'missed'}")
    axes.annotate(
        "", swing.tip[late][-1], swing.tip[late][-5], arrowprops={"arrowstyle": "->", "color": line.get_color()}
    )
axes.plot(*place, "k+", ms=14)
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="The tip, 0.06 s before and after")
axes.legend()
