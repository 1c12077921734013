"""
Two simulators of one strike
============================

The compiled rollout and MuJoCo share the parameters of arm, whip and controller, but no formula. Where their
tips differ by a fraction of a millimetre, neither has a mistake that the other has not.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt
import numpy as np

import whiptool as wt

model, controller = wt.preset("lemon2024"), wt.Controller()
strike = wt.Strike((-1.36, 1.41), (1.73, 1.41), 0.95)  # q_i, q_f [rad], D [s]
compiled = wt.CompiledRollout(model, controller).trajectory(strike)
mujoco = wt.ReferenceRollout(model, controller).trajectory(strike)
there = np.stack([np.interp(compiled.t, mujoco.t, axis) for axis in mujoco.tip.T], axis=1)
apart = np.linalg.norm(compiled.tip - there, axis=1)
print(f"the tips are at most {1e3 * apart.max():.2f} mm apart")

figure, (path, difference) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
path.plot(*compiled.tip.T, label="compiled")
path.plot(*mujoco.tip.T, "--", label="MuJoCo")
path.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="Path of the tip")
path.legend()
difference.plot(compiled.t, 1e3 * apart)
difference.set(xlabel="t [s]", ylabel="distance of the two tips [mm]", title="Difference")
