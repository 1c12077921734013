"""
Where the tip can hit, and how fast
===================================

Five thousand random strikes are simulated as one batch, each at another target: how near does its tip come,
and how fast is it there? Strikes that come within 15 cm are shown.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

model, rng = wt.preset("lemon2024"), np.random.default_rng(0)
strikes = wt.default_bounds(model.arm).sample(rng, 5_000)
radius, angle = model.reach * np.sqrt(rng.random(len(strikes))), 2 * np.pi * rng.random(len(strikes))
targets = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
near = wt.CompiledRollout(model).approach(strikes, targets)

figure, axes = plt.subplots(figsize=(6.4, 5), layout="constrained")
hit = near.distance < 0.15  # [m]
dots = axes.scatter(*near.tip[hit].T, c=near.speed[hit], s=10, vmin=0)
figure.colorbar(dots, label="speed of the tip at its closest approach [m/s]")
axes.set(
    xlabel="x [m]", ylabel="y [m]", aspect="equal", title=f"{hit.sum():,} of {len(strikes):,} random strikes come near"
)
