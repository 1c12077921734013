"""A simulator that keeps its last trajectories."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import Any

import numpy as np

from whiptool.models.strike import T_STAY
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.interface import Strikes

KEPT = 4  # trajectories


class RememberingRollout(CompiledRollout):
    """Simulates as `CompiledRollout`, whose arguments it takes, and keeps the trajectories of the last single strikes:
    the limits of a strike ask for the trajectory that is then shown.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._kept: OrderedDict[tuple[bytes, float], Trajectory] = OrderedDict()

    def trajectories(self, strikes: Strikes, *, t_stay: float = T_STAY) -> Iterator[Trajectory]:
        """Yield the whole trajectories of many strikes; that of a single one is computed once."""
        vectors = self.vectors(strikes)
        if len(vectors) != 1:
            yield from super().trajectories(vectors, t_stay=t_stay)
            return
        key = np.ascontiguousarray(vectors).tobytes(), float(t_stay)
        if key not in self._kept:
            self._kept[key] = next(super().trajectories(vectors, t_stay=t_stay))
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        yield self._kept[key]
