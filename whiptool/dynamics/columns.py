"""Which columns of an array hold what: one object for Python and for the compiled code."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


class Columns(dict[str, slice]):
    """Positions of named blocks in the columns of an array, as slices by name.

    Args:
        sizes: Number of columns of each block, in order.
    """

    def __init__(self, sizes: Mapping[str, int]) -> None:
        ends = np.cumsum(list(sizes.values()))
        super().__init__({name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends)})

    @property
    def width(self) -> int:
        """Number of all columns."""
        return max((block.stop for block in self.values()), default=0)

    def constants(self, name: str) -> dict[str, int]:
        """Return the width as `NAME`, and each block's first column as `NAME_block`, for compiled code."""
        return {name: self.width} | {f"{name}_{block}": columns.start for block, columns in self.items()}


def outcome_columns(a: int, dimension: int) -> Columns:
    """Return the columns of a strike's outcome in the compiled code, for `a` driven joints, in the plane or in space.

    They are the miss distance, its time, the tip's velocity and position then, whether the simulation diverged, its
    last step, the derivatives of the miss distance and of the tip's position and velocity, and for each driven joint
    the largest speed and torque, the lowest and highest position, the effort (the integral of the squared torque by the
    trapezoidal rule), and the derivatives of effort and largest torque.
    """
    sizes = {
        "distance": 1,
        "time": 1,
        "velocity": dimension,
        "tip": dimension,
        "diverged": 1,
        "last_step": 1,
        "slope": 1,
        "tip_slope": dimension,
        "velocity_slope": dimension,
    }
    of_joints = ("max_joint_speed", "max_torque", "lowest", "highest", "effort", "effort_slope", "max_torque_slope")
    return Columns(sizes | dict.fromkeys(of_joints, a))


def row_columns(n: int, a: int, dimension: int) -> Columns:
    """Return the columns of one sample of a trajectory: time, state of n joints, torques of `a` driven joints, tip
    position and velocity.
    """
    return Columns({"t": 1, "x": 2 * n, "tau": a, "tip": dimension, "velocity": dimension})
