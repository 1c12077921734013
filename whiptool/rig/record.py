"""Recording of a strike from the cycles of its run, for identification."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, Strike
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.cyclelog import Cycles, Phase

ENCODER = 2 * np.pi / 4096 / np.sqrt(12)  # [rad], standard error of an angle read to one count


def build_recording(
    cycles: Cycles,
    model: Model,
    *,
    track: StrikeRecording | None = None,
    controller: dict | None = None,
    target: Sequence[float] | None = None,
    t_stay: float = T_STAY,
    source: str = "rig",
) -> StrikeRecording:
    """Return the recording of a strike: joints from the servos, markers from a camera.

    Time 0 is the first cycle of the strike, by the loop's clock.

    Args:
        cycles: Cycles of the run, all phases.
        model: Model, for the lengths of the arm's links.
        track: Recording of a camera, with times relative to the strike's first cycle. None: the only markers are the
            arm's joints and the handle, computed from the encoders.
        controller: The controller as a table.
        target: Position of the target [m].
        t_stay: Time after the movement, as in the loop [s].
        source: Name of the source.

    Raises:
        InputError: The run ended before its strike.
    """
    during = cycles.during(Phase.STRIKE)
    seen = np.isfinite(during.q).all(axis=1)
    if seen.sum() < 2:
        raise InputError("run", f"{len(cycles)} cycles", "one that reached its strike")
    t = during.stamp[seen] - during.stamp[seen][0] + during.t[seen][0] - during.t[0]
    q = during.q[seen]
    joints: dict[str, Any] = {
        "strike": Strike.from_vector(cycles.about["strike"]) if "strike" in cycles.about else None,
        "controller": controller,
        "joints_t": t,
        "joints_q": q,
        "target": None if target is None else tuple(float(x) for x in target),
        "t_stay": t_stay,
        "source": source,
    }
    if track is not None:
        return dataclasses.replace(track, **joints)
    a = model.arm.n
    whole = np.zeros((len(q), model.n))
    whole[:, :a] = q
    points = joint_points(model, whole)[:, 1 : a + 1]  # behind the shoulder: (S, a, 2)
    markers = (*model.arm.joints[1:], "handle")
    reach = np.cumsum(model.arm.per_link("length"))
    return StrikeRecording(t=t, points=points, markers=markers, sigma=reach * ENCODER, camera="encoders", **joints)
