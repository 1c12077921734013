"""Nah's measure of a miss: whichever of the whip's last nodes comes nearest, until a fixed instant."""

from __future__ import annotations

import numpy as np

from whiptool import CompiledRollout, Trajectory
from whiptool.models.strike import T_STAY, AnyStrike
from whiptool.models.trajectory import Approach, Points
from whiptool.rollout.interface import Rollout, Strikes


class LastNodes(Rollout):
    """Rolls strikes out, and takes for the tip whichever of the last nodes comes nearest to the target.

    Args:
        rollout: What rolls them out.
        count: Number of nodes, the tip included.
        until: Instant after the movement's beginning at which a strike ends, whatever its duration is [s].
    """

    def __init__(self, rollout: CompiledRollout, count: int, until: float) -> None:
        self.model, self.engine, self.timestep = rollout.model, rollout.engine, rollout.timestep
        self.rollout, self.count, self.until = rollout, count, until

    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Return the whole of one strike until the fixed instant; `t_stay` says nothing here."""
        vector = self.one_vector(strike)
        return self.rollout.trajectory(vector, t_stay=self.until - float(vector[-1]))

    def approach(self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY) -> Approach:
        """Return the closest approaches of the nearest of the nodes; `t_stay` says nothing here."""
        vectors = self.vectors(strikes)
        N = self.model.whip.N
        stay = self.until - vectors[:, -1]
        return self.rollout.nearest_node(vectors, target, nodes=range(N - self.count, N), t_stay=stay)
