"""A strike of a rig that is followed by its log of cycles: the measured joints, and the simulated twin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.following.followed import Followed
from whiptool.following.run_view import Chart, Chosen, Curve, Measured, RunView, ShownMotion
from whiptool.goals.target import Target
from whiptool.models.strike import Strike
from whiptool.rig.cyclelog import Cycles, Phase
from whiptool.rig.session import CYCLES
from whiptool.rollout.interface import Rollout

_WORDS = {Phase.APPROACH: "moves to the start", Phase.SETTLE: "waits until the whip hangs", Phase.STRIKE: "strikes",
          Phase.RETURN: "goes back"}  # fmt: skip


class FollowedStrike(Followed):
    """A run of `rig strike`.

    Args:
        folder, heading: As for `Followed`.
        rollout: Simulator of the twin: the model and controller of the rig.
        strike: The strike.
        target: Its target.
        t_stay: Time after the strike's end for which it is watched [s].
    """

    every = 0.05

    def __init__(
        self, folder: Path, heading: str, rollout: Rollout, strike: Strike, target: Target, *, t_stay: float
    ) -> None:
        super().__init__(folder, heading)
        self._rollout, self._strike, self._target, self._t_stay = rollout, strike, target, t_stay
        self._cycles: Cycles | None = None

    def _read(self) -> bool:
        path, before = self.folder / CYCLES, 0 if self._cycles is None else len(self._cycles)
        try:
            self._cycles = Cycles.load(path)
        except (FileNotFoundError, InputError):  # not yet, or not yet its first line
            return False
        return len(self._cycles) > before

    def _view(self, finished: bool) -> RunView:
        chosen = Chosen(1, "the strike as it is measured, coloured, and its simulated twin", self._twin)
        if self._cycles is None or not len(self._cycles):
            return RunView(self.heading, finished, {"phase": "not begun"}, (), chosen=chosen)
        cycles, phase = self._cycles, Phase(int(self._cycles.phase[-1]))
        known = np.isfinite(cycles.q).all(axis=1)
        struck = cycles.phase == Phase.STRIKE
        zero = float(cycles.t[struck][0]) if struck.any() else float(cycles.t[-1])
        measured = Measured(cycles.t[known] - zero, cycles.q[known])
        facts = {"phase": _WORDS[phase], "cycles": str(len(cycles)), "missed": str(int((~known).sum()))}
        return RunView(self.heading, finished, facts, self._charts(), chosen=chosen, measured=measured)

    @property
    def _twin(self) -> tuple[float, ...]:
        return tuple(self._strike.vector.tolist())

    def _charts(self) -> tuple[Chart, ...]:
        """How far the joints are from where they should be, and the currents of their motors, over time."""
        assert self._cycles is not None
        c, joints = self._cycles, self._rollout.model.arm.joints
        errors = tuple(Curve(name, c.t, np.degrees(c.q[:, i] - c.q_d[:, i])) for i, name in enumerate(joints))
        currents = tuple(Curve(name, c.t, c.current[:, i]) for i, name in enumerate(joints))
        return Chart("joint minus command", "time [s]", "deg", errors), Chart("current", "time [s]", "A", currents)

    def motion(self, chosen: Chosen) -> ShownMotion:
        trajectory = self._rollout.trajectory(self._strike, t_stay=self._t_stay)
        return ShownMotion(self._rollout.model, trajectory, self._target)
