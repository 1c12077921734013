"""
One strike under three laws of impedance
========================================

The same movement is asked of the arm by online impedance adaptation control, as fitted to Table 4 of the
paper and as printed, and by constant impedance (Eq. 22). The softer the arm, the later it comes, and the more
the whip moves it.

*Needs:* whiptool as it is installed.
"""

import matplotlib.pyplot as plt

import whiptool as wt

model, strike = wt.preset("lemon2024"), wt.Strike((-1.36, 1.41), (1.73, 1.41), 0.95)
laws = {
    "OIAC, fitted to Table 4": wt.oiac_preset("table4"),
    "OIAC, as printed": wt.oiac_preset("printed"),
    "constant": wt.ConstantImpedance(),
}
figure, (path, error) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
for name, law in laws.items():
    swing = wt.CompiledRollout(model, wt.Controller(law)).trajectory(strike)
    path.plot(*swing.tip.T, label=name)
    error.plot(swing.t, swing.tracking_error[:, 0], label=name)
path.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="Path of the tip")
error.set(xlabel="t [s]", ylabel="error of the shoulder [rad]", title="Behind the reference")
error.legend()
