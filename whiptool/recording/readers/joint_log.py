"""Logs of a robot's joints: CSV with a column of times, then one per joint, at the robot's own rate.

The time is the first column. Where some columns are called `position_JOINT`, as in the trajectories that whiptool
exports, they are the joints', by name, and all others (velocities, torques) are left aside; else every other column is
a joint, in the arm's order. The key `joint_columns` of a sidecar says which columns are the arm's joints, in its order.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.readers.table import read_columns

POSITION = "position_"


def read_joint_log(path: Path, columns: Sequence[str] | None = None) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Read a log of S samples of a joints.

    Args:
        path: The file.
        columns: Which of its columns are the arm's joints, in the arm's order; None: as they are called.

    Returns:
        Times [s], (S,); joint positions as they stand there, (S, a); the joints' names, (a,), empty where only their
        order says which is which.

    Raises:
        InputError: It is no such file, has no joints, or a column is missing.
    """
    names, table = read_columns(path)
    if columns is not None:
        for name in columns:
            if name not in names[1:]:
                raise InputError(f"{path}: column", name, "one of " + ", ".join(names[1:])[:300])
        chosen, joints = list(columns), ()
    else:
        chosen = [name for name in names[1:] if name.startswith(POSITION)]
        joints = tuple(name.removeprefix(POSITION) for name in chosen)
        chosen = chosen or names[1:]
    if not chosen:
        raise InputError(str(path), "one column", "t [s] and one column per joint [rad]")
    return table[:, 0], table[:, [names.index(name) for name in chosen]], joints
