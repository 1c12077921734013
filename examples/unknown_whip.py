"""
A whip that was never measured
==============================

Only the arm is known. The hanging whip is filmed, then it strikes; from each film the belief about the whip
narrows, and the next strike is the one with the largest probability of a hit, within 2 cm and at 8 m/s or
more. The simulated whip is drawn at random: it is tapered, has a bead, a soft joint and uneven friction.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt

import whiptool as wt

model, target = wt.preset("lemon2024"), wt.Target((1.15, 0.05), hit_radius=0.02, speed=8.0)
controller = wt.Controller(wt.oiac_preset("table4")).reckoning_with(model)
port = wt.TipPort(wt.draw_twin("strange", 1, model, controller), target)
steps = wt.Adaptation(wt.default_prior(model, controller), port, target).run()

figure, axes = plt.subplots(figsize=(6.4, 5), layout="constrained")
for step in steps.strikes:
    said = f"{100 * step.judged.miss:.1f} cm" + (", a hit" if step.hit else "")
    axes.plot(*step.outcome.recording.points[:, 0].T, ".-", label=f"strike {step.number}: {said}")
axes.add_patch(plt.Circle(target.position, target.hit_radius, fill=False, lw=2))
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="The tip as it was filmed")
axes.legend()
