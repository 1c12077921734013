"""
Why a whip is thinner at its tip
================================

The same movement with whips whose tip is as thick as the handle, and down to a fifth of it. Mass, stiffness
and damping go with the thickness; a thin end is moved by all the momentum of the thick one.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt

import whiptool as wt

model, strike = wt.preset("lemon2024"), wt.Strike((-1.36, 0.47), (1.73, 1.41), 0.6)
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
for taper in (1.0, 0.7, 0.4, 0.2):
    swing = wt.CompiledRollout(model.with_whip(taper=taper)).trajectory(strike)
    axes.plot(swing.t, swing.tip_speed, label=f"{taper:.1f}: at most {swing.tip_speed.max():.1f} m/s")
axes.set(xlabel="t [s]", ylabel="speed of the tip [m/s]")
axes.legend(title="thickness at the tip over that at the handle")
