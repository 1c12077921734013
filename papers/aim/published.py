"""The robot of aimed strikes, a UR5e with a stick of 0.65 m and a rope of 1 m in 20 rods; and what others publish."""

from __future__ import annotations

from whiptool import default_controller, preset

MODEL = preset("ur5e")
CONTROLLER = default_controller(MODEL)

GOALS = 5700  # of "Point It, Strike It" (2026), in simulation
ONE_SHOT = 0.735  # share of them within 5 cm and 10 degrees at the first strike
BEST_OF_64 = 0.921  # with the best of 64 strikes that their network proposes
SAC_FIRST_HITS, SAC_TRIALS = 0.22, 25.9  # of SAC with hindsight at the planar hard task: `whiptool.reproduce hard`
