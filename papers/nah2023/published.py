"""What Nah et al. published: targets, evaluations, best strikes, and distances from their log files.

Nah, Krotov, Russo, Sternad, Hogan 2023, "Learning to manipulate a whip with simple primitive actions - A simulation
study", iScience 26(8), 107395, doi:10.1016/j.isci.2023.107395. Their code and logs: github.com/mosesnah-shared/
whip-project-targeting.
"""

from __future__ import annotations

import numpy as np

TARGETS = (  # [m]; 1 to 3 lie within reach, 4 to 6 at exactly full reach
    (1.995, 0.0, 0.0),
    (1.4107, 1.4107, 0.0),
    (0.9975, 0.9975, 1.410),
    (2.385, 0.0, 0.0),
    (1.68644, 1.68644, 0.0),
    (1.1925, 1.1925, 1.68644),
)
WITHIN_REACH = 3  # of them

EVALUATIONS = (40, 78, 39, 170, 249, 600)  # to the first hit; the last is their cap, without a hit
BEST = (None, None, None, None, None, 0.1018)  # [m], where there was none
CAP = 600
HIT_RADIUS = 0.05  # [m]
LAST_NODES = 15  # any of which hits
UNTIL = 2.9  # [s] after the movement began: they run 3 s, and begin to move at 0.1 s

STRIKES = (
    np.array(  # the best that they found, in the order of a strike's vector: perturbed in their robustness analysis
        [
            [-1.3614, 0.0, -0.3491, 1.4137, 1.7279, 0.0, 0.0, 1.4137, 0.9500],
            [-0.9425, 0.0, -1.0472, 1.4137, 1.7279, -1.0472, 0.0, 0.4712, 0.9500],
            [-0.9425, 1.0472, 0.0, 1.4137, 1.7279, -1.0472, 0.0, 1.4137, 0.5833],
            [-1.5475, 0.0, -0.3491, 1.4137, 1.7279, 0.0, 0.0, 0.3665, 0.9500],
            [-1.0821, 1.0472, 1.0472, 0.8203, 1.7279, -1.0472, 1.3963, 0.1571, 0.9500],
            [-0.9425, 1.0601, 0.3491, 0.9948, 1.7395, -0.9696, -0.2715, 0.9483, 0.5245],
        ]
    )
)
PERTURBED = 200  # strikes around each of them, as theirs
NOISE = 0.05  # of the bounds' width to either side, uniform

# Distances that their logs of 2021 give for DIRECT-L's first 19 strikes, the middle of the box and a third of it to
# either side along each axis, at four targets (optimization_log_T4_longer, T5_longer, T6_longer, T2). At that time the
# last 6 nodes counted at targets within reach (and 0.1 m were added), the tip alone at those beyond, which lay 1 cm
# farther away.
LOGGED_TARGETS = ((1.995, 0.0, 0.0), (1.4107, 1.4107, 0.0), (0.9975, 0.9975, 1.410), (1.69352, 1.69352, 0.0))
LOGGED_NODES = (6, 6, 6, 1)
LOGGED_OFFSET = (0.1, 0.1, 0.1, 0.0)  # [m]
LOGGED = np.array(
    [
        [0.86848, 0.23228, 1.58429, 1.44138, 1.47128, 0.62977, 0.67683, 0.43691, 1.72721, 1.71185, 0.91255, 0.77965,
         1.19552, 1.46811, 1.51666, 0.93983, 1.52537, 0.89838, 1.19308],
        [1.59745, 1.26359, 1.92812, 1.92745, 1.57949, 1.17549, 1.75745, 1.39848, 2.00545, 2.01571, 1.49640, 1.01683,
         1.98793, 2.15542, 1.41114, 1.51327, 1.81810, 1.17110, 1.74303],
        [2.27815, 1.75575, 2.55879, 2.49917, 2.50010, 2.03218, 2.22304, 1.11073, 2.64186, 2.99514, 1.06072, 1.94087,
         2.38831, 2.67575, 2.50166, 2.41235, 2.52701, 0.97995, 2.55280],
        [1.78897, 1.49181, 2.12128, 2.26711, 1.76381, 1.36110, 1.96382, 1.67150, 2.19653, 2.16310, 1.78054, 1.17552,
         2.36663, 2.39904, 1.59436, 1.67135, 2.02508, 1.23859, 1.92380],
    ]
)  # fmt: skip
