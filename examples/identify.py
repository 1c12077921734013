"""
A whip from its film
====================

Four strikes of a whip that is stiffer and less damped than the model are filmed with an error of 3 mm. The
fit finds stiffness and damping, and predicts a strike that it has not seen. The mass is known from a balance:
of mass, stiffness and damping a film shows the ratios alone.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

guess, controller, rng = wt.preset("lemon2024"), wt.Controller(), np.random.default_rng(1)
real = guess.with_parameters({"whip.k": 0.6, "whip.b": 0.04})
films = []
for vector in wt.default_bounds(guess.arm).sample(rng, 5):
    strike = wt.Strike.from_vector(vector)
    t, paths, _ = wt.CompiledRollout(real, controller).tip_path(strike, rate=90.0)
    tip = paths[0] + 0.003 * rng.standard_normal(paths[0].shape)  # (T, 2) [m]
    films.append(wt.StrikeRecording(t, tip[:, None], ("tip",), sigma=0.003, strike=strike, controller=controller))
fit = wt.fit(films[:4], wt.Plant(guess, controller), ["k", "b"])
print(fit)

figure, axes = plt.subplots(figsize=(6.4, 5), layout="constrained")
for name, model in {"guess": guess, "fit": fit.model}.items():
    axes.plot(
        *wt.CompiledRollout(model, controller).trajectory(films[4].strike).tip.T, label=f"predicted by the {name}"
    )
axes.plot(*films[4].points[:, 0].T, "k.", ms=3, label="filmed, not fitted")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="A held-out strike")
axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
