"""
A policy for a whole zone
=========================

Soft actor-critic learns a strike for every target of a disc, from 500 strikes. Then it strikes once at each
of 300 new targets. Longer training, other learners and checkpoints: ``python -m whiptool.train``.

*Needs:* ``pip install 'whiptool[rl]'``.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

rollout, zone = wt.CompiledRollout(wt.preset("lemon2024")), wt.Disc((1.2, 0.1), 0.2)
policy = wt.train(rollout, zone, "sac", episodes=5, progress=False)
targets = zone.place(np.random.default_rng(1).random((300, 2)))
near = rollout.approach([policy.strike(target) for target in targets], targets)

figure, axes = plt.subplots(figsize=(6.4, 5), layout="constrained")
dots = axes.scatter(*targets.T, c=100 * near.distance, s=14, vmin=0, vmax=20)
figure.colorbar(dots, label="miss distance [cm]")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=f"{(near.distance < 0.06).mean():.0%} are hit at once")
