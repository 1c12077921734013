"""
Exact derivatives
=================

How does the miss distance of a strike change with the stiffness of the whip? The tangents are derivatives of
the rollout itself, by automatic differentiation through every step of the integrator, in the same call that
gives the distances.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

model, target = wt.preset("lemon2024"), wt.Target((1.2, 0.1))
strike = wt.Strike((-1.36, 0.47), (1.73, 1.41), 0.6)
rollout = wt.CompiledRollout(model)
stiffness = np.linspace(0.05, 0.5, 46)  # k [N m/rad]
models = [model.with_parameters({"whip.k": k}) for k in stiffness]
near = rollout.approach([strike] * len(models), target, models=models)

figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
axes.plot(stiffness, 1e3 * near.distance, label="miss distance")
for k in (0.1, 0.2, 0.3, 0.4):
    here, slope = wt.CompiledRollout(model.with_parameters({"whip.k": k})).gradient(strike, target, names=["whip.k"])
    beside = np.array([-0.03, 0.03])
    axes.plot(k + beside, 1e3 * (here.distance + slope[0] * beside), color="C1", lw=3, alpha=0.7)
axes.plot([], [], color="C1", lw=3, label="exact derivative")
axes.set(xlabel="stiffness k of the whip's joints [N m/rad]", ylabel="miss distance [mm]")
axes.legend()
