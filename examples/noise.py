"""
What noise of the arm does
==========================

Two strikes hit the same point. Each is made a thousand times with joints that are off by a standard deviation
of 0.05 rad, and a duration that is off by 20 ms. Not every hit is equally safe.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

rollout, target = wt.CompiledRollout(wt.preset("lemon2024")), wt.Target((1.2, 0.1), hit_radius=0.03)
rng, spread = np.random.default_rng(0), np.array([0.05, 0.05, 0.05, 0.05, 0.02])  # [rad], [s]
figure, axes = plt.subplots(figsize=(6.4, 5), layout="constrained")
for seed in (0, 5):
    found = wt.search(rollout, wt.Target(target.position, hit_radius=1e-3), "gradient", seed=seed)
    near = rollout.approach(found.strike.vector + spread * rng.standard_normal((1000, 5)), target)
    share = (near.distance < target.hit_radius).mean()
    axes.scatter(*near.tip.T, s=5, label=f"{found.strike.D:.2f} s, {near.speed.mean():.1f} m/s: {share:.0%} hit")
axes.add_patch(plt.Circle(target.position, target.hit_radius, fill=False, lw=2))
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="The tip at its closest approach")
axes.legend()
