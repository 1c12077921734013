"""Strikes rolled out once: a whip does not know about its target, so that the same paths serve every target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree  # pyrefly: ignore[missing-module-attribute]  # compiled

from whiptool.errors import InputError
from whiptool.limits.motor_limits import MotorLimits
from whiptool.models.parameters import number
from whiptool.models.strike import T_STAY, StrikeBounds, default_bounds
from whiptool.rollout.compiled import CompiledRollout

RATE = 250.0  # [1/s] of the points that are kept
SPEED = 2.0  # [m/s] below which the tip does not strike


@dataclass(frozen=True, eq=False)
class Library:
    """Where the tip comes, when, and how fast, over many strikes.

    Args:
        rollout: Rollout of the whip.
        strikes: (B, 2 a + 1).
        box: Lower and upper bounds of the strikes, (2 a + 1,) each.
        free: Coordinates of a strike that may be chosen, (2 a + 1,).
        limits: Limits of the motors, if any.
        t_stay: A strike is watched so long after the movement ended [s].
        speed: Speed of the tip, at least, where it is to hit [m/s].
        owner: Strike of each of the N points, (N,).
        tau: When the tip is there, from the strike's start [s], (N,).
        points, velocities: Points and velocities of the tip [m], [m/s], (N, 2).
        tree: Tree of the points.
    """

    rollout: CompiledRollout
    strikes: np.ndarray
    box: tuple[np.ndarray, np.ndarray]
    free: np.ndarray
    limits: MotorLimits | None
    t_stay: float
    speed: float
    owner: np.ndarray
    tau: np.ndarray
    points: np.ndarray
    velocities: np.ndarray
    tree: cKDTree

    @classmethod
    def build(
        cls,
        rollout: CompiledRollout,
        *,
        size: int = 2000,
        seed: int = 0,
        q_i: tuple[float, ...] | None = None,
        bounds: StrikeBounds | None = None,
        limits: MotorLimits | None = None,
        t_stay: float = T_STAY,
        speed: float = SPEED,
    ) -> Library:
        """Roll out random strikes.

        Args:
            rollout: Rollout of the whip.
            size: How many strikes.
            seed: Seed of the strikes.
            q_i: Posture in which the arm waits [rad] and all strikes begin. Default: wherever the strike wants to
                begin, and the arm has to be there, the whip at rest, when it starts.
            bounds: Box of strikes; default: `default_bounds`.
            limits: Limits of the motors; strikes beyond them are left out.
            t_stay, speed: As above.

        Raises:
            InputError: A number is out of range, `q_i` is beyond the bounds, the motors can do none of the strikes, or
                their tips are all slower than `speed`.
        """
        arm = rollout.model.arm
        number("size", size, low=1)
        number("speed", speed, low=0)
        box = (bounds or default_bounds(arm)).box
        strikes = np.random.default_rng(seed).uniform(*box, (int(size), len(box[0])))
        free = np.ones(len(box[0]), bool)
        if q_i is not None:
            if len(q_i) != arm.n:
                raise InputError("q_i", q_i, f"{arm.n} angles, one per joint")
            ends = list(zip(box[0][: arm.n], box[1][: arm.n], strict=True))
            if not all(low <= x <= high for x, (low, high) in zip(q_i, ends, strict=True)):
                allowed = ", ".join(f"{low:.3g} to {high:.3g}" for low, high in ends)
                raise InputError("q_i", q_i, f"angles within the bounds, {allowed} rad", "give other bounds")
            strikes[:, : arm.n], free[: arm.n] = q_i, False
        strikes = strikes[possible(rollout, strikes, limits, t_stay)]
        if not len(strikes):
            raise InputError("limits", limits and limits.name, "a motor that some strike fits", "slow them: raise D")
        t, path, _ = rollout.tip_path(strikes, t_stay=t_stay, rate=RATE)
        velocity = np.gradient(path, 1 / RATE, axis=1)
        fast = np.hypot(velocity[..., 0], velocity[..., 1])
        with np.errstate(invalid="ignore"):
            owner, at = np.nonzero(fast >= speed)  # NaN does not pass
        if not len(owner):
            raise InputError("speed", speed, f"at most {np.nanmax(fast):.3g} m/s, the fastest tip of these strikes")
        points = path[owner, at]
        return cls(
            rollout,
            strikes,
            box,
            free,
            limits,
            t_stay,
            speed,
            owner,
            t[at],
            points,
            velocity[owner, at],
            cKDTree(points),
        )

    def possible(self, strikes: np.ndarray) -> np.ndarray:
        """Whether the motors can do it and it does not diverge, (B,)."""
        return possible(self.rollout, strikes, self.limits, self.t_stay)


def possible(rollout: CompiledRollout, strikes: np.ndarray, limits: MotorLimits | None, t_stay: float) -> np.ndarray:
    """Whether strikes stay within a motor's limits and do not diverge, (B,)."""
    near = rollout.approach(strikes, np.zeros(2), t_stay=t_stay)
    return ~near.diverged if limits is None else limits.violation_of_peaks(near) <= 0
