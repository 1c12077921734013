"""The hand's poses from a rigid body of motion capture: `hand = "NAME"` in the sidecar names the body.

Places and rotations are turned by the same `units`, `axes`, `up` and `origin` as the markers, and have the same clock.
Where the markers' y is up, markers and poses are turned to the axes of a model in space, whose z is up. The body's axes
are those that the program gave it; `hand_axes` and `hand_offset` say how it holds the whip, as for a robot's log.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import TURNED


def body_named(side: Sidecar, turns: Mapping[str, np.ndarray]) -> str | None:
    """Return the label of the body that the key `hand` names; None: it is missing, or names a file. `turns` are
    quaternions (x, y, z, w) of the file's rigid bodies, (T, 4), by label; (T, 0) where it has none."""
    name = side.values.get("hand")
    if not isinstance(name, str) or not turns:
        return None
    found = [x for x in turns if x == name] or [x for x in turns if x.rpartition(":")[2] == name]
    if len(found) != 1:
        if not found and (side.folder / name).exists():
            return None
        raise side.refuse("hand", f"one of the rigid bodies {', '.join(turns)}, or a file next to it"[:300])
    if not turns[found[0]].shape[1]:
        fix = "export it with Rotation: Quaternion"
        raise side.refuse("hand", "a rigid body whose rotation is a quaternion X, Y, Z, W", fix)
    return found[0]


def with_poses(
    side: Sidecar,
    read: Mapping[str, Any],
    body: tuple[np.ndarray, np.ndarray],
    units: str,
    axes: tuple[str, str, str] | None,
) -> tuple[Sidecar, dict[str, Any], list[str]]:
    """Return the sidecar without the keys that were used, the recording's arguments with the hand's poses added, and
    sentences on them.

    `read` has `t` (T,), `points` (T, M, 3) [m] and `up`. The body has places (T, 3) in the file's units and axes, and
    quaternions (T, 4), 0 or NaN where missing.
    """
    from scipy.spatial.transform import Rotation

    name, (places, turns) = side.table["hand"], body
    seen = np.isfinite(places).all(axis=1) & np.isfinite(turns).all(axis=1) & places.any(axis=1) & turns.any(axis=1)
    if seen.sum() < 2:
        raise side.refuse("hand", "a rigid body that was seen in at least two frames")
    turn = side.metres(np.vstack([np.eye(3), np.zeros(3)]), units, axes)
    turn = (turn[:3] - turn[3]).T
    if turn.shape != (3, 3) or not np.linalg.det(turn) > 0:
        raise side.refuse("axes", "three axes, right-handed, with a rigid body as the hand")
    turn = turn / np.linalg.norm(turn, axis=0)
    points, placed = read["points"], side.metres(places[seen], units, axes)
    up = side.table.get("up", read["up"])
    if up == "y":
        upright = np.array(TURNED["z"], float)
        points, placed, turn, up = points @ upright.T, placed @ upright.T, upright @ turn, "z"
    quaternions = (Rotation.from_matrix(turn) * Rotation.from_quat(turns[seen])).as_quat()
    poses, said = side.held(np.hstack([placed, quaternions]))
    said = [f"hand: the rigid body {name}, in {int(seen.sum())} of {len(places)} frames", *said]
    poses = {"hand_t": read["t"][seen], "hand_pose": poses}
    return side.changed(hand=None, up=None), {**read, "points": points, "up": up, **poses}, said
