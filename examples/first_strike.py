"""
A first strike
==============

Where does the arm have to start and end, and how long may it take, so that the tip of the whip meets a point?
DIRECT-L divides the box of strikes and stops at the first hit. The picture shows arm and whip at equal
intervals, and the path of the tip by its speed.

*Needs:* whiptool as it is installed.
"""

import whiptool as wt

model, target = wt.preset("lemon2024"), wt.Target((1.2, 0.1))  # x forward, y up [m]
rollout = wt.CompiledRollout(model)
result = wt.search(rollout, target, "directl")
print(result.strike, f"misses by {result.miss_distance:.3f} m after {result.n_trials} trials")

wt.plot_strike(rollout.trajectory(result.strike), model, target)
