"""
A robot in space
================

A UR5e swings a rope. The strike is looked up in the map that comes with the package, and refined until the
miss is below a tenth of a millimetre; it keeps the limits of the robot's joints, and arm, rope and floor do
not touch.

*Needs:* whiptool as it is installed.
"""

import numpy as np

import whiptool as wt

model, target = wt.preset("ur5e"), wt.Target.arriving((1.2, 0.3, 0.5), np.radians(60))  # x forward, y to the left, z up
strike = wt.load_map("ur5e").strike(target)
swing = wt.CompiledRollout(model).trajectory(strike)
print(swing.approach(target))

wt.plot_strike(swing, model, target)
